"""What one robot believes of the others over a run (Vandermeulen et al., sec. V, the video)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure as Canvas
from msgspec import Struct

from agent.behaviours.reconnection.belief import by_place
from scenarios.figures import Cell, Figure, Run, Table
from scenarios.reconnection.simulation import Result, Search
from scenarios.reconnection.study_reconnection import (
    ReconnectionParameters,
    check,
    graph_of,
    search_of,
)
from scenarios.study import Study, one_each

PARAMETERS = ReconnectionParameters(robots=4)
OBSERVER = 0
LEAST = 1e-3
"""Smaller beliefs are not shown."""

COLUMNS = ("kind", "instant", "steps", "robot", "vertex", "other", "x", "y", "connected", "belief")
"""Kinds of rows: `vertex` and its place; `edge` from a vertex to another one; for each instant, `steps` after
the search began, `robot` and its place, `connected` being 1 for those that can talk to the observer, who is
robot 0; and `belief`, of at least 0.001, of the observer that a robot's place is there."""


class Seen(Struct, frozen=True):
    """One instant."""

    steps: int
    places: list[int]
    connected: list[int]
    """Those in one network with the observer."""
    beliefs: dict[int, list[float]]
    """For each other robot, of every vertex."""


class Traced(Struct, frozen=True):
    """One run, looked at from one robot."""

    vertices: list[tuple[float, float]]
    edges: list[tuple[int, int]]
    seen: list[Seen]


def simulate(
    parameters: ReconnectionParameters, generator: np.random.Generator, samples: int
) -> list[Traced]:
    """So many runs, of the seeds that `study_reconnection` has."""
    return [_traced(parameters, int(generator.integers(2**31))) for _ in range(samples)]


def _traced(parameters: ReconnectionParameters, seed: int) -> Traced:
    """The run twice: once to know what happens when, and once to look at it."""
    graph = graph_of(parameters, seed)
    met: list[int] = []
    company = [0]

    def listen(step: int, search: Search) -> None:
        near = len(_group(search))
        if step > parameters.random_steps and near > company[-1]:
            met.append(step)
        company.append(near)

    result = _run(parameters, seed, listen)
    wanted = instants(parameters.random_steps, result.steps, met)
    seen: list[Seen] = []

    def look(step: int, search: Search) -> None:
        if step in wanted:
            seen.append(_seen(step - parameters.random_steps, search))

    _run(parameters, seed, look)
    return Traced(list(graph.vertices), [(a, b) for a, b, _ in graph.edges], seen)


def _run(parameters: ReconnectionParameters, seed: int, watch: Any) -> Result:
    return search_of(parameters, seed).run(parameters.random_steps, parameters.limit, watch)


def instants(begin: int, steps: int, met: Sequence[int]) -> list[int]:
    """At most six: the first, the last, and those about the observer's first meeting; increasing."""
    end = begin + steps
    first = next((step for step in met if step < end), begin + steps // 2)
    chosen = {
        begin,
        (begin + first) // 2,
        max(begin, first - 1),
        first,
        (first + end) // 2,
        max(begin, end - 1),
    }
    return sorted(chosen)


def _group(search: Search) -> tuple[int, ...]:
    return next(group for group in search.groups if OBSERVER in group)


def _seen(steps: int, search: Search) -> Seen:
    known = search.known[OBSERVER]
    return Seen(
        steps=steps,
        places=[member.motion.place for member in search.members],
        connected=list(_group(search)),
        beliefs={robot: by_place(search.model, belief).tolist() for robot, belief in known.believed.items()},
    )


def summarise(_parameters: ReconnectionParameters, partials: Sequence[list[Traced]]) -> dict[str, Any]:
    """Of the first run: `vertices`, `edges`, and what is `seen` at each instant, as `Seen`."""
    return {"traced": partials[0][0]}


TRACE = Study(
    name="reconnection",  # the same seeds
    title="Reconnection: what one robot believes over a run",
    parameters=ReconnectionParameters,
    samples=1,
    unit="runs",
    chunk=one_each,
    simulate=simulate,
    summarise=summarise,
    check=check,
)


def runs() -> list[Run]:
    """One run of four robots."""
    return [Run(TRACE, PARAMETERS, 1, at_most=True)]


def tabulate(results: list[dict[str, Any]]) -> Table:
    """The table, with columns as explained at `COLUMNS`."""
    traced: Traced = results[0]["traced"]
    rows: list[tuple[Cell, ...]] = [
        ("vertex", None, None, None, vertex, None, x, y, None, None)
        for vertex, (x, y) in enumerate(traced.vertices)
    ]
    rows += [("edge", None, None, None, a, b, None, None, None, None) for a, b in traced.edges]
    for number, seen in enumerate(traced.seen):
        rows += _rows(number, seen, traced.vertices)
    return Table(COLUMNS, rows)


def _rows(number: int, seen: Seen, vertices: Sequence[tuple[float, float]]) -> Iterator[tuple[Cell, ...]]:
    for robot, place in enumerate(seen.places):
        connected = int(robot in seen.connected)
        yield "robot", number, seen.steps, robot, place, None, *vertices[place], connected, None
    for robot, belief in seen.beliefs.items():
        for vertex, mass in enumerate(belief):
            if mass >= LEAST:
                yield "belief", number, seen.steps, robot, vertex, None, *vertices[vertex], None, mass


# --- the picture ---------------------------------------------------------------------------------

COLOURS = ("C3", "C0", "C2", "C1", "C4", "C5", "C8", "C9")
_LARGEST = 900.0
"""Area of the circle of certainty [points^2]."""


def draw(table: Table, canvas: Canvas) -> None:
    """An environment for every instant; a robot's colour is that of what is believed of it."""
    canvas.set_size_inches(9.0, 6.6)
    numbers = list(dict.fromkeys(table.where(kind="robot").column("instant")))
    panels = canvas.subplots(2, 3, squeeze=False).ravel()
    for axes in panels[len(numbers) :]:
        axes.set_axis_off()
    for axes, number in zip(panels, numbers, strict=False):
        _draw_graph(axes, table)
        _draw_instant(axes, table.where(instant=number))
    canvas.suptitle(
        "what the red robot believes of the others: area of a circle as the probability of that place; "
        "dots: where they are,\nringed in black if connected with the red one",
        fontsize=9,
    )


def _draw_graph(axes: Axes, table: Table) -> None:
    vertices = table.where(kind="vertex")
    points = np.stack([vertices.numbers("x"), vertices.numbers("y")], axis=1)
    edges = table.where(kind="edge")
    ends = np.stack([edges.column("vertex"), edges.column("other")], axis=1)
    axes.add_collection(LineCollection(list(points[ends]), colors="0.8", linewidths=0.8, zorder=1))
    axes.set_aspect("equal")
    axes.set_axis_off()


def _draw_instant(axes: Axes, table: Table) -> None:
    robots, beliefs = table.where(kind="robot"), table.where(kind="belief")
    for robot in robots.column("robot"):
        colour = COLOURS[robot % len(COLOURS)]
        of_it = beliefs.where(robot=robot)
        axes.scatter(of_it.numbers("x"), of_it.numbers("y"), _LARGEST * of_it.numbers("belief"),
                     color=colour, alpha=0.35, linewidths=0, zorder=2)  # fmt: skip
        (connected,) = robots.where(robot=robot).column("connected")
        it = robots.where(robot=robot)
        axes.scatter(it.numbers("x"), it.numbers("y"), 30, color=colour, zorder=4,
                     edgecolors="black" if connected else "white", linewidths=1.2)  # fmt: skip
    steps = robots.column("steps")[0]
    axes.set_title(f"step {steps} of the search", fontsize=9)
    axes.autoscale_view()


FIGURE = Figure(
    title="what one robot believes of the others over one run",
    runs=runs,
    tabulate=tabulate,
    draw=draw,
)
