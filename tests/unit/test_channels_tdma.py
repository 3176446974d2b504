"""Slots: three robots, slots of 10 ns of which the last 2 ns are silent; a frame lasts 30 ns."""

from __future__ import annotations

import numpy as np
import pytest

from channels.settings import TdmaSettings
from channels.tdma import Schedule, schedule_of, slot_order

SCHEDULE = Schedule(slot_ns=10, guard_ns=2, slots=3)


def test_slots_begin_one_after_the_other() -> None:
    starts = [(SCHEDULE.next_start(slot, 0), slot) for slot in range(3)]
    assert starts == [(0, 0), (10, 1), (20, 2)]
    assert SCHEDULE.frame_ns == 30


@pytest.mark.parametrize(
    ("after_ns", "start_ns"),
    [
        (0, 10),
        (9, 10),
        (10, 10),
        (11, 40),
        (39, 40),
        (40, 40),
        (41, 70),
        (10**18, 10**18),
        (-5, 10),
        (-25, -20),
    ],
)
def test_next_start_of_slot_1(after_ns: int, start_ns: int) -> None:
    assert SCHEDULE.next_start(1, after_ns) == start_ns


@pytest.mark.parametrize(
    ("start_ns", "airtime_ns", "inside"),
    [
        (9, 1, False),  # still slot 0
        (10, 0, True),
        (10, 8, True),  # up to the guard
        (10, 9, False),  # into the guard
        (17, 1, True),
        (18, 0, True),
        (18, 1, False),
        (19, 0, False),
        (20, 0, False),  # slot 2 already
        (40, 8, True),  # the next frame
        (43, 30, False),  # ends in a slot of its own, but not in the same one
    ],
)
def test_inside_slot_1(start_ns: int, airtime_ns: int, inside: bool) -> None:
    assert SCHEDULE.inside(1, start_ns, airtime_ns) == inside


def test_inside_answers_for_arrays() -> None:
    slots, starts, airtimes = np.array([0, 1, 2]), np.array([0, 15, 29]), np.array([8, 4, 0])
    assert SCHEDULE.inside(slots, starts, airtimes).tolist() == [True, False, False]
    assert SCHEDULE.inside(np.array([0, 1, 2]), 10, np.array([1, 1, 1])).tolist() == [False, True, False]


def test_without_guard_the_end_of_a_slot_belongs_to_the_next() -> None:
    schedule = Schedule(slot_ns=10, guard_ns=0, slots=2)
    assert not schedule.inside(0, 10, 0)
    assert schedule.inside(1, 10, 0)


def test_what_fits() -> None:
    assert [bool(SCHEDULE.fits(airtime)) for airtime in (0, 8, 9)] == [True, True, False]
    assert SCHEDULE.fits(np.array([8, 9])).tolist() == [True, False]


@pytest.mark.parametrize(("slot", "guard", "slots"), [(0, 0, 1), (10, 10, 1), (10, -1, 1), (10, 0, 0)])
def test_schedules_in_which_nobody_could_speak_are_refused(slot: int, guard: int, slots: int) -> None:
    with pytest.raises(ValueError, match=r"guard|slots"):
        Schedule(slot, guard, slots)


def test_schedule_of_settings() -> None:
    assert schedule_of(TdmaSettings(slot_s=0.01, guard_s=0.001), 5) == Schedule(10_000_000, 1_000_000, 5)


def test_fixed_order_is_robot_order() -> None:
    assert slot_order(TdmaSettings(slot_s=1), ["b", "a", "c"], seed=1) == [0, 1, 2]


def test_drawn_order_is_a_permutation_that_follows_the_robots_not_their_order() -> None:
    settings = TdmaSettings(slot_s=1, order="drawn")
    robots = [f"r{index}" for index in range(20)]
    slots = slot_order(settings, robots, seed=1)
    assert sorted(slots) == list(range(20))
    assert slots != list(range(20))
    assert slot_order(settings, robots[::-1], seed=1) == slots[::-1]
    assert slot_order(settings, robots, seed=2) != slots


def test_one_more_robot_leaves_the_drawn_order_of_the_others() -> None:
    settings = TdmaSettings(slot_s=1, order="drawn")
    robots = [f"r{index}" for index in range(20)]
    before = slot_order(settings, robots, seed=1)
    after = slot_order(settings, [*robots, "new"], seed=1)
    assert after != [*before, 20]
    ranks = sorted(range(20), key=before.__getitem__)
    assert sorted(range(20), key=after.__getitem__) == ranks
