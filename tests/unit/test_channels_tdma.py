"""Slots: three robots, slots of 10 ns of which the first and the last are silent; a frame lasts 30 ns."""

from __future__ import annotations

import numpy as np
import pytest

from channels.randomness import Draws
from channels.settings import RadioSettings, TdmaSettings, payload_limit
from channels.tdma import Schedule, schedule_of, slot_length_ns, slot_order

SCHEDULE = Schedule(slot_ns=10, guard_ns=2, slots=3)


def radio(**tdma: object) -> RadioSettings:
    """A radio of the paper's bit rate, with slots."""
    return RadioSettings(1.0, "tdma", TdmaSettings(**tdma), bit_rate_bps=3000.0)  # type: ignore[arg-type]


def test_slots_begin_one_after_the_other_each_with_half_the_guard() -> None:
    starts = [(SCHEDULE.next_start(slot, 0), slot) for slot in range(3)]
    assert starts == [(1, 0), (11, 1), (21, 2)]
    assert SCHEDULE.frame_ns == 30


@pytest.mark.parametrize(("guard_ns", "lead_ns"), [(0, 0), (1, 0), (2, 1), (3, 1), (8, 4), (9, 4)])
def test_of_an_odd_guard_the_end_has_the_larger_half(guard_ns: int, lead_ns: int) -> None:
    schedule = Schedule(10, guard_ns, 2)
    assert schedule.lead_ns == lead_ns
    assert schedule.next_start(1, 0) == 10 + lead_ns


@pytest.mark.parametrize(
    ("after_ns", "start_ns"),
    [
        (0, 11),
        (10, 11),
        (11, 11),
        (12, 41),
        (40, 41),
        (41, 41),
        (42, 71),
        (10**18, 10**18 + 1),  # 10**18 is 10 past the beginning of a frame
        (-5, 11),
        (-18, 11),
        (-19, -19),
        (-25, -19),
    ],
)
def test_next_start_of_slot_1(after_ns: int, start_ns: int) -> None:
    assert SCHEDULE.next_start(1, after_ns) == start_ns


@pytest.mark.parametrize(
    ("start_ns", "airtime_ns", "inside"),
    [
        (9, 1, False),  # still slot 0
        (9, 2, False),
        (10, 0, True),
        (10, 8, True),
        (10, 10, True),  # whoever keeps no guard does not leave its slot
        (11, 8, True),
        (12, 8, True),
        (12, 9, False),  # into slot 2
        (19, 1, True),
        (19, 0, True),
        (20, 0, False),  # slot 2 already
        (39, 1, False),
        (40, 8, True),  # the next frame
        (43, 30, False),  # ends in a slot of its own, but not in the same one
    ],
)
def test_inside_slot_1(start_ns: int, airtime_ns: int, inside: bool) -> None:
    assert SCHEDULE.inside(1, start_ns, airtime_ns) == inside


@pytest.mark.parametrize(
    ("start_ns", "airtime_ns", "keeps"),
    [
        (9, 1, False),
        (12, 1, False),  # the first three are silent
        (13, 0, True),
        (13, 4, True),  # up to the guard
        (14, 4, True),  # where a fast clock has skipped 13
        (15, 4, False),
        (17, 1, True),
        (18, 1, False),
        (19, 0, False),
        (20, 0, False),
        (43, 4, True),  # the next frame
    ],
)
def test_keeping_the_guard_of_slot_1(start_ns: int, airtime_ns: int, keeps: bool) -> None:
    # 6 of 10 ns are guard: a message has 13..17, and one nanosecond is forgiven
    assert Schedule(10, 6, 3).keeps_guard(1, start_ns, airtime_ns) == keeps


def test_without_guard_the_end_of_a_slot_belongs_to_the_next() -> None:
    schedule = Schedule(slot_ns=10, guard_ns=0, slots=2)
    for rule in (schedule.inside, schedule.keeps_guard):
        assert not rule(0, 10, 0)
        assert rule(1, 10, 0)
        assert rule(1, 10, 10)
        assert not rule(1, 10, 11)


def test_what_fits() -> None:
    assert [bool(SCHEDULE.fits(airtime)) for airtime in (0, 8, 9)] == [True, True, False]
    assert SCHEDULE.fits(np.array([8, 9])).tolist() == [True, False]


@pytest.mark.parametrize(("slot", "guard", "slots"), [(0, 0, 1), (10, 10, 1), (10, -1, 1), (10, 0, 0)])
def test_schedules_in_which_nobody_could_speak_are_refused(slot: int, guard: int, slots: int) -> None:
    with pytest.raises(ValueError, match=r"guard|slots"):
        Schedule(slot, guard, slots)


def test_schedule_of_settings() -> None:
    assert schedule_of(radio(slot_s=0.01, guard_s=0.001), 5, seed=1) == Schedule(10_000_000, 1_000_000, 5)
    with pytest.raises(ValueError, match="no tdma settings"):
        schedule_of(RadioSettings(1.0, "tdma"), 5, seed=1)


@pytest.mark.parametrize(("units", "frame_rate_hz"), [(1, 1.736), (3, 0.579), (9, 0.193)])
def test_frame_rates_of_the_paper(units: int, frame_rate_hz: float) -> None:
    """Julian et al. 2009, sec. 4: 3000 bit/s, estimates of 192 bits, nine robots."""
    schedule = schedule_of(radio(units=units, unit_bits=192), 9, seed=1)
    assert schedule.slot_ns == units * 64_000_000
    assert round(1e9 / schedule.frame_ns, 3) == frame_rate_hz


def test_a_slot_of_units_has_room_for_overhead_and_guard_beside_them() -> None:
    settings = RadioSettings(
        1.0, "tdma", TdmaSettings(units=2, unit_bits=100, guard_s=0.25), bit_rate_bps=1000.0, overhead_bits=50
    )
    schedule = schedule_of(settings, 3, seed=1)
    assert (schedule.slot_ns, schedule.guard_ns) == (500_000_000, 250_000_000)
    assert schedule.fits(250_000_000)
    assert not schedule.fits(250_000_001)
    assert payload_limit(settings) == 25


def test_the_limit_of_a_payload_follows_the_units_only_where_there_are_slots_of_units() -> None:
    units = TdmaSettings(units=2, unit_bits=100)
    assert payload_limit(RadioSettings(1.0, "tdma", units)) == 25
    assert payload_limit(RadioSettings(1.0, "tdma", units, max_payload_bytes=7)) == 7
    assert payload_limit(RadioSettings(1.0, "ideal", units)) == 1024
    assert payload_limit(RadioSettings(1.0, "tdma", TdmaSettings(slot_s=1.0))) == 1024
    assert payload_limit(RadioSettings(1.0, "tdma", TdmaSettings(units=10**9, unit_bits=8))) == 65_536


@pytest.mark.parametrize("tdma", [TdmaSettings(), TdmaSettings(units=3), TdmaSettings(unit_bits=192)])
def test_slots_of_no_length_are_refused(tdma: TdmaSettings) -> None:
    with pytest.raises(ValueError, match=r"neither a length nor units|have no size"):
        slot_length_ns(radio(), tdma)


@pytest.mark.parametrize("slots", [1, 2, 7, 100])
def test_every_frame_drawn_anew_is_a_permutation(slots: int) -> None:
    schedule = schedule_of(radio(units=1, unit_bits=192, order="drawn_each_frame"), slots, seed=1)
    orders = [tuple(schedule.place(slot, frame) for slot in range(slots)) for frame in range(-2, 30)]
    assert all(sorted(order) == list(range(slots)) for order in orders)
    assert len(set(orders)) > (30 if slots > 6 else min(slots, 2) - 1)


def test_every_slot_is_at_every_place_equally_often() -> None:
    schedule = schedule_of(radio(units=1, unit_bits=192, order="drawn_each_frame"), 5, seed=3)
    frames = 4000
    counts = np.zeros((5, 5))
    for frame in range(frames):
        for slot in range(5):
            counts[slot, schedule.place(slot, frame)] += 1
    assert abs(counts - frames / 5).max() < 5 * np.sqrt(frames * 0.2 * 0.8)


def test_an_order_drawn_each_frame_is_a_function_of_its_key() -> None:
    tdma = {"units": 1, "unit_bits": 192, "order": "drawn_each_frame"}
    one, same, other = (schedule_of(radio(**tdma), 8, seed) for seed in (1, 1, 2))
    assert one == same
    # Robots are told the key, and no seed.
    told = Schedule(one.slot_ns, one.guard_ns, one.slots, one.order_key)
    frames = [400, 3, 10**9, 0, 3]
    assert [told.place(2, frame) for frame in frames] == [one.place(2, frame) for frame in frames]
    assert any(one.place(2, frame) != other.place(2, frame) for frame in range(20))
    # By another route: the slot whose draw is the k-th smallest is at place k.
    assert one.order_key is not None
    draws = Draws.of_key(one.order_key).bits(17, np.arange(8)).tolist()
    assert [one.place(slot, 17) for slot in range(8)] == [sum(d < draw for d in draws) for draw in draws]


def test_the_next_start_may_be_soon_or_almost_two_frames_away() -> None:
    schedule = Schedule(10, 2, 4, order_key=99)
    for slot in range(4):
        starts = [40 * frame + 10 * schedule.place(slot, frame) + 1 for frame in range(20)]
        found = [schedule.next_start(slot, 0)]
        while len(found) < 20:
            found.append(schedule.next_start(slot, found[-1] + 1))
        assert found == starts
        gaps = np.diff(starts)
        assert (gaps.min() < 40, gaps.max() > 40, gaps.max() <= 70) == (True, True, True)


def test_fixed_order_is_robot_order() -> None:
    assert slot_order(TdmaSettings(slot_s=1), ["b", "a", "c"], seed=1) == [0, 1, 2]


def test_an_order_drawn_for_each_frame_leaves_robots_their_numbers() -> None:
    assert slot_order(TdmaSettings(slot_s=1, order="drawn_each_frame"), ["b", "a", "c"], seed=1) == [0, 1, 2]


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
