"""Transmissions at the same time, on teams small enough to judge by eye; times in nanoseconds.

Unless a test says otherwise a, b, c, d, e stand on a line 4 m apart and the radio reaches 5 m: each hears
its neighbours only.
"""

from __future__ import annotations

import numpy as np
import pytest

from channels.settings import TdmaSettings
from tests.traffic import Heard, Send, medium_of, play

A, B, C, D, E = range(5)
LINE = np.array([[4.0 * index, 0.0] for index in range(5)])
OUT, ME, OK, HIT, BUSY = "out_of_range", "not_a_candidate", "delivered", "collision", "half_duplex"


def fates(*sends: Send, positions: object = LINE, **settings: object) -> dict[tuple[int, int], Heard]:
    where = np.asarray(positions)
    return play(medium_of(len(where), **settings), sends, lambda _now: where)


def test_one_alone_is_heard_by_all_in_range() -> None:
    assert fates(Send(3, B, 10)) == {(B, 0): Heard(13, [OK, ME, OK, OUT, OUT])}


def test_hidden_terminals_collide_between_them_and_nowhere_else() -> None:
    found = fates(Send(0, B, 10), Send(5, D, 10))
    assert found == {
        (B, 0): Heard(10, [OK, ME, HIT, OUT, OUT]),
        (D, 0): Heard(15, [OUT, OUT, HIT, ME, OK]),
    }


def test_exposed_terminals_do_no_harm() -> None:
    # b and c hear each other, which spoils nothing for a and d.
    found = fates(Send(0, B, 10), Send(0, C, 10))
    assert found[B, 0].reasons == [OK, ME, BUSY, OUT, OUT]
    assert found[C, 0].reasons == [OUT, BUSY, ME, OK, OUT]


@pytest.mark.parametrize(
    ("start_ns", "airtime_ns", "harm"),
    [
        (0, 10, False),  # ends as the other begins
        (0, 11, True),
        (10, 10, True),  # the same times
        (12, 3, True),  # inside
        (5, 30, True),  # around
        (10, 1, True),  # begins with it
        (19, 1, True),  # ends with it
        (19, 20, True),
        (20, 5, False),  # begins as the other ends
        (10, 0, False),  # an instant at either end touches it
        (20, 0, False),
        (15, 0, True),  # but not one in its midst
    ],
)
@pytest.mark.parametrize("swapped", [False, True])
def test_only_what_shares_some_time_collides(
    start_ns: int, airtime_ns: int, harm: bool, swapped: bool
) -> None:
    one, other = (D, B) if swapped else (B, D)
    found = fates(Send(10, one, 10), Send(start_ns, other, airtime_ns))
    assert [found[robot, 0].reasons[C] for robot in (one, other)] == [HIT if harm else OK] * 2
    assert [found[robot, 0].ended_ns for robot in (one, other)] == [20, start_ns + airtime_ns]


def test_one_that_ended_as_another_began_does_no_harm_while_a_third_goes_on() -> None:
    found = fates(Send(0, B, 10), Send(10, D, 10), Send(0, E, 100))  # c does not hear e
    assert [found[robot, 0].reasons[C] for robot in (B, D)] == [OK, OK]


def test_one_that_ended_long_ago_still_counts_for_one_that_began_before_it_did() -> None:
    # d talks all the time, b in short words at its beginning, in its midst and at its end.
    found = fates(Send(0, D, 100), Send(0, B, 2), Send(50, B, 2), Send(98, B, 2), Send(100, B, 2))
    assert found[D, 0].reasons == [OUT, OUT, HIT, ME, OK]
    assert [found[B, seq].reasons[C] for seq in range(4)] == [HIT, HIT, HIT, OK]


def test_what_is_over_is_forgotten() -> None:
    found = fates(Send(0, B, 5), Send(5, D, 5), Send(10, B, 5), Send(15, D, 5), Send(15, B, 5))
    assert [found[D, seq].reasons[C] for seq in range(2)] == [OK, HIT]
    assert [found[B, seq].reasons[C] for seq in range(3)] == [OK, OK, HIT]


def test_a_chain_of_overlaps() -> None:
    # b overlaps d, d overlaps a later word of b, and the two of b have nothing to do with each other.
    found = fates(Send(0, B, 10), Send(8, D, 10), Send(16, B, 10), Send(26, D, 4))
    assert [found[B, 0].reasons[C], found[D, 0].reasons[C], found[B, 1].reasons[C]] == [HIT] * 3
    assert found[D, 1].reasons[C] == OK


def test_three_at_once() -> None:
    star = [[0.0, 0.0], [4.0, 0.0], [-4.0, 0.0], [0.0, 4.0], [0.0, -4.0]]  # a in the middle hears all
    found = fates(Send(0, B, 10), Send(3, C, 10), Send(6, D, 10), positions=star)
    assert [found[robot, 0].reasons[A] for robot in (B, C, D)] == [HIT] * 3
    assert [found[robot, 0].reasons[E] for robot in (B, C, D)] == [OUT] * 3


def test_nearer_is_no_better() -> None:
    positions = [[0.0, 0.0], [0.1, 0.0], [5.0, 0.0]]
    found = fates(Send(0, B, 10), Send(0, C, 10), positions=positions)
    assert found[B, 0].reasons == [HIT, ME, BUSY]
    assert found[C, 0].reasons == [HIT, BUSY, ME]


def test_a_disturber_at_exactly_the_range_disturbs_and_beyond_does_not() -> None:
    for far_m, fate in ((5.0, HIT), (5.001, OK)):
        positions = [[0.0, 0.0], [-1.0, 0.0], [far_m, 0.0]]
        assert fates(Send(0, B, 10), Send(0, C, 10), positions=positions)[B, 0].reasons[A] == fate


def test_altitude_takes_a_disturber_out_of_range() -> None:
    positions, sends = [[0.0, 0.0], [-1.0, 0.0], [3.0, 0.0]], (Send(0, B, 10), Send(0, C, 10))
    assert fates(*sends, positions=positions)[B, 0].reasons[A] == HIT
    assert fates(*sends, positions=positions, altitudes_m=[0, 0, 4.1])[B, 0].reasons[A] == OK
    assert fates(*sends, positions=positions, altitudes_m=[0, 0, 4.0])[B, 0].reasons[A] == HIT


@pytest.mark.parametrize(
    ("start_ns", "airtime_ns", "busy"),
    [(0, 10, False), (0, 11, True), (12, 1, True), (19, 9, True), (20, 9, False)],
)
def test_nobody_hears_while_it_speaks(start_ns: int, airtime_ns: int, busy: bool) -> None:
    found = fates(Send(10, A, 10), Send(start_ns, B, airtime_ns))
    assert found[A, 0].reasons[B] == (BUSY if busy else OK)
    assert found[B, 0].reasons[A] == (BUSY if busy else OK)
    assert found[B, 0].reasons[C] == OK


def test_speaking_names_the_reason_before_a_collision_does() -> None:
    # c speaks, and would have been between b and d.
    found = fates(Send(0, B, 10), Send(0, C, 10), Send(0, D, 10))
    assert found[B, 0].reasons == [OK, ME, BUSY, OUT, OUT]
    assert found[D, 0].reasons == [OUT, OUT, BUSY, ME, OK]


def test_own_messages_follow_each_other_and_do_not_collide() -> None:
    found = fates(Send(0, B, 10), Send(0, B, 10), Send(3, B, 10))
    assert [found[B, seq].ended_ns for seq in range(3)] == [10, 20, 30]
    assert [found[B, seq].reasons for seq in range(3)] == [[OK, ME, OK, OUT, OUT]] * 3


def test_a_message_that_waits_for_its_senders_radio_collides_when_it_is_sent() -> None:
    # The second of b is handed over with the first, long before d speaks.
    found = fates(Send(0, B, 10), Send(0, B, 10), Send(12, D, 3))
    assert [found[B, seq].reasons[C] for seq in range(2)] == [OK, HIT]
    assert found[D, 0].reasons[C] == HIT


@pytest.mark.parametrize("airtime_ns", [0, 10])
def test_what_found_no_place_in_the_queue_disturbs_nobody(airtime_ns: int) -> None:
    found = fates(Send(0, D, 10), Send(5, B, 10), Send(7, B, airtime_ns), queue=1)
    assert found[B, 1] == Heard(7, ["queue_full", ME, "queue_full", OUT, OUT])
    assert found[B, 0].reasons[C] == HIT
    alone = fates(Send(0, D, 10), Send(2, B, airtime_ns, refused=True))
    assert alone[B, 0] == Heard(2, ["queue_full", ME, "queue_full", OUT, OUT])
    assert alone[D, 0].reasons == [OUT, OUT, OK, ME, OK]


def test_what_is_out_of_its_slot_disturbs_like_any_other() -> None:
    tdma = {"access": "tdma", "tdma": TdmaSettings(slot_s=10e-9)}
    # b owns 10..20; d, whose slot is 30..40, speaks in it.
    found = fates(Send(12, B, 5), Send(14, D, 4), **tdma)
    assert found[D, 0].reasons == [OUT, OUT, "out_of_slot", ME, "out_of_slot"]
    assert found[B, 0].reasons == [OK, ME, HIT, OUT, OUT]


def test_what_is_too_long_for_any_slot_disturbs_like_any_other() -> None:
    tdma = {"access": "tdma", "tdma": TdmaSettings(slot_s=10e-9)}
    found = fates(Send(0, D, 11), Send(10, B, 5), **tdma)
    assert found[D, 0].reasons == [OUT, OUT, "too_long", ME, "too_long"]
    assert found[B, 0].reasons == [OK, ME, HIT, OUT, OUT]


def test_places_are_those_at_the_end_of_what_is_judged() -> None:
    # d leaves at 12: too late for the word of b that ends at 10, in time for the one that ends at 14.
    gone = LINE.copy()
    gone[D] = [0.0, 100.0]
    sends = [Send(0, D, 20), Send(0, B, 10), Send(10, B, 4)]
    found = play(medium_of(5), sends, lambda now_ns: LINE if now_ns < 12 else gone)
    assert [found[B, seq].reasons[C] for seq in range(2)] == [HIT, OK]
    assert found[D, 0].reasons == [OUT, OUT, OUT, ME, OUT]


def test_without_the_setting_nothing_collides() -> None:
    found = fates(Send(0, B, 10), Send(0, C, 10), Send(0, D, 10), collisions=False)
    assert {reason for fate in found.values() for reason in fate.reasons} == {OK, ME, OUT}


def test_without_a_bit_rate_messages_take_no_time_and_none_collide() -> None:
    found = fates(Send(0, B, 10), Send(0, C, 10), Send(0, D, 10), bit_rate_bps=None)
    assert {reason for fate in found.values() for reason in fate.reasons} == {OK, ME, OUT}
    assert {fate.ended_ns for fate in found.values()} == {0}
