"""Who hears what on a busy channel, against a model that knows nothing but the intervals."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.traffic import Heard, Send, medium_of, play

Place = tuple[int, int]


class Traffic(NamedTuple):
    """Robots that drive at constant velocities [m, m/ns], and what they hand to their radios."""

    starts: list[Place]
    velocities: list[Place]
    queue: int
    sends: list[Send]

    def positions(self, now_ns: int) -> NDArray[np.float64]:
        starts, velocities = np.array(self.starts, dtype=float), np.array(self.velocities, dtype=float)
        return np.asarray(starts + now_ns * velocities)


@st.composite
def traffic(draw: st.DrawFn) -> Traffic:
    number = draw(st.integers(1, 6))
    place = st.tuples(st.integers(-5, 5), st.integers(-5, 5))
    moving = draw(st.booleans())
    velocity = st.tuples(st.integers(-1, 1), st.integers(-1, 1)) if moving else st.just((0, 0))
    # Short spans, so that many begin or end together.
    send = st.builds(
        Send,
        st.integers(0, 30),
        st.integers(0, number - 1),
        st.integers(0, 12),
        st.sampled_from([False] * 5 + [True]),
    )
    each: dict[str, Any] = {"min_size": number, "max_size": number}
    return Traffic(
        draw(st.lists(place, **each)),
        draw(st.lists(velocity, **each)),
        draw(st.integers(1, 4)),
        draw(st.lists(send, max_size=14)),
    )


class Spoken(NamedTuple):
    """One message by the model: the interval for which it is on the air, or the instant it is refused."""

    sender: int
    seq: int
    start_ns: int
    end_ns: int
    refused: bool


def spoken(given: Traffic) -> list[Spoken]:
    """Each sender's messages one after the other; `queue` of them may be unfinished."""
    said: list[Spoken] = []
    for sender in range(len(given.starts)):
        own: list[Spoken] = []
        for seq, send in enumerate(
            sorted((s for s in given.sends if s.sender == sender), key=lambda s: s.at_ns)
        ):
            unfinished = [one for one in own if not one.refused and one.end_ns > send.at_ns]
            refused = send.refused or len(unfinished) >= given.queue
            start_ns = max([send.at_ns, *(one.end_ns for one in unfinished)])
            if refused:
                own.append(Spoken(sender, seq, send.at_ns, send.at_ns, True))
            else:
                own.append(Spoken(sender, seq, start_ns, start_ns + send.airtime_ns, False))
        said += own
    return said


def expected(given: Traffic, said: list[Spoken], one: Spoken, receiver: int) -> str:
    """The documented order of reasons, from the intervals and the places at the end of this one."""
    places = given.positions(one.end_ns).tolist()

    def near(robot: int) -> bool:
        (x, y), (other_x, other_y) = places[robot], places[receiver]
        return bool((x - other_x) ** 2 + (y - other_y) ** 2 <= 25)

    at_once = {
        other.sender
        for other in said
        if not other.refused
        and other.sender != one.sender
        and other.start_ns < one.end_ns
        and one.start_ns < other.end_ns
    }
    questions = [
        (receiver == one.sender, "not_a_candidate"),
        (not near(one.sender), "out_of_range"),
        (one.refused, "queue_full"),
        (receiver in at_once, "half_duplex"),
        (any(near(other) for other in at_once), "collision"),
    ]
    return next((reason for holds, reason in questions if holds), "delivered")


@given(traffic())
@settings(max_examples=400)
def test_fates_are_those_of_the_intervals_alone(given: Traffic) -> None:
    said = spoken(given)
    everyone = range(len(given.starts))
    model = {
        (one.sender, one.seq): Heard(one.end_ns, [expected(given, said, one, robot) for robot in everyone])
        for one in said
    }
    stands: dict[tuple[float, ...], NDArray[np.float64]] = {}

    def positions(now_ns: int) -> NDArray[np.float64]:
        # As the world does: the same array object while nobody moves.
        now = given.positions(now_ns)
        return stands.setdefault(tuple(now.ravel().tolist()), now)

    assert play(medium_of(len(given.starts), queue=given.queue), given.sends, positions) == model


@given(traffic())
def test_who_hears_with_collisions_hears_without(given: Traffic) -> None:
    number = len(given.starts)
    quiet = play(medium_of(number, queue=given.queue, collisions=False), given.sends, given.positions)
    busy = play(medium_of(number, queue=given.queue), given.sends, given.positions)
    assert quiet.keys() == busy.keys()
    for message, fate in busy.items():
        for with_them, without in zip(fate.reasons, quiet[message].reasons, strict=True):
            assert with_them == without or (
                with_them in ("collision", "half_duplex") and without == "delivered"
            )
