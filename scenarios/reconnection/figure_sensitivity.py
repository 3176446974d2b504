"""What the time to reconnection depends on: memory, horizon, radio; livelock; the parity of starts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple, TypeAlias

from matplotlib.figure import Figure as Canvas

from agent.behaviours.reconnection.environments import environment
from agent.behaviours.reconnection.methods import METHODS
from channels.graphs import hops
from scenarios.figures import Cell, Figure, Run, Table
from scenarios.reconnection.figure_tests import KINDS
from scenarios.reconnection.figure_times import LOOKS
from scenarios.reconnection.statistics import mean_interval
from scenarios.reconnection.study_reconnection import STUDY, Kind, ReconnectionParameters

RUNS = 100

COLUMNS = ("line", "x", "runs", "mean", "low", "high", "median", "censored")
"""Steps to reconnection: mean with its bootstrap interval (95 %), median, and how many runs did not end."""


class Point(NamedTuple):
    """One point of a line."""

    line: str
    x: float
    parameters: ReconnectionParameters


Points: TypeAlias = Callable[[], list[Point]]


def tabulate(points: Points, results: list[dict[str, Any]]) -> Table:
    """A row for each point, with columns as explained at `COLUMNS`."""
    rows: list[tuple[Cell, ...]] = []
    for point, result in zip(points(), results, strict=True):
        steps = result["steps"]
        interval = mean_interval(result["times"])
        rows.append(
            (
                point.line,
                point.x,
                result["samples"],
                steps["mean"],
                *interval,
                steps["median"],
                result["censored"],
            )
        )
    return Table(COLUMNS, rows)


def draw(label: str, ticks: Sequence[float], log: bool, table: Table, canvas: Canvas) -> None:
    """A line for each name, with intervals; a number at points of which not all runs ended."""
    axes = canvas.subplots()
    for number, name in enumerate(dict.fromkeys(table.column("line"))):
        line = table.where(line=name)
        x, mean, low, high = (line.numbers(column) for column in ("x", "mean", "low", "high"))
        axes.errorbar(x, mean, (mean - low, high - mean), fmt="o-", markersize=4, capsize=3,
                      color=f"C{number}", label=name)  # fmt: skip
        for place, height, count in zip(x, high, line.column("censored"), strict=True):
            if count:
                axes.annotate(f"{count} not ended", (place, height), (5, 0), textcoords="offset points",
                              fontsize=7, va="center")  # fmt: skip
    if log:
        axes.set_xscale("log")
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.set_yscale("log")
    axes.set_xlabel(label)
    axes.set_ylabel("mean steps to reconnection")
    axes.legend(fontsize=8)


def _figure(title: str, points: Points, label: str, ticks: Sequence[float], *, log: bool = False) -> Figure:
    return Figure(
        title=title,
        runs=partial(_runs, points),
        tabulate=partial(tabulate, points),
        draw=partial(draw, label, ticks, log),
    )


def _runs(points: Points) -> list[Run]:
    return [Run(STUDY, point.parameters, RUNS) for point in points()]


# --- memory, horizon, loss -----------------------------------------------------------------------

MEMORIES = (1, 2, 5, 10, 20, 50)
HORIZONS = (2, 4, 8, 12, 16)
HORIZON_KINDS: tuple[Kind, ...] = ("gridholes", "delaunay-thinned", "maze")
LOSSES = (0.0, 0.2, 0.5, 0.8)


def memory_points() -> list[Point]:
    """The persistent search of three robots, that avoids vertices for so many moves."""
    return [
        Point(kind, memory, ReconnectionParameters(method="persistent", environment=kind, memory=memory))
        for kind in KINDS
        for memory in MEMORIES
    ]


def horizon_points() -> list[Point]:
    """Three robots that plan so many steps ahead."""
    return [
        Point(kind, horizon, ReconnectionParameters(environment=kind, horizon=horizon))
        for kind in HORIZON_KINDS
        for horizon in HORIZONS
    ]


def loss_points() -> list[Point]:
    """Three robots that can miss contacts, and take silence for proof, or do not; and persistent ones."""
    points = []
    for loss in LOSSES:
        points += [
            Point("semi-markov, silence proves absence", loss, ReconnectionParameters(loss=loss)),
            Point(
                "semi-markov, silence as likely as it is", loss, ReconnectionParameters(loss=loss, miss=loss)
            ),
            Point("persistent", loss, ReconnectionParameters(method="persistent", loss=loss)),
        ]
    return points


MEMORY = _figure(
    "persistent search: for how many moves visited vertices are avoided", memory_points,
    "memory [moves], 3 robots", MEMORIES, log=True,
)  # fmt: skip
HORIZON = _figure(
    "semi-Markov search: how far plans look ahead", horizon_points, "horizon [steps], 3 robots", HORIZONS
)
LOSS = _figure(
    "a radio that misses contacts, and what silence is taken for", loss_points,
    "probability per step that a new contact is missed; gridholes, 3 robots", LOSSES,
)  # fmt: skip

# --- parity --------------------------------------------------------------------------------------

_GRID = ReconnectionParameters(robots=2, environment="gridholes")
_LAST = _GRID.vertices - 1


def parity_points() -> list[Point]:
    """Two robots in opposite corners of grids with holes, or one of them a vertex further; x: their distance.

    Edges are equally long, so that all arrive at the same steps, and each move changes the distance, in
    edges, by -2, 0 or 2. Robots an odd distance apart come to neighbouring vertices, which suffices to hear
    each other; those an even one apart must come to the very same.
    """
    graph = environment(_GRID.environment, _GRID.vertices)
    points = []
    for method in METHODS:
        for end in (_LAST, _LAST - 1):  # the last row is whole, whatever the seed
            odd = int(hops(graph, 0)[end]) % 2
            parameters = ReconnectionParameters(robots=2, method=method, starts=f"0,{end}")
            points.append(Point(method, odd, parameters))
    return points


def draw_parity(table: Table, canvas: Canvas) -> None:
    """Means of both parities side by side."""
    axes = canvas.subplots()
    for number, (method, look) in enumerate(LOOKS.items()):
        for odd, marker in ((0, "s"), (1, "o")):
            point = table.where(line=method, x=odd)
            mean, low, high = (point.numbers(name) for name in ("mean", "low", "high"))
            at = number - 0.12 + 0.24 * odd
            axes.errorbar([at], mean, (mean - low, high - mean), fmt=marker, color=look.colour, capsize=4,
                          fillstyle="full" if odd else "none")  # fmt: skip
            axes.annotate(f"{mean[0]:.0f}", (at, mean[0]), (7, 0), textcoords="offset points",
                          fontsize=8, va="center")  # fmt: skip
    axes.plot([], [], "s", color="grey", fillstyle="none", label="even distance: must come to one vertex")
    axes.plot([], [], "o", color="grey", label="odd distance: neighbouring vertices suffice")
    axes.set_xticks(range(len(LOOKS)), list(LOOKS))
    axes.set_xlim(-0.5, len(LOOKS) - 0.5)
    axes.set_yscale("log")
    axes.set_ylabel("mean steps to reconnection, 95 % intervals")
    axes.set_title("gridholes, 2 robots, edges of equal length", fontsize=10)
    axes.legend(fontsize=8)


PARITY = Figure(
    title="grids: starts at even and at odd distance",
    runs=partial(_runs, parity_points),
    tabulate=partial(tabulate, parity_points),
    draw=draw_parity,
)
