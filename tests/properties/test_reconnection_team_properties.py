"""No team ever breaks up, and none is held back more than that takes: against a team played in plain Python."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain, combinations, product
from typing import NamedTuple

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from agent.behaviours.reconnection.knowledge import Expectation, Knowledge, heard_by, merged
from agent.behaviours.reconnection.member import Member
from agent.behaviours.reconnection.methods import METHODS, Planner, Rules
from agent.behaviours.reconnection.model import walk_model, ways_of
from agent.behaviours.reconnection.planner import joint_moves
from agent.behaviours.reconnection.team import (
    Motion,
    arrays,
    departed,
    everybody,
    moved,
    networks,
    targets_of,
    turn_backs,
    turned_back,
    upwards,
)
from channels.graphs import Bools, Graph, hearing
from channels.randomness import Draws


@st.composite
def graphs(draw: st.DrawFn, most: int = 7) -> Graph:
    """Connected, with ways of unequal lengths; heard are neighbours, or whoever."""
    count = draw(st.integers(2, most))
    every = [(a, b) for b in range(count) for a in range(b)]
    pairs = {(draw(st.integers(0, v - 1)), v) for v in range(1, count)}
    pairs |= set(draw(st.lists(st.sampled_from(every), max_size=5)))
    links = draw(st.none() | st.lists(st.sampled_from(every), unique=True, max_size=10).map(tuple))
    lengths = st.sampled_from([0.4, 1.0, 1.6, 2.5])
    return Graph(
        vertices=tuple((float(v), 0.0) for v in range(count)),
        edges=tuple((a, b, draw(lengths)) for a, b in sorted(pairs)),
        links=links,
    )


def _hear(graph: Graph, a: int, b: int) -> bool:
    pairs = [(u, v) for u, v, _ in graph.edges] if graph.links is None else graph.links
    return a == b or (a, b) in pairs or (b, a) in pairs


def _together(graph: Graph, places: Sequence[int]) -> bool:
    reached = {0}
    for _ in places:
        reached |= {j for i in reached for j in range(len(places)) if _hear(graph, places[i], places[j])}
    return len(reached) == len(places)


def _stay_together(graph: Graph, motions: Sequence[Motion]) -> bool:
    """Whether they do at every step until all have arrived, if nobody decides anything more."""
    last = max(motion.left for motion in motions)
    courses = [
        [m.towards if not m.free and t >= m.left else m.place for t in range(last + 1)] for m in motions
    ]
    return all(_together(graph, places) for places in zip(*courses, strict=True))


def _out(graph: Graph, vertex: int) -> dict[int, int]:
    """Where ways lead, and how many steps they take."""
    found = {b: length for a, b, length in graph.edges if a == vertex}
    found |= {a: length for a, b, length in graph.edges if b == vertex}
    return {v: max(1, round(found[v])) for v in sorted(found)}


@st.composite
def teams(draw: st.DrawFn, graph: Graph, most: int = 4) -> list[Motion]:
    """Connected; waiting, on the way or on the way back, whatever that leads to."""
    motions: list[Motion] = []
    for _ in range(draw(st.integers(1, most))):
        near = [
            v
            for v in range(len(graph.vertices))
            if not motions or any(_hear(graph, v, m.place) for m in motions)
        ]
        motion = Motion(draw(st.sampled_from(near)), elapsed=draw(st.integers(0, 2)))
        if draw(st.booleans()):
            head, tau = draw(st.sampled_from(list(_out(graph, motion.place).items())))
            elapsed = draw(st.integers(0, tau))
            motion = Motion(motion.place, head, elapsed, tau + 1 - elapsed)
            if elapsed and draw(st.integers(0, 3)) == 0:
                motion = Motion(motion.place, motion.place, elapsed, draw(st.integers(1, elapsed)))
        motions.append(motion)
    return motions


@given(st.data())
@settings(max_examples=40, deadline=None)
def test_networks_are_as_many_as_eigenvalues_of_the_laplacian_are_zero(data: st.DataObject) -> None:
    graph = data.draw(graphs(9))
    places = dict(
        enumerate(data.draw(st.lists(st.integers(0, len(graph.vertices) - 1), min_size=1, max_size=6)))
    )
    found = networks(places, hearing(graph))
    assert sorted(chain(*found)) == list(places)
    assert [group[0] for group in found] == sorted(min(group) for group in found)
    adjacent = np.array(
        [[i != j and _hear(graph, places[i], places[j]) for j in places] for i in places], float
    )
    values = np.linalg.eigvalsh(np.diag(adjacent.sum(axis=0)) - adjacent)
    assert len(found) == np.count_nonzero(values < 1e-9)
    if len(places) > 1:
        assert (len(found) == 1) == (values[1] > 1e-9)  # Eq. 12
    for group in found:
        assert _together(graph, [places[robot] for robot in group])


@given(st.data())
@settings(max_examples=80, deadline=None)
def test_as_few_as_possible_turn_back(data: st.DataObject) -> None:
    graph = data.draw(graphs())
    motions = data.draw(teams(graph))
    indices = range(len(motions))
    tried = chain.from_iterable(combinations(indices, count) for count in range(len(motions) + 1))
    least = next(
        chosen
        for chosen in tried
        if _stay_together(graph, [turned_back(m) if i in chosen else m for i, m in enumerate(motions)])
    )
    found = turn_backs(motions, hearing(graph))
    assert found == least
    planner = Planner(ways_of(graph, 1), hearing(graph), _expected(graph), Rules())
    united, turned = planner.united(dict(enumerate(motions)))
    assert turned == least
    assert united == {i: turned_back(m) if i in least else m for i, m in enumerate(motions)}


def _expected(graph: Graph) -> Expectation:
    return Expectation(walk_model(graph, ways_of(graph, 1)))


def _decisions(graph: Graph, motions: Sequence[Motion]) -> Iterator[tuple[int, ...]]:
    """All that keep the team together, by trying all."""
    choices = [[-1, *_out(graph, m.place)] if m.free else [-1] for m in motions]
    for decision in product(*choices):
        after = [
            Motion(m.place, to, 0, _out(graph, m.place)[to] + 1) if to >= 0 else m
            for m, to in zip(motions, decision, strict=True)
        ]
        if not all(m.free for m in after) and _stay_together(graph, after):
            yield decision


@given(st.data())
@settings(max_examples=70, deadline=None)
def test_joint_moves_are_all_that_keep_a_team_together(data: st.DataObject) -> None:
    graph = data.draw(graphs(6))
    motions = data.draw(teams(graph, 3))
    expected = list(_decisions(graph, motions)) or [(-1,) * len(motions)]
    found = joint_moves(ways_of(graph, 1), hearing(graph), *arrays(motions))
    assert list(map(tuple, found.tolist())) == expected


class Position(NamedTuple):
    """Where one robot of the plain team is, and until when it is bound."""

    place: int
    towards: int
    left_at: int
    there_at: int


class PlainTeam:
    """Told what is decided, it knows where everybody is: places by step, by counting from decisions."""

    def __init__(self, graph: Graph, starts: Sequence[int]) -> None:
        self._graph = graph
        self.at = [Position(start, -1, 0, 0) for start in starts]

    def told(self, step: int, robot: int, motion: Motion, turned: bool) -> None:
        """What its robot has decided."""
        known = self.at[robot]
        if turned:
            assert known.towards >= 0
            home = Position(known.place, known.place, known.left_at, 2 * step - known.left_at)
            self.at[robot] = home if home.there_at > step else Position(known.place, -1, step, step)
        known = self.at[robot]
        if known.towards < 0 and not motion.free:
            arrival = step + _out(self._graph, known.place)[motion.towards] + 1
            self.at[robot] = Position(known.place, motion.towards, step, arrival)
        assert self.at[robot].towards == motion.towards

    def places(self, step: int) -> list[int]:
        for robot, known in enumerate(self.at):
            if known.towards >= 0 and known.there_at == step:
                self.at[robot] = Position(known.towards, -1, step, step)
        return [known.place for known in self.at]


class Run:
    """A team from its first step on, by the parts that robots are made of."""

    def __init__(self, graph: Graph, rules: Rules, robots: int, seed: int, wander: int, up: bool) -> None:
        self.graph, self.ways, self.hearing = graph, ways_of(graph, 1), hearing(graph)
        starts = Draws(seed, "starts").uniform(np.arange(robots)) * len(graph.vertices)
        self.members = [
            Member(self.ways, int(start), Draws(seed, f"{robot}"), wander)
            for robot, start in enumerate(starts)
        ]
        self.plain = PlainTeam(graph, [int(start) for start in starts])
        self.targets = (upwards if up else everybody)(robots)
        self.expected = _expected(graph)
        self.planner = Planner(self.ways, self.hearing, self.expected, rules)
        self.rules, self.wander = rules, wander
        self.known = [Knowledge({i: m.motion for i, m in enumerate(self.members)})] * robots
        self.groups: list[tuple[int, ...]] = []
        self.turned = self.met = self.moves = 0

    def step(self, step: int) -> None:
        motions = {i: member.motion for i, member in enumerate(self.members)}
        places = self.plain.places(step)
        assert [m.place for m in motions.values()] == places
        assert [m.free for m in motions.values()] == [known.towards < 0 for known in self.plain.at]
        groups = networks(dict(enumerate(places)), self.hearing)
        if step > self.wander:  # once together, always together
            for group in self.groups:
                assert any(set(group) <= set(now) for now in groups), (step, self.groups, groups)
        self.met += step > self.wander and len(groups) < len(self.groups)
        if step > 0:
            self.known = self.learnt(groups, motions)
        for i, member in enumerate(self.members):
            member.mind_own_business(step)
            if step < self.wander:
                self.plain.told(step, i, member.motion, turned=False)
        for group in groups if step >= self.wander else []:
            self.decide(step, group, motions, group not in self.groups or step == self.wander)
        self.groups = groups
        for member in self.members:
            member.advance()

    def learnt(self, groups: Sequence[tuple[int, ...]], motions: dict[int, Motion]) -> list[Knowledge]:
        known = list(self.known)
        for group in groups:
            here = {i: motions[i] for i in group}
            absent = [i for i in motions if i not in here]
            heard = heard_by(self.hearing, here.values())
            former = {id(self.known[i]): self.known[i] for i in group}.values()
            factors = [each.ticked(self.expected, self.ways, absent, heard, 0.0)[0] for each in former]
            together, _ = merged(factors, here)
            for i in group:
                known[i] = together
        return known

    def decide(self, step: int, group: tuple[int, ...], motions: dict[int, Motion], changed: bool) -> None:
        before = {i: motions[i] for i in group}
        targets = targets_of(group, group, self.targets)
        ages = {i: self.members[i].ages(self.rules.memory) for i in group}
        plan = self.planner.decided(
            before, targets, self.known[group[0]], ages, self.members[group[0]].drawn(step), changed
        )
        assert list(plan.motions) == list(group)
        self.turned += len(plan.turned)
        assert _stay_together(self.graph, list(plan.motions.values()))
        self.may_stand_still(plan.motions, targets)
        for i, motion in plan.motions.items():
            self.moves += before[i].free and not motion.free
            self.plain.told(step, i, motion, i in plan.turned)
            self.members[i].motion = motion

    def may_stand_still(self, motions: dict[int, Motion], targets: Sequence[int]) -> None:
        """Who searches and is alone never waits; a group only where it cannot go, or has nobody to find."""
        if not all(motion.free for motion in motions.values()):
            return
        assert not targets or not list(_decisions(self.graph, list(motions.values())))
        assert len(motions) > 1 or not targets


@given(
    graphs(9),
    st.sampled_from(METHODS),
    st.integers(2, 4),
    st.integers(0, 2**32),
    st.integers(0, 6),
    st.booleans(),
)
@settings(max_examples=45, deadline=None)
def test_no_team_ever_breaks_up(
    graph: Graph, method: str, robots: int, seed: int, wander: int, up: bool
) -> None:
    rules = Rules(method=method, horizon=4, width=2, budget=8)  # type: ignore[arg-type]
    run = Run(graph, rules, robots, seed, wander, up)
    for step in range(wander + 25):
        run.step(step)


def test_groups_meet_and_turn_back_in_such_runs() -> None:
    """Else the property above would say nothing of them."""
    length = (0.4, 1.6, 2.5, 1.0)
    ring = tuple((v, (v + 1) % 12, length[v % 4]) for v in range(12))
    graph = Graph(tuple((float(v), 0.0) for v in range(12)), (*ring, (0, 5, 2.5), (3, 9, 1.0)))
    met = turned = moves = 0
    for seed in range(6):
        run = Run(graph, Rules(method="persistent"), 4, seed, 3, up=False)
        for step in range(60):
            run.step(step)
        met, turned, moves = met + run.met, turned + run.turned, moves + run.moves
    assert met >= 6
    assert turned >= 3
    assert moves > 100


@given(st.data())
@settings(max_examples=40, deadline=None)
def test_what_nobody_decides_goes_as_foreseen(data: st.DataObject) -> None:
    graph = data.draw(graphs())
    ways = ways_of(graph, 1)
    (motion,) = data.draw(teams(graph, 1))
    if motion.free:
        motion = departed(ways, motion, data.draw(st.sampled_from(list(_out(graph, motion.place)))))
    arrival, place, towards = motion.left, motion.place, motion.towards
    for _ in range(arrival):
        assert motion.place == place
        assert not motion.free
        motion = moved(motion)
    assert motion == Motion(towards)


def test_a_group_that_cannot_move_waits() -> None:
    # Heard only within a vertex and between 0 and 2, which no way joins: neither may go, nor both.
    graph = Graph(((0, 0), (1, 0), (2, 0)), ((0, 1, 1.0), (1, 2, 2.5)), links=((0, 2),))
    near: Bools = hearing(graph)
    motions = [Motion(0), Motion(2)]
    assert not list(_decisions(graph, motions))
    assert joint_moves(ways_of(graph, 1), near, *arrays(motions)).tolist() == [[-1, -1]]
