"""Fig. 3 of Julian et al.: every number drawn stands in its table."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from matplotlib.patches import Polygon

from scenarios.coverage.simulation import CoverageParameters
from scenarios.coverage.study_coverage import STUDY
from scenarios.dissemination import figure_coverage
from scenarios.dissemination.figure_coverage import COMPARED, FIGURE, tabulate
from scenarios.figures import Run, Table, Work, drawn


@pytest.fixture(scope="module", autouse=True)
def simulated_only() -> Iterator[None]:
    """Runs of the emulator take their time; what is made of them does not depend on where they come from."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figure_coverage, "EMULATED", ())
        yield


@pytest.fixture(scope="module")
def results(simulated_only: None) -> list[dict[str, Any]]:
    work = Work(samples=2, jobs=1)
    return [work.result(run, lambda _: None) for run in FIGURE.runs()]


@pytest.fixture(scope="module")
def table(results: list[dict[str, Any]]) -> Table:
    return tabulate(results)


def area(corners: np.ndarray) -> float:
    x, y = corners.T
    return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2)


def test_it_takes_the_papers_three_frame_rates() -> None:
    chosen = [(run.parameters.m, run.parameters.scheme, run.samples) for run in FIGURE.runs()]
    assert chosen == [(1, "own", 60), (3, "location", 60), (9, "flooding", 60)]
    assert all(run.study is STUDY for run in FIGURE.runs())


def test_curves_are_the_studys(table: Table, results: list[dict[str, Any]]) -> None:
    for compared, result in zip(COMPARED, results, strict=True):
        curve = table.where(kind="curve", m=compared.m, scheme=compared.scheme)
        assert curve.column("cost_over_optimum") == result["cost_over_optimum"]["per_time"]["mean"]
        assert curve.column("time_s") == result["cost_over_optimum"]["times_s"]
        assert curve.column("cost_over_optimum")[-1] == pytest.approx(
            result["cost_over_optimum"]["final"]["mean"]
        )


@pytest.mark.parametrize("m", [1, 3])
def test_cells_share_out_the_square_around_their_robots(table: Table, m: int) -> None:
    places = table.where(kind="place", m=m)
    assert places.column("robot") == list(range(9))
    total = 0.0
    for robot, x, y in zip(*(places.column(name) for name in ("robot", "x_m", "y_m")), strict=True):
        cell = table.where(kind="corner", m=m, robot=robot)
        corners = np.column_stack([cell.numbers("x_m"), cell.numbers("y_m")]) - (x, y)
        assert area(corners) > 0
        assert (corners[:, 0] * np.roll(corners[:, 1], -1) > np.roll(corners[:, 0], -1) * corners[:, 1]).all()
        total += area(corners)
    assert total == pytest.approx(8100, rel=1e-9)


def test_the_picture_draws_the_tables_cells_and_curves(table: Table) -> None:
    canvas = drawn(FIGURE, table)
    first, later, *cells = canvas.axes
    assert [text.get_text() for text in first.get_legend().get_texts()] == [
        "m = 1: no hop", "m = 3: location-based", "m = 9: flooding", "optimum: 3x3 grid",
    ]  # fmt: skip
    for axes in (first, later):
        assert len(axes.lines) == 4
    for axes, m in zip(cells, (1, 3), strict=True):
        outlines = [patch for patch in axes.patches if isinstance(patch, Polygon)]
        drawn_corners = sorted(tuple(corner) for outline in outlines for corner in outline.get_xy()[:-1])
        listed = table.where(kind="corner", m=m)
        assert drawn_corners == sorted(zip(listed.column("x_m"), listed.column("y_m"), strict=True))


def test_emulated_runs_have_their_place(
    results: list[dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Run(STUDY, CoverageParameters(), 2, at_most=True)
    monkeypatch.setattr(figure_coverage, "EMULATED", ((COMPARED[1], run),))
    assert FIGURE.runs()[3:] == [run]
    table = tabulate([*results, results[1]])
    emulated = table.where(kind="emulated", m=3, scheme="location")
    assert emulated.column("time_s") == [20.0 * k for k in range(13)]
    assert (
        emulated.column("cost_over_optimum")
        == table.where(kind="curve", m=3).column("cost_over_optimum")[::20]
    )
    canvas = drawn(FIGURE, table)
    labels = [text.get_text() for text in canvas.axes[0].get_legend().get_texts()]
    assert "m = 3: location-based, emulated" in labels
