"""Disc range: heard up to a distance, and not beyond it."""

from __future__ import annotations

import numpy as np

from channels.fates import Batch, Bools, Floats, Ints, Reason


class Disc:
    """Who is out of range of whom; at exactly `range_m` one is in range.

    `altitudes_m` (N,): heights of the robots, which never change; None: all are on one plane.
    """

    def __init__(self, range_m: float, altitudes_m: Floats | None = None) -> None:
        self._range_squared = range_m * range_m
        self._altitudes = altitudes_m
        self._seen: Floats | None = None
        self._beyond: Bools | None = None
        self._asked = 0

    def beyond(self, positions: Floats, senders: Ints) -> Bools:
        """(len(senders), N) for positions (N, 2), which are never written to once handed over."""
        # Robots that move bring new positions every instant, and few of them speak: only their rows
        # are computed, for the range and for collisions. Positions that still come then stay, and are
        # worth the whole matrix.
        if positions is not self._seen:
            self._seen, self._beyond, self._asked = positions, None, 0
        self._asked += 1
        if self._asked <= 2:
            return self._farther(positions, senders)
        if self._beyond is None:
            self._beyond = self._farther(positions, np.arange(len(positions)))
        return self._beyond.take(senders, axis=0)

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

    def __init__(self, disc: Disc) -> None:
        self._disc = disc

    def refuses(self, batch: Batch) -> Bools:
        """(T, N)."""
        return self._disc.beyond(batch.positions, batch.senders)
