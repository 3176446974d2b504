"""Conversions between the units users write and the integers the emulator computes with.

Virtual time is counted in integer nanoseconds everywhere; seconds appear only where a person or
asyncio reads them.
"""

from __future__ import annotations

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
    """Time a transmission of `bits`, overhead included, occupies the air [ns], rounded up.

    Exact for any size: sender and medium agree on it to the nanosecond. 0 at unlimited bit rate (None).
    """
    if bit_rate_bps is None:
        return 0
    # A float is a ratio of integers, and only integers divide without rounding.
    bits_numerator, seconds_denominator = bit_rate_bps.as_integer_ratio()
    return -(-bits * NS_PER_S * seconds_denominator // bits_numerator)


def bits_within(duration_ns: int, bit_rate_bps: float) -> int:
    """Most bits whose airtime is no longer than a duration; exact, the inverse of `airtime_ns`."""
    bits_numerator, seconds_denominator = bit_rate_bps.as_integer_ratio()
    return duration_ns * bits_numerator // (NS_PER_S * seconds_denominator)
