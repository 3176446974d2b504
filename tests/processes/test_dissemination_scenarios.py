"""The shipped scenarios of dissemination and coverage, as users run them, and what goes wrong on a radio."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import orjson
import pytest

from emulator.run import Options, run
from emulator.scenario_file import load
from logs.compare import first_difference
from scenarios.dissemination.emulated import AGE, PROPAGATION
from scenarios.dissemination.study_propagation import STUDY, PropagationParameters
from scenarios.study import run_study
from tests.support import heliograph

pytestmark = pytest.mark.processes

SMALL_GRID = ["--robots", 16, "--set", "world.area_m=[120, 120]", "--set", "params.subgraphs=2x2,4x4"]


def result(folder: Path, *arguments: object) -> dict[str, Any]:
    done = heliograph("run", *arguments, "--out", folder / "log.mcap", "--json")
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = orjson.loads(done.stdout)
    return found


def test_news_crosses_a_grid(tmp_path: Path) -> None:
    found = result(tmp_path, "dissemination", *SMALL_GRID)
    score = found["score"]
    times = score["propagation"]
    assert 0 < times["2x2"]["units"] < times["4x4"]["units"]
    # The run ends as the last robot says that it is complete, in its slot after it has become so.
    assert times["4x4"]["s"] < found["virtual_s"] <= times["4x4"]["s"] + 16 * score["slot_s"]
    assert score["units_per_slot"] == 7
    assert score["slots_missed"] == 0
    assert score["never_known"] == {"pairs": 0, "of": 240}


@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("dissemination", ["run.duration_s=60.0"]),
        ("dissemination", ["run.duration_s=30.0", "radio.tdma.reuse=distance_two", "radio.collisions=true"]),
        ("dissemination-mixed", ["run.duration_s=60.0", "radio.loss=0.1", "clock.drift_ppm=20.0",
                                 "radio.tdma.guard_s=0.01", "params.scheme=location-probabilistic"]),
        ("dissemination-mixed", ["run.duration_s=60.0", "radio.tdma.order=drawn_each_frame",
                                 "radio.bursts.enter=0.02", "radio.bursts.leave=0.2", "params.distance=euclidean-3d"]),
        ("coverage", ["run.duration_s=20.0"]),
    ],
)  # fmt: skip
def test_processes_and_one_process_give_the_same_bytes(
    tmp_path: Path, name: str, overrides: list[str]
) -> None:
    logs = []
    for fleet in ("zenoh", "in_process"):
        scenario = load(name, overrides=overrides)
        logs.append(run(scenario, Options(out=tmp_path / f"{fleet}.mcap", fleet=fleet, echo=None)).log)
    difference = first_difference(*logs)
    assert difference is None, str(difference)
    assert logs[0].read_bytes() == logs[1].read_bytes()
    verified = heliograph("verify", logs[0], "--fleet", "in_process")
    assert verified.returncode == 0, verified.stderr


def test_the_emulator_and_the_simulation_are_one_process(tmp_path: Path) -> None:
    # A robot's slot order, and hence the time, is drawn in either: means must agree within their errors.
    grid = PropagationParameters(rows=4, columns=4, m=4, subgraphs="2x2,4x4")
    simulated = run_study(STUDY, grid, samples=400, jobs=1)
    emulated = run_study(PROPAGATION, grid, samples=6)
    for part in ("2x2", "4x4"):
        one, other = simulated["units"][part], emulated["units"][part]
        assert one["incomplete"] == other["incomplete"] == 0
        error = (one["se"] ** 2 + one["sd"] ** 2 / 6) ** 0.5
        assert abs(one["mean"] - other["mean"]) < 4 * error


@pytest.fixture(scope="module")
def undisturbed() -> dict[str, Any]:
    return aged()


def aged(**faults: Any) -> dict[str, Any]:
    found = run_study(AGE, AGE.parameters(duration=120.0, **faults), samples=2, seed=3)
    return {key: value["mean"] for key, value in found.items() if key != "samples"}


def test_losses_make_estimates_older(undisturbed: dict[str, Any]) -> None:
    lossy, bursty = aged(loss=0.1), aged(burst_loss=0.1)
    for faulty in (lossy, bursty):
        assert faulty["age_s"] > undisturbed["age_s"]
        assert faulty["updates_per_minute"] < undisturbed["updates_per_minute"]
        assert faulty["slots_missed"] == 0  # what is lost has been sent


def test_the_estimate_of_a_dead_robot_grows_old_with_everybody(undisturbed: dict[str, Any]) -> None:
    dying = aged(dying=1)
    # For 60 of 120 s its age at 8 others rises to 60 s, and it has no estimates itself: 8 * 60 * 30 pair
    # seconds squared, of 72 * 120 - 8 * 60 pair seconds.
    assert dying["age_s"] - undisturbed["age_s"] == pytest.approx(8 * 60 * 30 / (72 * 120 - 8 * 60), abs=0.5)
    assert dying["slots_missed"] == pytest.approx(1 / 18, abs=0.01)


def test_who_joins_late_is_unknown_until_then(undisturbed: dict[str, Any]) -> None:
    late = aged(late=2)
    # Half of the time, of 72 ordered pairs, 30 have one of the two in them.
    assert late["unknown_part"] - undisturbed["unknown_part"] == pytest.approx(0.5 * 30 / 72, abs=0.05)
    assert late["slots_missed"] == pytest.approx(2 / 18, abs=0.02)


def test_clocks_miss_their_slots_where_the_guard_is_too_short(undisturbed: dict[str, Any]) -> None:
    # 120 s at 50 ppm are 6 ms: half of a guard of 20 ms holds them, half of one of 1 us does not.
    guarded, missing = aged(drift_ppm=50.0, guard=0.02), aged(drift_ppm=50.0)
    assert guarded["slots_missed"] == 0
    assert guarded["age_s"] == pytest.approx(undisturbed["age_s"], rel=0.3)
    assert missing["slots_missed"] > 0.3
    assert missing["updates_per_minute"] < undisturbed["updates_per_minute"] / 2


def test_coverage_reaches_the_grid_where_estimates_hop(tmp_path: Path) -> None:
    found = result(tmp_path, "coverage", "--duration", 120)["score"]
    costs = found["coverage"]["cost_over_optimum"]
    assert costs["per_time"][0] > 10
    assert costs["final"] == pytest.approx(1.0, abs=0.1)
    assert found["coverage"]["optimum"] == {"value": pytest.approx(90.0**4 / 54), "exact": True}
    assert found["frame_rate_hz"] == pytest.approx(0.5787, abs=1e-4)
