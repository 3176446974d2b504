"""Each gate of the radio medium on a team small enough to judge by eye.

Robots a, b, c, d stand on a line at 0, 3, 5 and 9 m; the radio reaches 5 m unless a test says otherwise.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from channels.medium import Fates, Medium, Reason
from channels.randomness import Draws, stable_key
from channels.settings import RadioSettings, TdmaSettings

ROBOTS = ["a", "b", "c", "d"]
LINE = np.array([[0.0, 0.0], [3.0, 0.0], [5.0, 0.0], [9.0, 0.0]])
ME = Reason.not_a_candidate.name
MS = 1_000_000


def medium(seed: int = 1, robots: list[str] = ROBOTS, **settings: Any) -> Medium:
    return Medium(RadioSettings(**{"range_m": 5.0, **settings}), robots, seed)


def transmit(
    radio: Medium,
    senders: list[int],
    *,
    now_ns: int = 0,
    seqs: list[int] | None = None,
    airtimes_ns: list[int] | None = None,
    refused: list[bool] | None = None,
    positions: Any = LINE,
    off: tuple[int, ...] = (),
) -> Fates:
    number = len(senders)
    listening = np.ones(len(positions), dtype=bool)
    listening[list(off)] = False
    return radio.transmit(
        now_ns,
        np.array(senders, dtype=np.int64),
        np.array(seqs or [0] * number, dtype=np.int64),
        np.array(airtimes_ns or [0] * number, dtype=np.int64),
        np.array(refused or [False] * number, dtype=bool),
        positions,
        listening,
    )


def names(fates: Fates) -> list[list[str]]:
    return [[Reason(code).name for code in row] for row in fates.reason.tolist()]


def test_codes_are_those_of_the_log() -> None:
    assert {reason.name: int(reason) for reason in Reason} == {
        "delivered": 0,
        "out_of_range": 1,
        "queue_full": 2,
        "out_of_slot": 3,
        "too_long": 4,
        "loss": 5,
        "receiver_down": 6,
        "half_duplex": 7,
        "collision": 8,
        "burst": 9,
        "no_line_of_sight": 10,
        "not_a_candidate": 255,
    }


def test_range_includes_its_edge() -> None:
    fates = transmit(medium(), [0, 1, 2, 3])
    assert names(fates) == [
        [ME, "delivered", "delivered", "out_of_range"],
        ["delivered", ME, "delivered", "out_of_range"],
        ["delivered", "delivered", ME, "delivered"],
        ["out_of_range", "out_of_range", "delivered", ME],
    ]
    assert fates.reason.dtype == np.uint8
    assert fates.delay_ns.dtype == np.int64


def test_range_is_euclidean() -> None:
    positions = np.array([[1.0, 1.0], [4.0, 5.0], [4.0, -3.0], [4.0, 5.001]])
    assert names(transmit(medium(), [0], positions=positions)) == [
        [ME, "delivered", "delivered", "out_of_range"]
    ]


def test_range_is_three_dimensional_where_robots_have_altitudes() -> None:
    # b is 3 m from a on the ground: 4 m higher it is at the very edge, deeper as well as higher.
    for altitudes_m, fate in (
        ([0.0, 4.0, 0.0, 0.0], "delivered"),
        ([0.0, -4.0, 0.0, 0.0], "delivered"),
        ([7.0, 11.0, 0.0, 0.0], "delivered"),
        ([0.0, 4.001, 0.0, 0.0], "out_of_range"),
        ([0.0, -4.001, 0.0, 0.0], "out_of_range"),
    ):
        radio = Medium(RadioSettings(range_m=5.0), ROBOTS, 1, altitudes_m=altitudes_m)
        for _ in range(3):  # rows of the senders, the whole matrix, and what is remembered of it
            assert names(transmit(radio, [0, 1]))[0][1] == fate
            assert names(transmit(radio, [0, 1]))[1][0] == fate


def test_at_one_altitude_range_is_what_it_is_on_the_ground() -> None:
    high = Medium(RadioSettings(range_m=5.0), ROBOTS, 1, altitudes_m=[120.0] * 4)
    assert names(transmit(high, [0, 1, 2, 3])) == names(transmit(medium(), [0, 1, 2, 3]))


def test_range_follows_the_robots_and_remembers_those_that_stand() -> None:
    radio = medium()
    there, gone = LINE.copy(), LINE.copy()
    gone[1] = [0.0, 100.0]
    # Each first time its own rows, then the whole matrix, then the matrix again; for other senders, too.
    for positions, fate in ((there, "delivered"), (gone, "out_of_range"), (there, "delivered")):
        for _ in range(3):
            assert names(transmit(radio, [0], positions=positions))[0][1] == fate
            assert names(transmit(radio, [2, 0], positions=positions))[1][1] == fate


def test_a_refused_message_is_heard_by_nobody_in_range() -> None:
    fates = transmit(medium(), [0, 0], refused=[True, False])
    assert names(fates) == [
        [ME, "queue_full", "queue_full", "out_of_range"],
        [ME, "delivered", "delivered", "out_of_range"],
    ]


@pytest.mark.parametrize(
    ("start_ms", "airtime_ms", "heard"),
    [
        (9, 1, False),  # still in the slot of a
        (9, 2, False),
        (10, 8, True),  # the guard is the sender's to keep, by its own clock
        (11, 8, True),
        (12, 8, True),
        (13, 8, False),  # into the slot of c
        (19, 1, True),
        (19, 0, True),
        (20, 0, False),
        (49, 1, False),
        (50, 8, True),
        (52, 8, True),
    ],
)
def test_slots_by_true_time(start_ms: int, airtime_ms: int, heard: bool) -> None:
    # Slots of 10 ms, 2 ms guard: b owns 10..20 ms of every 40 ms.
    radio = medium(access="tdma", tdma=TdmaSettings(slot_s=0.010, guard_s=0.002))
    assert list(radio.slots) == [0, 1, 2, 3]
    fates = transmit(radio, [1], now_ns=(start_ms + airtime_ms) * MS, airtimes_ns=[airtime_ms * MS])
    fate = "delivered" if heard else "out_of_slot"
    assert names(fates) == [[fate, ME, fate, "out_of_range"]]


def test_a_batch_may_hold_what_began_at_different_instants() -> None:
    # All end at 20 ms: b in time, c a whole slot early, d two.
    radio = medium(access="tdma", tdma=TdmaSettings(slot_s=0.010), range_m=100.0)
    fates = transmit(radio, [1, 2, 3], now_ns=20 * MS, airtimes_ns=[10 * MS, 10 * MS, 3 * MS])
    assert [row[0] for row in names(fates)] == ["delivered", "out_of_slot", "out_of_slot"]


def test_of_two_that_speak_at_once_only_the_owner_of_the_slot_is_heard() -> None:
    radio = medium(access="tdma", tdma=TdmaSettings(slot_s=0.010))
    fates = transmit(radio, [0, 1], now_ns=10 * MS)
    assert [row[2] for row in names(fates)] == ["out_of_slot", "delivered"]


def test_slots_in_drawn_order() -> None:
    radio = medium(access="tdma", tdma=TdmaSettings(slot_s=0.010, order="drawn"), seed=3)
    assert sorted(radio.slots) == [0, 1, 2, 3]
    assert list(radio.slots) != [0, 1, 2, 3]
    for robot, slot in enumerate(radio.slots):
        fates = transmit(radio, list(range(4)), now_ns=slot * 10 * MS)
        speaks = [Reason.delivered in row for row in fates.reason]
        assert speaks == [other == robot for other in range(4)]


def test_slots_in_an_order_drawn_for_each_frame() -> None:
    radio = medium(access="tdma", tdma=TdmaSettings(slot_s=0.010, order="drawn_each_frame"), range_m=100.0)
    orders = set()
    for frame in range(12):
        speakers = []
        for place in range(4):
            fates = transmit(radio, [0, 1, 2, 3], now_ns=(40 * frame + 10 * place) * MS)
            (speaker,) = (index for index, row in enumerate(names(fates)) if "delivered" in row)
            assert radio.place_of(speaker, (40 * frame + 10 * place) * MS) == place
            speakers.append(speaker)
        assert sorted(speakers) == [0, 1, 2, 3]
        orders.add(tuple(speakers))
    assert len(orders) > 6


def test_robots_that_share_a_slot_are_heard_at_once() -> None:
    radio = Medium(
        RadioSettings(range_m=5.0, access="tdma", tdma=TdmaSettings(slot_s=0.010)),
        ROBOTS, 1, slots=[0, 1, 2, 0],
    )  # fmt: skip
    assert radio.schedule is not None
    assert radio.schedule.frame_ns == 30 * MS
    assert [radio.place_of(robot, 0) for robot in range(4)] == [0, 1, 2, 0]
    for now_ms, heard in ((0, [0, 3]), (10, [1]), (20, [2]), (30, [0, 3])):
        fates = transmit(radio, [0, 1, 2, 3], now_ns=now_ms * MS)
        assert [robot for robot, row in enumerate(names(fates)) if "delivered" in row] == heard


def test_what_fits_no_slot_is_too_long_wherever_it_starts() -> None:
    radio = medium(access="tdma", tdma=TdmaSettings(slot_s=0.010, guard_s=0.002))
    for now_ms in (0, 5):
        fates = transmit(radio, [0], now_ns=now_ms * MS, airtimes_ns=[8 * MS + 1])
        assert names(fates) == [[ME, "too_long", "too_long", "out_of_range"]]


def test_without_slots_nothing_is_too_long() -> None:
    assert names(transmit(medium(), [0], airtimes_ns=[10**12]))[0][1] == "delivered"


def test_a_robot_that_is_down_hears_nothing() -> None:
    fates = transmit(medium(), [0, 2], off=(1, 3))
    assert names(fates) == [
        [ME, "receiver_down", "delivered", "out_of_range"],
        ["delivered", "receiver_down", ME, "receiver_down"],
    ]


def test_certain_loss_loses_what_nothing_else_refused() -> None:
    fates = transmit(medium(loss=1.0), [0, 1], refused=[False, True], off=(1,))
    assert names(fates) == [
        [ME, "receiver_down", "loss", "out_of_range"],
        ["queue_full", ME, "queue_full", "out_of_range"],
    ]


def test_loss_asks_for_sender_sequence_number_and_receiver() -> None:
    draws = Draws(7, "loss")
    fates = transmit(medium(loss=0.5, range_m=100.0, seed=7), [2] * 50, seqs=list(range(50)))
    for seq in range(50):
        for receiver, name in enumerate(ROBOTS):
            lost = draws.uniform(stable_key("c"), seq, stable_key(name)) < 0.5
            expected = Reason.not_a_candidate if name == "c" else Reason.loss if lost else Reason.delivered
            assert fates.reason[seq, receiver] == expected


def test_delay_counts_from_the_end_however_long_the_message() -> None:
    fates = transmit(medium(latency_s=0.002), [0, 1], now_ns=9 * MS, airtimes_ns=[0, 5 * MS])
    assert fates.delay_ns.tolist() == [[2 * MS] * 4] * 2


def test_latency_is_never_zero() -> None:
    assert transmit(medium(latency_s=1e-12), [0]).delay_ns.min() == 1


def test_jitter_asks_for_sender_sequence_number_and_receiver() -> None:
    draws = Draws(7, "jitter")
    fates = transmit(medium(jitter_s=0.001, latency_s=0.002, seed=7), [1, 1], seqs=[4, 5])
    for row, seq in enumerate((4, 5)):
        for receiver, name in enumerate(ROBOTS):
            extra_ns = int(draws.uniform(stable_key("b"), seq, stable_key(name)) * MS)
            assert 0 <= extra_ns < MS
            assert fates.delay_ns[row, receiver] == 2 * MS + extra_ns


def test_jitter_of_two_nanoseconds_is_none_or_one() -> None:
    fates = transmit(medium(jitter_s=2e-9, latency_s=1e-9), [0] * 50, seqs=list(range(50)))
    assert set(fates.delay_ns.ravel().tolist()) == {1, 2}


def test_airtime_of_a_message_is_rounded_up() -> None:
    assert medium().airtime_ns(1000) == 0
    assert medium(bit_rate_bps=8_000).airtime_ns(10) == 10 * MS
    assert medium(bit_rate_bps=8_000, overhead_bits=8).airtime_ns(0) == 1 * MS
    assert medium(bit_rate_bps=7e9).airtime_ns(1) == 2  # 8/7 ns
    # Ten years, which a float does not hold to the nanosecond.
    assert medium(bit_rate_bps=3, overhead_bits=10**9).airtime_ns(0) == 333_333_333_333_333_334


def test_a_radio_works_through_its_queue() -> None:
    radio = medium(bit_rate_bps=1e6, queue=2)
    events = [
        # now, airtime -> start
        (0, 10, 0),
        (0, 10, 10),
        (0, 10, None),  # one is on air, one waits
        (9, 10, None),
        (10, 10, 20),  # the first has ended just now
        (15, 5, None),
        (35, 5, 35),  # idle since 30
        (36, 5, 40),
    ]
    assert [(now, airtime, radio.admit(0, now, airtime)) for now, airtime, _ in events] == events


def test_each_radio_has_a_queue_of_its_own() -> None:
    radio = medium(bit_rate_bps=1e6, queue=1)
    assert [radio.admit(sender, 0, 10) for sender in (0, 1, 0, 1)] == [0, 0, None, None]


def test_unlimited_bandwidth_queues_nothing() -> None:
    radio = medium(queue=1)
    assert [radio.admit(0, 5, airtime_ns) for airtime_ns in (0, 10, 10)] == [5, 5, 5]


def test_nobody_speaks() -> None:
    fates = transmit(medium(loss=0.5, jitter_s=1), [])
    assert fates.reason.shape == fates.delay_ns.shape == (0, 4)


def test_a_team_of_one() -> None:
    fates = transmit(medium(robots=["a"], loss=0.5), [0], positions=LINE[:1])
    assert names(fates) == [[ME]]


def test_tdma_without_settings_is_refused() -> None:
    with pytest.raises(ValueError, match="tdma settings"):
        medium(access="tdma")
    assert medium().schedule is None
    assert list(medium().slots) == [0, 0, 0, 0]
    assert medium().place_of(3, 10**12) is None


@pytest.mark.parametrize("transmissions", [1, 2, 5])
def test_deliveries_list_what_the_matrices_say(transmissions: int) -> None:
    rng = np.random.default_rng(transmissions)
    reason = rng.choice(np.array([0, 1, 5, 255], np.uint8), (transmissions, 7))
    delay_ns = rng.integers(1, 1000, (transmissions, 7))
    assert Fates(reason, delay_ns).deliveries() == [
        (
            [b for b in range(7) if reason[row, b] == 0],
            [int(delay_ns[row, b]) for b in range(7) if reason[row, b] == 0],
        )
        for row in range(transmissions)
    ]
    assert Fates(np.full_like(reason, 1), delay_ns).deliveries() == [([], [])] * transmissions
