"""Slots, enforced by true time: whoever speaks outside its own is heard by nobody."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from channels.fates import Batch, Bools, Reason
from channels.tdma import Schedule


class LengthGate:
    """Refuses what would not fit into any slot beside its guard."""

    reason = Reason.too_long

    def __init__(self, schedule: Schedule) -> None:
        self._schedule = schedule

    def refuses(self, batch: Batch) -> Bools | None:
        """(T, 1)."""
        fits: Bools = self._schedule.fits(batch.airtimes_ns)
        return None if fits.all() else ~fits[:, None]


class SlotGate:
    """Refuses what was not wholly inside the sender's own slot."""

    reason = Reason.out_of_slot

    def __init__(self, schedule: Schedule, slots: Sequence[int]) -> None:
        self._schedule = schedule
        self._slots = slots

    def refuses(self, batch: Batch) -> Bools | None:
        """(T, 1)."""
        # One at a time: slotted transmissions seldom end together, and frames differ in their order.
        inside = [
            self._schedule.inside(self._slots[sender], batch.now_ns - airtime_ns, airtime_ns)
            for sender, airtime_ns in zip(batch.senders.tolist(), batch.airtimes_ns.tolist(), strict=True)
        ]
        return None if all(inside) else ~np.array(inside)[:, None]
