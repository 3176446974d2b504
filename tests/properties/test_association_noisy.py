"""What holds of association under noise whatever is heard and seen."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from agent.behaviours.association.istate import StationaryIState
from agent.behaviours.association.matching import best_matching, posteriors
from agent.behaviours.association.noisy_istate import NoisyIState
from agent.behaviours.association.rates import ChannelRates

Floats = NDArray[np.float64]

RATE = st.floats(0.01, 0.45)
NOISE = st.builds(
    ChannelRates,
    transmission_probability=st.floats(0.1, 0.9),
    wireless_loss=RATE,
    wireless_false=st.sampled_from([0.0, 0.05]),
    visual_miss=st.sampled_from([0.0, 0.2]),
    visual_false=RATE,
)


@st.composite
def histories(draw: st.DrawFn) -> tuple[list[str], list[int], list[tuple[set[str], dict[int, int]]]]:
    """Wireless ids, visual ids, and what was heard and seen of them."""
    names = [f"{number:02d}" for number in range(draw(st.integers(0, 6)))]
    lights = list(range(draw(st.integers(0, 5))))
    heard = st.sets(st.sampled_from(names)) if names else st.just(set())
    seen = st.fixed_dictionaries(dict.fromkeys(lights, st.integers(0, 1)))
    return names, lights, draw(st.lists(st.tuples(heard, seen), max_size=8))


@given(histories())
def test_without_noise_it_strikes_out_what_the_papers_algorithm_does(
    history: tuple[list[str], list[int], list[tuple[set[str], dict[int, int]]]],
) -> None:
    names, lights, steps = history
    plain = StationaryIState(names, lights)
    istate = NoisyIState(ChannelRates(), wireless=names, closed=True)
    istate.roll_call([], lights)
    for heard, lamps in steps:
        plain.update(heard, {light for light, lamp in lamps.items() if lamp})
        istate.update(heard, lamps)
        left = np.isfinite(istate.log_likelihood_ratios())
        edges = {
            light: [n for n, stays in zip(names, left[:, light], strict=True) if stays] for light in lights
        }
        assert edges == plain.edges()


@given(histories(), NOISE, st.randoms(use_true_random=False), st.floats(0.0, 0.5))
@settings(deadline=None)
def test_neither_names_nor_the_order_of_steps_matter(
    history: tuple[list[str], list[int], list[tuple[set[str], dict[int, int]]]],
    rates: ChannelRates,
    random: object,
    nobody: float,
) -> None:
    names, lights, steps = history
    shuffled, other_names, other_lights = list(steps), list(names), list(lights)
    for values in (shuffled, other_names, other_lights):
        random.shuffle(values)  # type: ignore[attr-defined]
    rename = dict(zip(names, other_names, strict=True))
    relight = dict(zip(lights, other_lights, strict=True))
    one, other = (NoisyIState(rates, wireless=names, nobody=nobody) for _ in range(2))
    one.roll_call([], lights)
    other.roll_call([], lights)
    for heard, lamps in steps:
        one.update(heard, lamps)
    for heard, lamps in shuffled:
        other.update(
            {rename[name] for name in heard}, {relight[light]: lamp for light, lamp in lamps.items()}
        )
    rows = [other.wireless.index(rename[name]) for name in one.wireless]
    columns = [other.visual.index(relight[light]) for light in one.visual]
    np.testing.assert_allclose(one.posteriors(), other.posteriors()[np.ix_(rows, columns)], atol=1e-9)


@given(histories(), NOISE, st.floats(0.51, 1.0))
@settings(deadline=None)
def test_claims_are_one_to_one_and_part_of_the_likeliest_edges(
    history: tuple[list[str], list[int], list[tuple[set[str], dict[int, int]]]],
    rates: ChannelRates,
    confidence: float,
) -> None:
    _, _, steps = history
    istate = NoisyIState(rates, estimate=["visual_false"])
    for heard, lamps in steps:
        istate.update(heard, lamps)
    chances = istate.posteriors()
    assert (chances >= 0).all()
    assert (chances.sum(axis=0) < 1 + 1e-9).all()
    assert (chances.sum(axis=1) < 1 + 1e-9).all()
    claims = istate.claims(confidence)
    assert len({name for name, _ in claims.values()}) == len(claims)
    edges = istate.edges(0.001)
    assert all(name in edges[light] and chance >= confidence for light, (name, chance) in claims.items())
    assignment = istate.assignment(np.random.default_rng(0))
    assert len(set(assignment.values())) == len(assignment)


MATRICES = arrays.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=16).flatmap(
    lambda shape: st.tuples(
        arrays.arrays(float, shape, elements=st.one_of(st.floats(-400, 400), st.just(-np.inf))),
        arrays.arrays(float, shape[0], elements=st.one_of(st.floats(-400, 400), st.just(-np.inf))),
    )
)


@given(MATRICES)
@settings(deadline=None)
def test_whatever_the_weights_posteriors_are_chances(problem: tuple[Floats, Floats]) -> None:
    """Also where parts are too large to be summed exactly."""
    pairs, alone = problem
    chances = posteriors(pairs, alone)
    assert np.isfinite(chances).all()
    assert (chances >= 0).all()
    assert (chances.sum(axis=1) < 1 + 1e-6).all()
    assert not chances[np.isneginf(pairs)].any()
    chosen = best_matching(pairs, alone, np.random.default_rng(0))
    taken = chosen[chosen >= 0]
    assert len(set(taken.tolist())) == taken.size
    assert np.isfinite(pairs[np.flatnonzero(chosen >= 0), taken]).all()
