"""The contract: a log is a function of scenario, seed and version, and of nothing else."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import orjson
import pytest

from emulator.errors import RunFailed
from emulator.scoring import score
from logs.compare import first_difference
from tests.determinism.scenarios import BEHAVIOUR, SCENARIOS
from tests.support import heliograph, run_scenario, write_scenario


def assert_same(left: Path, right: Path) -> None:
    difference = first_difference(left, right)
    assert difference is None, str(difference)
    assert left.read_bytes() == right.read_bytes()


@pytest.fixture(params=sorted(SCENARIOS))
def scenario(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    return write_scenario(tmp_path, BEHAVIOUR, SCENARIOS[request.param], request.param)


@pytest.fixture
def busy_machine() -> Iterator[None]:
    """Two processes per core that do nothing but compute, while a test runs."""
    spin = [sys.executable, "-c", "while True: pass"]
    spinners = [subprocess.Popen(spin) for _ in range(2 * (os.cpu_count() or 1))]
    yield
    for spinner in spinners:
        spinner.kill()
        spinner.wait()


@pytest.mark.processes
def test_two_zenoh_runs_and_an_in_process_run_give_the_same_file(scenario: Path, tmp_path: Path) -> None:
    first = run_scenario(scenario, tmp_path / "first.mcap", "zenoh")
    second = run_scenario(scenario, tmp_path / "second.mcap", "zenoh")
    local = run_scenario(scenario, tmp_path / "local.mcap", "in_process")
    assert first.progress.activations > 100
    assert first.progress.delivered > 50
    assert_same(first.log, second.log)
    assert_same(first.log, local.log)
    assert first.digest == second.digest == local.digest
    assert first.progress == local.progress


def test_features_take_part(tmp_path: Path) -> None:
    """Guards the scenarios above: each must really use what it is there for."""
    named: dict[str, set[str]] = {}
    for name, toml in SCENARIOS.items():
        path = write_scenario(tmp_path, BEHAVIOUR, toml, name)
        outcome = run_scenario(path, tmp_path / f"{name}.mcap", "in_process")
        named[name] = set(outcome.progress.dropped) - {"out_of_range"}
    assert named["collisions-without-slots"] == {"collision", "half_duplex"}
    assert {"burst", "loss"} <= named["slots-of-units-drawn-each-frame-in-bursts"]
    assert "collision" in named["slots-shared-by-too-many"]
    assert {"collision", "loss"} <= named["walking-along-a-graph"]
    assert {"no_line_of_sight", "collision"} <= named["obstacles-in-the-line-of-sight"]
    everything = {
        "queue_full",
        "out_of_slot",
        "loss",
        "half_duplex",
        "collision",
        "burst",
        "no_line_of_sight",
    }
    assert set().union(*named.values()) == everything


@pytest.mark.processes
@pytest.mark.parametrize("seed", range(10))
def test_ten_seeds(seed: int, tmp_path: Path) -> None:
    zenoh = run_scenario("association", tmp_path / "zenoh.mcap", "zenoh", seed=seed, robots=12)
    local = run_scenario("association", tmp_path / "local.mcap", "in_process", seed=seed, robots=12)
    assert_same(zenoh.log, local.log)
    assert score(zenoh.log)["false_matches"] == 0


def test_limits_of_wall_clock_time_leave_no_trace(tmp_path: Path) -> None:
    digests = {
        run_scenario(
            "association", tmp_path / f"{limit}.mcap", "in_process", robots=3,
            overrides=[f"limits.answer_timeout_s={limit}"],
        ).digest
        for limit in (20, 40.5)
    }  # fmt: skip
    assert len(digests) == 1


def test_seeds_differ(tmp_path: Path) -> None:
    digests = {
        run_scenario("association", tmp_path / f"{seed}.mcap", "in_process", seed=seed, robots=5).digest
        for seed in range(10)
    }
    assert len(digests) == 10


@pytest.mark.processes
@pytest.mark.usefixtures("busy_machine")
def test_the_same_under_load(tmp_path: Path) -> None:
    loaded = run_scenario("association", tmp_path / "loaded.mcap", "zenoh")
    local = run_scenario("association", tmp_path / "local.mcap", "in_process")
    assert_same(loaded.log, local.log)


@pytest.mark.processes
def test_the_same_on_one_processor(tmp_path: Path) -> None:
    pinned = tmp_path / "pinned.mcap"
    done = heliograph("run", "association", "--out", pinned, "--json", prefix=["taskset", "-c", "0"])
    assert done.returncode == 0, done.stderr
    local = run_scenario("association", tmp_path / "local.mcap", "in_process")
    assert orjson.loads(done.stdout)["digest"] == local.digest
    assert_same(pinned, local.log)


def test_the_same_whatever_the_hash_seed(tmp_path: Path) -> None:
    """A set of text has the order of the hash seed; a behaviour may go through one all the same."""
    code = """
async def main(robot):
    names = {f"name {number}" for number in range(50)}
    robot.log("set", {"as it comes": names, "gone through": [name for name in names]})
    for name in names:
        robot.radio.broadcast(name)
"""
    scenario = write_scenario(tmp_path, code, SCENARIOS["no-cameras"].replace("busybody", "main"))
    digests = set()
    for fleet, hash_seed in (
        ("in_process", "1"),
        ("in_process", "random"),
        ("zenoh", "2"),
        ("zenoh", "random"),
    ):
        out = tmp_path / f"{fleet}-{hash_seed}.mcap"
        done = heliograph(
            "run",
            scenario,
            "--fleet",
            fleet,
            "--out",
            out,
            "--json",
            prefix=["env", f"PYTHONHASHSEED={hash_seed}"],
        )
        assert done.returncode == 0, done.stderr
        digests.add(orjson.loads(done.stdout)["digest"])
    assert len(digests) == 1


def test_pace_does_not_matter(tmp_path: Path) -> None:
    digests = set()
    for rate in ("max", "25"):
        done = heliograph(
            "run", "association", "--fleet", "in_process", "--duration", "2", "--rate", rate,
            "--out", tmp_path / f"{rate}.mcap", "--json",
        )  # fmt: skip
        digests.add(orjson.loads(done.stdout)["digest"])
    assert len(digests) == 1


@pytest.mark.processes
def test_a_failed_run_leaves_the_same_log_with_either_fleet(tmp_path: Path) -> None:
    failing = BEHAVIOUR.replace(
        'robot.log("talk"', 'assert robot.id != "r03" or robot.now_s < 1.5\n        robot.log("talk"'
    )
    scenario = write_scenario(tmp_path, failing, SCENARIOS["lossy-jittery-radio"])
    logs = []
    for number, fleet in enumerate(("zenoh", "zenoh", "in_process")):
        logs.append(tmp_path / f"{number}.mcap")
        with pytest.raises(RunFailed, match="robot r03 failed: AssertionError"):
            run_scenario(scenario, logs[-1], fleet)
    assert_same(logs[0], logs[1])
    assert_same(logs[0], logs[2])


@pytest.mark.processes
@pytest.mark.parametrize("name", ["commanded-motion", "slots-shared-by-too-many", "walking-along-a-graph"])
def test_verify(name: str, tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path, BEHAVIOUR, SCENARIOS[name])
    log = run_scenario(scenario, tmp_path / "log.mcap", "in_process").log
    scenario.unlink()
    (tmp_path / "my_robot.py").unlink()  # the log carries all that is needed
    same = heliograph("verify", log)
    assert (same.returncode, same.stdout.strip()) == (0, f"{log}: the same, byte for byte"), same.stderr


@pytest.mark.processes
@pytest.mark.parametrize("fleet", ["zenoh", "in_process"])
def test_verify_with_a_module_beside_the_behaviour(fleet: str, tmp_path: Path) -> None:
    helper = tmp_path / "voices" / "helper.py"
    helper.parent.mkdir()
    helper.write_text("def word(robot):\n    return f'I am {robot.id}'\n")
    code = "from voices.helper import word\n" + BEHAVIOUR.replace('{"id": robot.id', '{"id": word(robot)')
    scenario = write_scenario(tmp_path, code, SCENARIOS["no-cameras"])
    log = tmp_path / "log.mcap"
    done = heliograph("run", scenario, "--fleet", fleet, "--out", log)
    assert done.returncode == 0, done.stderr
    for path in (scenario, helper, tmp_path / "my_robot.py"):
        path.unlink()
    same = heliograph("verify", log, "--fleet", fleet)
    assert (same.returncode, same.stdout.strip()) == (0, f"{log}: the same, byte for byte"), same.stderr


def test_verify_does_not_score(tmp_path: Path) -> None:
    code = BEHAVIOUR + "\n\ndef score(log):\n    raise SystemExit('scored')\n"
    toml = 'score = "my_robot.py:score"\n' + SCENARIOS["no-cameras"]
    scenario = write_scenario(tmp_path, code, toml)
    log = run_scenario(scenario, tmp_path / "log.mcap", "in_process").log
    same = heliograph("verify", log, "--fleet", "in_process")
    assert (same.returncode, same.stdout.strip()) == (0, f"{log}: the same, byte for byte"), same.stderr


def test_verify_shows_the_first_record_that_differs(tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path, BEHAVIOUR, SCENARIOS["no-cameras"])
    log = run_scenario(scenario, tmp_path / "log.mcap", "in_process").log
    other = tmp_path / "other"
    other.mkdir()
    (other / "my_robot.py").write_text(BEHAVIOUR.replace('"accepted": accepted', '"accepted": not accepted'))
    done = heliograph("verify", log, "--fleet", "in_process", "--source", other)
    assert done.returncode == 1
    assert "/robot" in done.stdout
    assert "accepted" in done.stdout
