"""Slots, enforced by true time: whoever speaks outside its own is heard by nobody."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from channels.fates import Batch, Bools, Reason
from channels.tdma import Schedule


class LengthGate:
    """Refuses what would not fit into any slot before its guard."""

    reason = Reason.too_long

    def __init__(self, schedule: Schedule) -> None:
        self._schedule = schedule

    def refuses(self, batch: Batch) -> Bools | None:
        """(T, 1)."""
        fits: Bools = self._schedule.fits(batch.airtimes_ns)
        return None if fits.all() else ~fits[:, None]


class SlotGate:
    """Refuses what is not wholly inside the sender's own slot, before its guard."""

    reason = Reason.out_of_slot

    def __init__(self, schedule: Schedule, slots: Sequence[int]) -> None:
        self._schedule = schedule
        self._slots = np.array(slots, dtype=np.int64)

    def refuses(self, batch: Batch) -> Bools | None:
        """(T, 1)."""
        slots = self._slots[batch.senders]
        inside: Bools = self._schedule.inside(slots, batch.now_ns, batch.airtimes_ns)
        return None if inside.all() else ~inside[:, None]
