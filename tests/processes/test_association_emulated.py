"""Robot processes on the emulator against the vectorised simulation; and figures, drawn from small runs."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import msgspec
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from scenarios.association import figures_models
from scenarios.association.emulated import EMULATED, METRICS
from scenarios.association.figures_mobile import MIX, RANGE, SEPARATION, SPEED
from scenarios.association.paper_2014 import PAPER as PAPER_2014
from scenarios.association.paper_2016 import PAPER as PAPER_2016
from scenarios.association.study_mobile import SERIES, STUDY, MobileParameters
from scenarios.figures import Figure, Paper, Run, drawn
from scenarios.study import run_study

pytestmark = pytest.mark.processes

SMALL = MobileParameters(world=32.0, range=8.0, mobile_fraction=0.25, steps=60)


@pytest.mark.parametrize("wireless_range", [None, 10.0])
def test_both_agree_on_the_steady_state(wireless_range: float | None) -> None:
    parameters = msgspec.structs.replace(SMALL, wireless_range=wireless_range)
    emulated = run_study(EMULATED, parameters, samples=6)
    simulated = run_study(STUDY, parameters, samples=200, jobs=1)["all"]
    assert emulated["observers"] == 6 * 16
    for metric in METRICS:
        error = math.hypot(emulated[metric]["se"], simulated[metric]["se"])
        assert error < 0.05 * simulated[metric]["mean"]  # or agreement would mean little
        assert abs(emulated[metric]["mean"] - simulated[metric]["mean"]) < 4 * error


def test_what_the_emulator_cannot_take_is_refused() -> None:
    with pytest.raises(ValueError, match="world: 1024 robots are more than the 1000 the emulator takes"):
        run_study(EMULATED, MobileParameters(world=128.0), samples=1)


@pytest.mark.parametrize("sweep", [MIX, RANGE, SEPARATION, SPEED], ids=lambda sweep: str(sweep.key))
def test_every_emulated_point_is_one_of_the_figure(sweep: Any) -> None:
    assert sweep.emulated in sweep.values
    EMULATED.check(sweep.small())


def shrunk(run: Run) -> dict[str, Any]:
    """The result of a run, of a size for tests."""
    if run.study not in (EMULATED, SERIES):
        return run_study(run.study, run.parameters, samples=200, jobs=1)
    parameters = msgspec.structs.replace(
        run.parameters, world=4.0 * run.parameters.separation, mobile_fraction=0.5, steps=2
    )
    return run_study(run.study, parameters, samples=2, jobs=1)


def figures(paper: Paper) -> list[Any]:
    return [pytest.param(figure, id=f"{paper.name}-{number}") for number, figure in paper.figures.items()]


@pytest.mark.parametrize("figure", figures(PAPER_2014) + figures(PAPER_2016))
def test_every_figure_can_be_drawn(figure: Figure, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figures_models, "MODEL_POINTS", 2)
    table = figure.tabulate([shrunk(run) for run in figure.runs()])
    assert table.rows
    assert {len(row) for row in table.rows} == {len(table.columns)}
    assert not figure.runs() or "se" in table.columns
    canvas = drawn(figure, table)
    assert isinstance(canvas.canvas, FigureCanvasAgg)
    canvas.savefig(tmp_path / "figure.png")
    pixels = canvas.canvas.buffer_rgba()
    assert len(set(bytes(pixels)[::97])) > 20  # not blank
