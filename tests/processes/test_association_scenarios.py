"""The shipped association scenarios, as users run them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import orjson
import pytest

from tests.support import heliograph

pytestmark = pytest.mark.processes


def run(folder: Path, *arguments: object) -> dict[str, Any]:
    done = heliograph("run", *arguments, "--out", folder / "log.mcap", "--json")
    assert done.returncode == 0, done.stderr
    score: dict[str, Any] = orjson.loads(done.stdout)["score"]
    return score


@pytest.mark.parametrize(
    ("scenario", "steps"), [("association", None), ("association-naive", 32), ("association-logarithmic", 5)]
)
def test_stationary_robots(scenario: str, steps: int | None, tmp_path: Path) -> None:
    score = run(tmp_path, scenario)
    assert score["robots"] == score["steps_to_completion"]["completed"] == 20
    assert score["fraction_right"][-1] == 1.0
    assert score["ratio"][-1] == 1.0
    assert score["false_matches"] == 0
    if steps is not None:
        assert set(score["steps_to_completion"]["per_robot"].values()) == {steps}
        assert score["messages_sent"] == 20


def test_coloured_lights(tmp_path: Path) -> None:
    score = run(tmp_path, "association", "--set", "lamp.colours=3", "--set", "params.colours=3")
    assert score["fraction_right"][-1] == 1.0


def test_a_camera_that_reaches_farther_than_the_radio(tmp_path: Path) -> None:
    score = run(
        tmp_path, "association", "--set", "radio.range_m=10.0", "--set", "params.channel_inclusion=false",
    )  # fmt: skip
    assert score["steps_to_completion"]["completed"] == 20
    assert score["fraction_right"][-1] < 1.0
    assert score["false_matches_at_completion"] == 0


def test_more_robots_than_numbers_is_told_in_a_sentence(tmp_path: Path) -> None:
    done = heliograph("run", "association-naive", "--robots", 33, "--out", tmp_path / "log.mcap")
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert (
        "params.number: r32 has number 32, but params.ids = 32 allows 0 to 31; raise ids, or" in done.stderr
    )


def test_moving_robots(tmp_path: Path) -> None:
    """Five ranges across: what is deeper than three ranges from all walls is nobody's place."""
    score = run(tmp_path, "association-mobile", "--robots", 100, "--set", "world.area_m=[40.0, 40.0]", "--set",
                "radio.range_m=8.0", "--set", "camera.range_m=8.0", "--set", "params.steady_from_step=32",
                "--duration", 40)  # fmt: skip
    assert score["observers"] == score["all"]["observers"] == 5
    assert score["deep"]["observers"] == 0
    assert score["from_step"] == 32
    steady = score["all"]
    # 12.6 robots in range in the middle. Wide bounds: five robots, and walls all around.
    assert 0.6 < steady["fraction_right"]["mean"] <= steady["fraction_matched"]["mean"] < 0.95
    assert 1.05 < steady["ratio"]["mean"] < 1.6
    assert 6 < steady["visual_ids_in_list"] < 12.6
    assert len(score["per_step"]["fraction_matched"]) == 81
