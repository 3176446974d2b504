"""Sparse beliefs are the paper's tensors, on any small graph; merging and rounding keep their promises."""

from __future__ import annotations

import contextlib
import math
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from agent.behaviours.reconnection import belief as beliefs
from agent.behaviours.reconnection import mixture, pieces, wire
from agent.behaviours.reconnection.belief import Outcome
from agent.behaviours.reconnection.model import Model, walk_model, ways_of
from channels.graphs import Graph
from tests import reconnection_dense as dense

Array = NDArray[Any]


@st.composite
def graphs(draw: st.DrawFn, most: int = 5) -> Graph:
    """Connected: a random tree and some edges more."""
    count = draw(st.integers(2, most))
    pairs = {(draw(st.integers(0, v - 1)), v) for v in range(1, count)}
    every = [(a, b) for a in range(count) for b in range(a + 1, count)]
    pairs |= set(draw(st.lists(st.sampled_from(every), max_size=4)))
    lengths = st.sampled_from([0.3, 1.0, 1.7, 2.5])
    return Graph(
        vertices=tuple((float(v), 0.0) for v in range(count)),
        edges=tuple((a, b, draw(lengths)) for a, b in sorted(pairs)),
    )


@st.composite
def distributions(draw: st.DrawFn, size: int) -> list[float]:
    weights = draw(st.lists(st.integers(0, 9), min_size=size, max_size=size).filter(any))
    return [weight / sum(weights) for weight in weights]


class Case:
    """A model, sparse and dense, with random holding times, dwells and next vertices."""

    def __init__(self, draw: st.DrawFn) -> None:
        graph = draw(graphs())
        ways = ways_of(graph, 1)
        self.vertices = dense.augmented(graph)
        gammas = [draw(distributions(draw(st.integers(1, 4)))) for _ in self.vertices]
        count = len(graph.vertices)
        mu = [
            number
            for v in range(count)
            for number in draw(distributions(int(ways.start[v + 1] - ways.start[v])))
        ]
        self.model = walk_model(
            graph, ways, holding=gammas[count:], dwell=dict(enumerate(gammas[:count])), mu=mu
        )
        self.longest = max(map(len, gammas))
        self.holding = [dense.holding_matrix(gamma, self.longest) for gamma in gammas]
        directions = [at for at in self.vertices if isinstance(at, tuple)]
        self.m = dense.next_probabilities(self.vertices, dict(zip(directions, mu, strict=True)))
        self.f = dense.transition(self.m, self.holding)
        self.states = dense.states_of(self.model)

    def spread_out(self, belief: Array) -> Array:
        """A sparse belief as a (2, 0)-tensor."""
        tensor = np.zeros((len(self.vertices), self.longest))
        tensor[self.states] = belief
        return tensor

    def observed(self, heard: Array, belief: Array, miss: float) -> Array:
        after = dense.applied(dense.observation(self.vertices, heard, self.longest, miss), belief)
        if after.sum() == 0:
            able = self.spread_out(np.ones(self.model.states))
            free = dense.applied(dense.observation(self.vertices, heard, self.longest), able)
            after = free if free.sum() > 0 else able
        return np.asarray(after / after.sum())


cases = st.composite(Case)()


@st.composite
def any_belief(draw: st.DrawFn, states: int) -> Array:
    """Many zeros, and probabilities of all sizes."""
    sizes = st.one_of(st.just(0.0), st.floats(1e-12, 1.0), st.sampled_from([1e-200, 1e-30, 1.0]))
    drawn = draw(st.lists(sizes, min_size=min(states, 30), max_size=min(states, 30)))
    values = np.resize(drawn, states) * draw(st.sampled_from([1.0, 0.97])) ** np.arange(states)
    values[draw(st.integers(0, states - 1))] = 1.0
    return np.asarray(values / values.sum())


@settings(max_examples=40, deadline=None)
@given(cases)
def test_every_element_of_the_tensor(case: Case) -> None:
    assert np.allclose(case.f.sum(axis=(0, 1)), 1, rtol=0, atol=1e-14)
    assert all(np.allclose(matrix.sum(axis=0), 1, rtol=0, atol=1e-14) for matrix in case.holding)
    for state, (a, k) in enumerate(zip(*case.states, strict=True)):
        certain = np.zeros(case.model.states)
        certain[state] = 1.0
        column = case.spread_out(beliefs.advanced(case.model, certain))
        assert np.allclose(column, case.f[:, :, a, k], rtol=0, atol=1e-15)


@settings(max_examples=40, deadline=None)
@given(case=cases, data=st.data(), miss=st.sampled_from([0.0, 0.3]))
def test_sparse_is_dense(case: Case, data: st.DataObject, miss: float) -> None:
    """Two searchers, whose beliefs meet after some steps, and then go on together."""
    model = case.model
    places = st.lists(st.booleans(), min_size=model.vertices, max_size=model.vertices)
    pair = [beliefs.at_vertex(model, data.draw(st.integers(0, model.vertices - 1))) for _ in range(2)]
    tensors = [case.spread_out(belief) for belief in pair]
    for _ in range(5):
        for i in range(2):
            heard = np.array(data.draw(places))
            by_parts = beliefs.observed(model, heard, beliefs.advanced(model, pair[i]), miss)
            pair[i], outcome = beliefs.step(model, heard, pair[i], miss)
            assert np.array_equal(by_parts[0], pair[i])
            assert by_parts[1] is outcome
            tensors[i] = case.observed(heard, dense.applied(case.f, tensors[i]), miss)
            assert np.allclose(case.spread_out(pair[i]), tensors[i], rtol=0, atol=1e-12)
    together, outcome = beliefs.merged(pair)
    tensor = dense.merged(tensors)
    assert (tensor.sum() == 0) == (outcome is Outcome.disjoint)
    if outcome is Outcome.usual:
        assert np.allclose(case.spread_out(together), tensor, rtol=0, atol=1e-12)
    by_place = np.zeros(model.vertices)
    for at, mass in zip(case.vertices, case.spread_out(together).sum(axis=1), strict=True):
        by_place[at[0] if isinstance(at, tuple) else at] += mass
    assert np.allclose(beliefs.by_place(model, together), by_place, rtol=0, atol=1e-15)


def _model_of(graph: Graph, **options: Any) -> Model:
    return walk_model(graph, ways_of(graph, 2), **options)


@settings(max_examples=40, deadline=None)
@given(graph=graphs(most=8), data=st.data(), c=st.floats(0, 1))
def test_no_mass_is_lost(graph: Graph, data: st.DataObject, c: float) -> None:
    one, other = mixture.aligned(_model_of(graph), _model_of(graph, holding="normal", spread=0.3))
    belief = data.draw(any_belief(one.states))
    for after in (beliefs.advanced(one, belief), beliefs.advanced_mixture(one, other, c, belief)):
        assert math.isclose(math.fsum(after), 1.0, rel_tol=0, abs_tol=1e-14)
        assert np.all(after >= 0)


@settings(max_examples=60, deadline=None)
@given(data=st.data(), states=st.integers(1, 40), count=st.integers(1, 5))
def test_merging(data: st.DataObject, states: int, count: int) -> None:
    given_ = [data.draw(any_belief(states)) for _ in range(count)]
    together, outcome = beliefs.merged(given_)
    assert math.isclose(math.fsum(together), 1.0, rel_tol=0, abs_tol=1e-14)
    common = np.all(np.stack(given_) > 0, axis=0)
    assert (outcome is Outcome.usual) == bool(common.any())
    if outcome is Outcome.usual:
        assert np.array_equal(together > 0, common)
        assert np.array_equal(beliefs.merged(given_[::-1])[0], together)
    same, _ = beliefs.merged([given_[0]] * count)
    assert np.allclose(same, given_[0], rtol=1e-15 * 4, atol=0)
    assert np.allclose(same, given_[0], rtol=0, atol=1e-15)


@settings(max_examples=100, deadline=None)
@given(
    data=st.data(),
    states=st.integers(1, 300),
    bits=st.integers(1, 16),
    keep=st.sampled_from([0.5, 0.9, 0.999, 1 - 1e-6]),
)
def test_rounding_errs_by_no_more_than_stated(
    data: st.DataObject, states: int, bits: int, keep: float
) -> None:
    belief = data.draw(any_belief(states))
    got = wire.decode(states, wire.encode(belief, bits=bits, keep=keep))
    assert np.array_equal(got > 0, belief > 0)
    assert math.isclose(math.fsum(got), 1.0, rel_tol=0, abs_tol=1e-12)
    bound = wire.error_bound(int(np.count_nonzero(belief)), bits=bits, keep=keep)
    assert np.abs(got - belief).sum() / 2 <= bound + 1e-9


@settings(max_examples=50, deadline=None)
@given(data=st.data(), states=st.integers(1, 300))
def test_exactly_is_to_the_last_bit(data: st.DataObject, states: int) -> None:
    belief = data.draw(any_belief(states))
    assert np.array_equal(wire.decode(states, wire.exact(belief)), belief)


@settings(max_examples=200, deadline=None)
@given(data=st.data(), states=st.integers(1, 60), whole=st.booleans())
def test_no_bytes_do_harm(data: st.DataObject, states: int, whole: bool) -> None:
    """Random bytes, and good ones with some of them changed, are a belief or refused."""
    raw = bytearray(data.draw(st.binary(max_size=100)))
    if not whole:
        belief = data.draw(any_belief(states))
        raw = bytearray(data.draw(st.sampled_from([wire.exact(belief), wire.encode(belief)])))
        for _ in range(data.draw(st.integers(1, 3))):
            raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    with contextlib.suppress(wire.WireError):
        got = wire.decode(states, bytes(raw))
        assert got.shape == (states,)
        assert np.all(got >= 0)
        assert math.isclose(math.fsum(got), 1.0, rel_tol=0, abs_tol=1e-6)


@given(blob=st.binary(max_size=200), limit=st.integers(9, 60), data=st.data())
def test_pieces_there_and_back(blob: bytes, limit: int, data: st.DataObject) -> None:
    sent = pieces.split(blob, limit)
    assert max(map(len, sent)) <= limit
    assert pieces.joined(data.draw(st.permutations(sent))) == blob
