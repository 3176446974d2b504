"""What holds for plans on any environment."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from agent.behaviours.reconnection.model import walk_model, ways_of
from agent.behaviours.reconnection.planner import choose, joint_moves, plan_alone, plan_team
from agent.behaviours.reconnection.planner_arrays import ground_of
from channels.graphs import hearing
from tests.reconnection_plans import random_graph, stays_together

SEEDS = st.integers(0, 2**32 - 1)
ROUNDING = 1e-12


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, horizon=st.integers(1, 9), miss=st.floats(0, 0.9), targets=st.integers(1, 3))
def test_longer_plans_are_better_and_deafer_ones_worse(
    seed: int, horizon: int, miss: float, targets: int
) -> None:
    generator = np.random.default_rng(seed)
    graph = random_graph(generator, int(generator.integers(2, 13)), 0)
    ways = ways_of(graph, 2)
    model = walk_model(graph, ways)
    ground = ground_of(ways, hearing(graph), [model] * targets)
    beliefs = generator.dirichlet(np.full(model.states, 0.2), targets)
    vertex = int(generator.integers(len(graph.vertices)))
    best = plan_alone(ground, beliefs, vertex, horizon, miss=miss)
    value = best.values.max()
    assert -ROUNDING <= value <= 1 + ROUNDING
    assert plan_alone(ground, beliefs, vertex, horizon + 1, miss=miss).values.max() >= value - ROUNDING
    assert plan_alone(ground, beliefs, vertex, horizon, miss=miss / 2).values.max() >= value - ROUNDING
    strict = plan_alone(ground, beliefs, vertex, horizon, miss=miss, slack=0.0)
    assert abs(strict.values.max() - value) <= ROUNDING
    fewer = ground_of(ways, hearing(graph), [model])
    assert plan_alone(fewer, beliefs[:1], vertex, horizon, miss=miss).values.max() <= value + ROUNDING


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, members=st.integers(1, 4), width=st.integers(1, 6))
def test_whatever_a_group_decides_keeps_it_together(seed: int, members: int, width: int) -> None:
    """From decision to decision; what is planned is among what is allowed, and never above its own bound."""
    generator = np.random.default_rng(seed)
    graph = random_graph(generator, int(generator.integers(2, 13)), 0)
    ways, near = ways_of(graph, 2), hearing(graph)
    model = walk_model(graph, ways)
    ground = ground_of(ways, near, [model])
    belief = generator.dirichlet(np.full(model.states, 0.2), 1)
    team = [(int(generator.integers(len(graph.vertices))), -1, 0)] * members
    for _ in range(4):
        places, towards, remaining = np.array(team).T
        plan = plan_team(ground, belief, places, towards, remaining, 6, width=width, budget=1)
        assert plan.values.max() <= plan.bound + ROUNDING
        allowed = joint_moves(ways, near, places, towards, remaining).tolist()
        assert all(move in allowed for move in plan.moves.tolist())
        move = plan.moves[choose(plan.values, 0.05, float(generator.random()))].tolist()
        for i, to in enumerate(move):
            if to >= 0:
                way = int(np.flatnonzero((ways.tail == team[i][0]) & (ways.head == to))[0])
                team[i] = (team[i][0], to, int(ways.steps[way]) + 1)
        assert any(left for _, _, left in team)
        assert stays_together(near, team)
        soon = min(left for _, _, left in team if left)
        team = [(to, -1, 0) if left == soon else (at, to, max(0, left - soon)) for at, to, left in team]
