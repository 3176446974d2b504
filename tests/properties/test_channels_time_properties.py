"""Clocks, slots and airtimes: what must hold for every setting."""

from __future__ import annotations

from fractions import Fraction

from hypothesis import assume, given
from hypothesis import strategies as st

from channels.clocks import LocalClock
from channels.tdma import Schedule
from channels.units import airtime_ns

S = 10**9
CLOCKS = st.builds(LocalClock, st.integers(0, 1000 * S), st.integers(-(10**8), 10**8))
SCHEDULES = (
    st.tuples(
        st.integers(1, 10**7),
        st.integers(0, 10**7),
        st.integers(1, 60),
        st.none() | st.integers(0, 2**64 - 1),
    )
    .filter(lambda parts: parts[1] < parts[0])
    .map(lambda parts: Schedule(*parts))
)


@given(CLOCKS, st.integers(0, 10**6 * S), st.integers(0, 10**6 * S))
def test_clocks_never_run_backwards(clock: LocalClock, one_ns: int, other_ns: int) -> None:
    early, late = sorted((one_ns, other_ns))
    assert clock.local(early) <= clock.local(late)


@given(CLOCKS, st.integers(-(10**6) * S, 10**6 * S))
def test_true_is_the_first_instant_of_a_reading(clock: LocalClock, local_ns: int) -> None:
    true_ns = clock.true(local_ns)
    assert clock.local(true_ns) >= local_ns
    assert true_ns == 0 or clock.local(true_ns - 1) < local_ns


@given(CLOCKS, st.integers(0, 10**6 * S))
def test_a_reading_leads_back_to_its_instant_or_before(clock: LocalClock, true_ns: int) -> None:
    assert clock.true(clock.local(true_ns)) <= true_ns


@given(SCHEDULES, st.data(), st.integers(-(10**12), 10**18))
def test_next_start_is_the_first_start(schedule: Schedule, data: st.DataObject, after_ns: int) -> None:
    slot = data.draw(st.integers(0, schedule.slots - 1))
    start_ns = schedule.next_start(slot, after_ns)
    assert after_ns <= start_ns
    frame_ns, lead_ns = schedule.frame_ns, schedule.guard_ns // 2

    def starts_in(frame: int) -> int:
        return frame * frame_ns + schedule.place(slot, frame) * schedule.slot_ns + lead_ns

    assert start_ns == min(
        start for frame in range(-2, 3) if (start := starts_in(after_ns // frame_ns + frame)) >= after_ns
    )
    if schedule.order_key is None:
        assert (start_ns - lead_ns) % frame_ns == slot * schedule.slot_ns


@given(SCHEDULES, st.integers(-(10**6), 10**12))
def test_every_slot_has_one_place_in_a_frame(schedule: Schedule, frame: int) -> None:
    places = [schedule.place(slot, frame) for slot in range(schedule.slots)]
    assert sorted(places) == list(range(schedule.slots))


@given(SCHEDULES, st.integers(0, 10**18), st.integers(0, 2 * 10**7))
def test_at_most_one_robot_may_speak(schedule: Schedule, start_ns: int, lasting_ns: int) -> None:
    may = [slot for slot in range(schedule.slots) if schedule.inside(slot, start_ns, lasting_ns)]
    assert len(may) <= 1
    # By another route: whether a boundary between two slots of the common grid lies within.
    within = start_ns % schedule.slot_ns + lasting_ns <= schedule.slot_ns
    assert bool(may) == within
    kept = [slot for slot in range(schedule.slots) if schedule.keeps_guard(slot, start_ns, lasting_ns)]
    assert set(kept) <= set(may)


@given(SCHEDULES, st.data(), st.integers(0, 10**18))
def test_what_fits_may_start_with_the_slot(schedule: Schedule, data: st.DataObject, after_ns: int) -> None:
    slot = data.draw(st.integers(0, schedule.slots - 1))
    lasting_ns = data.draw(st.integers(0, schedule.slot_ns - schedule.guard_ns))
    start_ns = schedule.next_start(slot, after_ns)
    assert schedule.fits(lasting_ns)
    assert not schedule.fits(schedule.slot_ns - schedule.guard_ns + 1)
    assert schedule.keeps_guard(slot, start_ns, lasting_ns)


@given(SCHEDULES, st.data(), st.integers(0, 10**18))
def test_a_clock_may_be_off_by_half_the_guard_either_way(
    schedule: Schedule, data: st.DataObject, after_ns: int
) -> None:
    slot = data.draw(st.integers(0, schedule.slots - 1))
    start_ns = schedule.next_start(slot, after_ns)
    longest_ns, half_ns = schedule.slot_ns - schedule.guard_ns, schedule.guard_ns // 2
    for off_ns in (-half_ns, data.draw(st.integers(-half_ns, half_ns)), half_ns):
        assert schedule.inside(slot, start_ns + off_ns, longest_ns)
    assume(longest_ns > 2)  # what is shorter may be off by so much that it is in the next slot, its own
    assert not schedule.inside(slot, start_ns - half_ns - 1, longest_ns)
    assert not schedule.inside(slot, start_ns + half_ns + 2, longest_ns)  # of an odd guard, 1 ns more is left


@given(st.integers(0, 10**15), st.floats(1e-3, 1e15))
def test_airtime_is_the_first_nanosecond_that_is_long_enough(bits: int, bit_rate_bps: float) -> None:
    sent_ns = airtime_ns(bits, bit_rate_bps)
    exact_ns = Fraction(bits) * S / Fraction(bit_rate_bps)
    assert exact_ns <= sent_ns < exact_ns + 1
