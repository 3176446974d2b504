"""The score of moving robots: deep and all observers apart, and where they were."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms

from logs.reader import LogReader
from scenarios.association.score_mobile import score, score_history
from scenarios.places import positions
from tests.support import run_scenario, write_scenario
from tests.unit.test_association_score import TRUTH, entry

HISTORY = [
    entry("a", 1, {1: "bc"}, sent=True),
    entry("b", 1, {5: "a"}),
    entry("a", 2, {1: "bc", 2: "c"}, sent=True),
    entry("b", 2, {5: "c"}, sent=True),
    entry("a", 3, {}),
    entry("b", 3, {5: "ac"}),
]


def test_by_hand() -> None:
    deep = [False, False, True, False, True, True]
    result = score_history(HISTORY, deep, TRUTH, {"a": 2, "b": 1, "stands": 3}, steady_from_step=2)
    nothing = {"mean": None, "sd": None, "se": None}
    assert result == {
        "observers": 2,
        "from_step": 2,
        "all": {
            "observers": 2,
            "fraction_matched": {"mean": 0.5, "sd": 0.5, "se": 0.0},  # 1/2 of a; 1 and 0 of b
            "fraction_right": {"mean": pytest.approx(1 / 6), "sd": pytest.approx(0.28868, abs=1e-5), "se": 0.25},
            "ratio": {"mean": 1.75, "sd": pytest.approx(0.35355, abs=1e-5), "se": pytest.approx(0.25)},
            "ratio_of_sums": 6 / 3,
            "visual_ids_in_list": 1.0,
        },
        "deep": {
            "observers": 2,
            "fraction_matched": {"mean": 0.25, "sd": pytest.approx(0.35355, abs=1e-5), "se": pytest.approx(0.25)},
            "fraction_right": {"mean": 0.25, "sd": pytest.approx(0.35355, abs=1e-5), "se": pytest.approx(0.25)},
            "ratio": {"mean": 1.75, "sd": pytest.approx(0.35355, abs=1e-5), "se": pytest.approx(0.25)},
            "ratio_of_sums": 5 / 3,
            "visual_ids_in_list": 1.0,
        },
        "per_step": {
            "fraction_matched": [None, 0.5, 0.75, 0.0],
            "fraction_right": [None, 0.5, 0.25, 0.0],
            "ratio": [None, 1.5, 1.5, 2.0],
            "ratio_of_sums": [None, 1.5, 2.0, 2.0],
            "visual_ids_in_list": [None, 1.0, 1.5, 0.5],
        },
        "false_matches": 1,
        "messages_sent": 6,
        "messages_per_robot": 2.0,
        "flashes_sent": 3,
        "flashes_per_robot": 1.5,
    }  # fmt: skip
    assert score_history(HISTORY, [False] * 6, TRUTH, {})["deep"]["fraction_matched"] == nothing


START: dict[str, Any] = {
    "kind": "start",
    "area_m": [10.0, 20.0],
    "robots": [
        {"robot": "a", "position_m": [1.0, 2.0], "heading_rad": 0.0, "velocity_mps": [2.0, 0.0]},
        {"robot": "b", "position_m": [5.0, 5.0], "heading_rad": 0.0, "velocity_mps": [0.0, 0.0]},
    ],
}


def test_positions_of_robots_that_bounce() -> None:
    places = positions([(0, START)], {"kind": "bounce", "speed_mps": 2.0}, [0, 10**9, 5 * 10**9])
    assert [place.tolist() for place in places] == [
        [[1, 2], [5, 5]], [[3, 2], [5, 5]], [[9, 2], [5, 5]],
    ]  # fmt: skip


def test_positions_of_robots_that_are_commanded() -> None:
    still = {**START, "robots": [{**robot, "velocity_mps": [0.0, 0.0]} for robot in START["robots"]]}
    command = {
        "kind": "motion",
        "robot": "b",
        "velocity_mps": [0.0, 1.0],
        "towards_m": None,
        "speed_mps": 0.0,
    }
    drive_on = {**command, "velocity_mps": [0.0, 0.0], "towards_m": [5.0, 8.0], "speed_mps": 0.5}
    truth = [(0, still), (10**9, command), (3 * 10**9, drive_on)]
    places = positions(
        truth, {"kind": "commanded", "max_speed_mps": 3.0}, [0, 2 * 10**9, 4 * 10**9, 9 * 10**9]
    )
    assert [place.tolist()[1] for place in places] == [[5, 5], [5, 6], [5, 7.5], [5, 8]]


MOBILE = """
behaviour = "agent.behaviours.association.stationary:beacon"
score = "scenarios.association.score_mobile:score"
robots = 30
[run]
duration_s = 8.0
[world]
area_m = [36.0, 36.0]
placement = "jittered_grid"
motion = { kind = "bounce", speed_mps = 0.0 }
[[group]]
name = "mobile"
robots = 5
behaviour = "agent.behaviours.association.mobile:associate"
placement = "uniform"
speed_mps = 2.8
[radio]
range_m = 4.0
[lamp]
latency_s = 0.00001
[camera]
range_m = 4.0
phase_s = 0.00002
[record]
scene_rate_hz = 2.0
[params]
step_s = 0.5
transmission_probability = 0.5
roll_call = false
steady_from_step = 3
"""


@pytest.fixture(scope="module")
def mobile_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("mobile")
    return run_scenario(write_scenario(folder, "", MOBILE), folder / "log.mcap", "in_process").log


def drawn_poses(log: LogReader) -> dict[tuple[int, str], tuple[float, float]]:
    """(time [ns], robot) -> x, y [m], as viewers are shown them."""
    poses = {}
    for _, _, time_ns, data in log.raw({"/tf"}):
        for transform in FrameTransforms.FromString(data).transforms:
            poses[time_ns, transform.child_frame_id] = (transform.translation.x, transform.translation.y)
    return poses


def test_positions_are_those_that_viewers_see(mobile_log: Path) -> None:
    with LogReader(mobile_log) as log:
        drawn = drawn_poses(log)
        truth = list(log.records("/truth"))
    times_ns = sorted({time_ns for time_ns, _ in drawn})
    names = [robot["robot"] for robot in truth[0][1]["robots"]]
    assert len(times_ns) > 15
    places = positions(truth, {"kind": "bounce", "speed_mps": 0.0}, times_ns)
    for time_ns, place in zip(times_ns, places, strict=True):
        assert place.tolist() == [pytest.approx(drawn[time_ns, name], abs=1e-5) for name in names]


def test_deep_observers_of_a_log(mobile_log: Path) -> None:
    """Deeper than 12 m from the walls of 36 m x 36 m leaves a square of 12 m x 12 m in the middle."""
    with LogReader(mobile_log) as log:
        result = score(log)
        drawn = drawn_poses(log)
        entries = [(time_ns, record["robot"]) for time_ns, record in log.records("/robot")]
    inside = {
        robot for time_ns, robot in entries
        if time_ns >= 3 * 5 * 10**8 and all(12 < x < 24 for x in drawn[time_ns - 5 * 10**8, robot])
    }  # fmt: skip
    assert result["observers"] == 5
    assert result["deep"]["observers"] == len(inside) > 0
    assert result["all"]["observers"] == 5
    assert result["from_step"] == 3
    assert len(result["per_step"]["ratio"]) == 17


def test_flashes_and_messages_are_those_of_whom_they_should_be(mobile_log: Path) -> None:
    with LogReader(mobile_log) as log:
        result = score(log)
        own = [record["data"] for _, record in log.records("/robot")]
        sent = [record["from"] for _, record in log.records("/radio")]
    assert result["flashes_sent"] == sum(entry["sent"] for entry in own)
    assert result["messages_sent"] == len(sent)
    assert result["messages_per_robot"] == len(sent) / 30
