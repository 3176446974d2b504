"""Range: how far a transmission reaches at all, for itself and for what it disturbs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from channels.fates import Batch, Bools, Floats, Ints, Reason


class Reach(Protocol):
    """A link model: who is out of reach of whom."""

    def beyond(self, positions: Floats, places: Ints | None, senders: Ints) -> Bools:
        """(len(senders), N) for positions and places as in `Batch`, which are never written to."""


class Kept:
    """Rows of an (N, N) matrix that is a function of where the robots are."""

    def __init__(self, rows: Callable[[NDArray[Any], Ints], Bools]) -> None:
        """`rows(where, senders)`: (len(senders), N)."""
        self._rows = rows
        self._seen: NDArray[Any] | None = None
        self._all: Bools | None = None
        self._asked = 0

    def of(self, where: NDArray[Any], senders: Ints) -> Bools:
        """Rows of these senders, for an array that is never written to once handed over."""
        # Robots that move bring a new array every instant, and few of them speak: only their rows are
        # computed, for the range and for collisions. An array that still comes then stays, and is worth
        # the whole matrix.
        if where is not self._seen:
            self._seen, self._all, self._asked = where, None, 0
        self._asked += 1
        if self._asked <= 2:
            return self._rows(where, senders)
        if self._all is None:
            self._all = self._rows(where, np.arange(len(where)))
        return self._all.take(senders, axis=0)


class Disc:
    """In range is who is near enough; at exactly `range_m` one is.

    `altitudes_m` (N,): heights of the robots, which never change; None: all are on one plane.
    """

    def __init__(self, range_m: float, altitudes_m: Floats | None = None) -> None:
        self._range_squared = range_m * range_m
        self._altitudes = altitudes_m
        self._kept = Kept(self._farther)

    def beyond(self, positions: Floats, places: Ints | None, senders: Ints) -> Bools:
        """(len(senders), N), whatever the places."""
        return self._kept.of(positions, senders)

    def _farther(self, positions: Floats, senders: Ints) -> Bools:
        squared = positions[senders, 0, None] - positions[:, 0]
        squared *= squared
        squared_y = positions[senders, 1, None] - positions[:, 1]
        squared_y *= squared_y
        squared += squared_y
        if self._altitudes is not None:
            squared_z = self._altitudes[senders, None] - self._altitudes
            squared_z *= squared_z
            squared += squared_z
        beyond: Bools = squared > self._range_squared
        return beyond


class RangeGate:
    """Refuses receivers that are out of range where the robots are when the transmission ends."""

    reason = Reason.out_of_range

    def __init__(self, reach: Reach) -> None:
        self._reach = reach

    def refuses(self, batch: Batch) -> Bools:
        """(T, N)."""
        return self._reach.beyond(batch.positions, batch.places, batch.senders)
