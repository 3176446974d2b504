"""Planned searches against all plans played to their end (`reconnection_plans`), and what a plan promises."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

from agent.behaviours.reconnection import kernels
from agent.behaviours.reconnection.model import Model, Ways, walk_model, ways_of
from agent.behaviours.reconnection.planner import TeamPlan, choose, joint_moves, plan_alone, plan_team
from agent.behaviours.reconnection.planner_arrays import Ground, ground_of
from channels.graphs import Bools, Floats, Graph, Ints, hearing
from tests.reconnection_plans import (
    Decision,
    Member,
    best_alone,
    best_joint,
    decisions,
    random_graph,
    stays_together,
    targets_of,
    ways_out,
    worth,
)

ROOMY = 1 << 12
"""A width that small cases do not fill."""

SAME = 1e-12


class Case(NamedTuple):
    ways: Ways
    hearing: Bools
    models: list[Model]
    ground: Ground
    beliefs: list[Floats]
    miss: float
    horizon: int


def case_of(graph: Graph, generator: np.random.Generator, horizon: int, miss: float = 0.0) -> Case:
    """One to three targets, that may move unlike each other, anywhere."""
    ways, near = ways_of(graph, 2), hearing(graph)
    kinds = [walk_model(graph, ways), walk_model(graph, ways, holding="normal", spread=0.3)]
    models = [kinds[generator.integers(2)] for _ in range(generator.integers(1, 4))]
    beliefs = [generator.random(model.states) ** 4 for model in models]
    beliefs = [belief / belief.sum() for belief in beliefs]
    return Case(ways, near, models, ground_of(ways, near, models), beliefs, miss, horizon)


def small_case(generator: np.random.Generator, most_vertices: int, longest: int) -> Case:
    graph = random_graph(generator, int(generator.integers(4, most_vertices + 1)), int(generator.integers(4)))
    horizon, miss = int(generator.integers(1, longest + 1)), float(generator.choice([0.0, 0.3]))
    return case_of(graph, generator, horizon, miss)


def random_team(generator: np.random.Generator, case: Case, members: int) -> list[Member]:
    """Some at a vertex, some on the way, some on the way back; what they are committed to is safe."""
    while True:
        team: list[Member] = []
        for _ in range(members):
            place = int(generator.integers(len(case.hearing)))
            to, steps = ways_out(case.ways, place)[0]
            team.append(
                [(place, -1, 0), (place, to, int(generator.integers(1, steps + 2))), (place, place, 2)][
                    generator.choice(3, p=[0.6, 0.25, 0.15])
                ]
            )
        if stays_together(case.hearing, team):
            return team


def arrays(team: list[Member]) -> tuple[Ints, Ints, Ints]:
    places, towards, remaining = np.array(team, dtype=np.int64).T
    return places, towards, remaining


def planned(case: Case, team: list[Member], **options: float) -> TeamPlan:
    options = {"miss": case.miss, "width": ROOMY, "budget": 1, **options}
    return plan_team(case.ground, case.beliefs, *arrays(team), case.horizon, **options)  # type: ignore[arg-type]


@cache
def tried_out(seed: int, members: int, longest: int) -> tuple[Case, list[Member], dict[Decision, float]]:
    """A small case, a team, and the values of its first decisions by trying, which takes by far the longest."""
    generator = np.random.default_rng(seed)
    case = small_case(generator, 6, longest)
    team = random_team(generator, case, members)
    return case, team, by_trying(case, team)


def by_trying(case: Case, team: list[Member]) -> dict[Decision, float]:
    targets = targets_of(case.models, case.beliefs)
    return best_joint(case.ways, targets, case.hearing, team, case.horizon, case.miss)


def test_one_searcher_finds_what_trying_all_paths_finds() -> None:
    for seed in range(200):
        generator = np.random.default_rng(seed)
        case = small_case(generator, 9, 9)
        vertex = int(generator.integers(len(case.hearing)))
        targets = targets_of(case.models, case.beliefs)
        tried = best_alone(case.ways, targets, case.hearing, vertex, case.horizon, case.miss)
        for slack in (0.0, 0.05, 0.5):
            plan = plan_alone(case.ground, case.beliefs, vertex, case.horizon, miss=case.miss, slack=slack)
            assert plan.first.tolist() == sorted(tried)
            least = (1 - slack) * max(tried.values())
            for to, value in zip(plan.first.tolist(), plan.values.tolist(), strict=True):
                if value >= 0 or tried[to] > least + SAME:
                    assert value == pytest.approx(tried[to], abs=SAME), seed
                assert value < 0 or value >= least - SAME


def test_the_best_path_is_worth_what_is_said() -> None:
    for seed in range(20):
        generator = np.random.default_rng(seed)
        case = small_case(generator, 9, 12)
        vertex = int(generator.integers(len(case.hearing)))
        plan = plan_alone(case.ground, case.beliefs, vertex, case.horizon, miss=case.miss)
        at, seen = vertex, []
        for to in plan.best_path:
            steps = dict(ways_out(case.ways, at))[to]
            seen += [(at,)] * steps + [(to,)]
            at = to
        assert len(seen) >= case.horizon > 0
        value = worth(targets_of(case.models, case.beliefs), case.hearing, seen[: case.horizon], case.miss)
        assert value == pytest.approx(plan.values.max(), abs=SAME)


@pytest.mark.parametrize(("members", "cases", "longest"), [(1, 15, 8), (2, 30, 7), (3, 12, 5)])
def test_a_group_finds_what_trying_all_joint_plans_finds(members: int, cases: int, longest: int) -> None:
    for seed in range(cases):
        case, team, tried = tried_out(seed, members, longest)
        plan = planned(case, team)
        best = max(tried.values())
        assert plan.proven
        assert plan.bound == pytest.approx(best, abs=1e-9)
        for move, value in zip(plan.moves.tolist(), plan.values.tolist(), strict=True):
            if value >= 0 or tried[tuple(move)] > 0.95 * best + SAME:
                assert value == pytest.approx(tried[tuple(move)], abs=SAME), seed
        assert plan.values.max() == pytest.approx(best, abs=SAME)


def test_a_search_that_has_dropped_nodes_says_how_far_it_may_be_from_the_best() -> None:
    unproven = worse = 0
    for seed in range(15):
        case, team, tried = tried_out(seed, 2, 7)
        best = max(tried.values())
        plan = planned(case, team, width=1)
        assert plan.values.max() <= best + SAME
        assert plan.bound >= best - SAME
        assert plan.proven <= (plan.values.max() >= best - SAME)
        unproven += not plan.proven
        worse += plan.values.max() < best - SAME
    assert unproven
    assert worse


def test_a_greater_budget_widens_the_search_until_it_is_proven() -> None:
    proven = 0
    for seed in range(15):
        generator = np.random.default_rng(seed)
        case = small_case(generator, 6, 7)
        team = random_team(generator, case, 2)
        narrow, wide = planned(case, team, width=1), planned(case, team, width=1, budget=10**6)
        assert wide.proven
        assert wide.values.max() == pytest.approx(planned(case, team).values.max(), abs=SAME)
        assert (wide.width > narrow.width) == (not narrow.proven)
        assert wide.nodes >= narrow.nodes
        proven += narrow.proven
    assert proven < 15


def test_a_group_of_one_plans_as_a_lone_searcher() -> None:
    for seed in range(20):
        generator = np.random.default_rng(seed)
        case = small_case(generator, 9, 12)
        vertex = int(generator.integers(len(case.hearing)))
        alone = plan_alone(case.ground, case.beliefs, vertex, case.horizon, miss=case.miss)
        group = planned(case, [(vertex, -1, 0)])
        assert group.moves[:, 0].tolist() == alone.first.tolist()
        np.testing.assert_allclose(group.values, alone.values, rtol=0, atol=SAME)


def test_joint_moves_are_the_safe_ones_in_order() -> None:
    for seed in range(60):
        generator = np.random.default_rng(seed)
        case = small_case(generator, 7, 1)
        team = random_team(generator, case, int(generator.integers(1, 5)))
        tried = [list(decision) for decision, _ in decisions(case.ways, case.hearing, team)]
        found = joint_moves(case.ways, case.hearing, *arrays(team))
        assert found.tolist() == (tried or [[-1] * len(team)])
        once = joint_moves(case.ways, case.hearing, *arrays(team), once=True).tolist()
        kinds = {move: tuple(sorted(zip(team, move, strict=True))) for move in map(tuple, found.tolist())}
        assert len(once) == len(set(kinds.values()))
        assert {kinds[tuple(move)] for move in once} == set(kinds.values())


def test_more_joint_moves_than_are_looked_at_together() -> None:
    spokes = 40
    star = Graph(((0.0, 0.0),) * (spokes + 1), tuple((0, i, 1.0) for i in range(1, spokes + 1)))
    ways, near = ways_of(star, 2), hearing(star)
    found = joint_moves(ways, near, np.zeros(2), np.full(2, -1), np.zeros(2))
    wanted = decisions(ways, near, [(0, -1, 0)] * 2)
    assert found.tolist() == [list(decision) for decision, _ in wanted]
    assert len(found) == 3 * spokes  # one leaves, or both go the same way


def test_safe_follows_the_team_to_the_last_arrival() -> None:
    verdicts = []
    for seed in range(150):
        generator = np.random.default_rng(seed)
        case = small_case(generator, 7, 1)
        team = []
        for _ in range(generator.integers(1, 5)):
            place, left = int(generator.integers(len(case.hearing))), int(generator.integers(4))
            team.append((place, int(generator.choice([w for w, _ in ways_out(case.ways, place)])), left))
        verdict = stays_together(case.hearing, team)
        assert kernels.safe(*arrays(team), case.hearing) == verdict
        verdicts.append(verdict)
    assert 0.1 < np.mean(verdicts) < 0.9


def test_a_group_that_can_go_nowhere_stays() -> None:
    graph = Graph(((0.0, 0.0),) * 4, ((0, 2, 1.0), (1, 3, 1.0), (2, 3, 1.0)), links=((0, 1),))
    case = case_of(graph, np.random.default_rng(1), 6)
    team: list[Member] = [(0, -1, 0), (1, -1, 0)]
    plan = planned(case, team)
    assert plan.moves.tolist() == [[-1, -1]]
    assert plan.values.tolist() == pytest.approx(list(by_trying(case, team).values()), abs=SAME)
    apart = joint_moves(case.ways, case.hearing, np.array([0, 3]), np.full(2, -1), np.zeros(2))
    assert apart.tolist() == [[-1, -1]]


def test_choosing_among_the_near_best() -> None:
    values = [0.2, 0.96, 0.94, 1.0, -1.0]
    draws = (np.arange(1000) + 0.5) / 1000
    chosen = np.bincount([choose(values, 0.05, u) for u in draws], minlength=5)
    assert chosen.tolist() == [0, 500, 0, 500, 0]
    assert choose(values, 0.0, 0.999) == 3
    assert choose([0.3, 0.3 * (1 + 1e-15), 0.1], 0.0, 0.0) == 0  # rounding does not tell them apart
    assert choose([0.0, 0.0], 0.05, 1 - 1e-16) == 1


def test_nothing_to_find_anywhere_near() -> None:
    """All plans are worth 0; each is as good as any."""
    graph = Graph(((0.0, 0.0),) * 30, tuple((i, i + 1, 1.0) for i in range(29)))
    case = case_of(graph, np.random.default_rng(1), 6)
    beliefs = [np.where(model.place.repeat(np.diff(model.first)) > 25, 1.0, 0.0) for model in case.models]
    alone = plan_alone(case.ground, beliefs, 1, 6)
    assert alone.values.tolist() == [0.0, 0.0]
    group = plan_team(case.ground, beliefs, *arrays([(1, -1, 0), (2, -1, 0)]), 6)
    assert group.proven
    assert not group.values.any()


def test_what_does_not_fit_is_named() -> None:
    case = case_of(random_graph(np.random.default_rng(1), 5, 1), np.random.default_rng(1), 4)
    with pytest.raises(ValueError, match="beliefs: there must be one for each target"):
        plan_alone(case.ground, [*case.beliefs, case.beliefs[0]], 0, 4)
    with pytest.raises(ValueError, match="horizon: must be at least 1 step, not 0"):
        plan_alone(case.ground, case.beliefs, 0, 0)
    with pytest.raises(ValueError, match="miss: must be at least 0 and less than 1, not 1"):
        plan_alone(case.ground, case.beliefs, 0, 4, miss=1.0)
    with pytest.raises(ValueError, match="slack: must be at least 0 and less than 1, not 2"):
        plan_alone(case.ground, case.beliefs, 0, 4, slack=2)
    with pytest.raises(ValueError, match="models: names no target"):
        ground_of(case.ways, case.hearing, [])
    with pytest.raises(ValueError, match="must all be of one environment"):
        ground_of(case.ways, case.hearing[:-1, :-1], case.models)
