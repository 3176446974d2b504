"""Figures of reconnection: what is tabulated is what was found, and all that is drawn stands in the table."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure as Canvas
from msgspec.structs import replace

from channels.graphs import hearing, hops
from scenarios.figures import Table, Work, drawn
from scenarios.reconnection import (
    figure_beliefs,
    figure_livelock,
    figure_sensitivity,
    figure_tests,
    figure_times,
    statistics,
)
from scenarios.reconnection.paper import PAPER
from scenarios.reconnection.study_reconnection import (
    STUDY,
    Kind,
    ReconnectionParameters,
    check,
    graph_of,
    search_of,
)
from scenarios.study import generator, run_study

SAMPLES = 12
SCALE = {"semi-markov": 100.0, "persistent": 3000.0, "random": 900.0}


def invented(parameters: ReconnectionParameters, samples: int = SAMPLES) -> dict[str, Any]:
    """A result with the study's keys; exponential times whose scale depends on the method."""
    rng = np.random.default_rng(parameters.robots)
    times = np.ceil(rng.exponential(SCALE[parameters.method], samples)).astype(int)
    times[0] = 0
    censored = 1 if parameters.method == "random" else 0
    times[len(times) - censored :] = parameters.limit
    return {
        "steps": {"mean": float(times.mean()), "median": float(np.median(times))},
        "times": times.tolist(),
        "seeds": list(range(50, 50 + samples)),
        "censored": censored,
        "stuck": 0,
        "samples": samples,
    }


def invented_for(figure: Any) -> list[dict[str, Any]]:
    return [invented(run.parameters) for run in figure.runs()]


def test_invented_results_have_the_keys_of_real_ones() -> None:
    parameters = ReconnectionParameters(method="random", vertices=20, random_steps=5, robots=2)
    real = run_study(STUDY, parameters, samples=2, jobs=1)
    assert set(invented(parameters)) <= set(real)
    assert set(invented(parameters)["steps"]) <= set(real["steps"])


def test_everything_that_the_paper_needs_can_be_run() -> None:
    for figure in PAPER.figures.values():
        for run in figure.runs():
            check(run.parameters)


@pytest.mark.parametrize("name", [name for name in PAPER.figures if name != "beliefs"])
def test_every_figure_is_drawn_of_its_table(name: str) -> None:
    figure = PAPER.figures[name]
    table = figure.tabulate(invented_for(figure))
    assert all(len(row) == len(table.columns) for row in table.rows)
    others = [tuple(1.5 * cell if isinstance(cell, float) else cell for cell in row) for row in table.rows]
    assert pixels(drawn(figure, Table(table.columns, others))) != pixels(drawn(figure, table))


def pixels(canvas: Canvas) -> bytes:
    canvas.canvas.draw()  # type: ignore[attr-defined]
    return bytes(canvas.canvas.buffer_rgba())  # type: ignore[attr-defined]


# --- Fig. 3, Table I -----------------------------------------------------------------------------


@pytest.mark.parametrize("kind", figure_tests.KINDS)
def test_all_methods_and_teams_of_the_paper_are_compared(kind: Kind) -> None:
    parameters = [run.parameters for run in PAPER.figures[f"times-{kind}"].runs()]
    assert {(each.method, each.robots) for each in parameters} == {
        (method, robots) for method in SCALE for robots in (2, 3, 4, 5)
    }
    for each in parameters:
        assert replace(each, method="random", robots=2) == ReconnectionParameters(
            environment=kind, method="random", robots=2
        )
    assert all(run.samples >= 100 for run in PAPER.figures[f"times-{kind}"].runs())


def test_times_are_those_of_the_runs() -> None:
    figure = PAPER.figures["times-maze"]
    results = invented_for(figure)
    table = figure.tabulate(results)
    for run, result in zip(figure.runs(), results, strict=True):
        cell = {"method": run.parameters.method, "robots": run.parameters.robots}
        times = table.where(kind="time", **cell)
        assert times.column("steps") == result["times"]
        assert times.column("seed") == result["seeds"]
        assert sum(times.column("censored")) == result["censored"]
        (mean,) = table.where(kind="mean", **cell).rows
        row = dict(zip(table.columns, mean, strict=True))
        assert row["steps"] == result["steps"]["mean"]
        assert (row["low"], row["high"]) == statistics.t_interval(result["times"])


def test_what_has_not_ended_is_drawn_as_such() -> None:
    figure = PAPER.figures["times-gabriel"]
    table = figure.tabulate(invented_for(figure))
    (axes,) = drawn(figure, table).axes
    triangles = [line for line in axes.lines if line.get_marker() == "^"]
    assert [len(line.get_xdata()) for line in triangles] == [4]
    dots = [line for line in axes.lines if line.get_marker() == "."]
    assert sum(len(line.get_xdata()) for line in dots) == 3 * 4 * SAMPLES - 4
    ended = table.where(kind="mean", censored=0).column("method")
    assert set(ended) == {"semi-markov", "persistent"}


def test_the_table_of_tests_says_what_the_tests_say() -> None:
    results = invented_for(figure_tests.FIGURE)
    table = figure_tests.FIGURE.tabulate(results)
    assert len(table.rows) == 5 * 4 * 2
    found = {run.parameters: result for run, result in zip(figure_tests.runs(), results, strict=True)}
    for row in table.rows:
        cell = dict(zip(table.columns, row, strict=True))
        semi, other = (
            found[
                ReconnectionParameters(environment=cell["environment"], robots=cell["robots"], method=method)
            ]
            for method in ("semi-markov", cell["versus"])
        )
        tests = statistics.compared(semi["times"], other["times"])
        assert cell["welch_p"] == tests.welch
        assert cell["mann_whitney_p"] == tests.mann_whitney
        assert cell["wins"] == tests.wins
        assert cell["semi_markov_mean"] == semi["steps"]["mean"]
        assert cell["versus_mean"] == other["steps"]["mean"]
        assert cell["versus_censored"] == other["censored"]
        assert cell["reaches_99"] == ("yes" if tests.welch < 0.01 and tests.ratio < 1 else "no")
    assert {"yes", "no"} == set(table.column("reaches_99"))


def test_being_significantly_slower_does_not_reach_anything() -> None:
    results = []
    for run in figure_tests.runs():
        slow = run.parameters.method == "semi-markov"
        result = invented(run.parameters)
        times = [(1000 if slow else 10) + i for i in range(SAMPLES)]
        results.append(result | {"times": times, "steps": {"mean": float(np.mean(times)), "median": 0.0}})
    table = figure_tests.FIGURE.tabulate(results)
    assert max(table.column("welch_p")) < 0.01
    assert set(table.column("reaches_99")) == {"no"}


# --- beliefs -------------------------------------------------------------------------------------

TRACED = ReconnectionParameters(robots=3, vertices=40, random_steps=20)


def traced(seed: int) -> figure_beliefs.Traced:
    result = run_study(figure_beliefs.TRACE, TRACED, samples=1, seed=seed, jobs=1)
    found: figure_beliefs.Traced = result["traced"]
    return found


def test_a_trace_is_of_the_run_that_the_study_makes() -> None:
    seed = int(generator("reconnection", 1, 0).integers(2**31))
    assert run_study(STUDY, TRACED, samples=1, jobs=1)["seeds"] == [seed]
    places: dict[int, list[int]] = {}
    result = search_of(TRACED, seed).run(
        20, TRACED.limit, lambda step, it: places.update({step: [each.motion.place for each in it.members]})
    )
    trace = traced(1)
    graph = graph_of(TRACED, seed)
    assert trace.vertices == list(graph.vertices)
    assert trace.seen[0].steps == 0
    assert trace.seen[-1].steps == result.steps - 1
    heard = hearing(graph)
    for seen in trace.seen:
        assert seen.places == places[seen.steps + 20]
        assert set(seen.beliefs) == set(range(3)) - set(seen.connected)
        for belief in seen.beliefs.values():
            assert sum(belief) == pytest.approx(1)
            assert not np.asarray(belief)[heard[seen.places[0]]].any()  # nobody is heard there


def test_instants_are_about_the_first_meeting() -> None:
    assert figure_beliefs.instants(50, 100, [90, 120]) == [50, 70, 89, 90, 120, 149]
    assert figure_beliefs.instants(50, 100, []) == [50, 75, 99, 100, 125, 149]
    assert figure_beliefs.instants(50, 0, [50]) == [50]


def test_circles_are_the_beliefs_of_the_table() -> None:
    table = figure_beliefs.tabulate([{"traced": traced(1)}])
    canvas = drawn(figure_beliefs.FIGURE, table)
    instants = list(dict.fromkeys(table.where(kind="robot").column("instant")))
    for axes, instant in zip(canvas.axes, instants, strict=False):
        found = table.where(kind="belief", instant=instant).numbers("belief")
        sizes = np.concatenate([each.get_sizes() for each in axes.collections[1:]])
        assert np.sort(sizes[sizes != 30]) == pytest.approx(np.sort(900 * found))


def test_a_command_draws_one_run_however_many_samples_are_wanted() -> None:
    (run,) = figure_beliefs.FIGURE.runs()
    work = Work(samples=50, jobs=1)
    small = replace(run, parameters=TRACED)
    assert work.result(small, lambda part: None)["traced"].seen == traced(1).seen


# --- sensitivity ---------------------------------------------------------------------------------


def test_points_of_a_line_are_those_of_its_runs() -> None:
    for name in ("memory", "horizon", "loss", "parity"):
        figure = PAPER.figures[name]
        results = invented_for(figure)
        table = figure.tabulate(results)
        assert table.column("mean") == [result["steps"]["mean"] for result in results]
        assert table.column("censored") == [result["censored"] for result in results]
    points = figure_sensitivity.memory_points()
    assert {point.parameters.memory for point in points} == {1, 2, 5, 10, 20, 50}
    assert all(point.x == point.parameters.memory for point in points)
    assert all(point.parameters.miss in (0, point.x) for point in figure_sensitivity.loss_points())


def test_parity_is_that_of_every_environment() -> None:
    for point in figure_sensitivity.parity_points():
        for seed in (1, 2, 3):
            graph = graph_of(point.parameters, seed)
            assert graph.starts is not None
            start, end = graph.starts
            assert hops(graph, start)[end] % 2 == point.x
            assert {length for _, _, length in graph.edges} == {1.0}
    assert {point.x for point in figure_sensitivity.parity_points()} == {0, 1}


def test_shares_of_searches_that_do_not_end() -> None:
    results = []
    for run in figure_livelock.runs():
        limit = run.parameters.limit
        times = [3, 5, 5, limit] if run.parameters.deterministic else [3, 5, 5, 7]
        results.append({"times": times, "censored": times.count(limit), "stuck": 0, "samples": 4})
    table = figure_livelock.tabulate(results)
    for case, parameters in figure_livelock.CASES.items():
        (share,) = table.where(kind="share", case=case).column("share")
        left = table.where(kind="left", case=case)
        assert share == (0.25 if parameters.deterministic else 0)
        last = [(5, 0.25)] if parameters.deterministic else [(5, 0.25), (7, 0.0)]
        assert list(zip(left.column("steps"), left.column("share"), strict=True)) == [
            (0, 1.0), (3, 0.75), *last, (parameters.limit, share)
        ]  # fmt: skip


def test_all_kinds_have_a_figure() -> None:
    assert [name for name in PAPER.figures if str(name).startswith("times-")] == [
        f"times-{kind}" for kind in figure_tests.KINDS
    ]
    assert figure_times.ROBOTS == (2, 3, 4, 5)
