"""At which vertex of the world's graph every robot counts as being: where it communicates from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from channels.graphs import Graph, vertices_at
from emulator.placement import Vector

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


class Places:
    """A robot's place is the vertex at which it stood, or set out, last: on its way it is still there.

    From the very instant at which a robot comes to stand at a vertex, its place is that vertex. Who drives
    through a vertex without stopping, or turns round on the way, keeps the place that it had.
    """

    def __init__(self, graph: Graph, starts: Floats) -> None:
        """`starts` (N, 2): where the robots stand at first [m]."""
        self._vertices = np.array(graph.vertices)
        self._left = vertices_at(self._vertices, starts)
        self._aims = self._left.copy()
        self._ends_ns = np.zeros(len(starts), dtype=np.int64)
        self._places = _read_only(self._left.copy())

    def depart(self, robot: int, t_ns: int, start: Vector, end: Vector, end_ns: int) -> None:
        """From `t_ns` on a robot drives from one point to another, and stands there from `end_ns` on."""
        here, there = vertices_at(self._vertices, np.array([start, end])).tolist()
        place = here if here >= 0 else int(self._at(t_ns)[robot])
        self._left[robot] = place
        self._aims[robot] = there if there >= 0 else place
        self._ends_ns[robot] = end_ns

    def at(self, t_ns: int) -> Ints:
        """Vertices (N,), -1 for who has never stood at one; the same array while all is as it was.

        `t_ns` lies after the latest departure.
        """
        places = self._at(t_ns)
        if not np.array_equal(places, self._places):
            self._places = _read_only(places)
        return self._places

    def _at(self, t_ns: int) -> Ints:
        return np.where(t_ns >= self._ends_ns, self._aims, self._left)


def _read_only(places: Ints) -> Ints:
    places.flags.writeable = False
    return places
