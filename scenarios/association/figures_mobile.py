"""Figures of mobile association over time: Ivanov & Shell 2016, Figs. 10-17.

Deep observers of whole worlds by the vectorised simulation; and, for one value of each parameter, robot
processes on the emulator in a small world, beside the simulation of the same small world.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec
from matplotlib.figure import Figure as Canvas
from msgspec import Struct

from scenarios.association.emulated import EMULATED
from scenarios.association.study_mobile import SERIES, MobileParameters
from scenarios.figures import Cell, Figure, Run, Table

WORLDS = 10
"""Independent worlds a point."""
SMALL_WORLDS = 200
EMULATED_RUNS = 3
STEPS_SHOWN = 80

FRACTION_MATCHED, RATIO = "fraction_matched", "ratio"
LABELS = {FRACTION_MATCHED: "fraction matched", RATIO: "ratio of total to true edges"}


class Sweep(Struct, frozen=True):
    """One parameter of the world, the values it takes, and the value that the emulator checks."""

    key: str
    label: str
    values: Mapping[float, str]
    """Values, and what the figure calls them."""
    emulated: float
    small_world: float
    """Side of the emulator's world, in diameters."""

    def parameters(self, value: float) -> MobileParameters:
        """The default world but for this value."""
        changed: MobileParameters = msgspec.structs.replace(MobileParameters(), **{self.key: value})
        return changed

    def small(self) -> MobileParameters:
        """The emulator's world."""
        return msgspec.structs.replace(self.parameters(self.emulated), world=self.small_world)


MIX = Sweep("mobile_fraction", "part of the robots that is mobile",
            {0.1: "10 %", 0.5: "50 %", 0.9: "90 %"}, emulated=0.5, small_world=48.0)  # fmt: skip
RANGE = Sweep("range", "range [diameters]", {10.0: "10", 16.0: "16", 22.0: "22"}, emulated=10.0,
              small_world=64.0)  # fmt: skip
# The text's separations; its numbers of robots in range (14, 27, 74) belong to other ones.
SEPARATION = Sweep("separation", "mean separation [diameters]",
                   {8.0: "8 (12.6 in range)", 5.0: "5 (32.2 in range)", 3.2: "3.2 (78.5 in range)"},
                   emulated=5.0, small_world=65.0)  # fmt: skip
# 1/20 of the range is 0.8 diameters a step, and not the 1.25 that the text also gives: both.
SPEED = Sweep("speed", "speed [diameters per step]",
              {2.0: "2 (1/8 range)", 1.4: "1.4 (1/11 range)", 1.25: "1.25", 0.8: "0.8 (1/20 range)"},
              emulated=2.0, small_world=64.0)  # fmt: skip


def over_time(sweep: Sweep, metric: str) -> Figure:
    """One metric, step by step, for the values of one parameter."""
    title = f"{LABELS[metric].capitalize()} over time by {sweep.label.partition(' [')[0]}"
    return Figure(title, _runs(sweep), _tabulate(sweep, metric), _draw(sweep, metric))


def _runs(sweep: Sweep) -> Callable[[], list[Run]]:
    def runs() -> list[Run]:
        return [
            *(Run(SERIES, sweep.parameters(value), WORLDS) for value in sweep.values),
            Run(SERIES, sweep.small(), SMALL_WORLDS),
            Run(EMULATED, sweep.small(), EMULATED_RUNS, limited=True),
        ]

    return runs


def _tabulate(sweep: Sweep, metric: str) -> Callable[[list[dict[str, Any]]], Table]:
    def tabulate(results: list[dict[str, Any]]) -> Table:
        *simulated, small, emulated = results
        rows: list[tuple[Cell, ...]] = []
        for value, result in zip(sweep.values, simulated, strict=True):
            rows += _series(value, result["series"]["deep"][metric])
            rows.append(_steady("simulated steady state", value, result["deep"][metric]))
        rows.append(_steady("simulated small world", sweep.emulated, small["all"][metric]))
        rows.append(_steady("emulated small world", sweep.emulated, emulated[metric]))
        return Table(("kind", sweep.key, "step", metric, "se", "sd"), rows)

    return tabulate


def _series(value: float, series: Mapping[str, Sequence[float | None]]) -> list[tuple[Cell, ...]]:
    steps = zip(series["mean"], series["se"], series["sd"], strict=True)
    return [
        ("simulated", value, step, mean, error, deviation)
        for step, (mean, error, deviation) in enumerate(steps)
        if step <= STEPS_SHOWN and mean is not None
    ]


def _steady(kind: str, value: float, moment: Mapping[str, float | None]) -> tuple[Cell, ...]:
    return (kind, value, None, moment["mean"], moment["se"], moment.get("sd"))


def _draw(sweep: Sweep, metric: str) -> Callable[[Table, Canvas], None]:
    def draw(table: Table, canvas: Canvas) -> None:
        axes = canvas.subplots()
        for number, (value, name) in enumerate(sweep.values.items()):
            part = table.where(kind="simulated", **{sweep.key: value})
            axes.plot(part.column("step"), part.column(metric), color=f"C{number}", label=name)
            if value == sweep.emulated:
                _draw_small_world(axes, table, metric, f"C{number}")
        axes.set(xlabel="step", ylabel=LABELS[metric], xlim=(0, STEPS_SHOWN + 8))
        axes.legend(title=sweep.label, fontsize=8)

    return draw


def _draw_small_world(axes: Any, table: Table, metric: str, colour: str) -> None:
    """The emulator's robots and the simulation of the same world, each with four standard errors."""
    kinds = {"simulated small world": ("s", 2.0), "emulated small world": ("D", 5.0)}
    for kind, (marker, place) in kinds.items():
        part = table.where(kind=kind)
        errors = [4 * (error or 0.0) for error in part.column("se")]
        axes.errorbar(
            [STEPS_SHOWN + place],
            part.column(metric),
            yerr=errors,
            fmt=marker,
            color=colour,
            markerfacecolor="white",
            markersize=5,
            capsize=2,
            label=f"{kind}, all observers",
        )
