"""Best matchings and the chances of pairs: against enumeration, permanents, and cases done by hand."""

from __future__ import annotations

import importlib.util
import itertools
import math
import sys
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from agent.behaviours.association import marginals, matching
from agent.behaviours.association.matching import ALONE, TIE_NOISE, best_matching, posteriors, slacks
from agent.behaviours.association.rates import ChannelRates

Floats = NDArray[np.float64]


def matchings(rows: int, columns: int) -> Iterator[tuple[int, ...]]:
    """All of them: the column of each row, or -1."""
    for chosen in itertools.product(range(-1, columns), repeat=rows):
        taken = [column for column in chosen if column >= 0]
        if len(set(taken)) == len(taken):
            yield chosen


def weight(chosen: tuple[int, ...], pairs: Floats, alone: Floats) -> float:
    return math.prod(alone[row] if c < 0 else pairs[row, c] for row, c in enumerate(chosen))


def enumerated(pairs: Floats, alone: Floats) -> Floats:
    """Posteriors by the definition."""
    total, chances = 0.0, np.zeros(pairs.shape)
    for chosen in matchings(*pairs.shape):
        one = weight(chosen, pairs, alone)
        total += one
        for row, column in enumerate(chosen):
            if column >= 0:
                chances[row, column] += one
    return chances / total


def random_problem(rng: np.random.Generator, rows: int, columns: int) -> tuple[Floats, Floats]:
    """Log weights with some impossible ones, that leave at least one matching."""
    pairs = rng.normal(0.0, 3.0, (rows, columns))
    pairs[rng.random(pairs.shape) < 0.3] = -np.inf
    alone = rng.normal(-2.0, 2.0, rows)
    alone[rng.random(rows) < 0.3] = -np.inf
    if not any(weight(chosen, np.exp(pairs), np.exp(alone)) for chosen in matchings(rows, columns)):
        return random_problem(rng, rows, columns)
    return pairs, alone


NEVER = -np.inf


# --- posteriors -----------------------------------------------------------------------------------


def test_two_by_two_by_hand() -> None:
    a = 0.25
    pairs = np.log([[1.0, a], [a, 1.0]])
    found = posteriors(pairs, np.array([NEVER, NEVER]))
    assert found == pytest.approx(np.array([[1, a * a], [a * a, 1]]) / (1 + a * a), abs=1e-12)


def test_one_row_is_a_softmax() -> None:
    found = posteriors(np.log([[1.0, 2.0, 5.0]]), np.log([2.0]))
    assert found == pytest.approx(np.array([[0.1, 0.2, 0.5]]), abs=1e-12)


def test_against_enumeration() -> None:
    rng = np.random.default_rng(1)
    for _ in range(150):
        rows, columns = rng.integers(1, 5, 2)
        pairs, alone = random_problem(rng, rows, columns)
        assert posteriors(pairs, alone) == pytest.approx(enumerated(np.exp(pairs), np.exp(alone)), abs=1e-9)


def permanent(matrix: Floats) -> float:
    """Ryser's formula."""
    size = len(matrix)
    total = 0.0
    for columns in range(1, 2**size):
        chosen = [column for column in range(size) if columns >> column & 1]
        total += (-1) ** (size - len(chosen)) * math.prod(matrix[:, chosen].sum(axis=1))
    return total


def test_against_rysers_formula() -> None:
    pairs = np.random.default_rng(2).random((7, 7))
    found = posteriors(np.log(pairs), np.full(7, NEVER))
    for row, column in ((0, 0), (3, 5), (6, 1)):
        minor = np.delete(np.delete(pairs, row, 0), column, 1)
        assert found[row, column] == pytest.approx(pairs[row, column] * permanent(minor) / permanent(pairs))


@pytest.mark.parametrize(("rows", "columns"), [(12, 12), (10, 20), (20, 9), (20, 20), (30, 40)])
def test_without_evidence_all_are_alike(rows: int, columns: int) -> None:
    """Also where the sum is only approximate."""
    found = posteriors(np.zeros((rows, columns)), np.full(rows, NEVER))
    assert found == pytest.approx(np.full((rows, columns), 1 / max(rows, columns)), rel=0.02)


def test_parts_are_summed_by_themselves() -> None:
    """Twenty rows that fall into fives: exact, though twenty are too many at once."""
    rng = np.random.default_rng(3)
    pairs, alone = np.full((20, 24), NEVER), np.full(20, NEVER)
    order, columns = rng.permutation(20), rng.permutation(24)
    for part in range(4):
        rows, places = order[5 * part : 5 * part + 5], columns[6 * part : 6 * part + 6]
        inner = rng.normal(0.0, 2.0, (5, 6))
        pairs[np.ix_(rows, places)] = inner
        alone[rows] = rng.normal(-3.0, 1.0, 5)
        expected = enumerated(np.exp(inner), np.exp(alone[rows]))
        found = posteriors(pairs, alone)[np.ix_(rows, places)]
        assert found == pytest.approx(expected, abs=1e-9)


def test_what_is_cut_off_still_counts() -> None:
    """Slacks past the last cut, in a part too large to be summed with them."""
    assert marginals.EXACT_SIDE < 14
    pairs = np.full((14, 14), -13.0)  # from each other, two rows are 26 apart: cut at once
    np.fill_diagonal(pairs, 0.0)
    pairs[np.arange(14), np.arange(1, 15) % 14] = -0.6  # a ring: 14 * 0.6 = 8.4 to shift it
    found = posteriors(pairs, np.full(14, -14.0))
    exact = marginals._subset_sums(np.exp(pairs).T, np.ones(14), np.full(14, math.exp(-14.0))).T
    assert found == pytest.approx(exact, abs=1e-3)


def test_what_is_cut_off_is_not_impossible() -> None:
    """However unlikely: nothing else is certain."""
    a = math.exp(-13.0)
    assert -2 * math.log(a) > matching.CUTS[0]  # to swap the columns
    found = posteriors(np.log([[1.0, a], [a, 1.0]]), np.array([NEVER, NEVER]))
    assert found[[0, 1], [1, 0]] == pytest.approx([a * a / (1 + a * a)] * 2, rel=1e-6)
    assert found[0, 0] == found[1, 1] < 1.0


def test_much_that_is_cut_off_is_something_together() -> None:
    """Five hundred columns that only the first row could have, past the last cut."""
    others, each = 500, math.exp(-12.5)
    assert -math.log(each) > matching.CUTS[-1]
    assert marginals.EXACT_SIDE < 14
    chain = np.full((14, 27), NEVER)
    np.fill_diagonal(chain, 0.0)
    rows = np.arange(13)
    chain[rows, 14 + rows] = chain[rows + 1, 14 + rows] = -6.0  # free columns make one part of all rows
    pairs = np.hstack([chain, np.full((14, others), NEVER)])
    pairs[0, 27:] = math.log(each)
    found = posteriors(pairs, np.full(14, NEVER))
    # To the other rows it is the same as if the first one were left alone.
    alone = np.array([others * each] + [0.0] * 13)
    exact = marginals._subset_sums(np.exp(chain).T, np.ones(27), alone).T
    assert found[0, 27:].sum() == pytest.approx(1.0 - exact[0].sum(), rel=0.01)
    assert found[0, :27] == pytest.approx(exact[0], abs=1e-4)


def test_huge_weights_neither_overflow_nor_vanish() -> None:
    rng = np.random.default_rng(4)
    pairs = rng.normal(0.0, 3.0, (6, 8))
    alone = rng.normal(-3.0, 1.0, 6)
    shift = rng.normal(0.0, 5000.0, (6, 1))  # of a whole row: changes no posterior
    plain = posteriors(pairs, alone)
    assert posteriors(pairs + shift, alone + shift[:, 0]) == pytest.approx(plain, abs=1e-8)
    steep = posteriors(rng.normal(0.0, 5000.0, (20, 20)), np.full(20, NEVER))
    assert np.isfinite(steep).all()
    assert steep.sum(axis=1) == pytest.approx(np.ones(20))


@pytest.mark.parametrize("shape", [(0, 0), (0, 3), (3, 0)])
def test_nothing_to_match(shape: tuple[int, int]) -> None:
    pairs, alone = np.zeros(shape), np.zeros(shape[0])
    assert posteriors(pairs, alone).shape == shape
    assert best_matching(pairs, alone, np.random.default_rng(0)).tolist() == [ALONE] * shape[0]


# --- approximations -------------------------------------------------------------------------------


def association(rng: np.random.Generator, robots: int, steps: int, rates: ChannelRates) -> Floats:
    """Log likelihood ratios of as many visual as wireless ids after so many steps."""
    sent = rng.random((steps, robots)) < 0.5
    heard = sent & (rng.random(sent.shape) >= rates.wireless_loss)
    lit = np.where(
        sent, rng.random(sent.shape) >= rates.visual_miss, rng.random(sent.shape) < rates.visual_false
    )
    table = rates.log_likelihood_ratios()
    total: Floats = table[heard[:, None, :].astype(int), lit[:, :, None].astype(int)].sum(axis=0)
    return total


def scaled(pairs: Floats, alone: Floats) -> tuple[Floats, Floats, Floats]:
    chosen = best_matching(pairs, alone)
    return matching._scaled(pairs, alone, chosen, slacks(pairs, alone, chosen)[1])


@pytest.mark.parametrize("steps", [4, 8, 12])
def test_nearly_is_near_and_surely_is_sure(steps: int) -> None:
    """Fourteen robots: what is said of pairs above 0.9, and how far off all others are."""
    rng = np.random.default_rng(steps)
    rates = ChannelRates(wireless_loss=0.1, visual_miss=0.1, visual_false=0.05)
    errors, wrong_said, wrong, plain_said = [], 0.0, 0.0, 0.0
    for _ in range(6):
        problem = scaled(association(rng, 14, steps, rates), np.full(14, -20.0))
        exact = marginals._subset_sums(problem[0].T, problem[2], problem[1]).T
        near = marginals.near_posteriors(*problem)
        plain = marginals.bethe_posteriors(*problem)[0]
        errors.append(np.abs(near - exact).mean())
        wrong_said += (1 - near[near > 0.9]).sum()
        wrong += (1 - exact[near > 0.9]).sum()
        plain_said += (1 - plain[near > 0.9]).sum()
    assert np.mean(errors) < 0.005
    assert wrong_said == pytest.approx(wrong, rel=0.25, abs=0.05)
    if steps == 8:  # belief propagation alone is far too sure of itself
        assert plain_said < 0.6 * wrong


def test_belief_propagation_takes_swaps_for_impossible() -> None:
    """Why it is not left alone with its opinion."""
    pairs = np.array([[1.0, 0.5], [0.5, 1.0]])
    nothing = np.zeros(2)
    assert marginals.bethe_posteriors(pairs, nothing, nothing)[0][0, 0] > 0.99
    assert marginals.near_posteriors(pairs, nothing, nothing)[0, 0] == pytest.approx(0.8)


# --- best matching --------------------------------------------------------------------------------


def test_slacks_against_enumeration() -> None:
    rng = np.random.default_rng(5)
    for _ in range(100):
        rows, columns = rng.integers(1, 5, 2)
        pairs, alone = random_problem(rng, rows, columns)
        alone = matching._finite(pairs, alone)
        best, with_pair = NEVER, np.full(pairs.shape, NEVER)
        for chosen in matchings(rows, columns):
            total = sum(alone[row] if c < 0 else pairs[row, c] for row, c in enumerate(chosen))
            best = max(best, total)
            for row, column in enumerate(chosen):
                if column >= 0:
                    with_pair[row, column] = max(with_pair[row, column], total)
        found, potentials = slacks(pairs, alone, best_matching(pairs, alone))
        assert found == pytest.approx(best - with_pair, abs=1e-9)
        assert (potentials <= 0).all()


def test_the_best_matching_is_the_best() -> None:
    rng = np.random.default_rng(6)
    for _ in range(100):
        rows, columns = rng.integers(1, 5, 2)
        pairs, alone = random_problem(rng, rows, columns)
        best = max(weight(chosen, np.exp(pairs), np.exp(alone)) for chosen in matchings(rows, columns))
        for generator in (None, rng):
            found = tuple(best_matching(pairs, alone, generator).tolist())
            assert weight(found, np.exp(pairs), np.exp(alone)) == pytest.approx(best)


def test_impossible_pairs_are_never_taken_and_as_few_rows_as_possible_are_left() -> None:
    """Two rows want one column; a third could have it, but needs no other."""
    pairs = np.array([[5.0, NEVER, NEVER], [900.0, NEVER, NEVER], [1000.0, -1000.0, NEVER]])
    alone = np.full(3, NEVER)
    for seed in range(20):
        found = best_matching(pairs, alone, np.random.default_rng(seed)).tolist()
        assert found == [ALONE, 0, 1]
    chances = posteriors(pairs, alone)
    assert chances[2] == pytest.approx([0.0, 1.0, 0.0])
    assert chances[1, 0] == pytest.approx(1.0)


def test_ties_fall_at_random() -> None:
    """All six matchings of three rows and three columns, alike often (chi-square, 5 degrees of freedom)."""
    rng = np.random.default_rng(7)
    counts: dict[tuple[int, ...], int] = {}
    for _ in range(3000):
        found = tuple(best_matching(np.full((3, 3), 17.3), np.full(3, NEVER), rng).tolist())
        counts[found] = counts.get(found, 0) + 1
    assert len(counts) == 6
    assert sum((count - 500) ** 2 / 500 for count in counts.values()) < 25.7  # p = 1e-4


def test_noise_overrules_nothing_that_is_real() -> None:
    pairs = np.zeros((8, 8))
    np.fill_diagonal(pairs, 10 * TIE_NOISE)
    for seed in range(50):
        found = best_matching(pairs, np.full(8, NEVER), np.random.default_rng(seed))
        assert found.tolist() == list(range(8))


@pytest.mark.parametrize("p", [0.1, 0.3, 0.5, 0.8])
def test_evidence_differs_by_far_more_than_the_noise(p: float) -> None:
    """Totals of two assignments differ by a K + b H: K more joint observations, H more heard, at most v * steps.

    With n11 = k of an edge, n10 = h - k, n01 = c - k and n00 = t - h - c + k; all visual ids are assigned, so
    only k and h of those chosen can differ.
    """
    visual, steps = 10, 200
    most = visual * steps
    for loss, miss, false in itertools.product((0.01, 0.1, 0.3), (0.01, 0.1, 0.25), (0.01, 0.05, 0.2)):
        rates = ChannelRates(
            transmission_probability=p, wireless_loss=loss, visual_miss=miss, visual_false=false
        )
        (l00, l01), (l10, l11) = rates.log_likelihood_ratios().tolist()
        a, b = l11 - l10 - l01 + l00, l10 - l00
        heard = np.arange(most + 1)
        joint = np.rint(-b * heard / a)
        differences = np.abs(a * joint + b * heard)
        differences = differences[differences > 1e-10]  # nearer to 0: the same total, but for rounding
        assert min(differences.min(initial=np.inf), abs(a)) > 100 * visual * TIE_NOISE


def test_without_scipy_one_sentence_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "scipy.optimize", None)
    spec = importlib.util.spec_from_file_location("matching_again", matching.__file__)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    with pytest.raises(ModuleNotFoundError, match=r"needs SciPy; install heliograph\[matching\]$") as failure:
        spec.loader.exec_module(module)
    assert failure.value.name == "scipy"
