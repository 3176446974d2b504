"""Where robots count as being in a graph, for every journey."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from channels.graphs import Graph
from channels.messages import MotionCommand
from channels.units import NS_PER_S
from emulator.scenario import CommandedMotion, RobotSpec
from emulator.world import World

SIDE = 4
VERTICES = tuple((float(x), float(y)) for y in range(SIDE) for x in range(SIDE))
GRID = Graph(vertices=VERTICES, edges=())  # who is where does not depend on edges

# Quarter seconds at whole speeds: robots stop at vertices, between them, and turn round on their way.
instants = st.integers(0, 40).map(lambda quarters: quarters * NS_PER_S // 4)
commands = st.one_of(
    st.builds(
        MotionCommand, towards_m=st.sampled_from(VERTICES), speed_mps=st.sampled_from([0.0, 1.0, 2.0, 4.0])
    ),
    st.builds(MotionCommand, velocity_mps=st.sampled_from([(0.0, 0.0), (1.0, 0.0), (0.0, -2.0)])),
    st.builds(MotionCommand, towards_m=st.tuples(st.floats(0, 3), st.floats(0, 3)), speed_mps=st.just(1.0)),
)
journeys = st.lists(st.tuples(instants, commands), max_size=8).map(
    lambda j: sorted(j, key=lambda leg: leg[0])
)


def world(start: int) -> World:
    spec = RobotSpec("a", VERTICES[start], 0.0, (0.0, 0.0), "m:f", {})
    return World((3.0, 3.0), [spec], CommandedMotion(9.0), GRID)


def asked(
    start: int, journey: list[tuple[int, MotionCommand]], times_ns: list[int]
) -> list[tuple[int, tuple[float, float]]]:
    """Place and position at each of these instants, after what is commanded then."""
    some, pending, found = world(start), list(journey), []
    for now_ns in times_ns:
        while pending and pending[0][0] <= now_ns:
            some.command(0, *pending.pop(0))
        places = some.places(now_ns)
        assert places is not None
        x, y = some.positions(now_ns)[0].tolist()
        found.append((int(places[0]), (x, y)))
    return found


START = st.integers(0, len(VERTICES) - 1)
OFTEN = [NS_PER_S // 8 * k for k in range(120)]


@given(START, journeys, st.lists(st.integers(0, 119), unique=True).map(sorted))
def test_who_asks_changes_nothing(
    start: int, journey: list[tuple[int, MotionCommand]], some: list[int]
) -> None:
    often = asked(start, journey, OFTEN)
    assert asked(start, journey, [OFTEN[k] for k in some]) == [often[k] for k in some]


@given(START, journeys)
def test_who_stands_at_a_vertex_is_there_and_nobody_comes_to_be_elsewhere(
    start: int, journey: list[tuple[int, MotionCommand]]
) -> None:
    found = asked(start, journey, OFTEN)
    for k, (place, position) in enumerate(found[1:], 1):
        if position == found[k - 1][1] and position in VERTICES:  # for an eighth of a second: it stands
            assert VERTICES[place] == position
        if place != found[k - 1][0]:
            # It has come to stand there since: with 4 m/s at most it cannot be far yet.
            assert np.abs(np.subtract(VERTICES[place], position)).max() <= 0.5 + 1e-9
    last_place, last = found[-1]
    if not journey:
        assert (last_place, last) == (start, VERTICES[start])
