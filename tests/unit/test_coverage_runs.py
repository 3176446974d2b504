"""Robots that cover a square, on the emulator: what they are told to do, by what they know at that instant."""

from __future__ import annotations

import math
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agent.behaviours.coverage.controller import centroid
from agent.behaviours.coverage.density import Density, Hill
from emulator.run import Options, run
from emulator.scenario_file import load
from logs.reader import LogReader
from scenarios.dissemination.knowledge import History, knowledge, read
from scenarios.dissemination.score import places

SHIPPED = (files("scenarios.coverage") / "coverage.toml").read_text()
S = 1_000_000_000
Entry = tuple[int, str, dict[str, Any]]


def covered(
    folder: Path, *overrides: str, text: str = SHIPPED, robots: int | None = None
) -> tuple[History, list[Entry]]:
    """A run, and its entries `coverage`: log time, robot, data."""
    folder.mkdir(exist_ok=True)
    (folder / "x.toml").write_text(text)
    scenario = load(str(folder / "x.toml"), robots=robots, overrides=list(overrides))
    run(scenario, Options(out=folder / "run.mcap", fleet="in_process", echo=None))
    with LogReader(folder / "run.mcap") as log:
        said = [
            (now_ns, record["robot"], record["data"])
            for now_ns, record in log.records("/robot")
            if record["entry"] == "coverage"
        ]
        return read(log), said


def commands(history: History) -> list[tuple[int, str, list[float]]]:
    return [
        (now_ns, record["robot"], record["velocity_mps"])
        for now_ns, record in history.truth
        if record["kind"] == "motion"
    ]


def test_params_that_are_left_out_are_those_of_the_shipped_scenario(tmp_path: Path) -> None:
    """A robot alone: at first it is as fast as it may be, and in the end gain says how fast."""
    left_out = ("gain", "max_speed_mps", "control_s", "density")
    lines = [
        line for line in SHIPPED.splitlines() if not line.startswith(tuple(f"{key} =" for key in left_out))
    ]
    assert len(SHIPPED.splitlines()) - len(lines) == len(left_out)
    told, _ = covered(tmp_path / "told", "run.duration_s=20.0", robots=1)
    assumed, _ = covered(tmp_path / "assumed", "run.duration_s=20.0", text="\n".join(lines), robots=1)
    speeds = [math.hypot(*velocity) for _, _, velocity in commands(told)]
    assert max(speeds) == pytest.approx(4.0)
    assert min(speeds) < 2.0
    assert commands(assumed) == commands(told)


def test_a_robot_reckons_with_all_that_has_arrived_when_it_decides(tmp_path: Path) -> None:
    history, said = covered(tmp_path, "run.duration_s=4.0")
    found = knowledge(history.transmissions, 9)
    for now_ns, robot, data in said:
        heard = (found.receiver == history.robots.index(robot)) & (found.received_ns <= now_ns)
        assert data["known"] == len(set(found.origin[heard].tolist()))
    assert {data["known"] for _, _, data in said} >= {0, 1, 2, 8}


def test_the_density_says_where_a_robot_goes_that_knows_nobody(tmp_path: Path) -> None:
    hill = "{ floor = 1.0, hills = [{ x_m = 20.0, y_m = 70.0, sigma_m = 10.0, weight = 50.0 }] }"
    text = SHIPPED.replace('density = "uniform"', f"density = {hill}")
    history, said = covered(tmp_path, "run.duration_s=40.0", text=text, robots=1)
    goal = centroid((45.0, 45.0), [], (90.0, 90.0), Density(1.0, (Hill(20.0, 70.0, 10.0, 50.0),)))
    assert goal[0] < 30
    assert goal[1] > 60
    assert len(said) == 201
    assert all(data["goal_m"] == pytest.approx(goal, abs=1e-6) for _, _, data in said)
    assert places(history, [40.0])[0, 0, :2] == pytest.approx(goal, abs=0.01)


def test_who_leaves_stops_where_it_is(tmp_path: Path) -> None:
    text = SHIPPED + '\n[[robot]]\nid = "r04"\nparams = { leaves_s = 1.0 }\n'
    history, _ = covered(tmp_path, "run.duration_s=3.0", text=text)
    assert history.ended_ns[4] == 1 * S
    before, then, end = places(history, [0.9, 1.0, 3.0])[:, 4, :2]
    assert np.hypot(*(then - before)) > 0.1  # on its way until then
    assert end == pytest.approx(then, abs=1e-9)
