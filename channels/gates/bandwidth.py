"""Bit rate and the transmit queue: how long a message takes, and whether it leaves its sender."""

from __future__ import annotations

from collections import deque

import numpy as np

from channels.fates import Batch, Bools, Reason
from channels.units import NS_PER_S


def airtime_ns(payload_bytes: int, overhead_bits: int, bit_rate_bps: float | None) -> int:
    """Time a message occupies the radio, rounded up to whole nanoseconds; 0 at unlimited bit rate."""
    if bit_rate_bps is None:
        return 0
    # A float is a ratio of integers: dividing exactly keeps large messages free of rounding.
    bits_numerator, seconds_denominator = bit_rate_bps.as_integer_ratio()
    bits = 8 * payload_bytes + overhead_bits
    return -(-bits * NS_PER_S * seconds_denominator // bits_numerator)


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
