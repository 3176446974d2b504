"""Robot processes that search for each other, over Zenoh, as users run them."""

from __future__ import annotations

from pathlib import Path

import orjson
import pytest

from scenarios.reconnection.emulated import EMULATED, EmulatedParameters
from scenarios.reconnection.study_reconnection import STUDY, ReconnectionParameters
from scenarios.study import run_study
from tests.support import heliograph

pytestmark = pytest.mark.processes

SMALL = {"environment": "delaunay", "vertices": 30, "random_steps": 10, "limit": 200}


@pytest.mark.parametrize(("method", "robots"), [("semi-markov", 4), ("persistent", 2)])
def test_processes_need_the_same_times_as_the_simulation(method: str, robots: int) -> None:
    chosen = {"method": method, "robots": robots, **SMALL}
    simulated = run_study(STUDY, ReconnectionParameters(**chosen), samples=2, jobs=1)  # type: ignore[arg-type]
    emulated = run_study(EMULATED, EmulatedParameters(**chosen), samples=2)  # type: ignore[arg-type]
    for key in ("times", "seeds", "steps", "censored", "moves", "turned"):
        assert emulated[key] == simulated[key]
    assert emulated["broken"] == 0
    assert emulated["same"] is None


def test_the_study_compares_run_by_run() -> None:
    done = heliograph(
        "study", "reconnection-emulated", "--samples", 2, "--set", "compare=true", "--json",
        *(word for key, value in SMALL.items() for word in ("--set", f"{key}={value}")),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = orjson.loads(done.stdout)
    assert found["same"] == found["samples"] == 2


def test_the_shipped_scenario_repeats_a_run_of_the_study(tmp_path: Path) -> None:
    few = ReconnectionParameters(random_steps=20, method="persistent")
    study = run_study(STUDY, few, samples=3, jobs=1)
    shortest = min(range(3), key=study["times"].__getitem__)
    done = heliograph(
        "run", "reconnection", "--seed", study["seeds"][shortest], "--out", tmp_path / "x.mcap", "--json",
        "--set", "params.random_steps=20", "--set", "params.method=persistent",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = orjson.loads(done.stdout)["score"]
    assert found["steps"] == study["times"][shortest]
    assert found["agreement"]["same"] == found["agreement"]["asked"]


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ("loss=0.1", "loss: radios lose messages, not contacts"),
        ("width=3", "width: robots of the emulator search 8 far"),
        ("limit=5000000", "limit: a run of the emulator lasts"),
        ("starts=1,2", "starts: 1,2 are 2 vertices for 3 robots"),
    ],
)
def test_what_the_emulator_cannot_do_is_told_in_one_sentence(change: str, complaint: str) -> None:
    done = heliograph("study", "reconnection-emulated", "--set", change)
    assert done.returncode != 0
    assert complaint in done.stderr
    assert "Traceback" not in done.stderr
