"""Association under noise in large samples: the same answers as the robots', exact laws, known numbers."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from agent.behaviours.association.noisy_istate import NoisyIState
from scenarios.association.study_noisy import (
    STUDY,
    Evidence,
    NoisyParameters,
    Tallies,
    likeliest,
    observations,
    rates_of,
    simulate,
    summarise,
)
from scenarios.study import run_study

CASES = [
    NoisyParameters(wireless=8, visual=5, wireless_loss=0.2, visual_miss=0.1, visual_false=0.05),
    NoisyParameters(wireless=6, visual=6, wireless_loss=0.1, p=0.3),
    NoisyParameters(wireless=5, visual=2, wireless_loss=0.0, visual_miss=0.2),
    NoisyParameters(wireless=4, visual=1, wireless_loss=0.0, visual_false=0.1),
    NoisyParameters(wireless=3, visual=3, wireless_loss=0.0),
]


def study(samples: int, seed: int = 1, jobs: int = 1, **keys: Any) -> dict[str, Any]:
    return run_study(STUDY, NoisyParameters(**keys), samples=samples, seed=seed, jobs=jobs)


@pytest.mark.parametrize("parameters", CASES, ids=range(len(CASES)))
def test_the_same_bits_give_the_same_answers_as_the_robots_i_state(parameters: NoisyParameters) -> None:
    samples, rng = 6, np.random.default_rng(1)
    rates, wireless, visual = rates_of(parameters), parameters.wireless, parameters.visual
    names = [f"{number:02d}" for number in range(wireless)]
    evidence = Evidence(rates, samples, wireless, visual)
    istates = [NoisyIState(rates, wireless=names, closed=True) for _ in range(samples)]
    for _ in range(15):
        heard, lit = observations(parameters, rng, samples)
        evidence.update(heard, lit)
        weights = evidence.log_likelihood_ratios()
        found = likeliest(weights, rng)
        for sample, istate in enumerate(istates):
            lamps = dict(enumerate(lit[sample].tolist()))
            istate.update(set(itertools.compress(names, heard[sample])), lamps)
            expected = istate.log_likelihood_ratios()
            np.testing.assert_allclose(weights[sample], expected, rtol=0, atol=1e-10)
            robots = [names.index(name) for name in istate.assignment(rng).values()]
            both = expected[robots, range(visual)], expected[found[sample], range(visual)]
            assert both[0].sum() == pytest.approx(both[1].sum(), abs=1e-7)
            assert np.isfinite(both[1]).all()
            if best_by_far(expected):
                assert robots == found[sample].tolist()


def best_by_far(weights: NDArray[np.float64]) -> bool:
    """Whether one assignment has more than all others, by listing them."""
    rows, columns = weights.shape
    totals = sorted(
        sum(weights[row, column] for column, row in enumerate(chosen))
        for chosen in itertools.permutations(range(rows), columns)
    )
    return len(totals) < 2 or totals[-1] - totals[-2] > 1e-6


def exact(parameters: NoisyParameters, steps: int) -> tuple[float, float]:
    """P(all right) and the mean fraction right after so many steps, by listing all that can be observed.

    Among the likeliest assignments one is taken with equal chance: for one light, or for two of two robots,
    whatever falls at random does that.
    """
    wireless, visual = parameters.wireless, parameters.visual
    joint, heard = rates_of(parameters).joint(), rates_of(parameters).heard()
    table = rates_of(parameters).log_likelihood_ratios()
    bits = list(itertools.product((0, 1), repeat=wireless + visual))
    assignments = list(itertools.permutations(range(wireless), visual))
    everything, fraction = 0.0, 0.0
    for history in itertools.product(bits, repeat=steps):
        chance = 1.0
        for row in history:
            x, y = row[:wireless], row[wireless:]
            chance *= math.prod(joint[x[j], y[j]] for j in range(visual))
            chance *= math.prod(heard[x[j]] for j in range(visual, wireless))
        if chance == 0.0:
            continue
        totals = [
            sum(table[row[i], row[wireless + j]] for row in history for j, i in enumerate(chosen))
            for chosen in assignments
        ]
        best = [one for one, total in zip(assignments, totals, strict=True) if total > max(totals) - 1e-9]
        for chosen in best:
            right = sum(i == j for j, i in enumerate(chosen))
            everything += chance / len(best) * (right == visual)
            fraction += chance / len(best) * right / visual
    return everything, fraction


@pytest.mark.parametrize(
    ("wireless", "visual", "steps"), [(2, 1, 0), (2, 1, 2), (2, 1, 3), (3, 1, 2), (2, 2, 2)]
)
@pytest.mark.parametrize(
    "noise",
    [
        {"wireless_loss": 0.0},
        {"wireless_loss": 0.3},
        {"wireless_loss": 0.2, "visual_miss": 0.1, "visual_false": 0.15},
        {"wireless_loss": 0.1, "visual_false": 0.2, "p": 0.2},
    ],
)
def test_small_cases_against_the_exact_law(
    wireless: int, visual: int, steps: int, noise: dict[str, float]
) -> None:
    keys = {"wireless": wireless, "visual": visual, "steps": steps, **noise}
    result = study(20_000, **keys)
    everything, fraction = exact(NoisyParameters(**keys), steps)
    assert abs(result["p_all_right"][steps] - everything) < 4 * result["p_all_right_se"][steps]
    assert abs(result["fraction_right"][steps] - fraction) < 4 * result["fraction_right_se"][steps]


def test_without_noise_by_hand() -> None:
    """w = 2, v = 1: undecided while both robots have done the same, and then one in two is right."""
    result = study(20_000, wireless=2, visual=1, wireless_loss=0.0, steps=8)
    for step, value in enumerate(result["p_all_right"]):
        assert abs(value - (1 - 0.5 ** (step + 1))) < 4 * math.sqrt(0.5 ** (step + 1) / 20_000)


def test_before_the_first_step_all_is_chance() -> None:
    result = study(20_000, wireless=4, visual=3, steps=0)
    assert abs(result["p_all_right"][0] - 1 / 24) < 4 * result["p_all_right_se"][0]
    assert abs(result["fraction_right"][0] - 1 / 4) < 4 * result["fraction_right_se"][0]


def test_ties_do_not_fall_by_index() -> None:
    """All wireless ids alike: each light goes to each of them alike often."""
    found = likeliest(np.zeros((6000, 5, 3)), np.random.default_rng(0))
    for column in range(3):
        counts = np.bincount(found[:, column], minlength=5)
        assert ((counts - 1200) ** 2 / 1200).sum() < 23.5  # chi-square, 4 degrees of freedom, p = 1e-4


def test_the_shortcut_gives_what_solving_gives() -> None:
    """Columns whose best rows all differ are not sent to the solver; here their answers are."""
    rng = np.random.default_rng(3)
    weights = rng.normal(0.0, 2.0, (300, 6, 4))
    weights[rng.random(weights.shape) < 0.2] = -np.inf
    weights[:, range(4), range(4)] = 1.0
    found = likeliest(weights, rng)
    for sample in range(300):
        best = max(
            sum(weights[sample, row, column] for column, row in enumerate(chosen))
            for chosen in itertools.permutations(range(6), 4)
        )
        assert weights[sample, found[sample], range(4)].sum() == pytest.approx(best)


def test_ten_of_twenty_with_a_tenth_lost() -> None:
    """99 % of runs are all right at step 18, give or take one."""
    result = study(5000, steps=24)
    assert result["t99_all"] in (17, 18, 19)
    assert result["t99_fraction"] in (12, 13, 14)
    assert result["p_all_right"][15] < 0.98


def test_more_noise_takes_longer() -> None:
    times = [
        study(1000, steps=50, wireless=8, visual=4, **noise)["t99_all"]
        for noise in (
            {"wireless_loss": 0.0},
            {"wireless_loss": 0.1},
            {"wireless_loss": 0.3},
            {"wireless_loss": 0.3, "visual_miss": 0.1, "visual_false": 0.05},
        )
    ]
    assert times == sorted(times)
    assert len(set(times)) == 4


@pytest.mark.parametrize("p", [0.0, 1.0])
def test_who_always_does_the_same_is_never_told_apart(p: float) -> None:
    result = study(4000, wireless=3, visual=2, visual_miss=0.2, visual_false=0.1, p=p, steps=5)
    assert result["t99_all"] is None
    for value, error in zip(result["p_all_right"], result["p_all_right_se"], strict=True):
        assert abs(value - 1 / 6) < 4 * error


def test_only_one_to_choose_from() -> None:
    result = study(10, wireless=1, visual=1, wireless_loss=1.0, visual_miss=1.0, steps=3)
    assert result["p_all_right"] == result["fraction_right"] == [1.0] * 4
    assert result["t99_all"] == result["t99_fraction"] == 0


def test_a_summary_by_hand() -> None:
    parts = [
        Tallies(2, np.array([0, 1]), np.array([1, 3]), np.array([1, 5])),
        Tallies(2, np.array([0, 2]), np.array([2, 4]), np.array([2, 8])),
    ]
    result = summarise(NoisyParameters(wireless=3, visual=2, steps=1), parts)
    assert result["p_all_right"] == [0.0, 0.75]
    assert result["p_all_right_se"] == pytest.approx([0.0, 0.25])
    assert result["fraction_right"] == [0.375, 0.875]
    assert result["fraction_right_se"] == pytest.approx([0.125, 0.125])
    assert (result["t99_all"], result["t99_fraction"], result["samples"]) == (None, None, 4)
    alone = summarise(
        NoisyParameters(wireless=3, visual=2, steps=1), [Tallies(1, *np.ones((3, 2), dtype=int))]
    )
    assert alone["p_all_right_se"] == [None, None]


def test_a_seed_is_a_result_whatever_the_chunks() -> None:
    keys = {"wireless": 30, "visual": 20, "steps": 3}
    assert STUDY.chunk(NoisyParameters(**keys)) < 1000
    one = study(1000, seed=5, **keys)
    assert study(1000, seed=5, **keys) == one
    assert study(1000, seed=6, **keys) != one


def test_a_chunk_draws_from_its_generator_alone() -> None:
    tallies = [simulate(CASES[0], np.random.default_rng(9), 20) for _ in range(2)]
    assert tallies[0].right.tolist() == tallies[1].right.tolist()
    assert tallies[0].all_right.shape == (61,)


def test_who_is_seen_is_heard() -> None:
    with pytest.raises(ValueError, match=r"^visual: 5 robots are seen but only 4 heard"):
        study(10, wireless=4, visual=5)
