"""What random environments of all kinds have in common: edges are taken away, and all is scaled."""

from __future__ import annotations

import math

import numpy as np

from channels.graphs import Floats, Graph, Ints, Rectangle
from channels.randomness import Draws

MARGIN = 0.5
"""How far vertices are from the sides of the area at least, in units."""


def thinned(vertices: int, pairs: Ints, kept: int, draws: Draws) -> Ints:
    """Pairs (E, 2) of a connected graph without those taken away at random, until so many are left.

    They go one by one, but none that would cut the graph in two. Those that cannot go when their turn comes
    are a spanning tree: the one that Kruskal's algorithm finds in the opposite order (1956).
    """
    order = np.argsort(draws.bits(np.arange(len(pairs))), kind="stable")
    above = list(range(vertices))

    def root(vertex: int) -> int:
        while above[vertex] != vertex:
            above[vertex] = vertex = above[above[vertex]]
        return vertex

    spared = np.zeros(len(pairs), dtype=bool)
    for edge in order[::-1]:
        first, second = root(int(pairs[edge, 0])), root(int(pairs[edge, 1]))
        spared[edge] = first != second
        above[first] = second
    taken = order[~spared[order]][: max(0, len(pairs) - kept)]
    return np.delete(pairs, taken, axis=0)


def lengths_of(points: Floats, pairs: Ints) -> Floats:
    """(E,), in operations that are rounded alike everywhere."""
    offsets = points[pairs[:, 0]] - points[pairs[:, 1]]
    return np.asarray(np.sqrt(offsets[:, 0] ** 2 + offsets[:, 1] ** 2))


def scaled(points: Floats, pairs: Ints, obstacles: list[Rectangle] | None = None) -> Graph:
    """The graph of points (V, 2) and pairs (E, 2), in units in which edges are 1 long on average.

    It is moved to where the margin begins; what of the obstacles lies beyond the margin is cut off.
    """
    lengths = lengths_of(points, pairs)
    mean = math.fsum(lengths) / len(lengths)
    corner = points.min(axis=0)
    places = (points - corner) / mean + MARGIN
    ends = zip(pairs.tolist(), (lengths / mean).tolist(), strict=True)
    rectangles = (np.array(obstacles or [], dtype=float).reshape(-1, 2, 2) - corner) / mean + MARGIN
    rectangles = rectangles.clip(0.0, places.max(axis=0) + MARGIN).reshape(-1, 4)
    return Graph(
        vertices=tuple((x, y) for x, y in places.tolist()),
        edges=tuple((a, b, length) for (a, b), length in ends),
        obstacles=tuple((x0, y0, x1, y1) for x0, y0, x1, y1 in rectangles.tolist() if x0 < x1 and y0 < y1),
    )
