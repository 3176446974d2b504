"""Vectorised stationary association: against its exact law, against the i-state, and by hand."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agent.behaviours.association.istate import StationaryIState
from scenarios.association import study_stationary
from scenarios.association.study_stationary import (
    NEIGHBOURHOODS,
    STUDY,
    NeighbourhoodParameters,
    StationaryParameters,
    _Code,
    _tell_apart,
    activity_words,
    chunk,
    completion_steps,
    matched_steps,
)
from scenarios.study import run_study

RUNS = 20_000


def study(samples: int = RUNS, seed: int = 1, **parameters: Any) -> dict[str, Any]:
    return run_study(STUDY, StationaryParameters(**parameters), samples=samples, seed=seed, jobs=1)


def law(w: int, v: int, t: int) -> float:
    """P(done by t) with p = 1/2: all strings of length t that visible ids have differ from all others."""
    cells = 2.0**t
    different = math.prod(max(0.0, 1 - i / cells) for i in range(v))
    return different * max(0.0, 1 - v / cells) ** (w - v)


def matched_law(w: int, t: int, p: float, colours: int) -> float:
    """P(no other of w ids has the string of one id): a sum over the number of steps it was active in."""
    return sum(
        math.comb(t, k) * p**k * (1 - p) ** (t - k) * (1 - (p / colours) ** k * (1 - p) ** (t - k)) ** (w - 1)
        for k in range(t + 1)
    )


# --- the exact law -------------------------------------------------------------------------------


@pytest.mark.parametrize(("w", "v"), [(2, 1), (4, 3), (8, 8), (12, 8), (20, 1), (40, 39), (100, 10)])
def test_completion_follows_its_exact_law(w: int, v: int) -> None:
    result = study(wireless=w, visual=v)
    done = np.cumsum(result["distribution"]) / RUNS
    exact = np.array([law(w, v, t) for t in range(len(done))])
    # Where hardly any run can be on the other side the normal error means nothing; Poisson's 1 / n does.
    error = np.sqrt(exact * (1 - exact) / RUNS) + 1 / RUNS
    assert (np.abs(done - exact) <= 4 * error).all()
    mean = sum(1 - law(w, v, t) for t in range(200))
    assert abs(result["steps"]["mean"] - mean) <= 4 * result["steps"]["se"]


def test_the_mean_that_can_be_worked_out_by_hand() -> None:
    steps = study(samples=400_000, wireless=4, visual=3)["steps"]
    assert abs(steps["mean"] - 88 / 21) <= 4 * steps["se"]
    assert steps["se"] < 0.003


def test_seeing_all_takes_as_long_as_seeing_all_but_one() -> None:
    steps = completion_steps(matched_steps(np.random.default_rng(3), 9, 500))
    assert (steps[:, 9] == steps[:, 8]).all()
    assert (steps[:, 8] != steps[:, 7]).any()


@pytest.mark.parametrize(
    ("w", "p", "colours"),
    [
        (5, 0.5, 1),
        (20, 0.5, 1),
        (20, 0.3, 1),
        (6, 0.9, 1),
        (3, 0.02, 1),
        (20, 0.5, 2),
        (20, 0.7, 255),
        (9, 1.0, 3),
    ],
)
def test_fraction_matched_follows_its_exact_law(w: int, p: float, colours: int) -> None:
    result = study(wireless=w, visual=w // 2, p=p, colours=colours)
    for t, (mean, error) in enumerate(result["fraction_matched"]):
        exact = matched_law(w, t, p, colours)
        if colours == 1 and p == 0.5:
            assert exact == pytest.approx((1 - 0.5**t) ** (w - 1), abs=1e-12)
        assert abs(mean - exact) <= 4 * error + 4 / RUNS
    assert result["fraction_matched"][0][0] == 0
    assert result["fraction_matched"][-1] == [1.0, 0.0]


@pytest.mark.parametrize(("p", "colours"), [(0.004, 1), (0.3, 1), (0.999, 1), (1.0, 2), (0.01, 200)])
def test_two_robots_are_told_apart_by_the_first_difference(p: float, colours: int) -> None:
    """A geometric time; words are full long before it where robots hardly ever differ."""
    steps = study(wireless=2, visual=1, p=p, colours=colours)["steps"]
    differ = 1 - (1 - p) ** 2 - p**2 / colours
    assert abs(steps["mean"] - 1 / differ) <= 4 * steps["se"]
    assert steps["sd"] == pytest.approx(math.sqrt(1 - differ) / differ, rel=0.05)


def test_strings_are_drawn_on_where_words_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """The law must hold however short the words are that strings are drawn in."""

    def shortened(code: _Code, wireless: int, p: float, colours: int) -> None:
        initialise(code, wireless, p, colours)
        code.steps = 2
        code.mask = np.uint64(3 << 62)

    initialise = _Code.__init__
    monkeypatch.setattr(_Code, "__init__", shortened)
    result = study(wireless=12, visual=8)
    done = np.cumsum(result["distribution"]) / RUNS
    exact = np.array([law(12, 8, t) for t in range(len(done))])
    assert (np.abs(done - exact) <= 4 * (np.sqrt(exact * (1 - exact) / RUNS) + 1 / RUNS)).all()


def test_all_neighbourhoods_at_once() -> None:
    parameters = NeighbourhoodParameters(wireless=10)
    result = run_study(NEIGHBOURHOODS, parameters, samples=RUNS, jobs=1)
    assert result["samples"] == RUNS
    assert len(result["steps"]) == 11
    assert result["steps"][0] == {"mean": 0.0, "sd": 0.0, "se": 0.0}
    for v, steps in enumerate(result["steps"]):
        mean = sum(1 - law(10, v, t) for t in range(100))
        assert abs(steps["mean"] - mean) <= 4 * steps["se"]


# --- sample by sample ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("w", "v", "p"), [(1, 1, 0.5), (2, 2, 0.5), (7, 4, 0.5), (20, 10, 0.5), (6, 6, 0.25)]
)
def test_equals_the_i_state_driven_by_the_same_bits(w: int, v: int, p: float) -> None:
    samples = 60
    steps = matched_steps(np.random.default_rng(5), w, samples, p)
    words = activity_words(np.random.default_rng(5), p, samples * w).reshape(samples, w)
    bits = words[:, :, np.newaxis] >> np.arange(63, -1, -1, dtype=np.uint64) & np.uint64(1)
    for row, active in zip(steps, bits, strict=True):
        istate = StationaryIState([f"{h:02d}" for h in range(w)], range(v))
        matched = dict.fromkeys(istate.matches(), 0)
        completion = 0 if istate.is_final() else None
        for t in range(58):
            heard, lit = np.flatnonzero(active[:, t]), set(np.flatnonzero(active[:v, t]).tolist())
            istate.update([f"{h:02d}" for h in heard], lit)
            for s, name in istate.matches().items():
                assert name == f"{s:02d}"
                matched.setdefault(s, t + 1)
            if completion is None and istate.is_final():
                completion = t + 1
        assert [matched[s] for s in range(v)] == row[:v].tolist()
        assert completion == completion_steps(row[np.newaxis])[0, v]


@given(
    st.lists(st.lists(st.integers(0, 2**9 - 1), min_size=1, max_size=9, unique=True), min_size=1, max_size=4)
)
def test_telling_apart_equals_comparing_all_with_all(rows: list[list[int]]) -> None:
    """Strings of nine steps, each different from the others of its row."""
    code = _Code(9, 0.5, 1)
    listed = [(row, word << 55) for row, words in enumerate(rows) for word in words]
    ordered = sorted(range(len(listed)), key=lambda place: listed[place])
    steps = np.full(len(listed), -1)
    groups = np.array([listed[place][0] for place in ordered])
    words = np.array([listed[place][1] for place in ordered], dtype=np.uint64)
    _tell_apart(np.random.default_rng(1), code, steps, groups, np.array(ordered), words)
    for place, (row, word) in enumerate(listed):
        others = [other for number, (its, other) in enumerate(listed) if its == row and number != place]
        common = [next(t for t in range(64) if (word ^ other) >> (63 - t) & 1) for other in others]
        assert steps[place] == max(common, default=-1) + 1


@given(
    st.integers(1, 63).flatmap(lambda low: st.integers(2**low, 2 ** (low + 1) - 1))
    | st.sampled_from([0, 1, 2**53 - 1, 2**54 - 1, 2**63 - 1, 2**64 - 1, 2**64 - 2**10])
)
def test_common_steps_are_leading_zeros(difference: int) -> None:
    code = _Code(2, 0.5, 1)
    assert code.common_steps(np.array([difference], dtype=np.uint64))[0] == min(
        63, 64 - difference.bit_length()
    )


@pytest.mark.parametrize("p", [0.5, 0.25, 0.3, 0.02, 0.97, 1.0, 0.0])
def test_bits_are_set_with_their_probability_and_independent(p: float) -> None:
    count = 20_000
    words = activity_words(np.random.default_rng(2), p, count)
    bits = (words[:, np.newaxis] >> np.arange(64, dtype=np.uint64) & np.uint64(1)).astype(float)
    error = math.sqrt(p * (1 - p) / count)
    assert (np.abs(bits.mean(axis=0) - p) <= 5 * error).all()
    centred = bits - p
    assert np.abs((centred[:, 1:] * centred[:, :-1]).mean(axis=0)).max() <= 6 * p * (1 - p) / math.sqrt(count)


# --- what is reported ----------------------------------------------------------------------------


def test_the_summary_is_that_of_all_chunks_together(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study_stationary, "HISTORY_CELLS", 64)  # and blocks within a chunk change nothing
    parameters = StationaryParameters(wireless=8, visual=5)
    sizes = [300, 1, 40]
    partials = [
        STUDY.simulate(parameters, np.random.default_rng(seed), size) for seed, size in enumerate(sizes)
    ]
    result = STUDY.summarise(parameters, partials)
    steps = np.concatenate(
        [matched_steps(np.random.default_rng(seed), 8, size)[:, :5] for seed, size in enumerate(sizes)]
    )
    done = steps.max(axis=1)
    assert result["samples"] == 341
    assert result["distribution"] == np.bincount(done).tolist()
    assert result["steps"]["mean"] == pytest.approx(done.mean(), rel=1e-12)
    assert result["steps"]["sd"] == pytest.approx(done.std(ddof=1), rel=1e-9)
    assert result["steps"]["se"] == pytest.approx(done.std(ddof=1) / math.sqrt(341), rel=1e-9)
    assert len(result["fraction_matched"]) == done.max() + 1
    for t, (mean, error) in enumerate(result["fraction_matched"]):
        fractions = (steps <= t).mean(axis=1)
        assert mean == pytest.approx(fractions.mean(), rel=1e-12)
        assert error == pytest.approx(fractions.std(ddof=1) / math.sqrt(341), rel=1e-6, abs=1e-12)


def test_the_same_seed_gives_the_same_result() -> None:
    parameters = {"wireless": 30, "visual": 7, "p": 0.4}
    assert study(samples=chunk(StationaryParameters(wireless=30)) + 5, **parameters) == study(
        samples=chunk(StationaryParameters(wireless=30)) + 5, **parameters
    )
    assert study(samples=500, **parameters) != study(samples=500, seed=2, **parameters)


@pytest.mark.parametrize(("w", "v"), [(0, 0), (1, 0), (5, 0), (1, 1)])
def test_nothing_to_tell_apart_is_done_at_once(w: int, v: int) -> None:
    result = study(samples=10, wireless=w, visual=v)
    assert result["steps"] == {"mean": 0.0, "sd": 0.0, "se": 0.0}
    assert result["distribution"] == [10]
    assert result["fraction_matched"] == ([[1.0, 0.0]] if v else [])


def test_one_sample_has_no_deviation() -> None:
    result = study(samples=1, wireless=5, visual=3)
    assert result["steps"]["sd"] is None
    assert result["steps"]["se"] is None
    assert all(error is None for _, error in result["fraction_matched"])
    assert msgspec.json.decode(msgspec.json.encode(result)) == result


@pytest.mark.parametrize(
    ("parameters", "sentence"),
    [
        ({"wireless": 4, "visual": 5}, "^visual: 5 robots are seen but only 4 heard"),
        ({"p": 1.0}, "^p: with 1 two robots differ in less than one of 1000 steps"),
        ({"p": 1e-5}, "^p: with 1e-05 "),
        ({"p": 1.0, "colours": 1}, "^p: "),
    ],
)
def test_parameters_that_do_not_go_together(parameters: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        study(**parameters)


def test_neighbourhoods_and_strings_check_their_probability_too() -> None:
    with pytest.raises(ValueError, match=r"^p: "):
        run_study(NEIGHBOURHOODS, NeighbourhoodParameters(p=1.0), samples=1)
    with pytest.raises(ValueError, match=r"^p: "):
        matched_steps(np.random.default_rng(1), 5, 5, 0.0)
