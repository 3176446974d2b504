"""Random environments of points in a square, and of their Delaunay triangulation."""

from __future__ import annotations

import numpy as np

from agent.behaviours.reconnection.environment_parts import lengths_of, scaled, thinned
from channels.graphs import Bools, Floats, Graph, Ints
from channels.randomness import Draws

_DARTS = 200
"""How many places are tried for each point, on average, before there is no room."""


def gabriel(vertices: int, seed: int, *, gap: float) -> Graph:
    """Two points are joined where no other lies in the circle between them (Gabriel & Sokal 1969)."""
    points = random_points(vertices, seed, gap)
    pairs, near = triangulated(points)
    return scaled(points, pairs[near])


def delaunay(vertices: int, seed: int, *, gap: float, longest: float) -> Graph:
    """Triangulation without what is longer than `longest` medians, unless the Gabriel graph has it."""
    points = random_points(vertices, seed, gap)
    return scaled(points, _without_long(points, longest))


def delaunay_thinned(vertices: int, seed: int, *, gap: float, longest: float, degree: float) -> Graph:
    """Of the same, edges taken away at random until vertices have so many on average."""
    points = random_points(vertices, seed, gap)
    kept = max(vertices - 1, round(degree * vertices / 2))
    draws = Draws(seed, "environment/delaunay-thinned")
    return scaled(points, thinned(vertices, _without_long(points, longest), kept, draws))


def random_points(vertices: int, seed: int, gap: float) -> Floats:
    """(V, 2) in the unit square, from the lower left along x first.

    Darts are thrown one after the other; those nearer than gap / sqrt(V) to one before do not count. Raises
    ValueError where there is no room.
    """
    draws = Draws(seed, "environment/points")
    squared = gap * gap / vertices
    points, count = np.empty((vertices, 2)), 0
    for block in range(_DARTS):
        darts = np.arange(block * vertices, (block + 1) * vertices)
        for place in draws.uniform(darts[:, np.newaxis], np.arange(2)):
            offsets = points[:count] - place
            if gap == 0 or not np.any(offsets[:, 0] ** 2 + offsets[:, 1] ** 2 < squared):
                points[count] = place
                count += 1
                if count == vertices:
                    return points[np.lexsort(points.T)]
    raise ValueError(f"gap: no room is left after {count} of {vertices} vertices; choose less than {gap}")


def triangulated(points: Floats) -> tuple[Ints, Bools]:
    """Pairs (E, 2) that the Delaunay triangulation joins, in order; whether the Gabriel graph does (E,).

    If any point lies in the circle over an edge of the triangulation, so does the third corner of one of the
    edge's triangles.
    """
    if len(points) == 2:
        return np.array([[0, 1]]), np.ones(1, dtype=bool)
    try:
        from scipy.spatial import Delaunay
    except ModuleNotFoundError:
        sentence = "environments of random points need SciPy; install heliograph[desk]"
        raise ModuleNotFoundError(sentence, name="scipy") from None
    corners = Delaunay(points).simplices.astype(np.int64)
    sides = corners[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    third = points[corners[:, [2, 0, 1]].ravel()]
    inside = ((points[sides[:, 0]] - third) * (points[sides[:, 1]] - third)).sum(axis=1) < 0
    pairs, which = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True)
    return pairs, np.bincount(which.ravel(), weights=inside) == 0


def _without_long(points: Floats, longest: float) -> Ints:
    pairs, near = triangulated(points)
    lengths = lengths_of(points, pairs)
    return pairs[near | (lengths <= longest * np.median(lengths))]
