"""What groups know: the order of what happens in a step, against dense matrices and one belief per robot."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import networkx as nx
import numpy as np
import pytest

from agent.behaviours.reconnection import belief as beliefs
from agent.behaviours.reconnection import facts, mixture
from agent.behaviours.reconnection.belief import Outcome
from agent.behaviours.reconnection.knowledge import Expectation, Knowledge, heard_by, merged, point
from agent.behaviours.reconnection.member import Member
from agent.behaviours.reconnection.messages import MessageError
from agent.behaviours.reconnection.model import Model, walk_model, ways_of
from agent.behaviours.reconnection.team import Motion, departed, moved, networks, turned_back
from channels.graphs import Graph, hearing
from channels.randomness import Draws
from tests import reconnection_dense as dense

Array = Any

GRAPH = Graph(
    tuple((float(v), 0.0) for v in range(9)),
    (*((v, (v + 1) % 9, (0.5, 1.0, 1.5)[v % 3]) for v in range(9)), (0, 4, 1.0)),
)
WAYS, HEARING = ways_of(GRAPH, 2), hearing(GRAPH)
MODEL = walk_model(GRAPH, WAYS)
EXPECTED = Expectation(MODEL)


class Dense:
    """F as a tensor, made of mu and gamma as the paper writes it, and beliefs [augmented vertex, steps - 1]."""

    def __init__(self, dwell: Sequence[float] = (1.0,)) -> None:
        self.vertices = dense.augmented(GRAPH)
        out = Counter(at[0] for at in self.vertices if isinstance(at, tuple))
        mu = {way: 1 / out[way[0]] for way in self.vertices if isinstance(way, tuple)}
        lengths = {pair: length for a, b, length in GRAPH.edges for pair in ((a, b), (b, a))}
        gammas = []
        for at in self.vertices:
            if isinstance(at, tuple):
                tau = max(1, round(2 * lengths[at]))
                least, most = max(1, -(-tau // 2)), 3 * tau // 2
                gammas.append([float(k >= least) / (most - least + 1) for k in range(1, most + 1)])
            else:
                gammas.append(list(dwell))
        self.longest = max(map(len, gammas))
        holding = [dense.holding_matrix(gamma, self.longest) for gamma in gammas]
        self.f = dense.transition(dense.next_probabilities(self.vertices, mu), holding)
        self.real = np.array([[k < len(gamma) for k in range(self.longest)] for gamma in gammas])

    def certain(self, motion: Motion) -> Array:
        belief = np.zeros((len(self.vertices), self.longest))
        at = motion.place if motion.free else (motion.place, motion.towards)
        belief[self.vertices.index(at), 0 if motion.free else motion.elapsed - 1] = 1.0
        return belief

    def after(self, belief: Array, heard: Sequence[int], miss: float) -> Array:
        """F, then the observation from places heard, then normalised; uniform where nothing is left."""
        mask = np.isin(np.arange(len(WAYS.start) - 1), heard)
        seen = dense.observation(self.vertices, mask, self.longest, miss)
        belief = dense.applied(seen, dense.applied(self.f, belief))
        if belief.sum() == 0:
            belief = self.real * dense.applied(seen, np.ones_like(belief))
        return belief / belief.sum()

    def merged(self, each: Sequence[Array]) -> Array:
        mean = dense.merged(each)
        return mean if mean.sum() > 0 else np.mean(each, axis=0)


DENSE = Dense()
AT, STEPS = dense.states_of(MODEL)


def _components(places: Sequence[int]) -> list[list[int]]:
    graph = nx.Graph()
    graph.add_nodes_from(range(len(places)))
    joined = {frozenset(edge[:2]) for edge in GRAPH.edges}
    graph.add_edges_from(
        (i, j)
        for i, a in enumerate(places)
        for j, b in enumerate(places)
        if a == b or frozenset((a, b)) in joined
    )
    return [sorted(component) for component in nx.connected_components(graph)]


class Memories:
    """One belief per robot of each other, and how long ago that was last heard: nothing is shared."""

    def __init__(self, motions: Sequence[Motion], miss: float) -> None:
        robots = range(len(motions))
        self.miss = miss
        self.motions = list(motions)
        self.belief = {(i, j): DENSE.certain(motions[j]) for i in robots for j in robots if i != j}
        self.since = dict.fromkeys(self.belief, 0)
        self.groups = [[*robots]]  # where everybody starts, everybody knows
        self.events: Counter[str] = Counter()

    def step(self, motions: Sequence[Motion]) -> None:
        """Everybody has moved; those who were connected at the step before know the same."""
        places = [motion.place for motion in motions]
        groups = _components(places)
        old, since = dict(self.belief), dict(self.since)
        for group in groups:
            former = [shared[0] for before in self.groups if (shared := [i for i in before if i in group])]
            self.events[f"{len(former)} factors"] += len(group) < len(motions)  # of somebody absent
            self.events["splits"] += any(
                set(before) - set(group) for before in self.groups if former[0] in before
            )
            heard = [p for p in range(len(WAYS.start) - 1) if any(HEARING[p, places[i]] for i in group)]
            for j in range(len(motions)):
                each = [DENSE.after(old[i, j], heard, self.miss) for i in former if j not in group]
                for i in group:
                    if j in group and i != j:
                        self.belief[i, j], self.since[i, j] = DENSE.certain(motions[j]), 0
                    elif j not in group:
                        self.belief[i, j] = DENSE.merged(each)
                        self.since[i, j] = 1 + min(since[k, j] for k in former)
        self.groups = groups


def _shared(known: Sequence[Knowledge], motions: Sequence[Motion], miss: float) -> list[Knowledge]:
    """The same by what is tested: groups share an object."""
    after = list(known)
    for group in networks({i: motion.place for i, motion in enumerate(motions)}, HEARING):
        here = {i: motions[i] for i in group}
        absent = [i for i in range(len(motions)) if i not in here]
        heard = heard_by(HEARING, here.values())
        former = {id(known[i]): known[i] for i in group}.values()
        factors = [each.ticked(EXPECTED, WAYS, absent, heard, miss)[0] for each in former]
        together, _ = merged(factors, here)
        for i in group:
            after[i] = together
    return after


@pytest.mark.parametrize("miss", [0.0, 0.3])
def test_four_robots_that_meet_and_part_know_what_the_paper_says(miss: float) -> None:
    members = [Member(WAYS, start, Draws(21, f"{i}"), 10**6) for i, start in enumerate((0, 2, 5, 7))]
    motions = [member.motion for member in members]
    memories = Memories(motions, miss)
    known = [Knowledge(dict(enumerate(motions)))] * 4
    for step in range(45):
        for member in members:
            member.mind_own_business(step)
            member.advance()
        motions = [member.motion for member in members]
        memories.step(motions)
        known = _shared(known, motions, miss)
        for (i, j), belief in memories.belief.items():
            assert known[i].vector(MODEL, WAYS, j) == pytest.approx(belief[AT, STEPS], abs=1e-12)
            assert known[i].since.get(j, 0) == memories.since[i, j]
            assert (j in known[i].certain) == (memories.since[i, j] == 0)
    # Else nothing of this has been tested.
    assert memories.events["splits"] > 5
    assert memories.events["2 factors"] > 5
    assert memories.events["3 factors"] > 1


def _motions(graph_ways: Iterable[tuple[int, int, int]]) -> list[Motion]:
    found = []
    for place, towards, elapsed in graph_ways:
        motion = departed(WAYS, Motion(place), towards)
        for _ in range(elapsed):
            motion = moved(motion)
        found.append(motion)
    return found


def test_two_that_met_are_one_factor_ever_after() -> None:
    """Robots 0 and 1 part, then meet 2: what they knew together counts once, for each as it went on."""
    known = Knowledge({0: Motion(0), 1: Motion(0), 2: Motion(4), 3: Motion(7)})
    heard = heard_by(HEARING, [Motion(0)])
    once, _ = known.ticked(EXPECTED, WAYS, [3], heard, 0.0)
    together, outcomes = merged([once], {0: Motion(0), 1: Motion(0)})
    assert together.believed[3] is once.believed[3]
    assert outcomes == {3: Outcome.usual}
    assert together.certain == {0: Motion(0), 1: Motion(0)}
    assert 2 not in together.believed


def test_since_counts_from_the_last_contact_of_any_of_those_who_meet() -> None:
    a = Knowledge({}, {2: beliefs.at_vertex(MODEL, 3)}, {2: 9})
    b = Knowledge({}, {2: beliefs.at_vertex(MODEL, 4)}, {2: 4})
    after, outcomes = merged([a, b], {0: Motion(0), 1: Motion(1)})
    assert after.since == {2: 4}
    assert outcomes == {2: Outcome.disjoint}
    assert after.believed[2][[3, 4]] == pytest.approx([0.5, 0.5])
    later, _ = after.ticked(EXPECTED, WAYS, [1, 2], np.zeros(9, dtype=bool), 0.0)
    assert later.since == {1: 1, 2: 5}
    assert later.certain == {}


def test_groups_that_meet_need_not_take_the_same_robots_for_absent() -> None:
    """One counts on a silent member, 3, which the other takes for absent."""
    at = [beliefs.at_vertex(MODEL, vertex) for vertex in range(9)]
    a = Knowledge({}, {2: at[3]}, {2: 9})
    b = Knowledge({}, {2: at[3], 3: at[5]}, {2: 4, 3: 1})
    for factors in ([a, b], [b, a]):
        together, outcomes = merged(factors, {0: Motion(0), 1: Motion(1)})
        assert list(together.believed) == [2, 3]
        assert together.believed[3] is at[5]
        assert together.since == {2: 4, 3: 1}
        assert outcomes == {2: Outcome.usual, 3: Outcome.usual}
    alone = merged([a], {0: Motion(0)})[0].completed(b)
    assert alone.believed[3] is at[5]
    assert alone.believed[2] is at[3]
    assert alone.since == {2: 9, 3: 1}


def test_what_a_group_tells_of_others_than_are_absent_is_left_out() -> None:
    known = Knowledge({}, {robot: beliefs.at_vertex(MODEL, robot) for robot in (1, 2, 4)}, {1: 5, 2: 6, 4: 7})
    found = facts.understood(facts.told(known, exact=True), MODEL.states, [0, 2, 4])
    assert found.since == {2: 6, 4: 7}
    assert all(np.array_equal(found.believed[robot], known.believed[robot]) for robot in (2, 4))
    backwards = Knowledge({}, dict(reversed(known.believed.items())), known.since)
    with pytest.raises(MessageError, match="twice, or not in order"):
        facts.understood(facts.told(backwards, exact=True), MODEL.states, [2])


def test_what_is_known_is_not_changed_by_what_comes_after() -> None:
    """Robots that part both go on from one object."""
    before = Knowledge({0: Motion(0)}, {1: beliefs.at_vertex(MODEL, 3)}, {1: 2})
    kept = before.believed[1].copy()
    heard = np.ones(9, dtype=bool)
    first, outcomes = before.ticked(EXPECTED, WAYS, [0, 1], heard, 0.0)
    assert set(outcomes.values()) == {Outcome.everything_heard}
    second, _ = before.ticked(EXPECTED, WAYS, [0, 1], ~heard, 0.0)
    assert (before.believed[1] == kept).all()
    assert before.since == {1: 2}
    assert before.certain == {0: Motion(0)}
    assert not np.array_equal(first.believed[1], second.believed[1])


@pytest.mark.parametrize("motion", [Motion(1), *_motions([(1, 2, 1), (1, 2, 2), (2, 3, 3)])])
def test_certainty_is_where_a_robot_is(motion: Motion) -> None:
    assert point(MODEL, WAYS, motion) == pytest.approx(DENSE.certain(motion)[AT, STEPS])


def test_certainty_of_those_who_turn_is_where_they_are_heard_from() -> None:
    (away,) = _motions([(2, 3, 2)])
    assert np.array_equal(point(MODEL, WAYS, turned_back(away)), beliefs.at_vertex(MODEL, 2))
    leaving = departed(WAYS, Motion(2), 3)
    assert np.array_equal(point(MODEL, WAYS, leaving), beliefs.at_vertex(MODEL, 2))
    # Longer on the way than thought possible: about to arrive.
    slow = Motion(2, 3, 40, 2)
    belief = beliefs.advanced(MODEL, point(MODEL, WAYS, slow))
    assert np.array_equal(belief, beliefs.at_vertex(MODEL, 3))


def test_who_has_worked_at_a_vertex_is_believed_to_have() -> None:
    model = walk_model(GRAPH, WAYS, dwell={1: [0.5, 0.0, 0.25, 0.25]})
    for elapsed, stays in enumerate((0.5, 1.0, 0.5, 0.0)):
        after = beliefs.advanced(model, point(model, WAYS, Motion(1, elapsed=elapsed)))
        assert dense.by_vertex(model, after)[1] == pytest.approx(stays)


# Robots that may be neutral

STILL = (0.0, 0.0, 0.5, 0.5)


def _neutral() -> Model:
    return walk_model(GRAPH, WAYS, dwell=dict.fromkeys(range(9), STILL))


def test_neutral_or_cooperative_it_moves_by_both() -> None:
    expected = Expectation(MODEL, _neutral(), half_steps=5.0)
    both = (Dense(), Dense(STILL))
    at, steps = dense.states_of(expected.model)
    longest = max(each.longest for each in both)
    belief = beliefs.at_vertex(expected.model, 4)
    tensor = np.zeros((len(DENSE.vertices), longest))
    tensor[4, 0] = 1.0
    heard = heard_by(HEARING, [Motion(7), Motion(2)])
    unheard = np.array([not heard[at[0] if isinstance(at, tuple) else at] for at in DENSE.vertices])
    for since in range(1, 15):
        belief, outcome = expected.stepped(heard, belief, 0.2, since)
        c = 1 - 2 ** (-since / 5)
        after = np.zeros_like(tensor)
        for share, each in zip((c, 1 - c), both, strict=True):
            room = [(0, 0), (0, longest - each.longest)] * 2
            after += share * dense.applied(np.pad(each.f, room), tensor)
        tensor = after * np.where(unheard, 1.0, 0.2)[:, None]
        tensor /= tensor.sum()
        assert outcome is Outcome.usual
        assert belief == pytest.approx(tensor[at, steps], abs=1e-12)


@pytest.mark.parametrize("since", [0, 1, 3, 5, 17, 400])
def test_plans_blend_both_by_tenths(since: int) -> None:
    neutral = _neutral()
    expected = Expectation(MODEL, neutral, half_steps=5.0)
    planned = expected.planned(since)
    tenths = round(10 * (1 - 2 ** (-since / 5)))
    cooperative, other = mixture.aligned(MODEL, neutral)
    blend = mixture.blended(cooperative, other, tenths / 10)
    assert np.array_equal(planned.hazard, blend.hazard)
    assert np.array_equal(planned.next_mu, blend.next_mu)
    assert planned.states == expected.model.states
    assert expected.planned(since) is planned


def test_one_model_is_planned_with_as_it_is() -> None:
    assert EXPECTED.planned(3) is MODEL
    assert EXPECTED.model is MODEL


@pytest.mark.parametrize("half_steps", [0.0, -1.0, float("nan")])
def test_when_neutral_ones_cooperate_must_be_said(half_steps: float) -> None:
    with pytest.raises(ValueError, match="half_steps: must be more than 0"):
        Expectation(MODEL, _neutral(), half_steps)


def test_a_place_is_heard_by_any() -> None:
    heard = heard_by(HEARING, [Motion(2), *_motions([(6, 7, 1)])])
    assert np.flatnonzero(heard).tolist() == [1, 2, 3, 5, 6, 7]
