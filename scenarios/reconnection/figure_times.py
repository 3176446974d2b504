"""Times of reconnection by method and team size: Vandermeulen et al., Fig. 3, on each kind of environment."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from agent.behaviours.reconnection.methods import Method
from scenarios.figures import Cell, Figure, Run, Table
from scenarios.reconnection.statistics import t_interval
from scenarios.reconnection.study_reconnection import STUDY, Kind, ReconnectionParameters

RUNS = 100
"""The paper has 50."""
ROBOTS = (2, 3, 4, 5)

COLUMNS = ("kind", "environment", "robots", "method", "run", "seed", "steps", "low", "high", "censored")
"""Kinds of rows: `time` of one run, `censored` being 1 where it is the limit; `mean` of all, with the 95 %
interval by Student and how many of them are censored; `median`."""


class Look(NamedTuple):
    """How a method is drawn: in the paper's colours."""

    colour: str
    offset: float


LOOKS: dict[Method, Look] = {
    "random": Look("C3", -0.24),
    "persistent": Look("C0", 0.0),
    "semi-markov": Look("black", 0.24),
}
_WIDTH = 0.09
"""How far from the middle of its column a dot lies at most."""


def cells(kind: Kind) -> list[ReconnectionParameters]:
    """All that is compared on one kind of environment, in the order of runs."""
    return [
        ReconnectionParameters(method=method, environment=kind, robots=robots)
        for method in LOOKS
        for robots in ROBOTS
    ]


def runs(kind: Kind) -> list[Run]:
    """The study for each method and team size."""
    return [Run(STUDY, parameters, RUNS) for parameters in cells(kind)]


def tabulate(kind: Kind, results: list[dict[str, Any]]) -> Table:
    """The table, with columns as explained at `COLUMNS`."""
    rows: list[tuple[Cell, ...]] = []
    for parameters, result in zip(cells(kind), results, strict=True):
        rows += _rows(parameters, result)
    return Table(COLUMNS, rows)


def _rows(parameters: ReconnectionParameters, result: dict[str, Any]) -> Iterator[tuple[Cell, ...]]:
    cell = (parameters.environment, parameters.robots, parameters.method)
    for run, (seed, steps) in enumerate(zip(result["seeds"], result["times"], strict=True)):
        yield "time", *cell, run, seed, steps, None, None, int(steps >= parameters.limit)
    low, high = t_interval(result["times"])
    yield "mean", *cell, None, None, result["steps"]["mean"], low, high, result["censored"]
    yield "median", *cell, None, None, result["steps"]["median"], None, None, result["censored"]


def draw(kind: Kind, table: Table, canvas: Canvas) -> None:
    """Every time, on a scale that shows the tails, and the means with their intervals."""
    axes = canvas.subplots()
    for method, look in LOOKS.items():
        _draw_method(axes, table.where(method=method), method, look)
    if table.where(kind="time", steps=0).rows:  # which logarithms cannot show
        axes.set_yscale("symlog", linthresh=1, linscale=0.3)
        axes.set_ylim(bottom=0)
    else:
        axes.set_yscale("log")
    axes.set_xticks(ROBOTS)
    axes.set_xlabel("robots")
    axes.set_ylabel("steps to reconnection")
    axes.set_title(f"{kind}: single runs, means, 95 % intervals", fontsize=10)
    canvas.legend(fontsize=8, loc="outside lower center", ncols=4)


def _draw_method(axes: Axes, table: Table, method: str, look: Look) -> None:
    times = table.where(kind="time")
    at = times.numbers("robots") + look.offset + _WIDTH * _scatter(times.numbers("run"))
    steps, censored = times.numbers("steps"), times.numbers("censored") > 0
    axes.plot(at[~censored], steps[~censored], ".", color=look.colour, alpha=0.35, markersize=3)
    if censored.any():
        axes.plot(at[censored], steps[censored], "^", color=look.colour, markersize=5, label="not ended")
    means = table.where(kind="mean")
    middle, low, high = (means.numbers(name) for name in ("steps", "low", "high"))
    axes.errorbar(
        means.numbers("robots") + look.offset, middle, (middle - np.maximum(low, 0), high - middle),
        fmt="o", color=look.colour, markersize=6, capsize=4, markeredgecolor="white", label=method, zorder=3,
    )  # fmt: skip


def _scatter(runs: np.ndarray[Any, np.dtype[np.float64]]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Something even between -1 and 1 for each run, so that dots do not cover each other."""
    golden = (5**0.5 - 1) / 2
    return 2 * (runs * golden % 1.0) - 1


def figure(kind: Kind) -> Figure:
    """The figure of one kind of environment."""
    return Figure(
        title=f"steps to reconnection by method and team size, {kind}",
        runs=partial(runs, kind),
        tabulate=partial(tabulate, kind),
        draw=partial(draw, kind),
    )
