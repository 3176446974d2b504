"""Graphs of an environment: where robots can go, and from where they can talk to each other.

Vandermeulen, Groß & Kolling ("Re-establishing communication in teams of mobile robots", sec. II): the
environment graph G_e = (V, E_e) says which cells of a decomposition are neighbours, the communication graph
G_c = (V, E_c), on the same vertices, from which cells two robots hear each other. Lengths are in units; what
a unit is in metres is for those to say who use the graph.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

Ints: TypeAlias = NDArray[np.int64]
Floats: TypeAlias = NDArray[np.float64]
Bools: TypeAlias = NDArray[np.bool_]

Point: TypeAlias = tuple[float, float]
Rectangle: TypeAlias = tuple[float, float, float, float]

MOST_VERTICES = 10_000
SAME_PLACE = 1e-6
"""So near to a vertex one is at it."""
_NUMBERS_AT_ONCE = 1_000_000
"""In one array; more would only fill memory."""


class Graph(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """An environment. Plain data: what a graph file holds, and what robots are told."""

    vertices: tuple[Point, ...]
    """x, y of every vertex."""
    edges: tuple[tuple[int, int, float], ...]
    """Ways, each once: the two vertices it joins, and its length. They can be gone in both directions."""
    links: tuple[tuple[int, int], ...] | None = None
    """Pairs of vertices from which robots hear each other, besides those at one vertex; None: the ends of
    every edge."""
    starts: tuple[int, ...] | None = None
    """Where robots start, in their order; None: `spread`."""
    obstacles: tuple[Rectangle, ...] = ()
    """Rectangles x0, y0, x1, y1 that nobody sees or hears through."""


def check(graph: Graph) -> None:
    """Raises ValueError, "key: what is wrong", for a graph that is none, or is not in one piece."""
    count = len(graph.vertices)
    if not 2 <= count <= MOST_VERTICES:
        raise ValueError(f"vertices: there are {count}; a graph has 2 to {MOST_VERTICES}")
    for i, point in enumerate(graph.vertices):
        if not all(math.isfinite(number) for number in point):
            raise ValueError(f"vertices[{i}]: {list(point)} are not both finite numbers")
    _check_pairs("edges", ((a, b) for a, b, _ in graph.edges), count)
    for i, (_, _, length) in enumerate(graph.edges):
        if not (math.isfinite(length) and length > 0):
            raise ValueError(f"edges[{i}]: its length must be a number greater than 0, is {length}")
    _check_pairs("links", graph.links or (), count)
    for i, start in enumerate(graph.starts or ()):
        if not 0 <= start < count:
            raise ValueError(f"starts[{i}]: there is no vertex {start}; they are 0 to {count - 1}")
    for i, (x0, y0, x1, y1) in enumerate(graph.obstacles):
        if not (x0 < x1 and y0 < y1 and all(map(math.isfinite, (x0, y0, x1, y1)))):
            raise ValueError(f"obstacles[{i}]: must be x0, y0, x1, y1 with x0 < x1 and y0 < y1")
    cut_off = np.flatnonzero(hops(graph, 0) < 0)
    if len(cut_off):
        raise ValueError(
            f"edges: no way leads from vertex 0 to vertex {cut_off[0]}, nor to {len(cut_off) - 1} others"
        )


def _check_pairs(key: str, pairs: Iterable[tuple[int, int]], count: int) -> None:
    seen: dict[tuple[int, int], int] = {}
    for i, (a, b) in enumerate(pairs):
        for vertex in (a, b):
            if not 0 <= vertex < count:
                raise ValueError(f"{key}[{i}]: there is no vertex {vertex}; they are 0 to {count - 1}")
        if a == b:
            raise ValueError(f"{key}[{i}]: joins vertex {a} to itself; leave it out")
        pair = min(a, b), max(a, b)
        if pair in seen:
            raise ValueError(f"{key}[{i}]: joins {a} and {b} as {key}[{seen[pair]}] does; leave one out")
        seen[pair] = i


def neighbours(graph: Graph) -> list[list[tuple[int, float]]]:
    """For each vertex those one can go to, in order, and how far that is."""
    found: list[list[tuple[int, float]]] = [[] for _ in graph.vertices]
    for a, b, length in graph.edges:
        found[a].append((b, length))
        found[b].append((a, length))
    for ways in found:
        ways.sort()
    return found


def hearing(graph: Graph) -> Bools:
    """From which vertices robots hear each other, themselves included: symmetric (V, V)."""
    count = len(graph.vertices)
    heard = np.eye(count, dtype=bool)
    pairs = [(a, b) for a, b, _ in graph.edges] if graph.links is None else list(graph.links)
    if pairs:
        first, second = np.array(pairs).T
        heard[first, second] = heard[second, first] = True
    return heard


def hops(graph: Graph, start: int) -> Ints:
    """Least number of edges from a vertex to every other, -1 where there is no way: (V,)."""
    ways = neighbours(graph)
    found = np.full(len(graph.vertices), -1)
    found[start] = 0
    reached = [start]
    for vertex in reached:
        for other, _ in ways[vertex]:
            if found[other] < 0:
                found[other] = found[vertex] + 1
                reached.append(other)
    return found


def spread(graph: Graph, robots: int) -> tuple[int, ...]:
    """Vertices far apart for so many robots, each different.

    The vertices nearest to the corners of the bounding box, first two that are opposite (lower left, upper
    right, upper left, lower right), then the one nearest to its centre (Vandermeulen et al., sec. V); further
    ones are always those farthest, as the crow flies, from all before. Raises ValueError where there are
    more robots than vertices.
    """
    if robots > len(graph.vertices):
        raise ValueError(f"{robots} robots cannot start at {len(graph.vertices)} different vertices")
    points = np.array(graph.vertices)
    (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
    corners = [(x0, y0), (x1, y1), (x0, y1), (x1, y0), ((x0 + x1) / 2, (y0 + y1) / 2)]
    chosen: list[int] = []
    for place in corners[:robots]:
        squared = ((points - place) ** 2).sum(axis=1)
        squared[chosen] = math.inf
        chosen.append(int(squared.argmin()))
    while len(chosen) < robots:
        gaps = ((points[:, None] - points[chosen]) ** 2).sum(axis=2).min(axis=1)
        chosen.append(int(gaps.argmax()))
    return tuple(chosen)


def starts(graph: Graph, robots: int) -> tuple[int, ...]:
    """Where so many robots start. Raises ValueError where the graph names too few places."""
    if graph.starts is None:
        return spread(graph, robots)
    if len(graph.starts) < robots:
        raise ValueError(f"starts: names {len(graph.starts)} vertices for {robots} robots; name more")
    return graph.starts[:robots]


def vertices_at(vertices: Sequence[Point] | Floats, points: Floats) -> Ints:
    """The vertex at each point (N, 2), within `SAME_PLACE` along each axis, -1 where none is: (N,)."""
    near = (np.abs(points[:, None] - np.asarray(vertices)) <= SAME_PLACE).all(axis=2)
    return np.where(near.any(axis=1), near.argmax(axis=1), -1)


def in_sight(points: Floats, others: Floats, obstacles: Sequence[Rectangle]) -> Bools:
    """Whether straight lines between points (..., 2) pass no obstacle's inside; shapes broadcast.

    Liang & Barsky 1984: a line is clipped to each rectangle. Along a side, or through a corner only, it
    passes. The same from either end.
    """
    one, other = np.broadcast_arrays(points, others)
    # From left to right always: rounding must not let one see the other and not be seen.
    back = (other[..., 0] < one[..., 0]) | ((other[..., 0] == one[..., 0]) & (other[..., 1] < one[..., 1]))
    start = np.where(back[..., None], other, one)
    way = np.where(back[..., None], one, other) - start
    clear = np.ones(start.shape[:-1], dtype=bool)
    at_once = max(1, _NUMBERS_AT_ONCE // max(1, clear.size))
    for first in range(0, len(obstacles), at_once):
        corners = np.array(obstacles[first : first + at_once]).T
        clear &= ~_crosses(start, way, corners.reshape(4, -1, *[1] * clear.ndim)).any(axis=0)
    return clear


def _crosses(start: Floats, way: Floats, corners: Floats) -> Bools:
    """Which rectangles, of corners (4, R, 1, ...), each line (...) crosses: (R, ...)."""
    enter, leave, inside = np.zeros(()), np.ones(()), np.ones((), dtype=bool)
    for axis in (0, 1):
        at, along, low, high = start[..., axis], way[..., axis], corners[axis], corners[axis + 2]
        still = along == 0
        inside = inside & (~still | ((at > low) & (at < high)))
        step = np.where(still, 1.0, along)
        with np.errstate(over="ignore"):  # hardly moving at all, it is there before, or after, all time
            first, second = (low - at) / step, (high - at) / step
        enter = np.where(still, enter, np.maximum(enter, np.minimum(first, second)))
        leave = np.where(still, leave, np.minimum(leave, np.maximum(first, second)))
    crosses: Bools = inside & (enter < leave)
    return crosses
