"""The tables behind the papers' figures: fed with results made by hand, and compared value by value."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from functools import cache
from typing import Any

import pytest

from scenarios.association import figures_models
from scenarios.association.emulated import EMULATED
from scenarios.association.figures_mobile import (
    FRACTION_MATCHED,
    MIX,
    RANGE,
    RATIO,
    SEPARATION,
    SPEED,
    STEPS_SHOWN,
)
from scenarios.association.figures_models import BY_RANGE, BY_SEPARATION, BY_SPEED, STYLES, Axis, steady_state
from scenarios.association.figures_stationary import EXAMPLES, LARGEST, RUNS, SIZES
from scenarios.association.mobile_batches import batch_model, new_ids
from scenarios.association.mobile_models import (
    MobileSystem,
    fraction_matched_corrected,
    fraction_matched_literal,
    multi_region_model,
    two_region_model,
)
from scenarios.association.paper_2014 import PAPER as PAPER_2014
from scenarios.association.paper_2016 import PAPER as PAPER_2016
from scenarios.association.study_mobile import GROUPS, SERIES
from scenarios.association.study_stationary import (
    NEIGHBOURHOODS,
    STUDY,
    NeighbourhoodParameters,
    StationaryParameters,
)
from scenarios.figures import Figure, Table

Numbers = Iterator[float]


def numbers() -> Numbers:
    """All different, and easy to recognise."""
    return (100.0 + number / 8 for number in itertools.count())


def moment(fresh: Numbers) -> dict[str, float]:
    return {key: next(fresh) for key in ("mean", "sd", "se")}


def shown(table: Table, *columns: str) -> list[tuple[Any, ...]]:
    """These columns of all rows."""
    return list(zip(*(table.column(name) for name in columns), strict=True))


def all_different(results: object) -> bool:
    """Whether no number in these results stands there twice."""
    found: list[float] = []
    todo = [results]
    while todo:
        part = todo.pop()
        if isinstance(part, dict):
            todo += part.values()
        elif isinstance(part, list):
            todo += part
        elif isinstance(part, float):
            found.append(part)
    return len(found) == len(set(found)) > 0


# --- the exact law, by another route -----------------------------------------------------------------


def cdf(wireless: int, visual: int, step: int) -> float:
    """P(T <= t): v strings out of 2^t all different, and none of the other w - v strings among them."""
    strings = 2.0**step
    different = math.prod(max(0.0, 1 - other / strings) for other in range(visual))
    return different * max(0.0, 1 - visual / strings) ** (wireless - visual)


def exact_moments(wireless: int, visual: int) -> tuple[float, float]:
    """Mean and standard deviation of T."""
    law = [
        cdf(wireless, visual, step) - (cdf(wireless, visual, step - 1) if step else 0.0) for step in range(60)
    ]
    mean = math.fsum(step * part for step, part in enumerate(law))
    return mean, math.sqrt(math.fsum((step - mean) ** 2 * part for step, part in enumerate(law)))


# --- stationary robots -------------------------------------------------------------------------------


def of_all_visual(wireless: int, fresh: Numbers) -> dict[str, Any]:
    """What the study of all neighbourhoods of one size returns: index v = 0 ... w."""
    return {"steps": [moment(fresh) for _ in range(wireless + 1)], "samples": 7}


@pytest.mark.parametrize("figure", [PAPER_2014.figures[4], PAPER_2016.figures[5]], ids=["2014", "2016"])
def test_all_neighbourhoods(figure: Figure) -> None:
    runs = figure.runs()
    assert [run.parameters for run in runs] == [NeighbourhoodParameters(wireless=w) for w in range(2, 41)]
    assert {(run.study.name, run.samples) for run in runs} == {(NEIGHBOURHOODS.name, RUNS)}
    fresh = numbers()
    results = [of_all_visual(wireless, fresh) for wireless in range(2, LARGEST + 1)]
    assert all_different(results)

    table = figure.tabulate(results)
    assert len(table.rows) == 780
    assert shown(table, "wireless", "visual") == [(w, v) for w in range(2, 41) for v in range(1, w)]
    for w, v, mean, se, sd in shown(table, "wireless", "visual", "mean", "se", "sd"):
        assert {"mean": mean, "se": se, "sd": sd} == results[w - 2]["steps"][v]
    expected = [exact_moments(w, v)[0] for w, v in shown(table, "wireless", "visual")]
    assert table.column("exact_mean") == pytest.approx(expected, rel=1e-9)


def test_distributions() -> None:
    figure = PAPER_2016.figures[6]
    assert [run.parameters for run in figure.runs()] == [
        StationaryParameters(wireless=w, visual=v) for w, v in EXAMPLES
    ]
    fresh = numbers()
    results: list[dict[str, Any]] = []
    for number in range(len(EXAMPLES)):
        counts = [number, 3, 5 + number, 80, 0, 11]
        results.append({"steps": moment(fresh), "distribution": counts, "samples": sum(counts)})

    table = figure.tabulate(results)
    assert shown(table, "wireless", "visual", "step") == [(w, v, t) for w, v in EXAMPLES for t in range(6)]
    for (wireless, visual), result in zip(EXAMPLES, results, strict=True):
        part = table.where(wireless=wireless, visual=visual)
        n = result["samples"]
        parts = [count / n for count in result["distribution"]]
        assert part.column("fraction_of_runs") == pytest.approx(parts, rel=1e-12)
        assert part.column("se") == pytest.approx([math.sqrt(p * (1 - p) / n) for p in parts], rel=1e-12)
        exact = [cdf(wireless, visual, t) - (cdf(wireless, visual, t - 1) if t else 0.0) for t in range(6)]
        assert part.column("exact_probability") == pytest.approx(exact, abs=1e-13)
        assert part.column("mean") == [result["steps"]["mean"]] * 6
        # 2016, Eq. 1: the false edges halve in every step.
        false_edges = wireless * visual - visual
        assert part.column("branching_process") == pytest.approx([math.log2(false_edges)] * 6)


def test_a_run_beyond_the_law_had_no_chance_worth_a_number() -> None:
    counts = [0] * 150 + [1]
    result = {"steps": moment(numbers()), "distribution": counts, "samples": 1}
    table = PAPER_2016.figures[6].tabulate([result] * len(EXAMPLES))
    assert table.where(step=150).column("exact_probability") == [0.0] * len(EXAMPLES)
    assert table.where(step=150).column("fraction_of_runs") == [1.0] * len(EXAMPLES)


@pytest.mark.parametrize(("number", "wireless"), [(7, 20), (8, 40)])
def test_against_the_branching_process(number: int, wireless: int) -> None:
    figure = PAPER_2016.figures[number]
    (run,) = figure.runs()
    assert (run.study.name, run.parameters) == (
        NEIGHBOURHOODS.name,
        NeighbourhoodParameters(wireless=wireless),
    )
    result = of_all_visual(wireless, numbers())
    assert all_different(result)

    table = figure.tabulate([result])
    odd = [visual for visual in range(wireless) if visual % 2]
    assert shown(table, "wireless", "visual") == [(wireless, visual) for visual in odd]
    for key in ("mean", "se", "sd"):
        assert table.column(key) == [result["steps"][visual][key] for visual in odd]
    moments = [exact_moments(wireless, visual) for visual in odd]
    assert table.column("exact_mean") == pytest.approx([mean for mean, _ in moments], rel=1e-9)
    assert table.column("exact_sd") == pytest.approx([sd for _, sd in moments], rel=1e-6)
    halvings = [math.log2(visual * (wireless - 1)) for visual in odd]
    assert table.column("branching_process") == pytest.approx(halvings)


def test_fraction_matched_per_step() -> None:
    figure = PAPER_2016.figures[9]
    assert [run.parameters for run in figure.runs()] == [
        StationaryParameters(wireless=w, visual=w - 1) for w in SIZES
    ]
    assert {run.study.name for run in figure.runs()} == {STUDY.name}
    fresh = numbers()
    lengths = [3, 8, 5, 13]
    results = [{"fraction_matched": [[next(fresh), next(fresh)] for _ in range(n)]} for n in lengths]
    assert all_different(results)

    table = figure.tabulate(results)
    assert len(table.rows) == sum(lengths)
    for wireless, result, length in zip(SIZES, results, lengths, strict=True):
        part = table.where(wireless=wireless)
        assert part.column("step") == list(range(length))
        assert list(map(list, shown(part, "fraction_matched", "se"))) == result["fraction_matched"]
        exact = [(1 - 2.0**-t) ** (wireless - 1) for t in range(length)]
        assert part.column("exact") == pytest.approx(exact, rel=1e-12)
        # 2016, Eqs. 2 and 3, with v = w.
        model = [(1 - 1 / wireless) ** (wireless * (wireless - 1) / 2.0**t) for t in range(length)]
        assert part.column("model") == pytest.approx(model, rel=1e-12)


# --- i-states ----------------------------------------------------------------------------------------


def test_transition_graph() -> None:
    figure = PAPER_2014.figures[3]
    assert figure.runs() == []
    table = figure.tabulate([])
    states, moves = table.where(kind="state"), table.where(kind="transition")
    assert len(states.rows) + len(moves.rows) == len(table.rows)
    assert states.column("state") == list(range(1, 16))
    assert states.column("level") == [1] + [2] * 7 + [3] * 6 + [4]
    assert len(set(states.column("istate"))) == 15
    assert states.column("istate")[0] == "111/111/111/111"
    assert states.column("istate")[-1] == "100/010/001/000"
    level = dict(zip(states.column("state"), states.column("level"), strict=True))
    for state in range(1, 16):
        part = moves.where(state=state)
        assert sum(part.column("observations")) == 16
        assert part.column("probability") == [count / 16 for count in part.column("observations")]
        assert sum(part.column("probability")) == 1.0
        assert set(part.column("level")) == {level[state]}
        assert min(level[target] for target in part.column("to_state")) >= level[state]
    assert table.where(state=15, to_state=15).column("observations") == [16]


def test_expected_steps_of_the_transition_graph() -> None:
    """Each state's is one more than the mean of those it leads to, as the transitions in the table say."""
    table = PAPER_2014.figures[3].tabulate([])
    expected = table.where(kind="state").column("expected_steps")
    assert expected[-1] == 0.0
    assert expected[0] == pytest.approx(exact_moments(4, 3)[0], rel=1e-12)
    for state in range(1, 15):
        part = table.where(kind="transition", state=state)
        later = [p * expected[target - 1] for target, p in shown(part, "to_state", "probability")]
        assert expected[state - 1] == pytest.approx(1 + sum(later))


# --- moving robots -----------------------------------------------------------------------------------


def steady(fresh: Numbers, samples: int) -> dict[str, Any]:
    """What the simulation of moving robots returns, but for the series."""
    groups = {group: {metric: moment(fresh) for metric in (FRACTION_MATCHED, RATIO)} for group in GROUPS}
    return {**groups, "samples": samples}


def with_series(fresh: Numbers, steps: int, samples: int) -> dict[str, Any]:
    def lists() -> dict[str, list[float | None]]:
        # At the first step nobody has anything yet.
        return {key: [None, *itertools.islice(fresh, steps)] for key in ("mean", "sd", "se")}

    series = {group: {metric: lists() for metric in (FRACTION_MATCHED, RATIO)} for group in GROUPS}
    return {**steady(fresh, samples), "series": series}


def emulated(fresh: Numbers, samples: int) -> dict[str, Any]:
    """As the study of the emulator returns it: a standard error, and no deviation."""
    metrics = {metric: {"mean": next(fresh), "se": next(fresh)} for metric in (FRACTION_MATCHED, RATIO)}
    return {**metrics, "observers": 160, "samples": samples}


SWEPT = {10: MIX, 11: MIX, 12: RANGE, 13: RANGE, 14: SEPARATION, 15: SEPARATION, 16: SPEED, 17: SPEED}
"""Figures over time."""
AXES = {20: BY_RANGE, 21: BY_SEPARATION, 22: BY_SPEED, 23: BY_RANGE, 24: BY_SEPARATION, 25: BY_SPEED}
"""Figures of the steady state."""
FRACTIONS = {10, 12, 14, 16, 20, 21, 22}


def metric_of(number: int) -> str:
    return FRACTION_MATCHED if number in FRACTIONS else RATIO


def of_kind(table: Table, kind: str, key: str, metric: str) -> list[tuple[Any, ...]]:
    return shown(table.where(kind=kind), key, metric, "se", "sd", "samples")


def row(value: float, moment: dict[str, float], samples: int) -> tuple[Any, ...]:
    return value, moment["mean"], moment["se"], moment.get("sd"), samples


@pytest.mark.parametrize("number", SWEPT)
def test_over_time(number: int) -> None:
    figure, sweep, metric = PAPER_2016.figures[number], SWEPT[number], metric_of(number)
    key, values = sweep.key, list(sweep.values)
    *big, small_run, emulated_run = figure.runs()
    assert [run.study.name for run in big] == [SERIES.name] * len(values)
    assert [run.parameters for run in big] == [sweep.parameters(value) for value in values]
    assert (small_run.study.name, emulated_run.study.name) == (SERIES.name, EMULATED.name)
    assert small_run.parameters == emulated_run.parameters == sweep.small()
    fresh = numbers()
    results = [with_series(fresh, STEPS_SHOWN + 20, 3 + place) for place in range(len(big))]
    small, on_emulator = with_series(fresh, 90, 23), emulated(fresh, 29)
    assert all_different([*results, small, on_emulator])

    table = figure.tabulate([*results, small, on_emulator])
    steps = list(range(1, STEPS_SHOWN + 1))  # none for step 0, when nobody has anything
    assert len(table.rows) == len(big) * (len(steps) + 1) + 2
    for value, result in zip(values, results, strict=True):
        part = table.where(kind="simulated", **{key: value})
        series = result["series"]["deep"][metric]
        assert part.column("step") == steps
        assert part.column(metric) == [series["mean"][step] for step in steps]
        assert part.column("se") == [series["se"][step] for step in steps]
        assert part.column("sd") == [series["sd"][step] for step in steps]
        assert set(part.column("samples")) == {result["samples"]}
    assert of_kind(table, "simulated steady state", key, metric) == [
        row(value, result["deep"][metric], result["samples"])
        for value, result in zip(values, results, strict=True)
    ]
    checked = [row(sweep.emulated, small["all"][metric], 23), row(sweep.emulated, on_emulator[metric], 29)]
    assert of_kind(table, "simulated small world", key, metric) == checked[:1]
    assert of_kind(table, "emulated small world", key, metric) == checked[1:]
    assert {row[2] for row in table.rows if row[0] != "simulated"} == {None}


@cache
def models(key: str, value: float, metric: str) -> dict[str, float | None]:
    """The library's word on one point of the default world; names as in the legend."""
    system = MobileSystem(**{"radius": 16.0, "speed": 1.4, "separation": 4.0, key: value})
    variance, batches = new_ids(system).listed_variance, batch_model(system, 0.05)
    if metric == FRACTION_MATCHED:
        return {
            "literal": fraction_matched_literal(system),
            "literal, Eq. 10": fraction_matched_literal(system, variance),
            "corrected": fraction_matched_corrected(system, variance),
            "batches": batches.fraction_matched,
        }
    return {
        "two regions": two_region_model(system, variance, corrected=False).ratio(),
        "two regions, corrected": two_region_model(system, variance, corrected=True).ratio(),
        "many regions": multi_region_model(system, variance).ratio(),
        "batches": batches.ratio,
    }


@pytest.mark.parametrize("number", AXES)
def test_steady_state(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        figures_models, "_models", lambda *_: {}
    )  # they take their time, and have a test below
    figure, axis, metric = PAPER_2016.figures[number], AXES[number], metric_of(number)
    key, values = axis.sweep.key, list(axis.values)
    *big, small_run, emulated_run = figure.runs()
    assert [run.parameters for run in big] == [axis.sweep.parameters(value) for value in values]
    assert small_run.parameters == emulated_run.parameters == axis.sweep.small()
    fresh = numbers()
    results = [steady(fresh, 3 + place) for place in range(len(big))]
    small, on_emulator = steady(fresh, 23), emulated(fresh, 29)
    assert all_different([*results, small, on_emulator])

    table = figure.tabulate([*results, small, on_emulator])
    assert len(table.rows) == len(big) + 2
    assert of_kind(table, "simulated", key, metric) == [
        row(value, result["deep"][metric], result["samples"])
        for value, result in zip(values, results, strict=True)
    ]
    checked = axis.sweep.emulated
    assert of_kind(table, "simulated small world", key, metric) == [row(checked, small["all"][metric], 23)]
    assert of_kind(table, "emulated small world", key, metric) == [row(checked, on_emulator[metric], 29)]


QUICK = [Axis(RANGE, (8.0, 10.0)), Axis(SEPARATION, (5.0, 8.0)), Axis(SPEED, (1.9, 2.5))]
"""Where models take a tenth of a second."""


@pytest.mark.parametrize("metric", [FRACTION_MATCHED, RATIO])
@pytest.mark.parametrize("axis", QUICK, ids=lambda axis: str(axis.sweep.key))
def test_models(axis: Axis, metric: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figures_models, "MODEL_POINTS", 3)
    fresh = numbers()
    results = [steady(fresh, 3) for _ in axis.values]
    table = steady_state(axis, metric).tabulate([*results, steady(fresh, 3), emulated(fresh, 3)])
    first, last = axis.values
    points = [first, (first + last) / 2, last]
    assert len(table.rows) == 4 + 3 * len(STYLES[metric])
    for name in STYLES[metric]:
        part = table.where(kind=name)
        assert part.column(axis.sweep.key) == pytest.approx(points)
        assert part.column("se") == part.column("sd") == part.column("samples") == [None] * 3
        middle = models(axis.sweep.key if axis.sweep != RANGE else "radius", points[1], metric)
        assert part.column(metric)[1] == middle[name]
    assert None not in middle.values()
    assert len(set(middle.values())) == len(middle)
