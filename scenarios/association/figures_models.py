"""Figures of mobile association in the steady state beside the models: Ivanov & Shell 2016, Figs. 20-25."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Canvas
from msgspec import Struct

from scenarios.association.figures_mobile import (
    FRACTION_MATCHED,
    LABELS,
    RANGE,
    RATIO,
    SEPARATION,
    SPEED,
    WORLDS,
    Sweep,
    draw_small_world,
    small_world,
    small_world_moments,
)
from scenarios.association.mobile_batches import BatchModel, batch_model, new_ids
from scenarios.association.mobile_models import (
    MobileSystem,
    fraction_matched_corrected,
    fraction_matched_literal,
    multi_region_model,
    two_region_model,
)
from scenarios.association.study_mobile import SERIES, MobileParameters
from scenarios.figures import Cell, Figure, Run, Table

MODEL_POINTS = 13


class Axis(Struct, frozen=True):
    """A parameter of the world, and its values in the figure."""

    sweep: Sweep
    """The parameter, and the value that the emulator checks."""
    values: Sequence[float]


BY_RANGE = Axis(RANGE, (8.0, 10.0, 12.0, 14.0, 16.0, 18.0, 20.0, 22.0))
BY_SEPARATION = Axis(SEPARATION, (3.2, 4.0, 5.0, 6.25, 8.0))
BY_SPEED = Axis(SPEED, (0.8, 1.25, 1.4, 1.7, 2.0, 2.5))

# Name of a model, and how its line looks; the first ones as in the paper.
STYLES = {
    FRACTION_MATCHED: {"literal": "r--", "literal, Eq. 10": "r:", "corrected": "m-.", "batches": "k-"},
    RATIO: {
        "two regions": "g:",
        "two regions, corrected": "g-.",
        "many regions": "b--",
        "batches": "k-",
    },
}


def steady_state(axis: Axis, metric: str) -> Figure:
    """One metric against one parameter, simulated and modelled."""
    title = f"{LABELS[metric].capitalize()} by {axis.sweep.label.partition(' [')[0]}, simulation and models"
    return Figure(title, _runs(axis), _tabulate(axis, metric), _draw(axis, metric))


def _runs(axis: Axis) -> Callable[[], list[Run]]:
    return lambda: [
        *(Run(SERIES, axis.sweep.parameters(value), WORLDS) for value in axis.values),
        *small_world(axis.sweep),
    ]


def _tabulate(axis: Axis, metric: str) -> Callable[[list[dict[str, Any]]], Table]:
    def tabulate(results: list[dict[str, Any]]) -> Table:
        rows: list[tuple[Cell, ...]] = []
        *simulated, small, emulated = results
        for value, result in zip(axis.values, simulated, strict=True):
            rows.append(("simulated", value, *_cells(result["deep"][metric]), result["samples"]))
        for kind, moment, samples in small_world_moments(small, emulated, metric):
            rows.append((kind, axis.sweep.emulated, *_cells(moment), samples))
        for value in np.linspace(axis.values[0], axis.values[-1], MODEL_POINTS).tolist():
            modelled = _models(axis.sweep.parameters(value), metric)
            rows += [(name, value, predicted, None, None, None) for name, predicted in modelled.items()]
        return Table(("kind", axis.sweep.key, metric, "se", "sd", "samples"), rows)

    return tabulate


def _cells(moment: Mapping[str, float | None]) -> tuple[Cell, ...]:
    return moment["mean"], moment["se"], moment.get("sd")


def _models(parameters: MobileParameters, metric: str) -> dict[str, float | None]:
    system = MobileSystem(parameters.range, parameters.speed, parameters.separation)
    variance = _listed_variance(system)
    batches = _batches(system, parameters.mobile_fraction)
    if metric == FRACTION_MATCHED:
        return {
            "literal": fraction_matched_literal(system),
            "literal, Eq. 10": fraction_matched_literal(system, variance),
            "corrected": fraction_matched_corrected(system, variance),
            "batches": batches.fraction_matched,
        }
    return {
        "two regions": two_region_model(system, variance, corrected=False).ratio(),
        "two regions, corrected": two_region_model(system, variance, corrected=True).ratio(),
        "many regions": multi_region_model(system, variance).ratio(),
        "batches": batches.ratio,
    }


@cache
def _listed_variance(system: MobileSystem) -> float:
    """Computed once for both metrics' figures."""
    return new_ids(system).listed_variance


@cache
def _batches(system: MobileSystem, mobile_fraction: float) -> BatchModel:
    """Likewise."""
    return batch_model(system, mobile_fraction)


def _draw(axis: Axis, metric: str) -> Callable[[Table, Canvas], None]:
    def draw(table: Table, canvas: Canvas) -> None:
        axes = canvas.subplots()
        simulated = table.where(kind="simulated")
        axes.errorbar(
            simulated.column(axis.sweep.key),
            simulated.numbers(metric),
            yerr=simulated.numbers("sd"),
            fmt="o",
            color="tab:blue",
            markersize=4,
            capsize=3,
            label="simulated, mean and one standard deviation",
        )
        for name, style in STYLES[metric].items():
            part = table.where(kind=name)
            axes.plot(
                part.column(axis.sweep.key),
                part.numbers(metric),
                style,
                linewidth=1.2,
                label=f"model: {name}",
            )
        nudge = 0.006 * (axis.values[-1] - axis.values[0])
        places = (axis.sweep.emulated - nudge, axis.sweep.emulated + nudge)
        draw_small_world(axes, table, metric, places, "tab:orange")
        axes.set(xlabel=axis.sweep.label, ylabel=LABELS[metric])
        axes.legend(fontsize=8)

    return draw
