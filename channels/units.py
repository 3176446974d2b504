"""Conversions between the units users write and the integers the emulator computes with.

Virtual time is counted in integer nanoseconds everywhere; seconds appear only where a person or
asyncio reads them.
"""

from __future__ import annotations

import math

NS_PER_S = 1_000_000_000

MAX_TIME_NS = 1_000_000 * NS_PER_S
"""Latest virtual instant, 11.6 days: beyond it a float of seconds no longer resolves 1 ns."""


def to_ns(seconds: float) -> int:
    """Nearest integer nanosecond to a duration or instant in seconds."""
    return round(seconds * NS_PER_S)


def to_s(nanoseconds: int) -> float:
    """Seconds as the float nearest to an integer number of nanoseconds."""
    return nanoseconds / NS_PER_S


def airtime_ns(bits: int, bit_rate_bps: float | None) -> int:
    """Time a transmission of `bits` occupies the air, rounded up; 0 at unlimited bit rate (None)."""
    return 0 if bit_rate_bps is None else math.ceil(bits * NS_PER_S / bit_rate_bps)
