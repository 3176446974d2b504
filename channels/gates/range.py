"""Disc range: heard up to a distance, and not beyond it."""

from __future__ import annotations

import numpy as np

from channels.fates import Batch, Bools, Floats, Ints, Reason


class RangeGate:
    """Refuses receivers farther than `range_m`; a receiver at exactly that distance hears."""

    reason = Reason.out_of_range

    def __init__(self, range_m: float) -> None:
        self._range_squared = range_m * range_m
        self._seen: Floats | None = None
        self._beyond: Bools | None = None

    def refuses(self, batch: Batch) -> Bools:
        """(T, N)."""
        positions = batch.positions
        # Robots that move bring new positions every instant, and few of them speak: only their rows
        # are computed. Positions that come a second time stay, and are worth the whole matrix.
        if positions is not self._seen:
            self._seen, self._beyond = positions, None
            return self._farther(positions, batch.senders)
        if self._beyond is None:
            self._beyond = self._farther(positions, np.arange(len(positions)))
        return self._beyond.take(batch.senders, axis=0)

    def _farther(self, positions: Floats, senders: Ints) -> Bools:
        squared = positions[senders, 0, None] - positions[:, 0]
        squared *= squared
        squared_y = positions[senders, 1, None] - positions[:, 1]
        squared_y *= squared_y
        squared += squared_y
        beyond: Bools = squared > self._range_squared
        return beyond
