"""When a group decides, and by what."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from agent.behaviours.reconnection import belief as beliefs
from agent.behaviours.reconnection.knowledge import Expectation, Knowledge
from agent.behaviours.reconnection.methods import METHODS, Plan, Planner, Rules, due
from agent.behaviours.reconnection.model import walk_model, ways_of
from agent.behaviours.reconnection.planner import SLACK, joint_moves, plan_alone, plan_team
from agent.behaviours.reconnection.planner_arrays import ground_of
from agent.behaviours.reconnection.team import Motion, arrays, departed, moved
from channels.graphs import Floats, Graph, hearing

LENGTHS = (0.5, 1.0, 2.0, 1.0, 0.5)
RING = Graph(
    tuple((float(v), 0.0) for v in range(10)),
    (*((v, (v + 1) % 10, LENGTHS[v % 5]) for v in range(10)), (1, 7, 1.5)),
)
WAYS, HEARING = ways_of(RING, 2), hearing(RING)
MODEL = walk_model(RING, WAYS)
EXPECTED = Expectation(MODEL)
NOBODY = np.zeros(10, dtype=bool)


def _planner(expected: Expectation = EXPECTED, **rules: Any) -> Planner:
    return Planner(WAYS, HEARING, expected, Rules(**rules))


def _at(vertex: int, steps: int = 0, model: Any = MODEL) -> Floats:
    """What is believed of a robot so many steps after it was there."""
    belief = beliefs.at_vertex(model, vertex)
    for _ in range(steps):
        belief = beliefs.advanced(model, belief)
    return belief


def _knowledge(**believed: Floats) -> Knowledge:
    return Knowledge(
        {}, {int(name[1:]): b for name, b in believed.items()}, {int(n[1:]): 7 for n in believed}
    )


def _way_on(place: int, towards: int, elapsed: int = 1) -> Motion:
    motion = departed(WAYS, Motion(place), towards)
    for _ in range(elapsed):
        motion = moved(motion)
    return motion


ARRIVED, WAITING, AWAY = Motion(1), Motion(1, elapsed=3), _way_on(0, 1)


@pytest.mark.parametrize(
    ("motions", "changed", "expected"),
    [
        ([ARRIVED], False, True),
        ([AWAY], False, False),
        ([AWAY], True, False),
        ([AWAY, AWAY], True, False),
        ([ARRIVED, AWAY], False, True),
        ([WAITING, AWAY], False, False),
        ([WAITING, AWAY], True, True),
        ([WAITING, WAITING], False, True),
        ([ARRIVED, WAITING, AWAY], False, True),
    ],
)
def test_a_group_decides_when_somebody_arrives_or_it_changes_or_all_stand(
    motions: list[Motion], changed: bool, expected: bool
) -> None:
    assert due(dict(enumerate(motions)), changed) is expected


@pytest.mark.parametrize("method", METHODS)
def test_who_searches_for_nobody_stays(method: str) -> None:
    planner = _planner(method=method)
    motions = {0: ARRIVED, 3: WAITING}
    assert planner.decided(motions, (), Knowledge({}), {}, 0.5, True) == Plan(motions)
    bound = {0: AWAY}  # but goes to the end of its way
    assert planner.decided(bound, (), Knowledge({}), {}, 0.5, True) == Plan(bound)


@pytest.mark.parametrize("method", METHODS)
def test_between_arrivals_nothing_is_decided(method: str) -> None:
    motions = {0: WAITING, 3: AWAY}
    plan = _planner(method=method).decided(motions, (1,), Knowledge({}), {}, 0.5)
    assert plan == Plan(motions)


@pytest.mark.parametrize("method", METHODS)
def test_who_would_be_lost_turns_back_and_the_others_decide(method: str) -> None:
    # 2 to 3 and 1 to 0: their ends do not hear each other, nor does either end hear where the other is.
    motions = {0: _way_on(2, 3), 4: _way_on(1, 0), 5: ARRIVED}
    plan = _planner(method=method, horizon=4).decided(
        motions, (1,), _knowledge(r1=_at(6, 9)), {5: (1, 2, 3)}, 0.5, True
    )
    assert plan.turned == (0,)
    assert plan.motions[0] == Motion(2, 2, 1, 1)
    assert plan.motions[4] == motions[4]
    own = {-1: ARRIVED, 0: departed(WAYS, ARRIVED, 0), 2: departed(WAYS, ARRIVED, 2)}
    assert plan.motions[5] in own.values()
    assert (plan.contact is not None) == (method == "semi-markov")


def test_alone_it_goes_where_contact_is_likeliest() -> None:
    planner = _planner(horizon=9, deterministic=True)
    belief = _at(6, 6)
    alone = plan_alone(ground_of(WAYS, HEARING, [MODEL]), [belief], 1, 9, slack=0.0)
    for u in (0.0, 0.6, 0.99):
        plan = planner.decided({2: Motion(1)}, (0,), _knowledge(r0=belief), {}, u)
        assert plan.motions == {2: departed(WAYS, Motion(1), alone.best_path[0])}
        assert plan.contact == alone.values.max()
        assert plan.proven
        assert plan.nodes > 0


def test_within_the_slack_it_goes_anywhere_with_the_same_probability() -> None:
    # From 1 both ways round a ring are the same, to a target that is opposite.
    ring = Graph(tuple((float(v), 0.0) for v in range(8)), tuple((v, (v + 1) % 8, 1.0) for v in range(8)))
    ways, heard = ways_of(ring, 1), hearing(ring)
    model = walk_model(ring, ways)
    known = Knowledge({}, {0: _at(5, 4, model)}, {0: 4})

    def gone(u: float, **rules: Any) -> int:
        plan = Planner(ways, heard, Expectation(model), Rules(horizon=8, **rules)).decided(
            {1: Motion(1)}, (0,), known, {}, u
        )
        return plan.motions[1].towards

    assert [gone(u) for u in (0.0, 0.49, 0.5, 0.99)] == [0, 0, 2, 2]
    assert [gone(u, deterministic=True) for u in (0.0, 0.49, 0.5, 0.99)] == [0] * 4


def test_a_team_does_what_its_plan_says() -> None:
    motions = {1: Motion(1), 2: Motion(2, elapsed=2), 3: _way_on(0, 1)}
    found = _knowledge(r0=_at(6, 9), r4=_at(4, 9))
    ground = ground_of(WAYS, HEARING, [MODEL, MODEL])
    vectors = [found.believed[0], found.believed[4]]
    expected = plan_team(ground, vectors, *arrays(motions.values()), 6, slack=SLACK)
    near = expected.moves[expected.values >= (1 - SLACK) * expected.values.max()]
    assert len(near) > 0
    for u in (np.arange(len(near)) + 0.5) / len(near):
        plan = _planner(horizon=6).decided(motions, (0, 4), found, {}, float(u))
        chosen = near[int(u * len(near))].tolist()
        assert plan.motions == {
            robot: motion if to < 0 else departed(WAYS, motion, to)
            for (robot, motion), to in zip(motions.items(), chosen, strict=True)
        }
        assert (plan.contact, plan.proven) == (expected.values.max(), expected.proven)


@pytest.mark.parametrize("method", METHODS)
def test_a_decision_is_one_of_those_that_keep_the_team_together(method: str) -> None:
    motions = {1: Motion(1), 2: Motion(2, elapsed=2), 3: _way_on(0, 1)}
    safe = {tuple(row) for row in joint_moves(WAYS, HEARING, *arrays(motions.values())).tolist()}
    planner, seen = _planner(method=method, horizon=4), set()
    ages: Mapping[int, tuple[int, ...]] = {1: (3, 3, 3), 2: (3, 3)}
    for u in np.linspace(0, 1, 30, endpoint=False):
        plan = planner.decided(motions, (0,), _knowledge(r0=_at(6, 9)), ages, float(u))
        choice = tuple(
            plan.motions[robot].towards if motion.free else -1 for robot, motion in motions.items()
        )
        assert choice in safe
        seen.add(choice)
    assert (len(seen) == len(safe)) == (method == "random")


@pytest.mark.parametrize("miss", [0.0, 0.4])
def test_what_silence_proves_is_planned_with(miss: float) -> None:
    ground = ground_of(WAYS, HEARING, [MODEL])
    belief = _at(6, 9)
    plan = _planner(horizon=9, miss=miss).decided({2: Motion(1)}, (0,), _knowledge(r0=belief), {}, 0.0)
    assert plan.contact == plan_alone(ground, [belief], 1, 9, miss=miss).values.max()


@pytest.mark.parametrize("robots", [1, 2])
def test_those_never_lost_can_be_searched_for(robots: int) -> None:
    """At the first step all know where all start, and nobody has been sought before."""
    motions = {robot: Motion(robot) for robot in range(robots)}
    known = Knowledge({**motions, 2: Motion(5)})
    plan = _planner(horizon=6).decided(motions, (2,), known, {}, 0.0, True)
    believed = _planner(horizon=6).decided(motions, (2,), _knowledge(r2=_at(5)), {}, 0.0, True)
    assert plan == believed


def test_neutral_robots_are_planned_for_as_they_move() -> None:
    still = walk_model(RING, WAYS, dwell={v: [0.0] * 19 + [1.0] for v in range(10)})
    expected = Expectation(MODEL, still, half_steps=50.0)
    believed = _at(5, 0, expected.model)
    known = Knowledge({}, {0: believed}, {0: 0})
    soon = _planner(expected, horizon=6).decided({1: Motion(3)}, (0,), known, {}, 0.0)
    late = _planner(expected, horizon=6).decided(
        {1: Motion(3)}, (0,), Knowledge({}, {0: believed}, {0: 10**6}), {}, 0.0
    )
    assert soon.contact == pytest.approx(1.0)  # it is still there
    only = _planner(horizon=6).decided({1: Motion(3)}, (0,), _knowledge(r0=_at(5)), {}, 0.0)
    assert late.contact == pytest.approx(only.contact)
    assert only.contact is not None
    assert only.contact < 0.99
