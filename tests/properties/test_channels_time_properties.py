"""Clocks, slots and airtimes: what must hold for every setting."""

from __future__ import annotations

from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st

from channels.clocks import LocalClock
from channels.tdma import Schedule
from channels.units import airtime_ns

S = 10**9
CLOCKS = st.builds(LocalClock, st.integers(0, 1000 * S), st.integers(-(10**8), 10**8))
SCHEDULES = (
    st.tuples(st.integers(1, 10**7), st.integers(0, 10**7), st.integers(1, 300))
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
    assert after_ns <= start_ns < after_ns + schedule.frame_ns
    assert start_ns % schedule.frame_ns == slot * schedule.slot_ns


@given(SCHEDULES, st.data(), st.integers(0, 10**18), st.integers(0, 2 * 10**7))
def test_at_most_one_robot_may_speak(
    schedule: Schedule, data: st.DataObject, start_ns: int, lasting_ns: int
) -> None:
    may = [slot for slot in range(schedule.slots) if schedule.inside(slot, start_ns, lasting_ns)]
    assert len(may) <= 1
    if may:
        assert schedule.fits(lasting_ns)
        assert not schedule.inside(may[0], start_ns + schedule.slot_ns, lasting_ns) or schedule.slots == 1


@given(SCHEDULES, st.data(), st.integers(0, 10**18))
def test_what_fits_may_start_with_the_slot(schedule: Schedule, data: st.DataObject, after_ns: int) -> None:
    slot = data.draw(st.integers(0, schedule.slots - 1))
    lasting_ns = data.draw(st.integers(0, schedule.slot_ns))
    start_ns = schedule.next_start(slot, after_ns)
    assert schedule.inside(slot, start_ns, lasting_ns) == schedule.fits(lasting_ns)


@given(st.integers(0, 10**15), st.floats(1e-3, 1e15))
def test_airtime_is_the_first_nanosecond_that_is_long_enough(bits: int, bit_rate_bps: float) -> None:
    sent_ns = airtime_ns(bits, bit_rate_bps)
    exact_ns = Fraction(bits) * S / Fraction(bit_rate_bps)
    assert exact_ns <= sent_ns < exact_ns + 1
