"""Figures of mobile association over time: Ivanov & Shell 2016, Figs. 10-17.

Deep observers of whole worlds by the vectorised simulation; and, for one value of each parameter, robot
processes on the emulator in a small world, beside the simulation of the same small world.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter
from msgspec import Struct

from scenarios.association.emulated import EMULATED
from scenarios.association.study_mobile import SERIES, MobileParameters
from scenarios.figures import Cell, Figure, Run, Table

WORLDS = 10
"""Independent worlds a point."""
SMALL_WORLDS = 200
EMULATED_RUNS = 8
EMULATED_STEPS = 50
STEPS_SHOWN = 60

FRACTION_MATCHED, RATIO = "fraction_matched", "ratio"
SMALL_WORLD = {"simulated small world": "s", "emulated small world": "D"}
"""Kinds of rows, and their markers."""
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
    worlds: int = WORLDS

    def parameters(self, value: float) -> MobileParameters:
        """The default world but for this value."""
        changed: MobileParameters = msgspec.structs.replace(MobileParameters(), **{self.key: value})
        return changed

    def small(self) -> MobileParameters:
        """The emulator's world."""
        return msgspec.structs.replace(
            self.parameters(self.emulated), world=self.small_world, steps=EMULATED_STEPS
        )


MIX = Sweep("mobile_fraction", "part of the robots that is mobile",
            {0.1: "10 %", 0.5: "50 %", 0.9: "90 %"}, emulated=0.5, small_world=48.0,
            worlds=4)  # fmt: skip
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


def small_world(sweep: Sweep) -> list[Run]:
    """The small world simulated, and on the emulator."""
    small = sweep.small()
    return [
        Run(SERIES, small, SMALL_WORLDS, at_least=True),
        Run(EMULATED, small, EMULATED_RUNS, at_most=True),
    ]


def _runs(sweep: Sweep) -> Callable[[], list[Run]]:
    def runs() -> list[Run]:
        return [
            *(Run(SERIES, sweep.parameters(value), sweep.worlds) for value in sweep.values),
            *small_world(sweep),
        ]

    return runs


def _tabulate(sweep: Sweep, metric: str) -> Callable[[list[dict[str, Any]]], Table]:
    def tabulate(results: list[dict[str, Any]]) -> Table:
        *simulated, small, emulated = results
        rows: list[tuple[Cell, ...]] = []
        for value, result in zip(sweep.values, simulated, strict=True):
            samples = result["samples"]
            rows += _series(value, result["series"]["deep"][metric], samples)
            rows.append(_steady("simulated steady state", value, result["deep"][metric], samples))
        for kind, moment, samples in small_world_moments(small, emulated, metric):
            rows.append(_steady(kind, sweep.emulated, moment, samples))
        return Table(("kind", sweep.key, "step", metric, "se", "sd", "samples"), rows)

    return tabulate


def small_world_moments(
    small: Mapping[str, Any], emulated: Mapping[str, Any], metric: str
) -> list[tuple[str, Mapping[str, float | None], int]]:
    """Kind, moment, and number of worlds or runs, of the two results of `small_world`."""
    results = ((small["all"][metric], small["samples"]), (emulated[metric], emulated["samples"]))
    return [(kind, *result) for kind, result in zip(SMALL_WORLD, results, strict=True)]


def _series(
    value: float, series: Mapping[str, Sequence[float | None]], samples: int
) -> list[tuple[Cell, ...]]:
    steps = zip(series["mean"], series["se"], series["sd"], strict=True)
    return [
        ("simulated", value, step, mean, error, deviation, samples)
        for step, (mean, error, deviation) in enumerate(steps)
        if step <= STEPS_SHOWN and mean is not None
    ]


def _steady(kind: str, value: float, moment: Mapping[str, float | None], samples: int) -> tuple[Cell, ...]:
    return (kind, value, None, moment["mean"], moment["se"], moment.get("sd"), samples)


def _draw(sweep: Sweep, metric: str) -> Callable[[Table, Canvas], None]:
    def draw(table: Table, canvas: Canvas) -> None:
        axes = canvas.subplots()
        for number, (value, name) in enumerate(sweep.values.items()):
            part = table.where(kind="simulated", **{sweep.key: value})
            axes.plot(part.column("step"), part.numbers(metric), color=f"C{number}", label=name)
            if value == sweep.emulated:
                draw_small_world(axes, table, metric, (STEPS_SHOWN + 2, STEPS_SHOWN + 5), f"C{number}")
        axes.set(xlabel="step", ylabel=LABELS[metric], xlim=(0, STEPS_SHOWN + 8))
        if metric == RATIO:  # it starts at a quarter of the robots in range
            axes.set_yscale("log")
            axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            axes.yaxis.set_minor_formatter(NullFormatter())
        axes.legend(title=sweep.label, fontsize=8)

    return draw


def draw_small_world(axes: Axes, table: Table, metric: str, places: Sequence[float], colour: str) -> None:
    """The small world, simulated and on the emulator, at two places; bars of four standard errors."""
    for (kind, marker), place in zip(SMALL_WORLD.items(), places, strict=True):
        part = table.where(kind=kind)
        axes.errorbar(
            [place],
            part.numbers(metric),
            yerr=4 * part.numbers("se"),
            fmt=marker,
            color=colour,
            markerfacecolor="white",
            markersize=5,
            capsize=2,
            label=f"{kind}, 4 standard errors of {part.column('samples')[0]}",
        )
