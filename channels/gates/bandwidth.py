"""The transmit queue: when a message leaves its sender, and whether it does."""

from __future__ import annotations

from collections import deque

import numpy as np

from channels.fates import Batch, Bools, Reason


class TransmitQueues:
    """Each sender's radio: one transmission after the other, and few may wait.

    Instants given for one sender never decrease.
    """

    def __init__(self, robots: int, capacity: int) -> None:
        self._capacity = capacity
        self._ends: list[deque[int]] = [deque() for _ in range(robots)]

    def admit(self, sender: int, now_ns: int, airtime_ns: int) -> int | None:
        """Start of a message handed over now, or None: `capacity` messages have not ended yet."""
        ends = self._ends[sender]
        while ends and ends[0] <= now_ns:
            ends.popleft()
        if len(ends) >= self._capacity:
            return None
        start_ns = ends[-1] if ends else now_ns
        ends.append(start_ns + airtime_ns)
        return start_ns


class QueueGate:
    """Refuses, at every receiver, what never left its sender's queue."""

    reason = Reason.queue_full

    def refuses(self, batch: Batch) -> Bools | None:
        """(T, 1)."""
        return batch.refused[:, None] if np.count_nonzero(batch.refused) else None
