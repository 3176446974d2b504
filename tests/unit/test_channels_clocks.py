"""Clocks that are ahead, fast or slow, in numbers a reader can check by hand."""

from __future__ import annotations

import pytest

from channels.clocks import LocalClock, draw_clocks
from channels.settings import ClockSettings

S = 1_000_000_000
ROBOTS = [f"r{index:02}" for index in range(200)]


def test_perfect_clock_reads_true_time() -> None:
    clock = LocalClock()
    assert [clock.local(t) for t in (0, 1, 5 * S)] == [0, 1, 5 * S]
    assert [clock.true(t) for t in (0, 1, 5 * S)] == [0, 1, 5 * S]


def test_fast_clock_that_started_ahead() -> None:
    clock = LocalClock(offset_ns=500, drift_ppb=20_000)  # 20 ppm: 20 us a second
    assert [clock.local(t) for t in (0, 1, S, 10 * S)] == [500, 501, S + 20_500, 10 * S + 200_500]
    assert clock.true(S + 20_500) == S
    assert clock.true(0) == 0  # it never read so little: the smallest true instant is the start


def test_slow_clock_reads_the_same_twice_and_wakes_at_the_first() -> None:
    clock = LocalClock(drift_ppb=-100_000_000)  # nine ticks in ten nanoseconds
    assert [clock.local(t) for t in range(12)] == [0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9]
    assert [clock.true(reading) for reading in range(10)] == [0, 2, 3, 4, 5, 6, 7, 8, 9, 10]


def test_fast_clock_skips_a_reading() -> None:
    clock = LocalClock(drift_ppb=100_000_000)  # eleven ticks in ten nanoseconds
    assert [clock.local(t) for t in (8, 9, 10, 11)] == [8, 9, 11, 12]
    assert [clock.true(reading) for reading in (9, 10, 11)] == [9, 10, 10]


def test_a_clock_must_run_forwards() -> None:
    with pytest.raises(ValueError, match="forwards"):
        LocalClock(drift_ppb=-1_000_000_000)


def test_without_imperfection_all_clocks_are_perfect() -> None:
    assert draw_clocks(ClockSettings(), ROBOTS, seed=1) == [LocalClock()] * len(ROBOTS)


def test_drawn_clocks_stay_within_their_bounds_and_use_them() -> None:
    clocks = draw_clocks(ClockSettings(drift_ppm=0.002, offset_s=3e-9), ROBOTS, seed=1)
    assert {clock.drift_ppb for clock in clocks} == {-2, -1, 0, 1, 2}
    assert {clock.offset_ns for clock in clocks} == {0, 1, 2}


def test_a_clock_is_a_matter_of_name_and_seed_alone() -> None:
    settings = ClockSettings(drift_ppm=50, offset_s=1)
    clocks = draw_clocks(settings, ["a", "b", "c"], seed=1)
    assert draw_clocks(settings, ["c", "new", "a"], seed=1)[::2] == [clocks[2], clocks[0]]
    assert draw_clocks(settings, ["a", "b", "c"], seed=2) != clocks


def test_drift_and_offset_are_drawn_apart() -> None:
    clocks = draw_clocks(ClockSettings(drift_ppm=1000, offset_s=0.002), ROBOTS, seed=1)
    assert any(clock.offset_ns - 1_000_000 > 0 > clock.drift_ppb for clock in clocks)
    assert any(clock.offset_ns - 1_000_000 < 0 < clock.drift_ppb for clock in clocks)
