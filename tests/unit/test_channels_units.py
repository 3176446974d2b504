"""Conversions of units, where rounding matters."""

from __future__ import annotations

import pytest

from channels.units import airtime_ns, to_ns, to_s


@pytest.mark.parametrize(
    ("bits", "bit_rate_bps", "expected_ns"),
    [
        (1000, None, 0),
        (0, 250_000.0, 0),
        (80, 8000.0, 10_000_000),
        (8, 250_000.0, 32_000),
        (1, 3.0, 333_333_334),  # 333 333 333.3
        (8, 7e9, 2),  # 8/7
        (1, 1e12, 1),  # a thousandth
        (3 * 10**9, 3.0, 10**18),
        (3 * 10**9 + 1, 3.0, 10**18 + 333_333_334),  # more than a float holds to the nanosecond
        (1, 0.5, 2_000_000_000),
        (12, 1000, 12_000_000),
    ],
)
def test_airtime_is_exact_and_rounded_up(bits: int, bit_rate_bps: float | None, expected_ns: int) -> None:
    assert airtime_ns(bits, bit_rate_bps) == expected_ns


def test_seconds_become_the_nearest_nanosecond() -> None:
    assert [to_ns(seconds) for seconds in (0.0, 0.1, 1e-9, 4e-10, 6e-10, 999_999.999_999_999)] == [
        0, 100_000_000, 1, 0, 1, 999_999_999_999_999,
    ]  # fmt: skip
    assert to_s(1_500_000_000) == 1.5
