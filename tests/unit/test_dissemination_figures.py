"""The tables behind the figures of Julian et al. 2009: fed with results made by hand, compared value by value."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from agent.behaviours.dissemination.selection import NEW_ESTIMATES
from scenarios.dissemination import figure_stamps, stamps
from scenarios.dissemination.emulated import PROPAGATION as EMULATED
from scenarios.dissemination.figure_propagation import PARTS, RUNS, SLOTS
from scenarios.dissemination.paper_2009 import PAPER
from scenarios.dissemination.stamps import STAMPS, StampsParameters
from scenarios.dissemination.study_age import STUDY as AGE
from scenarios.dissemination.study_age import AgeParameters
from scenarios.dissemination.study_propagation import STUDY as PROPAGATION
from scenarios.dissemination.study_propagation import PropagationParameters
from scenarios.figures import Table, drawn

Numbers = Iterator[float]


def numbers() -> Numbers:
    """All different, and easy to recognise."""
    return (100.0 + number / 8 for number in itertools.count())


def shown(table: Table, *columns: str) -> list[tuple[Any, ...]]:
    """These columns of all rows."""
    return list(zip(*(table.column(name) for name in columns), strict=True))


def test_the_paper_has_its_figures() -> None:
    assert PAPER.name == "julian-2009"
    assert sorted(PAPER.figures) == [2, 3, 5]


def test_all_runs_can_be_done() -> None:
    for figure in PAPER.figures.values():
        for run in figure.runs():
            run.study.check(run.parameters)
            assert isinstance(run.parameters, run.study.parameters)
            assert run.samples >= 2


# --- figure 2 ----------------------------------------------------------------------------------------


def propagation(fresh: Numbers, incomplete: bool = False) -> dict[str, Any]:
    def of_part() -> dict[str, float | int | None]:
        if incomplete:
            return {"mean": None, "sd": None, "se": None, "incomplete": 7}
        return {key: next(fresh) for key in ("mean", "sd", "se")} | {"incomplete": 0}

    return {"units": {part: of_part() for part in PARTS}, "frames": {}, "slots_per_frame": 100, "samples": 7}


def propagation_table() -> tuple[list[dict[str, Any]], Table]:
    fresh = numbers()
    figure = PAPER.figures[2]
    results = [
        propagation(fresh, incomplete=getattr(run.parameters, "m", None) == 1) for run in figure.runs()
    ]
    return results, figure.tabulate(results)


def test_propagation_is_run_for_every_reading_of_new_estimates_and_flooding() -> None:
    flooding, *runs, emulated = PAPER.figures[2].runs()
    assert flooding.parameters == PropagationParameters(scheme="flooding", m=100)
    assert flooding.study is PROPAGATION
    expected = [(new, m, RUNS[new]) for new in NEW_ESTIMATES for m in SLOTS]
    assert [(run.parameters.new_estimates, run.parameters.m, run.samples) for run in runs] == expected  # type: ignore[attr-defined]
    point = PropagationParameters(m=7)
    assert (emulated.study, emulated.parameters, emulated.at_most) == (EMULATED, point, True)
    assert 7 in SLOTS


def test_propagation_table() -> None:
    (flooding, *points, emulated), table = propagation_table()
    columns = ("units", "se", "sd", "incomplete", "samples")
    levels = table.where(kind="flooding")
    assert levels.column("subgraph") == list(PARTS)
    for part in PARTS:
        found = flooding["units"][part]
        row = (found["mean"], found["se"], found["sd"], 0, 7)
        assert shown(levels.where(subgraph=part), *columns) == [row]
    keys = [(new, m) for new in NEW_ESTIMATES for m in SLOTS]
    for (new, m), result in zip(keys, points, strict=True):
        part = table.where(kind="simulated", new_estimates=new, m=m, subgraph="6x6")
        found = result["units"]["6x6"]
        row = (found["mean"], found["se"], found["sd"], found["incomplete"], 7)
        assert shown(part, *columns) == [row]
    assert len(table.rows) == len(PARTS) * (2 + len(NEW_ESTIMATES) * len(SLOTS))
    assert shown(table.where(kind="emulated"), "new_estimates", "m", "subgraph", "units") == [
        ("first", 7, part, emulated["units"][part]["mean"]) for part in PARTS
    ]
    assert table.where(kind="simulated", m=1, new_estimates="first").column("units") == [None] * 4


def test_propagation_picture() -> None:
    _, table = propagation_table()
    panels = drawn(PAPER.figures[2], table).axes
    assert len(panels) == 3
    for axes, new in zip(panels, NEW_ESTIMATES, strict=True):
        lines = {tuple(line.get_ydata()) for line in axes.lines if len(line.get_ydata()) == len(SLOTS)}
        for part in PARTS:
            expected = table.where(kind="simulated", new_estimates=new, subgraph=part).numbers("units")
            assert any(np.array_equal(expected, line, equal_nan=True) for line in lines)
        points = {
            line.get_ydata()[0] for line in axes.lines if line.get_marker() == "*" and len(line.get_ydata())
        }
        assert points == set(table.where(kind="emulated", new_estimates=new).column("units"))
        levels = {line.get_ydata()[0] for line in axes.lines if line.get_linestyle() == "--"}
        assert levels == set(table.where(kind="flooding").column("units"))


# --- figure 5 ----------------------------------------------------------------------------------------


def received_by_beta(fresh: Numbers) -> dict[str, Any]:
    robots = [
        {
            "robot": f"r{number:02d}",
            "distance_m": next(fresh),
            "moves": number % 2 == 0,
            "updates_per_minute": 60.0 - number,
            "received_s": [10.0 + number, 60.0 + number],
            "stamp_s": [5.0 + number, 55.0 + number],
        }
        for number in range(1, 9)
    ]
    return {"receiver": "r00", "duration_s": 100.0, "robots": robots}


def moments(fresh: Numbers) -> dict[str, Any]:
    return {"mean": next(fresh), "se": next(fresh), "placements": 20}


def ages(fresh: Numbers) -> dict[str, Any]:
    def part() -> dict[str, Any]:
        return {
            "age_s": {"mean": moments(fresh), "p95": moments(fresh)}, "updates_per_minute": moments(fresh),
        }  # fmt: skip

    ranks = {"distance_and_updates": moments(fresh), "distance_and_age": moments(fresh)}
    return {
        "spearman": {"all_pairs": ranks, "remotest": {key: moments(fresh) for key in ranks}},
        "by_distance": [{"from_m": 15.0 * k, "to_m": 15.0 * (k + 1), **part()} for k in range(3)],
        "samples": 20,
    }


def stamps_table() -> tuple[list[dict[str, Any]], Table]:
    fresh = numbers()
    emulated = stamps.summarise(StampsParameters(), [[received_by_beta(fresh)], [received_by_beta(fresh)]])
    results = [emulated, *(ages(fresh) for _ in figure_stamps.COMPARED)]
    return results, PAPER.figures[5].tabulate(results)


def test_stamps_are_emulated_and_ages_simulated() -> None:
    emulated, *simulated = PAPER.figures[5].runs()
    assert (emulated.study, emulated.parameters, emulated.at_most) == (STAMPS, StampsParameters(), True)
    assert [run.study for run in simulated] == [AGE] * 3
    assert [run.samples for run in simulated] == [150] * 3
    assert AgeParameters() in [run.parameters for run in simulated]


def test_stamps_table() -> None:
    (emulated, *simulated), table = stamps_table()
    for robot in emulated["first"]["robots"]:
        rows = table.where(kind="stamp", robot=robot["robot"])
        assert rows.column("received_s") == robot["received_s"]
        assert rows.column("stamp_s") == robot["stamp_s"]
        assert set(shown(rows, "distance_m", "moves")) == {(robot["distance_m"], int(robot["moves"]))}
    # Distances ascend with the number and updates fall, in both runs.
    receiver = table.where(kind="receiver")
    assert shown(receiver, "robot", "spearman", "spearman_se", "samples") == [
        ("r00", pytest.approx(-1), pytest.approx(0), 2)
    ]
    for compared, result in zip(figure_stamps.COMPARED, simulated, strict=True):
        said = {"scheme": compared.parameters.scheme, "alpha": compared.parameters.alpha}
        expected = [
            (part["from_m"], part["to_m"], part["age_s"]["mean"]["mean"], part["age_s"]["mean"]["se"],
             part["updates_per_minute"]["mean"], part["updates_per_minute"]["se"], 20)
            for part in result["by_distance"]
        ]  # fmt: skip
        columns = ("from_m", "to_m", "age_s", "age_se", "updates_per_minute", "updates_se", "samples")
        assert shown(table.where(kind="age", **said), *columns) == expected
        rank = result["spearman"]["remotest"]["distance_and_updates"]
        assert shown(table.where(kind="ranks", **said), "spearman", "spearman_se") == [
            (rank["mean"], rank["se"])
        ]


def test_stamps_picture() -> None:
    _, table = stamps_table()
    staircases, older, renewed = drawn(PAPER.figures[5], table).axes
    drawn_steps = {
        (tuple(line.get_xdata()), tuple(line.get_ydata()))
        for line in staircases.lines
        if len(line.get_xdata()) == 3
    }
    for number in range(1, 9):
        steps = ((10.0 + number, 60.0 + number, 100.0), (5.0 + number, 55.0 + number, 55.0 + number))
        assert steps in drawn_steps
    # What is held as the picture begins, at 50 s, is in it: the oldest of these is of 6 s.
    assert staircases.get_ylim() == (6.0, 100.0)
    for axes, key in ((older, "age_s"), (renewed, "updates_per_minute")):
        lines = [tuple(line.get_ydata()) for line in axes.lines if len(line.get_ydata()) == 3]
        for compared in figure_stamps.COMPARED:
            said = {"scheme": compared.parameters.scheme, "alpha": compared.parameters.alpha}
            assert tuple(table.where(kind="age", **said).column(key)) in lines


def test_the_overrides_are_what_the_parameters_say() -> None:
    parameters = StampsParameters(m=9, scheme="flooding", alpha=0.5, duration=20.0)
    assert stamps.overrides(parameters) == [
        "run.duration_s=20.0", "radio.tdma.units=9", "params.scheme=flooding", "params.alpha=0.5",
    ]  # fmt: skip
    with pytest.raises(
        ValueError, match=r"^m: flooding sends everything, so a slot must take 9 estimates; set m to 9$"
    ):
        stamps.check(StampsParameters(scheme="flooding"))
