"""The exact law of stationary association: by hand, by enumeration, in exact and in high precision, by observing."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from decimal import Decimal, localcontext
from fractions import Fraction
from functools import cache
from itertools import product
from typing import Any

import msgspec
import numpy as np
import pytest

from agent.behaviours.association.istate import StationaryIState
from scenarios.association.approximations import branching_process_time, fits, logarithmic_cost, naive_cost
from scenarios.association.mixing import Chances, mix, mix_alike
from scenarios.association.predictions import PredictAssociation, check_association, predict_association
from scenarios.association.theory import (
    CompletionLaw,
    agreement,
    exact_lower_bound,
    fraction_matched,
    fraction_matched_model,
    lower_bound,
    pairs_to_tell_apart,
)

SPREAD = [
    (2, 1),
    (2, 2),
    (3, 1),
    (5, 3),
    (17, 16),
    (40, 20),
    (199, 1),
    (200, 1),
    (200, 60),
    (200, 100),
    (200, 199),
    (200, 200),
]


def enumerated(w: int, v: int, t: int, p: Fraction, colours: int) -> tuple[Fraction, Fraction]:
    """P(done by t) and expected fraction matched, over all strings of all robots."""
    probabilities = [1 - p] + [p / colours] * colours
    strings = list(product(range(colours + 1), repeat=t))
    weight = {string: math.prod((probabilities[s] for s in string), start=Fraction(1)) for string in strings}
    done = matched = Fraction(0)
    for robots in product(strings, repeat=w):
        chance = math.prod((weight[string] for string in robots), start=Fraction(1))
        times = Counter(robots)
        alone = sum(times[string] == 1 for string in robots[:v])
        done += chance * (alone == v)
        matched += chance * Fraction(alone, v)
    return done, matched


def rational(w: int, v: int, t: int, symbols: int = 2) -> Fraction:
    """The product formula, written as it stands."""
    m = symbols**t
    return (
        math.prod((1 - Fraction(i, m) for i in range(v)), start=Fraction(1)) * (1 - Fraction(v, m)) ** (w - v)
        if m >= v
        else Fraction(0)
    )


def by_classes(w: int, v: int, t: int, p: Any, colours: int = 1) -> Any:
    """P(done by t) in the numbers given (Fraction, Decimal): another route, without recursion over steps.

    The N strings with k transmissions have probability q each. Of a invisible and b visible robots all with such
    strings, the visible take N (N-1) ... (N-b+1) and the others (N-b)^a choices. Counts of the classes are convolved.
    """
    u = w - v
    one = p / p
    total = [[one * 0 for _ in range(v + 1)] for _ in range(u + 1)]
    total[0][0] = one
    for k in range(t + 1):
        n = math.comb(t, k) * colours**k
        q = (p / colours) ** k * (1 - p) ** (t - k)
        term = [
            [
                math.perm(n, b) * (n - b) ** a * q ** (a + b) / (math.factorial(a) * math.factorial(b))
                if b <= n
                else one * 0
                for b in range(v + 1)
            ]
            for a in range(u + 1)
        ]
        total = [
            [
                sum((total[i][j] * term[a - i][b - j] for i in range(a + 1) for j in range(b + 1)), one * 0)
                for b in range(v + 1)
            ]
            for a in range(u + 1)
        ]
    return total[u][v] * math.factorial(u) * math.factorial(v)


def by_contour(w: int, v: int, t: int, p: float, nodes: int) -> float:
    """P(done by t) as a coefficient of prod_s (exp(q_s y) + q_s x), by Cauchy's integral near the saddle point."""
    u = w - v
    k = np.arange(t + 1)
    q = p**k * (1 - p) ** (t - k)
    n = np.array([float(math.comb(t, i)) for i in k])
    low, high = 1e-9, 1e30
    while high / low > 1 + 1e-9:
        middle = math.sqrt(low * high)
        z = q * middle * np.exp(-q * u)
        low, high = (middle, high) if (n * z / (1 + z)).sum() < v else (low, middle)
    x = low * np.exp(2j * math.pi * np.arange(nodes) / nodes)[:, None, None]
    y = u * np.exp(2j * math.pi * np.arange(nodes) / nodes)[None, :, None]
    z = q * x * np.exp(-q * y)
    logs = n * (0.5 * np.log1p(2 * z.real + np.abs(z) ** 2) + 1j * np.arctan2(z.imag, 1 + z.real))
    scale = math.lgamma(u + 1) + math.lgamma(v + 1)
    integrand = np.exp(y[..., 0] + logs.sum(axis=2) + scale - v * np.log(x[..., 0]) - u * np.log(y[..., 0]))
    return float(integrand.mean().real)


@cache
def general(w: int, v: int, p: float, colours: int, steps: int) -> tuple[list[float], list[float]]:
    """The recursion, whether or not symbols are equal."""
    chances = Chances.before_any_step(w - v, v)
    cdf, survival = [float(chances.done[-1, -1])], [float(chances.undone[-1, -1])]
    for _ in range(steps):
        chances = mix(mix_alike(chances, colours), chances, p)
        cdf.append(float(chances.done[-1, -1]))
        survival.append(float(chances.undone[-1, -1]))
    return cdf, survival


# --- the law itself ---------------------------------------------------------------------------------


def test_by_hand() -> None:
    law = CompletionLaw(2, 1)
    assert law.cdf[:4].tolist() == [0.0, 0.5, 0.75, 0.875]  # done as soon as the two differ: geometric
    assert law.mean == pytest.approx(2.0, abs=1e-14)
    assert law.sd == pytest.approx(math.sqrt(2), abs=1e-14)
    assert CompletionLaw(4, 3).mean == pytest.approx(88 / 21, abs=1e-14)
    assert CompletionLaw(2, 1, 0.2).mean == pytest.approx(1 / 0.32, abs=1e-12)


def test_all_visible_is_all_but_one() -> None:
    for w in (1, 2, 7, 50):
        for p, colours in ((0.5, 1), (0.2, 1), (0.6, 2)):
            assert CompletionLaw(w, w, p, colours).mean == pytest.approx(
                CompletionLaw(w, w - 1, p, colours).mean, rel=1e-13
            )


@pytest.mark.parametrize(("w", "v"), [(0, 0), (1, 0), (5, 0), (200, 0), (1, 1)])
@pytest.mark.parametrize("p", [0.0, 0.5, 1.0])
def test_nothing_to_do_is_done_at_once(w: int, v: int, p: float) -> None:
    law = CompletionLaw(w, v, p)
    assert (law.mean, law.sd, law.cdf.tolist(), law.quantile(0.99)) == (0.0, 0.0, [1.0], 0)


@pytest.mark.parametrize(
    ("w", "v", "t"), [(2, 1, 4), (3, 1, 3), (3, 2, 3), (3, 3, 3), (4, 1, 2), (4, 2, 3), (4, 4, 2), (5, 3, 2)]
)
@pytest.mark.parametrize("p", [Fraction(1, 2), Fraction(3, 10), Fraction(9, 10)])
def test_equals_enumeration(w: int, v: int, t: int, p: Fraction) -> None:
    done, matched = enumerated(w, v, t, p, 1)
    assert CompletionLaw(w, v, float(p)).cdf[t] == pytest.approx(float(done), rel=1e-13)
    assert CompletionLaw(w, v, float(p)).survival[t] == pytest.approx(float(1 - done), rel=1e-13)
    assert fraction_matched(w, t, float(p))[t] == pytest.approx(float(matched), rel=1e-13)
    assert by_classes(w, v, t, p) == done
    if p == Fraction(1, 2):
        assert rational(w, v, t) == done


@pytest.mark.parametrize(
    ("w", "v", "t", "colours"), [(2, 1, 3, 2), (3, 2, 2, 2), (4, 2, 2, 2), (3, 1, 2, 3), (3, 3, 2, 3)]
)
@pytest.mark.parametrize("p", [Fraction(1, 2), Fraction(3, 4), Fraction(1, 5), Fraction(1)])
def test_equals_enumeration_with_colours(w: int, v: int, t: int, colours: int, p: Fraction) -> None:
    done, matched = enumerated(w, v, t, p, colours)
    assert CompletionLaw(w, v, float(p), colours).cdf[t] == pytest.approx(float(done), rel=1e-13, abs=1e-300)
    assert fraction_matched(w, t, float(p), colours)[t] == pytest.approx(
        float(matched), rel=1e-13, abs=1e-300
    )


@pytest.mark.parametrize(("w", "v"), SPREAD)
def test_equal_symbols_are_correctly_rounded(w: int, v: int) -> None:
    law = CompletionLaw(w, v)
    for t in range(len(law.cdf)):
        exact = rational(w, v, t)
        assert law.cdf[t] == float(exact)
        assert law.survival[t] == float(1 - exact)


@pytest.mark.parametrize(("w", "v"), SPREAD[::2] + SPREAD[-1:])
def test_moments_and_quantiles_are_exact(w: int, v: int) -> None:
    """Sums of exact rationals far beyond where the law is cut, in 60 digits."""
    law = CompletionLaw(w, v)
    with localcontext() as context:
        context.prec = 60
        survival = [
            Decimal(1) - Decimal(f.numerator) / Decimal(f.denominator)
            for f in (rational(w, v, t) for t in range(140))
        ]
        mean = sum(survival, Decimal(0))
        second = sum(((2 * t + 1) * s for t, s in enumerate(survival)), Decimal(0))
        assert abs(Decimal(law.mean) - mean) < Decimal("1e-13")
        assert abs(Decimal(law.sd) - (second - mean * mean).sqrt()) < Decimal("1e-12")
    for q in (0.01, 0.1, 0.25, 0.5, 0.9, 0.99, 0.999999):
        assert law.quantile(q) == next(t for t in range(200) if rational(w, v, t) >= Fraction(q))


def test_quantiles_on_jumps() -> None:
    """A level that the law meets exactly belongs to that step, rounding or not."""
    assert [CompletionLaw(2, 1).quantile(q) for q in (0.0, 0.5, 0.75, 0.875, 1 - 2.0**-40)] == [
        0,
        1,
        2,
        3,
        40,
    ]
    assert CompletionLaw(2, 1).quantile(0.5000001) == 2
    assert CompletionLaw(2, 1, 0.3).quantile(0.42) == 1  # 2 * 0.3 * 0.7
    assert CompletionLaw(2, 1, 0.3).quantile(0.4200001) == 2
    assert CompletionLaw(3, 2).quantile(math.nextafter(1, 0)) < 60


# --- any probability, and colours -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("w", "v"), [(2, 1), (5, 5), (20, 10), (60, 20), (60, 45), (200, 3), (200, 196), (200, 200)]
)
def test_recursion_equals_product_formula(w: int, v: int) -> None:
    law = CompletionLaw(w, v)
    cdf, survival = general(w, v, 0.5, 1, len(law.cdf) - 1)
    np.testing.assert_allclose(cdf, law.cdf, rtol=0, atol=1e-15)
    np.testing.assert_allclose(survival, law.survival, rtol=1e-13, atol=0)


@pytest.mark.parametrize(("p", "colours"), [(2 / 3, 2), (0.75, 3), (7 / 8, 7)])
def test_recursion_equals_product_formula_with_colours(p: float, colours: int) -> None:
    law = CompletionLaw(25, 11, p, colours)
    cdf, survival = general(25, 11, p, colours, len(law.cdf) - 1)
    np.testing.assert_allclose(cdf, law.cdf, rtol=0, atol=1e-15)
    np.testing.assert_allclose(survival, law.survival, rtol=1e-12, atol=0)
    assert [float(rational(25, 11, t, colours + 1)) for t in range(len(law.cdf))] == law.cdf.tolist()


@pytest.mark.parametrize("p", [Fraction(3, 10), Fraction(49, 50)])
@pytest.mark.parametrize(("w", "v", "colours"), [(8, 5, 1), (9, 2, 1), (6, 6, 1), (7, 4, 3)])
def test_any_probability_exactly(w: int, v: int, p: Fraction, colours: int) -> None:
    law = CompletionLaw(w, v, float(p), colours)
    for t in (1, 2, 5, 12):
        exact = by_classes(w, v, t, p, colours)
        assert law.cdf[t] == pytest.approx(float(exact), rel=1e-12, abs=1e-25)
        assert law.survival[t] == pytest.approx(float(1 - exact), rel=1e-12)


@pytest.mark.parametrize(
    ("w", "v", "p", "t"),
    [
        (200, 200, 0.3, 12),
        (200, 200, 0.3, 26),
        (100, 100, 0.05, 60),
        (80, 79, 0.8, 20),
        (60, 1, 0.8, 14),
        (90, 88, 0.9, 35),
    ],
)
def test_any_probability_in_high_precision(w: int, v: int, p: float, t: int) -> None:
    with localcontext() as context:
        context.prec = 60
        exact = by_classes(w, v, t, Decimal(p))
    law = CompletionLaw(w, v, p)
    assert law.cdf[t] == pytest.approx(float(exact), rel=1e-12)
    assert law.survival[t] == pytest.approx(float(1 - exact), rel=1e-12)


@pytest.mark.parametrize(
    ("w", "v", "p", "t"),
    [(60, 30, 0.5, 10), (60, 30, 0.2, 18), (60, 30, 0.2, 40), (90, 50, 0.85, 30), (80, 16, 0.3, 14)],
)
def test_any_probability_by_contour_integral(w: int, v: int, p: float, t: int) -> None:
    assert CompletionLaw(w, v, p).cdf[t] == pytest.approx(by_contour(w, v, t, p, 128), rel=1e-9)


def test_transmitting_seldom_and_often_are_the_same() -> None:
    seldom, often = CompletionLaw(30, 12, 0.125), CompletionLaw(30, 12, 0.875)
    np.testing.assert_allclose(seldom.cdf, often.cdf, rtol=0, atol=1e-15)


def test_half_is_the_best_probability() -> None:
    means = [CompletionLaw(20, 10, p).mean for p in (0.1, 0.3, 0.45, 0.5, 0.55, 0.7, 0.9)]
    assert min(means) == means[3]
    assert means[:3] == sorted(means[:3], reverse=True)


def test_colours_help() -> None:
    means = [CompletionLaw(20, 10, 0.5, colours).mean for colours in (1, 2, 3, 7, 50)]
    assert means == sorted(means, reverse=True)


def test_rare_transmissions() -> None:
    """In units of 1/p, the law has a limit."""
    seldom, seldomer = CompletionLaw(6, 3, 0.02), CompletionLaw(6, 3, 0.01)
    assert seldom.mean * 0.02 == pytest.approx(seldomer.mean * 0.01, rel=0.03)
    law = CompletionLaw(2, 1, 0.005)
    assert law.mean == pytest.approx(1 / 0.00995, rel=1e-12)
    assert law.sd == pytest.approx(math.sqrt(1 - 0.00995) / 0.00995, rel=1e-12)


@pytest.mark.parametrize(("w", "v", "p", "colours"), [(10, 4, 0.5, 1), (10, 4, 0.3, 1), (10, 10, 0.9, 2)])
def test_tail(w: int, v: int, p: float, colours: int) -> None:
    """Bonferroni's bound holds, and is reached in the end."""
    law = CompletionLaw(w, v, p, colours)
    bound = pairs_to_tell_apart(w, v) * agreement(p, colours) ** np.arange(len(law.survival))
    assert (law.survival <= bound * (1 + 1e-12)).all()
    assert law.survival[-1] == pytest.approx(bound[-1], rel=1e-4)


def test_arrays_cannot_be_spoilt() -> None:
    with pytest.raises(ValueError, match="read-only"):
        CompletionLaw(3, 2).cdf[0] = 1.0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((-1, 0), "wireless: -1 is too few"),
        ((3, -1), "visual: -1 is too few"),
        ((3, 4), "visual: 4 visual ids, but 3"),
        ((3, 2, 0.0), "p: with 0 "),
        ((3, 2, 1.0), "p: with 1 "),
        ((3, 2, 0.0, 4), "p: with 0 "),
        ((3, 2, -0.1), "p: -0.1 is no probability"),
        ((3, 2, 1.1), "p: 1.1 is no probability"),
        ((3, 2, math.nan), "p: nan is no probability"),
        ((3, 2, 0.5, 0), "colours: 0 is too few"),
        ((1001, 2), "wireless: 1001 ids"),
        ((201, 2, 0.3), "wireless: 201 ids"),
        ((3, 2, 1e-7), "p: 1e-07 needs more"),
        ((3, 2, 1e-300), "p: 1e-300 needs more"),
        ((3, 2, 1 - 1e-7), "needs more"),
    ],
)
def test_what_is_no_neighbourhood(arguments: Any, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        CompletionLaw(*arguments)


@pytest.mark.parametrize("q", [-0.1, 1.0, 2.0, math.nan])
def test_what_is_no_quantile(q: float) -> None:
    with pytest.raises(ValueError, match="q: "):
        CompletionLaw(3, 2).quantile(q)


# --- fraction matched -------------------------------------------------------------------------------


def test_fraction_matched_at_one_half() -> None:
    expected = [(1 - 2.0**-t) ** 19 for t in range(41)]
    np.testing.assert_allclose(fraction_matched(20, 40), expected, rtol=1e-13)
    assert fraction_matched(1, 3).tolist() == [1.0, 1.0, 1.0, 1.0]


def test_fraction_matched_for_others() -> None:
    assert fraction_matched(30, 60, 0.2)[60] == pytest.approx(
        float(
            sum(
                math.comb(60, k) * q * (1 - q) ** 29
                for k in range(61)
                for q in [Fraction(1, 5) ** k * Fraction(4, 5) ** (60 - k)]
            )
        ),
        rel=1e-13,
    )
    assert fraction_matched(5, 3, 0.0).tolist() == [0.0] * 4
    with pytest.raises(ValueError, match="wireless: 0 is too few"):
        fraction_matched(0, 3)
    with pytest.raises(ValueError, match="steps: -1 is too few"):
        fraction_matched(2, -1)


def test_fraction_matched_model() -> None:
    """2016, Eqs. 2 and 3, by hand; good for many ids (Fig. 9)."""
    model = fraction_matched_model(20, 5)
    assert model[0] == pytest.approx((19 / 20) ** 380)
    assert model[5] == pytest.approx((19 / 20) ** (380 / 32))
    assert fraction_matched_model(20, 5, visual=10)[5] == pytest.approx((9 / 10) ** (190 / 32))
    assert fraction_matched_model(1, 2).tolist() == [1.0, 1.0, 1.0]
    assert fraction_matched_model(3, 2, visual=1).tolist() == [0.0, 0.0, 0.0]
    assert np.abs(fraction_matched_model(40, 30) - fraction_matched(40, 30)).max() < 0.01


# --- approximations, bounds, costs ------------------------------------------------------------------


def test_branching_process_time() -> None:
    assert branching_process_time(20, 10) == pytest.approx(math.log2(190))
    assert branching_process_time(2, 1) == 0.0
    assert branching_process_time(1, 1) == branching_process_time(5, 0) == 0.0
    assert (
        branching_process_time(20, 10, 0.5, 3)
        < branching_process_time(20, 10)
        < branching_process_time(20, 10, 0.1)
    )


def test_the_fit_with_a_root() -> None:
    """Of all readings, the root over both factors is the one near the exact mean (2014; h in [2, 40])."""
    readings = {
        "as printed": lambda a, b: 2 * a * b,
        "root of both": lambda a, b: 2 * math.sqrt(a * b),
        "root of all": lambda a, b: math.sqrt(2 * a * b),
        "root of one": lambda a, b: 2 * math.sqrt(a) * b,
        "root of the other": lambda a, b: 2 * a * math.sqrt(b),
        "root in one": lambda a, b: a * b,
    }
    squares = dict.fromkeys([*readings, "arsinh"], 0.0)
    cases = [(h, s) for h in range(2, 41) for s in range(1, h)]
    for h, s in cases:
        mean = CompletionLaw(h, s).mean
        for name, reading in readings.items():
            squares[name] += (reading(math.log2(h), math.log2(s + 1)) - mean) ** 2
        squares["arsinh"] += (fits(h, s)["arsinh"] - mean) ** 2
        assert fits(h, s)["log_product"] == pytest.approx(
            readings["as printed"](math.log2(h), math.log2(s + 1))
        )
        assert fits(h, s)["log_product_root"] == pytest.approx(
            readings["root of both"](math.log2(h), math.log2(s + 1))
        )
    rms = {name: math.sqrt(total / len(cases)) for name, total in squares.items()}
    assert min(rms, key=lambda name: rms[name]) == "root of both"
    assert rms["root of both"] == pytest.approx(0.94, abs=0.005)
    assert rms["as printed"] > 25
    assert rms["arsinh"] == pytest.approx(2.67, abs=0.005)


def test_lower_bounds() -> None:
    assert [lower_bound(v) for v in range(10)] == [0, 0, 1, 2, 2, 3, 3, 3, 3, 4]
    for colours in (1, 2, 3):
        for w in range(9):
            for v in range(w + 1):
                law = CompletionLaw(w, v, 0.5, colours)
                assert exact_lower_bound(w, v, colours) == int(np.flatnonzero(law.cdf)[0])
    assert exact_lower_bound(5, 4) == lower_bound(4) + 1
    assert exact_lower_bound(4, 4) == lower_bound(4)


def flashes(ids: Sequence[int], steps: int) -> list[list[bool]]:
    """The logarithmic algorithm (2014, Alg. 2): who flashes in which step."""
    return [[bool(number >> step & 1) for number in ids] for step in range(steps)]


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 8, 13, 16, 20, 100, 128, 1000])
def test_logarithmic_cost(n: int) -> None:
    cost = logarithmic_cost(n)
    shown = flashes(range(n), int(cost["steps"]))
    assert cost["messages"] == sum(map(sum, shown))
    assert len(set(zip(*shown, strict=True))) == n or n == 1  # every id is told from every other
    if n > 1:
        short = flashes(range(n), int(cost["steps"]) - 1)
        assert len(set(zip(*short, strict=True))) < n
    assert cost["messages"] <= cost["messages_bound"]
    assert (cost["messages"] == cost["messages_bound"]) == (n & (n - 1) == 0)


def test_costs_of_some_ids() -> None:
    assert logarithmic_cost(16, [0, 15, 7]) == {"steps": 4, "messages": 7, "messages_bound": 32.0}
    assert naive_cost(16, [0, 15, 7]) == {"steps": 16, "messages": 3, "messages_bound": 16}
    assert naive_cost(5) == {"steps": 5, "messages": 5, "messages_bound": 5}
    assert logarithmic_cost(0) == {"steps": 0, "messages": 0, "messages_bound": 0.0}
    with pytest.raises(ValueError, match="ids: 16 is not an id"):
        logarithmic_cost(16, [16])
    with pytest.raises(ValueError, match="ids: -1 is too few"):
        naive_cost(-1)


# --- predictions ------------------------------------------------------------------------------------


def test_prediction() -> None:
    found = predict_association(PredictAssociation(wireless=20, visual=10))
    law = CompletionLaw(20, 10)
    assert found["expected_steps"] == law.mean
    assert found["sd"] == law.sd
    assert found["cdf"] == law.cdf[: len(found["cdf"])].tolist()
    assert 1 - found["cdf"][-1] < 1e-12 <= 1 - found["cdf"][-2]
    assert len(found["fraction_matched"]) == len(found["fraction_matched_model"]) == len(found["cdf"])
    assert found["quantiles"]["0.5"] == law.quantile(0.5)
    assert found["errors"]["branching_process"] == found["branching_process"] - law.mean
    assert set(found["errors"]) == {"branching_process", *found["fits"]}
    assert found["naive"]["steps"] == 21
    assert msgspec.json.decode(msgspec.json.encode(found)) == found


def test_prediction_for_others() -> None:
    found = predict_association(PredictAssociation(wireless=6, visual=3, p=0.2, colours=2, ids=64))
    assert found["expected_steps"] == CompletionLaw(6, 3, 0.2, 2).mean
    assert found["fits"] == {}
    assert found["logarithmic"] == {"steps": 6, "messages": 192, "messages_bound": 192.0}
    with pytest.raises(ValueError, match="ids: 5 are fewer"):
        check_association(PredictAssociation(wireless=6, visual=3, ids=5))


# --- what robots would find -------------------------------------------------------------------------


@pytest.mark.parametrize(("w", "v", "p", "colours"), [(6, 4, 0.5, 1), (5, 5, 0.3, 1), (6, 2, 0.6, 3)])
def test_the_law_is_that_of_the_istate(w: int, v: int, p: float, colours: int) -> None:
    """Kolmogorov distance of many runs of the i-state itself; Massart's bound at one in a million."""
    runs = 3000
    rng = np.random.default_rng(20160428)
    names = [f"r{number}" for number in range(w)]
    finished = np.zeros(400, dtype=int)
    for _ in range(runs):
        istate = StationaryIState(names, range(v))
        step = 0
        while not istate.is_final():
            emitted = (rng.random(w) < p) * rng.integers(1, colours + 1, w)
            active = [number for number in range(w) if emitted[number]]
            istate.update(
                {names[number]: int(emitted[number]) for number in active},
                {number: int(emitted[number]) for number in active if number < v},
            )
            step += 1
        finished[step] += 1
    law = CompletionLaw(w, v, p, colours)
    observed = np.cumsum(finished)[: len(law.cdf)] / runs
    assert np.abs(observed - law.cdf).max() < math.sqrt(math.log(2e6) / (2 * runs))
