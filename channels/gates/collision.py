"""Transmissions at the same time: nobody understands two at once, and nobody hears while it speaks.

There is no capture: of two overlapping transmissions a receiver that either would reach gets neither, however
much nearer one of the senders is. Those that are too long or out of their slot disturb like any other.
"""

from __future__ import annotations

import numpy as np

from channels.fates import Batch, Bools, OnAir, Reason
from channels.gates.range import Reach


class HalfDuplexGate:
    """Refuses receivers that were transmitting themselves during any part of the transmission."""

    reason = Reason.half_duplex

    def refuses(self, batch: Batch) -> Bools | None:
        """(T, N)."""
        if batch.on_air is None:
            return None
        talking = np.zeros((len(batch.senders), len(batch.positions)), dtype=bool)
        rows, others = np.nonzero(_overlaps(batch, batch.on_air))
        talking[rows, batch.on_air.senders[others]] = True
        return talking


class CollisionGate:
    """Refuses receivers that another transmission reached during any part of this one."""

    reason = Reason.collision

    def __init__(self, reach: Reach) -> None:
        self._reach = reach

    def refuses(self, batch: Batch) -> Bools | None:
        """(T, N)."""
        if batch.on_air is None:
            return None
        in_range = ~self._reach.beyond(batch.positions, batch.places, batch.on_air.senders)
        # A product of whole numbers, in the type that has a fast one: exact below 2**24 transmissions.
        disturbing = _overlaps(batch, batch.on_air).astype(np.float32) @ in_range.astype(np.float32)
        disturbed: Bools = disturbing > 0
        return disturbed


def _overlaps(batch: Batch, air: OnAir) -> Bools:
    """(T, A): which others were on the air at the same time; what ends as the other begins was not."""
    overlaps: Bools = (
        (air.starts_ns < batch.now_ns)
        & (air.ends_ns > batch.starts_ns[:, None])
        & (air.senders != batch.senders[:, None])
    )
    return overlaps
