"""The medium against a reading of its rules robot by robot, and the statistics of loss."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from channels.medium import Medium, Reason
from channels.randomness import Draws, stable_key
from channels.settings import RadioSettings, TdmaSettings

MS = 1_000_000
TDMA = TdmaSettings(slot_s=0.010, guard_s=0.002)


@st.composite
def situations(draw: st.DrawFn) -> dict[str, Any]:
    number = draw(st.integers(1, 6))
    speakers = draw(st.lists(st.integers(0, number - 1), max_size=6))
    each: dict[str, Any] = {"min_size": len(speakers), "max_size": len(speakers)}
    place = st.tuples(st.integers(-4, 4), st.integers(-4, 4))
    return {
        "robots": [f"r{index}" for index in range(number)],
        "tdma": draw(st.booleans()),
        "loss": draw(st.sampled_from([0.0, 0.3, 1.0])),
        "seed": draw(st.integers(0, 2**32)),
        "now_ms": draw(st.integers(0, 200)),
        "senders": speakers,
        "seqs": draw(st.lists(st.integers(0, 10**6), **each)),
        "airtimes_ms": draw(st.lists(st.integers(0, 11), **each)),
        "refused": draw(st.lists(st.booleans(), **each)),
        "positions": draw(st.lists(place, min_size=number, max_size=number)),
        "listening": draw(st.lists(st.booleans(), min_size=number, max_size=number)),
    }


def build(situation: dict[str, Any], **more: Any) -> Medium:
    radio = RadioSettings(
        range_m=5.0,
        access="tdma" if situation["tdma"] else "ideal",
        tdma=TDMA,
        loss=situation["loss"],
        **more,
    )
    return Medium(radio, situation["robots"], situation["seed"])


def reasons(medium: Medium, situation: dict[str, Any]) -> list[list[int]]:
    fates = medium.transmit(
        situation["now_ms"] * MS,
        np.array(situation["senders"], dtype=np.int64),
        np.array(situation["seqs"], dtype=np.int64),
        np.array(situation["airtimes_ms"], dtype=np.int64) * MS,
        np.array(situation["refused"], dtype=bool),
        np.array(situation["positions"], dtype=np.float64),
        np.array(situation["listening"], dtype=bool),
    )
    rows: list[list[int]] = fates.reason.tolist()
    return rows


def expected_reason(situation: dict[str, Any], row: int, receiver: int) -> Reason:
    """The documented order, one question after the other; times in whole milliseconds."""
    sender, robots = situation["senders"][row], situation["robots"]
    (x, y), (other_x, other_y) = situation["positions"][sender], situation["positions"][receiver]
    airtime_ms = situation["airtimes_ms"][row]
    into_slot_ms = (situation["now_ms"] - airtime_ms - 10 * sender) % (10 * len(robots))
    draw = Draws(situation["seed"], "loss").uniform(
        stable_key(robots[sender]), situation["seqs"][row], stable_key(robots[receiver])
    )
    questions = [
        (receiver == sender, Reason.not_a_candidate),
        ((x - other_x) ** 2 + (y - other_y) ** 2 > 25, Reason.out_of_range),
        (situation["refused"][row], Reason.queue_full),
        (situation["tdma"] and airtime_ms > 8, Reason.too_long),
        (situation["tdma"] and into_slot_ms + max(airtime_ms, 1) > 10, Reason.out_of_slot),
        (not situation["listening"][receiver], Reason.receiver_down),
        (draw < situation["loss"], Reason.loss),
    ]
    return next((reason for refused, reason in questions if refused), Reason.delivered)


@given(situations())
@settings(max_examples=300)
def test_every_receiver_has_the_reason_of_the_first_gate_that_refuses(situation: dict[str, Any]) -> None:
    everyone = range(len(situation["robots"]))
    expected = [
        [expected_reason(situation, row, receiver) for receiver in everyone]
        for row in range(len(situation["senders"]))
    ]
    assert reasons(build(situation), situation) == expected


@given(situations())
def test_every_transmission_is_accounted_for(situation: dict[str, Any]) -> None:
    known = {int(reason) for reason in Reason}
    for sender, row in zip(situation["senders"], reasons(build(situation), situation), strict=True):
        assert set(row) <= known
        itself = [index for index, code in enumerate(row) if code == Reason.not_a_candidate]
        assert itself == [sender]


@given(situations(), st.randoms(use_true_random=False))
def test_fates_do_not_depend_on_who_else_speaks_or_in_which_order(
    situation: dict[str, Any], shuffler: Any
) -> None:
    together = reasons(build(situation), situation)
    order = list(range(len(situation["senders"])))
    shuffler.shuffle(order)
    medium = build(situation)
    for row in order:
        columns = ("senders", "seqs", "airtimes_ms", "refused")
        alone = {**situation, **{column: [situation[column][row]] for column in columns}}
        assert reasons(medium, alone) == [together[row]]


@given(situations())
def test_range_is_symmetric(situation: dict[str, Any]) -> None:
    number = len(situation["robots"])
    everyone = {
        **situation,
        "tdma": False,
        "loss": 0.0,
        "senders": list(range(number)),
        "seqs": [0] * number,
        "airtimes_ms": [0] * number,
        "refused": [False] * number,
    }
    beyond = np.array(reasons(build(everyone), everyone)) == Reason.out_of_range
    assert np.array_equal(beyond, beyond.T)


@given(
    st.integers(1, 5),
    st.lists(st.tuples(st.integers(0, 20), st.integers(0, 30)), max_size=40),
)
def test_a_radio_sends_one_message_after_the_other_and_holds_no_more_than_its_queue(
    capacity: int, steps: list[tuple[int, int]]
) -> None:
    medium = Medium(RadioSettings(range_m=1.0, bit_rate_bps=1e6, queue=capacity), ["a"], 0)
    now_ns, ends = 0, [0]
    for wait_ns, airtime_ns in steps:
        now_ns += wait_ns
        held = sum(end > now_ns for end in ends)
        start_ns = medium.admit(0, now_ns, airtime_ns)
        assert (start_ns is None) == (held >= capacity)
        if start_ns is not None:
            assert start_ns == max(now_ns, ends[-1])
            ends.append(start_ns + airtime_ns)


def test_loss_has_its_frequency_for_every_sender_and_receiver() -> None:
    robots = [f"r{index:02}" for index in range(20)]
    medium = Medium(RadioSettings(range_m=1.0, loss=0.3), robots, seed=4711)
    rounds = 500
    senders, seqs = np.tile(np.arange(20), rounds), np.repeat(np.arange(rounds), 20)
    nothing = np.zeros(len(senders), dtype=np.int64)
    fates = medium.transmit(
        0, senders, seqs, nothing, nothing > 0, np.zeros((20, 2)), np.ones(20, dtype=bool)
    )
    lost = fates.reason == Reason.loss
    sigma = np.sqrt(0.3 * 0.7)
    assert abs(lost.sum() / (20 * 19 * rounds) - 0.3) < 5 * sigma / np.sqrt(20 * 19 * rounds)
    per_link = lost.reshape(rounds, 20, 20).mean(axis=0)[~np.eye(20, dtype=bool)]
    assert abs(per_link - 0.3).max() < 5 * sigma / np.sqrt(rounds)
    there, back = lost.reshape(rounds, 20, 20)[:, 0, 1], lost.reshape(rounds, 20, 20)[:, 1, 0]
    assert abs(np.corrcoef(there, back)[0, 1]) < 5 / np.sqrt(rounds)


def test_one_more_robot_changes_nobody_elses_fate() -> None:
    few, more = ["a", "b", "c"], ["a", "new", "b", "c"]
    everyone = {3: np.array([0, 1, 2]), 4: np.array([0, 2, 3])}
    fates = [
        Medium(RadioSettings(range_m=1.0, loss=0.5, jitter_s=0.1), robots, seed=5).transmit(
            0,
            np.tile(everyone[len(robots)], 50),
            np.repeat(np.arange(50), 3),
            np.zeros(150, dtype=np.int64),
            np.zeros(150, dtype=bool),
            np.zeros((len(robots), 2)),
            np.ones(len(robots), dtype=bool),
        )
        for robots in (few, more)
    ]
    assert np.array_equal(fates[0].reason, fates[1].reason[:, [0, 2, 3]])
    assert np.array_equal(fates[0].delay_ns, fates[1].delay_ns[:, [0, 2, 3]])
