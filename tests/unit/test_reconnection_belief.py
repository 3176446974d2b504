"""Beliefs against hand calculation, and against Eqs. 1 to 7 in Fractions."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from agent.behaviours.reconnection import belief as beliefs
from agent.behaviours.reconnection.belief import Outcome
from agent.behaviours.reconnection.model import walk_model, ways_of
from channels.graphs import Floats, Graph, hearing
from tests import reconnection_dense as dense

PATH = Graph(vertices=((0, 0), (1, 0), (2, 0)), edges=((0, 1, 1.0), (1, 2, 1.0)))
WAYS = ways_of(PATH, 2)
MODEL = walk_model(PATH, WAYS)
HEARING = hearing(PATH)

# (at, steps there): probability after four steps without an observation, from vertex 0; tau = 2.
AFTER_FOUR: dict[tuple[dense.Augmented, int], Fraction] = {
    (0, 1): Fraction(1, 18),
    (1, 1): Fraction(1, 3),
    (2, 1): Fraction(1, 18),
    ((1, 0), 1): Fraction(1, 6),
    ((1, 0), 2): Fraction(1, 9),
    ((1, 2), 1): Fraction(1, 6),
    ((1, 2), 2): Fraction(1, 9),
}


def _after(steps: int) -> Floats:
    belief = beliefs.at_vertex(MODEL, 0)
    for _ in range(steps):
        belief = beliefs.advanced(MODEL, belief)
    return belief


def test_four_steps_along_a_path() -> None:
    vertices = dense.augmented(PATH)
    expected = np.zeros(MODEL.states)
    for (at, steps), probability in AFTER_FOUR.items():
        expected[MODEL.first[vertices.index(at)] + steps - 1] = probability
    assert _after(4) == pytest.approx(expected, abs=1e-15)


def test_the_papers_equations_give_the_same_fractions() -> None:
    vertices = dense.augmented(PATH)
    third = [Fraction(1, 3)] * 3
    mu = {way: Fraction(1, 2 if way[0] == 1 else 1) for way in vertices if isinstance(way, tuple)}
    holding = [dense.holding_matrix(third if isinstance(at, tuple) else [Fraction(1)], 3) for at in vertices]
    transition = dense.transition(dense.next_probabilities(vertices, mu), holding)
    belief = np.full((len(vertices), 3), Fraction(0))
    belief[0, 0] = Fraction(1)
    for _ in range(4):
        belief = dense.applied(transition, belief)
    found = {(vertices[a], int(k) + 1): belief[a, k] for a, k in np.argwhere(belief > 0)}
    assert found == AFTER_FOUR
    assert np.all(transition.sum(axis=(0, 1)) == 1)
    assert all(np.all(matrix.sum(axis=0) == 1) for matrix in holding)


def test_a_move_takes_one_step_more_than_the_way() -> None:
    graph = Graph(vertices=((0, 0), (1, 0)), edges=((0, 1, 1.5),))
    ways = ways_of(graph, 2)
    model = walk_model(graph, ways, spread=0.0)
    belief = beliefs.at_vertex(model, 0)
    for elapsed in (1, 2, 3):
        belief = beliefs.advanced(model, belief)
        assert np.array_equal(belief, beliefs.on_way(model, 0, elapsed))
    assert np.array_equal(beliefs.advanced(model, belief), beliefs.at_vertex(model, 1))


def test_where_a_robot_is_for_longer_than_can_be() -> None:
    assert np.array_equal(beliefs.at_vertex(MODEL, 1, 7), beliefs.at_vertex(MODEL, 1))
    assert np.array_equal(beliefs.on_way(MODEL, 2, 9), beliefs.on_way(MODEL, 2, 3))
    assert not np.array_equal(beliefs.on_way(MODEL, 2, 2), beliefs.on_way(MODEL, 2, 3))
    with pytest.raises(ValueError, match="not 0"):
        beliefs.on_way(MODEL, 2, 0)


def test_on_its_way_a_robot_communicates_as_from_where_it_left() -> None:
    belief = beliefs.on_way(MODEL, 1, 2)  # 1 > 0
    assert (WAYS.tail[1], WAYS.head[1]) == (1, 0)
    assert beliefs.by_place(MODEL, belief).tolist() == [0, 1, 0]
    assert dense.by_vertex(MODEL, belief).tolist() == [0, 0, 0, 0, 1, 0, 0]


def test_silence_clears_what_is_heard() -> None:
    heard = beliefs.heard_from(HEARING, [0])
    assert heard.tolist() == [True, True, False]
    after, outcome = beliefs.observed(MODEL, heard, _after(4))
    assert outcome is Outcome.usual
    assert np.array_equal(after, beliefs.at_vertex(MODEL, 2))


def test_silence_may_be_a_loss() -> None:
    """1/18 at 0, 8/9 at place 1, 1/18 at 2: with heard places halved, 9/19 in all."""
    after, outcome = beliefs.observed(MODEL, beliefs.heard_from(HEARING, [0]), _after(4), miss=0.5)
    assert outcome is Outcome.usual
    left = np.array([1 / 36, 16 / 36, 1 / 18])
    assert beliefs.by_place(MODEL, after) == pytest.approx(left / left.sum(), abs=1e-15)


def test_nothing_left_is_anywhere_unheard() -> None:
    after, outcome = beliefs.observed(MODEL, np.array([True, True, False]), beliefs.at_vertex(MODEL, 0))
    assert outcome is Outcome.nothing_left
    unheard = np.flatnonzero(after)
    assert unheard.tolist() == [2, 12, 13, 14]  # vertex 2, and 2 > 1
    assert np.all(after[unheard] == 1 / 4)


def test_everything_heard_is_anywhere() -> None:
    heard = beliefs.heard_from(HEARING, [0, 2])
    after, outcome = beliefs.observed(MODEL, heard, _after(4))
    assert outcome is Outcome.everything_heard
    assert np.all(after == 1 / MODEL.states)
    softened, outcome = beliefs.observed(MODEL, heard, _after(4), miss=0.25)
    assert outcome is Outcome.usual
    assert softened == pytest.approx(_after(4), abs=1e-15)


def test_what_is_given_stays_what_it_is() -> None:
    heard, belief = beliefs.heard_from(HEARING, [0]), _after(4)
    before = belief.copy()
    beliefs.advanced(MODEL, belief)
    beliefs.observed(MODEL, heard, belief)
    beliefs.step(MODEL, heard, belief)
    beliefs.merged([belief, belief])
    beliefs.mass_at(MODEL, belief, 1)
    assert np.array_equal(belief, before)


def test_merge_by_hand() -> None:
    one, other = np.array([0.5, 0.5, 0.0]), np.array([0.125, 0.375, 0.5])
    mean, outcome = beliefs.merged([one, other])
    assert outcome is Outcome.usual
    assert mean == pytest.approx(np.array([1, 3**0.5, 0]) / (1 + 3**0.5), abs=1e-15)


def test_disjoint_beliefs_are_averaged() -> None:
    merged, outcome = beliefs.merged([np.array([1.0, 0, 0]), np.array([0, 0.5, 0.5])])
    assert outcome is Outcome.disjoint
    assert merged.tolist() == [0.5, 0.25, 0.25]


def test_merge_of_what_is_hardly_possible() -> None:
    """Products of these are too small for a float."""
    one = np.array([1.0, 1e-300, 5e-324])
    mean, outcome = beliefs.merged([one, one, np.array([1.0, 1e-200, 5e-324])])
    assert outcome is Outcome.usual
    assert mean[1] == pytest.approx(10 ** (-800 / 3), rel=1e-13)
    assert mean[2] == 5e-324


def test_calibration() -> None:
    belief = _after(4)
    assert beliefs.mass_at(MODEL, belief, 1) == pytest.approx(8 / 9, abs=1e-15)
    assert beliefs.mass_at(MODEL, beliefs.at_vertex(MODEL, 0), 0) == 1
    assert beliefs.mass_at(MODEL, beliefs.at_vertex(MODEL, 0), 2) == 0
