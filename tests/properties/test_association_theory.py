"""What holds for the law of every neighbourhood."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from scenarios.association.mixing import Chances, mix
from scenarios.association.mobile_models import (
    MobileSystem,
    age_regions,
    multi_region_model,
    two_region_model,
)
from scenarios.association.theory import (
    CompletionLaw,
    agreement,
    exact_lower_bound,
    fraction_matched,
    pairs_to_tell_apart,
)

probabilities = st.one_of(st.just(0.5), st.floats(0.03, 0.97))
colours = st.sampled_from([1, 1, 2, 3])
ROUNDING = 1e-13


@st.composite
def neighbourhoods(draw: st.DrawFn, most: int = 40) -> tuple[int, int]:
    wireless = draw(st.integers(0, most))
    return wireless, draw(st.integers(0, wireless))


def on_one_axis(*laws: CompletionLaw) -> list[np.ndarray]:
    steps = max(len(law.cdf) for law in laws)
    return [np.concatenate([law.cdf, np.ones(steps - len(law.cdf))]) for law in laws]


@settings(max_examples=40, deadline=None)
@given(neighbourhoods(), probabilities, colours)
def test_a_law(size: tuple[int, int], p: float, colours: int) -> None:
    law = CompletionLaw(*size, p, colours)
    assert ((law.cdf >= 0) & (law.cdf <= 1)).all()
    assert ((law.survival >= 0) & (law.survival <= 1)).all()
    assert law.cdf[-1] == 1.0
    np.testing.assert_allclose(law.cdf + law.survival, 1, rtol=0, atol=2e-16)
    assert (np.diff(law.cdf) >= -ROUNDING).all()
    assert (np.diff(law.survival) <= ROUNDING * law.survival[:-1]).all()
    pmf = np.diff(law.cdf, prepend=0.0)
    steps = np.arange(len(pmf))
    assert math.isclose(law.mean, pmf @ steps, abs_tol=1e-9)
    assert math.isclose(law.sd, math.sqrt(max(0.0, pmf @ (steps - law.mean) ** 2)), abs_tol=1e-6)
    assert law.mean >= exact_lower_bound(*size, colours) - 1e-12
    bound = pairs_to_tell_apart(*size) * agreement(p, colours) ** steps
    assert (law.survival <= bound * (1 + 1e-9)).all()


@settings(max_examples=40, deadline=None)
@given(neighbourhoods(), probabilities, colours)
def test_more_ids_take_longer(size: tuple[int, int], p: float, colours: int) -> None:
    w, v = size
    law, more_heard, more_seen = on_one_axis(
        CompletionLaw(w, v, p, colours),
        CompletionLaw(w + 1, v, p, colours),
        CompletionLaw(w + 1, v + 1, p, colours),
    )
    assert (more_heard <= law + ROUNDING).all()
    assert (more_seen <= more_heard + ROUNDING).all()


@settings(max_examples=40, deadline=None)
@given(neighbourhoods(25), probabilities, st.floats(0, 1, exclude_max=True))
def test_quantiles_invert_the_law(size: tuple[int, int], p: float, q: float) -> None:
    law = CompletionLaw(*size, p)
    step = law.quantile(q)
    assert law.cdf[step] >= q - 1e-12
    assert step == 0 or law.cdf[step - 1] < q


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 60), probabilities, colours, st.integers(0, 40))
def test_fraction_matched(wireless: int, p: float, colours: int, steps: int) -> None:
    fraction = fraction_matched(wireless, steps, p, colours)
    assert fraction.shape == (steps + 1,)
    assert ((fraction >= 0) & (fraction <= 1 + ROUNDING)).all()
    assert (np.diff(fraction) >= -ROUNDING).all()
    assert (fraction_matched(wireless + 1, steps, p, colours) <= fraction + ROUNDING).all()
    # one visual id is matched when its observer is done
    done = CompletionLaw(wireless, 1, p, colours).cdf
    shared = min(len(done), steps + 1)
    np.testing.assert_allclose(fraction[:shared], done[:shared], rtol=0, atol=1e-12)


@settings(max_examples=40, deadline=None)
@given(neighbourhoods(20), st.floats(0.01, 0.99), st.integers(0, 2**32))
def test_mixing_keeps_what_is_certain(size: tuple[int, int], share: float, seed: int) -> None:
    """With any chances within the groups: probabilities stay so, and add up to one."""
    rng = np.random.default_rng(seed)
    shape = (size[0] - size[1] + 1, size[1] + 1)
    groups = []
    for _ in range(2):
        undone = rng.random(shape) ** rng.integers(1, 40)
        groups.append(Chances(1 - undone, undone))
    mixed = mix(*groups, share)
    np.testing.assert_allclose(mixed.done + mixed.undone, 1, rtol=0, atol=1e-15)
    swapped = mix(groups[1], groups[0], 1 - share)
    np.testing.assert_allclose(mixed.done, swapped.done, rtol=1e-11, atol=1e-25)
    certain = Chances(np.ones(shape), np.zeros(shape))
    np.testing.assert_array_equal(mix(certain, certain, share).undone, 0.0)
    np.testing.assert_allclose(mix(certain, certain, share).done, 1.0, rtol=0, atol=0)


systems = st.builds(
    MobileSystem, radius=st.floats(1, 30), speed=st.floats(0.1, 50), separation=st.floats(1, 40)
)


@settings(max_examples=40, deadline=None)
@given(systems, st.floats(0, 5))
def test_mobile_models(system: MobileSystem, excess: float) -> None:
    areas = age_regions(system.radius, system.speed)
    assert (areas >= 0).all()
    assert math.isclose(areas.sum(), math.pi * system.radius**2, rel_tol=1e-9)
    variance = system.new_ids() + excess
    literal, corrected = (two_region_model(system, variance, corrected=c) for c in (False, True))
    assert literal.steady_state()[0] <= corrected.steady_state()[0] * (1 + 1e-9)
    assert 1 <= corrected.ratio() <= literal.ratio() * (1 + 1e-9)
    assert multi_region_model(system, variance).ratio() >= 1
