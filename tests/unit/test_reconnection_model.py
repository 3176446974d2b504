"""Models of how robots move: assumed, learnt, mixed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from agent.behaviours.reconnection import belief as beliefs
from agent.behaviours.reconnection import mixture
from agent.behaviours.reconnection.learning import History, empirical, learnt_dwell, learnt_holding, learnt_mu
from agent.behaviours.reconnection.model import hazards, normal, uniform, walk_model, ways_of
from channels.graphs import Graph
from tests import reconnection_dense as dense

# A path 0 - 1 - 2 and a way from 1 to 3 that is longer.
STAR = Graph(vertices=((0, 0), (1, 0), (2, 0), (1, 3)), edges=((0, 1, 1.0), (1, 2, 0.1), (1, 3, 2.25)))
WAYS = ways_of(STAR, 2)


def test_ways_take_at_least_a_step_and_halves_go_to_even() -> None:
    found = {
        (int(u), int(w)): int(steps) for u, w, steps in zip(WAYS.tail, WAYS.head, WAYS.steps, strict=True)
    }
    assert found == {(0, 1): 2, (1, 0): 2, (1, 2): 1, (2, 1): 1, (1, 3): 4, (3, 1): 4}
    assert WAYS.start.tolist() == [0, 1, 4, 5, 6]
    assert WAYS.head.tolist() == [1, 0, 2, 3, 1, 1]


def test_size_is_the_papers() -> None:
    """n_a = n_e + 2 N_e augmented vertices, 4 N_e directed edges (sec. III.A)."""
    model = walk_model(STAR, WAYS)
    assert len(model.place) == 4 + 2 * 3
    assert len(model.next_at) == 4 * 3
    assert model.place.tolist() == [0, 1, 2, 3, *WAYS.tail.tolist()]
    assert np.all(model.hazard[model.first[1:] - 1] == 1)
    assert np.diff(model.first).tolist() == [1, 1, 1, 1, 3, 3, 1, 6, 1, 6]


@pytest.mark.parametrize(("tau", "support"), [(1, [1]), (2, [1, 2, 3]), (3, [2, 3, 4]), (5, [3, 4, 5, 6, 7])])
def test_between_half_and_one_and_a_half_of_the_time(tau: int, support: list[int]) -> None:
    gamma = uniform(tau)
    assert (np.flatnonzero(gamma) + 1).tolist() == support
    assert gamma[support[0] - 1 :] == pytest.approx(1 / len(support))


def test_uniform_does_not_stumble_over_binary_fractions() -> None:
    assert (np.flatnonzero(uniform(10, 0.1)) + 1).tolist() == [9, 10, 11]
    assert (np.flatnonzero(uniform(10, 0.7)) + 1).tolist() == list(range(3, 18))
    assert (np.flatnonzero(uniform(2, 3.0)) + 1).tolist() == list(range(1, 9))


@pytest.mark.parametrize(("tau", "spread"), [(2, 0.5), (7, 0.2), (30, 0.1), (30, 0.6)])
def test_normal(tau: int, spread: float) -> None:
    gamma = normal(tau, spread)
    steps = np.arange(1, len(gamma) + 1)
    assert gamma.sum() == pytest.approx(1)
    assert gamma @ steps == pytest.approx(tau)
    assert np.argmax(gamma) == tau - 1
    assert gamma @ (steps - tau) ** 2 <= (spread * tau) ** 2 + 1 / 12  # cut off, and in whole steps


def test_normal_comes_close_to_its_deviation_where_little_is_cut_off() -> None:
    gamma = normal(100, 0.1)
    assert math.sqrt(gamma @ (np.arange(1, len(gamma) + 1) - 100) ** 2) == pytest.approx(10, rel=0.02)
    assert normal(100, 0.0).tolist() == uniform(100, 0.0).tolist() == [0.0] * 99 + [1.0]
    assert normal(1, 5.0).tolist() == [1.0]


def test_hazards_by_hand() -> None:
    assert hazards([0.25, 0.25, 0.5, 0.0, 0.0]).tolist() == [0.25, 1 / 3, 1.0, 1.0, 1.0]


def test_tasks_at_vertices_take_time() -> None:
    model = walk_model(STAR, WAYS, dwell={0: [0.0, 0.5, 0.5]})
    belief = beliefs.advanced(model, beliefs.at_vertex(model, 0))
    assert np.array_equal(belief, beliefs.at_vertex(model, 0, 2))
    belief = beliefs.advanced(model, belief)
    assert dense.by_vertex(model, belief)[[0, 4]].tolist() == [0.5, 0.5]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"holding": "gamma"}, "holding: must be one of uniform, normal, is 'gamma'"),
        ({"holding": [[1.0]]}, "holding: 1 distributions for 6 ways"),
        ({"holding": [[1.0]] * 5 + [[0.5, 0.4]]}, r"holding\[5\]: must be probabilities"),
        ({"spread": -0.1}, "spread: must be a number of 0 or more"),
        ({"spread": math.nan}, "spread: must be a number of 0 or more"),
        ({"mu": [1.0, 0.5]}, "mu: must be 6 probabilities"),
        ({"mu": [1.0, 0.5, 0.5, 0.5, 1.0, 1.0]}, "mu: those of the ways out of vertex 1"),
        ({"mu": [1.0, 1.5, -0.5, 0.0, 1.0, 1.0]}, "mu: must be 6 probabilities"),
        ({"dwell": {4: [1.0]}}, "dwell: there is no vertex 4"),
        ({"dwell": {1: []}}, r"dwell\[1\]: must be probabilities"),
        ({"dwell": {1: [math.nan]}}, r"dwell\[1\]: must be probabilities"),
    ],
)
def test_what_is_no_model(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}"):
        walk_model(STAR, WAYS, **options)


def test_ways_of_another_graph() -> None:
    path = Graph(vertices=((0, 0), (1, 0)), edges=((0, 1, 1.0),))
    with pytest.raises(ValueError, match="another graph"):
        walk_model(path, WAYS)


def test_empirical() -> None:
    assert empirical([2, 2, 4]).tolist() == [0, 2 / 3, 0, 1 / 3]
    assert empirical([2, 2, 4], smoothing=1.0, longest=5).tolist() == [1 / 8, 3 / 8, 1 / 8, 2 / 8, 1 / 8]
    for samples, smoothing, longest in (([], 0.0, None), ([], 1.0, None), ([0], 0.0, None), ([3], 0.0, 2)):
        with pytest.raises(ValueError, match="samples"):
            empirical(samples, smoothing, longest)
    with pytest.raises(ValueError, match="smoothing"):
        empirical([1], -1.0)


def test_a_history_tells_ways_and_times() -> None:
    history = History(WAYS)
    for vertex, step, left in ((0, 0, 0), (1, 3, 5), (3, 9, 9), (1, 15, 15), (0, 19, 20), (1, 23, 23)):
        history.visit(vertex, step, left)
    history.visit(1, 4, robot=1)
    history.visit(0, 6, robot=1)
    assert history.went.tolist() == [2, 2, 0, 1, 0, 1]
    assert history.on_way == [[2, 2], [3, 1], [], [3], [], [5]]
    assert history.stayed == {0: [1, 2, 1], 1: [3, 1, 1, 1], 3: [1]}
    assert history.mu(prior=0.0).tolist() == [1, 2 / 3, 0, 1 / 3, 1, 1]
    assert history.mu().tolist() == [1, 3 / 6, 1 / 6, 2 / 6, 1, 1]
    assert history.dwell(prior=0.0)[1].tolist() == [3 / 4, 0, 1 / 4]
    # One sample more, a third of it of each number of steps.
    assert history.dwell()[1] == pytest.approx([10 / 15, 1 / 15, 4 / 15], abs=1e-15)
    assert history.dwell()[3].tolist() == [1]


def test_what_is_learnt_makes_a_model() -> None:
    history = History(WAYS)
    for vertex, step in ((0, 0), (1, 4), (3, 10), (1, 14)):
        history.visit(vertex, step)
    model = walk_model(
        STAR, WAYS, holding=history.holding(prior=0.0), mu=history.mu(prior=0.0), dwell=history.dwell()
    )
    belief = beliefs.at_vertex(model, 0)
    for _ in range(10):
        belief = beliefs.advanced(model, belief)
    assert np.array_equal(belief, beliefs.at_vertex(model, 3))  # it did so once, and nothing else is known


def test_who_has_always_worked_somewhere_may_pass_through() -> None:
    """One sample of three is the prior's, a third of which leaves after one step."""
    for prior, leaves in ((0.0, 0.0), (1.0, 1 / 9)):
        model = walk_model(STAR, WAYS, dwell={0: learnt_dwell([3, 3], prior)})
        belief = beliefs.advanced(model, beliefs.at_vertex(model, 0))
        assert dense.by_vertex(model, belief)[[0, 4]] == pytest.approx([1 - leaves, leaves], abs=1e-15)
    for stays, prior, message in (([3], -1.0, "prior"), ([3], math.nan, "prior"), ([], 1.0, "samples")):
        with pytest.raises(ValueError, match=message):
            learnt_dwell(stays, prior)


def test_a_history_refuses_jumps() -> None:
    history = History(WAYS)
    history.visit(0, 0)
    for vertex, step, message in (
        (2, 9, "no way leads to vertex 2"),
        (1, 1, "no way leads"),
        (9, 5, "none can be"),
    ):
        with pytest.raises(ValueError, match=message):
            history.visit(vertex, step)
    history.forget()
    history.visit(2, 9)
    assert history.went.sum() == 0


def test_learnt_without_data_is_what_one_assumes() -> None:
    assert learnt_mu(WAYS, [0] * 6, 0.0).tolist() == [1, 1 / 3, 1 / 3, 1 / 3, 1, 1]
    for found, steps in zip(learnt_holding(WAYS, [[]] * 6), WAYS.steps.tolist(), strict=True):
        assert np.array_equal(found, uniform(steps))
    assert learnt_holding(WAYS, [[5]] + [[]] * 5, prior=3.0)[0] == pytest.approx(
        [1 / 4, 1 / 4, 1 / 4, 0, 1 / 4]
    )
    for went, prior, message in (([0] * 5, 1.0, "went"), ([-1] * 6, 1.0, "went"), ([0] * 6, -1.0, "prior")):
        with pytest.raises(ValueError, match=message):
            learnt_mu(WAYS, went, prior)
    with pytest.raises(ValueError, match="on_way"):
        learnt_holding(WAYS, [[]] * 5)
    with pytest.raises(ValueError, match="prior"):
        learnt_holding(WAYS, [[]] * 6, math.inf)


def test_the_longer_the_more_willing() -> None:
    assert mixture.willingness(0, 40) == 0
    assert mixture.willingness(40, 40) == pytest.approx(0.5)
    assert mixture.willingness(80, 40) == pytest.approx(0.75)
    assert mixture.willingness(10**6, 40) == 1


def test_a_mixture_is_the_mean_of_both() -> None:
    """One of them moves on at once, the other stays for two steps: 1/4 of it is on the way after one."""
    moving, staying = mixture.aligned(walk_model(STAR, WAYS), walk_model(STAR, WAYS, dwell={0: [0.0, 1.0]}))
    assert moving.states == staying.states
    assert np.array_equal(moving.first, staying.first)
    after = beliefs.advanced_mixture(moving, staying, 0.25, beliefs.at_vertex(moving, 0))
    assert dense.by_vertex(moving, after).tolist() == [0.75, 0, 0, 0, 0.25, 0, 0, 0, 0, 0]


def test_aligned_models_are_still_themselves() -> None:
    for option in ({"spread": 0.0}, {"holding": "normal"}, {"dwell": {1: [0.1, 0.2, 0.7]}}):
        model = walk_model(STAR, WAYS, **option)
        wide, _ = mixture.aligned(model, walk_model(STAR, WAYS, spread=2.0, dwell={1: [0.2] * 5}))
        narrow, stretched = beliefs.at_vertex(model, 1), beliefs.at_vertex(wide, 1)
        for _ in range(12):
            narrow, stretched = beliefs.advanced(model, narrow), beliefs.advanced(wide, stretched)
            expected = dense.by_vertex(model, narrow)
            assert dense.by_vertex(wide, stretched) == pytest.approx(expected, abs=1e-15)


def test_models_of_different_graphs_have_no_states_in_common() -> None:
    path = Graph(vertices=((0, 0), (1, 0)), edges=((0, 1, 1.0),))
    with pytest.raises(ValueError, match="different graphs"):
        mixture.aligned(walk_model(path, ways_of(path, 2)), walk_model(STAR, WAYS))


@pytest.mark.parametrize(
    "option", [{"dwell": {1: [0.1, 0.2, 0.7]}}, {"spread": 0.0}, {"mu": [1, 0.7, 0.2, 0.1, 1, 1]}]
)
def test_models_that_differ_in_one_way_blend_into_one(option: dict[str, Any]) -> None:
    one, other = mixture.aligned(walk_model(STAR, WAYS), walk_model(STAR, WAYS, **option))
    both = mixture.blended(one, other, 0.3)
    belief = np.arange(1.0, one.states + 1)
    expected = beliefs.advanced_mixture(one, other, 0.3, belief)
    assert beliefs.advanced(both, belief) == pytest.approx(expected, rel=1e-13)


def test_models_that_differ_in_both_blend_by_how_often_they_leave() -> None:
    """One leaves vertex 1 after every step, the other after every third: three quarters of who leaves."""
    one, other = mixture.aligned(
        walk_model(STAR, WAYS),
        walk_model(STAR, WAYS, dwell={1: [0.0, 0.0, 1.0]}, mu=[1, 1, 0, 0, 1, 1]),
    )
    both = mixture.blended(one, other, 0.5)
    assert both.next_mu[1:4] == pytest.approx([3 / 4 / 3 + 1 / 4, 1 / 4, 1 / 4])
    mass = beliefs.advanced(both, beliefs.at_vertex(both, 1)).sum()
    assert mass == pytest.approx(1)


def test_ways_that_take_too_long_are_refused() -> None:
    """What beliefs would need a number for at every step of."""
    for length in (1e300, 60_000.0):
        graph = Graph(((0, 0), (1, 0), (2, 0)), ((0, 1, 1.0), (1, 2, length)))
        with pytest.raises(
            ValueError, match=r"^travel_steps: the way from vertex 1 to 2, .* more than 100,000 steps; set"
        ):
            ways_of(graph, 2.0)
        limit = 100_000 / length
        assert ways_of(graph, limit).steps.max() == 100_000
    many = Graph(tuple((float(x), 0.0) for x in range(100)), tuple((x, x + 1, 40_000.0) for x in range(99)))
    with pytest.raises(
        ValueError, match=r"^travel_steps: all ways together take 7,920,000 steps, .* less than 0.631$"
    ):
        ways_of(many, 1.0)
    assert ways_of(many, 0.6).steps.sum() == 99 * 2 * 24_000
