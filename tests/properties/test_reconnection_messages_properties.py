"""Whatever comes over the air is a message of the team, or refused in a sentence."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from agent.behaviours.reconnection.messages import (
    Course,
    Decision,
    Fact,
    Facts,
    MessageError,
    Piece,
    Presence,
    Presences,
    decode,
    decode_facts,
    encode,
    follows,
)
from agent.behaviours.reconnection.model import ways_of
from agent.behaviours.reconnection.team import Motion, departed, moved, turned_back
from channels.graphs import Graph, neighbours

TEAM = 5
RING = Graph(
    tuple((float(np.cos(i)), float(np.sin(i))) for i in range(6)),
    tuple((i, (i + 1) % 6, 0.5 + i % 3) for i in range(6)),
)
WAYS = ways_of(RING, 2.0)
members = st.integers(0, TEAM - 1)


@st.composite
def motions(draw: st.DrawFn) -> Motion:
    """Anything that a robot can be about to do or be doing."""
    motion = Motion(draw(st.integers(0, 5)), elapsed=draw(st.integers(0, 20)))
    if draw(st.booleans()):
        near = [vertex for vertex, _ in neighbours(RING)[motion.place]]
        motion = departed(WAYS, motion, draw(st.sampled_from(near)))
        for _ in range(draw(st.integers(0, motion.left - 1))):
            motion = moved(motion)
        if draw(st.booleans()):
            motion = turned_back(motion)
            for _ in range(draw(st.integers(0, max(0, motion.left - 1)))):
                motion = moved(motion)
    return motion


presences = st.builds(
    Presence,
    number=members,
    course=motions().map(lambda motion: Course(*motion)),
    searching=st.booleans(),
    former=st.lists(members, max_size=TEAM).map(tuple),
    ages=st.lists(st.integers(0, 10), max_size=3).map(tuple),
)
sound = st.one_of(
    st.builds(Presences, step=st.integers(0, 1000), robots=st.lists(presences, max_size=4)),
    st.builds(Piece, step=st.integers(0, 1000), teller=members, piece=st.binary(max_size=40)),
    st.builds(
        Decision,
        step=st.integers(0, 1000),
        planner=members,
        courses=st.dictionaries(members, motions().map(lambda motion: Course(*motion))),
    ),
)


@given(sound)
def test_what_robots_say_is_understood(message: Presences | Piece | Decision) -> None:
    assert decode(encode(message), TEAM, WAYS) == message


@settings(max_examples=300)
@given(sound, st.lists(st.tuples(st.integers(0, 200), st.integers(0, 255)), max_size=4), st.integers(0, 200))
def test_what_is_damaged_is_sound_or_refused(
    message: Presences | Piece | Decision, damage: list[tuple[int, int]], length: int
) -> None:
    raw = bytearray(encode(message))
    for at, byte in damage:
        raw[at % len(raw)] = byte
    try:
        found = decode(bytes(raw[:length]), TEAM, WAYS)
    except MessageError:
        return
    courses = [each.course for each in found.robots] if isinstance(found, Presences) else []
    courses += found.courses.values() if isinstance(found, Decision) else []
    for course in courses:
        motion = course.motion()
        for _ in range(motion.left):  # everybody arrives somewhere, and can go on from there
            motion = moved(motion)
        departed(WAYS, motion, neighbours(RING)[motion.place][0][0])


@given(st.binary(max_size=60))
def test_noise_is_refused(raw: bytes) -> None:
    for read in (lambda: decode(raw, TEAM, WAYS), lambda: decode_facts(raw)):
        try:
            read()
        except MessageError:
            continue
        assert raw[:1] >= b"\x90"  # msgpack's lists begin with that, or what is longer


@given(st.lists(st.builds(Fact, robot=members, since=st.integers(0, 99), belief=st.binary(max_size=9))))
def test_facts_come_back(facts: list[Fact]) -> None:
    if len(facts) <= 62:
        assert decode_facts(encode(Facts(facts))).absent == facts


@given(motions(), motions())
def test_nobody_follows_where_it_cannot(motion: Motion, decided: Motion) -> None:
    if follows(WAYS, motion, decided):
        assert decided.place == motion.place
        assert motion.free or decided in (motion, turned_back(motion))
    assert follows(WAYS, motion, motion)
    assert follows(WAYS, motion, turned_back(motion))
