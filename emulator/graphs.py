"""The world's graph: what a scenario says of it, and what it is in metres."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct

from channels.graphs import Graph, Point, Rectangle, in_sight
from channels.settings import Positive
from emulator.placement import Vector

Name = Annotated[str, Meta(min_length=1)]

MOST_VERTICES = 2000
MOST_PAIRS = 100_000
"""Edges, and links: every robot is told all of them."""
APART_M = 1e-5
"""Vertices nearer to each other than this are one place."""


class GraphSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """Where robots can go. Exactly one of `file`, `generator` and `vertices` says it.

    Once a scenario is loaded it is `vertices` and all that belongs to them, in metres.
    """

    file: Name | None = None
    """JSON of a `channels.graphs.Graph`, relative to the scenario file; see `channels.graph_text`."""
    generator: Name | None = None
    """"module:function", or "file.py:function" as behaviours are found; it returns a Graph."""
    args: dict[str, Any] = {}
    """Keyword arguments for the generator; `seed` is the scenario's unless it is among them."""
    vertices: list[Point] | None = None
    edges: list[tuple[int, int, float]] = []
    links: list[tuple[int, int]] | None = None
    starts: list[int] | None = None
    """With a file or generator: instead of the starts that it names."""
    obstacles: list[Rectangle] = []
    scale_m: Positive = 1.0
    """Metres in one unit of the graph, file or generator."""
    heard_m: Positive | None = None
    """Links between all vertices so near, and with no obstacle between; None: those of the graph."""


def graph_of(settings: GraphSettings | None) -> Graph | None:
    """The graph of a scenario that has been loaded, in metres; None where it has none."""
    if settings is None or settings.vertices is None:
        return None
    return Graph(
        vertices=tuple(settings.vertices),
        edges=tuple(settings.edges),
        links=None if settings.links is None else tuple(settings.links),
        starts=None if settings.starts is None else tuple(settings.starts),
        obstacles=tuple(settings.obstacles),
    )


def settings_of(graph: Graph) -> GraphSettings:
    """What `graph_of` makes this graph of."""
    return GraphSettings(
        vertices=list(graph.vertices),
        edges=list(graph.edges),
        links=None if graph.links is None else list(graph.links),
        starts=None if graph.starts is None else list(graph.starts),
        obstacles=list(graph.obstacles),
    )


def in_metres(graph: Graph, scale_m: float) -> Graph:
    """The graph with all lengths in metres, and of plain numbers, whatever a generator has made it of."""
    return Graph(
        vertices=tuple((float(x) * scale_m, float(y) * scale_m) for x, y in graph.vertices),
        edges=tuple((int(a), int(b), float(length) * scale_m) for a, b, length in graph.edges),
        links=None if graph.links is None else tuple((int(a), int(b)) for a, b in graph.links),
        starts=None if graph.starts is None else tuple(map(int, graph.starts)),
        obstacles=tuple(_scaled(rectangle, scale_m) for rectangle in graph.obstacles),
    )


def _scaled(rectangle: Rectangle, scale_m: float) -> Rectangle:
    x0, y0, x1, y1 = (float(number) * scale_m for number in rectangle)
    return x0, y0, x1, y1


def links_by_distance(
    graph: Graph, heard_m: float, obstacles: Sequence[Rectangle]
) -> tuple[tuple[int, int], ...]:
    """Pairs of vertices at most `heard_m` apart, with none of these obstacles between them, in order."""
    points, found = np.array(graph.vertices), list[tuple[int, int]]()
    for vertex in range(len(points) - 1):
        near = vertex + 1 + np.flatnonzero(_squared(points, vertex) <= heard_m * heard_m)
        clear = in_sight(points[vertex], points[near], obstacles)
        found += ((vertex, other) for other in near[clear].tolist())
    return tuple(found)


def coincident(graph: Graph) -> tuple[int, int] | None:
    """The first two vertices that are one place, or None."""
    points = np.array(graph.vertices)
    for vertex in range(len(points) - 1):
        near = np.flatnonzero(_squared(points, vertex) < APART_M * APART_M)
        if len(near):
            return vertex, vertex + 1 + int(near[0])
    return None


def _squared(points: np.ndarray[Any, np.dtype[np.float64]], vertex: int) -> Any:
    """Squared distances of a vertex to all after it."""
    return ((points[vertex + 1 :] - points[vertex]) ** 2).sum(axis=1)


def area_around(graph: Graph) -> Vector:
    """Width and height of an area with as much room beyond the last vertices as there is before the first."""
    points = np.array(graph.vertices)
    width, height = (points.min(axis=0) + points.max(axis=0)).tolist()
    return width, height
