"""The command as a user types it: what it prints, what it refuses, and how."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import databeam_mcap_reader
import orjson
import pytest

from emulator.scenario import side_for_neighbours
from logs.reader import LogReader
from tests.support import TIMEOUT_S, heliograph, write_scenario

pytestmark = pytest.mark.processes

GOOD = """
behaviour = "my_robot.py:main"
robots = 2
[run]
duration_s = 1.0
[world]
area_m = [10.0, 10.0]
[radio]
range_m = 20.0
"""
BEHAVIOUR = "async def main(robot):\n    robot.radio.broadcast(robot.id)\n"


def refused(*arguments: object, cwd: Path | None = None) -> str:
    """The one sentence with which the command refuses; it must be one, with exit code 2."""
    done = heliograph(*arguments, cwd=cwd)
    assert done.returncode == 2, (done.stdout, done.stderr)
    assert done.stdout == ""
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith("heliograph: ")
    return line.removeprefix("heliograph: ")


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A log over Zenoh and the JSON its run printed."""
    out = tmp_path_factory.mktemp("finished") / "log.mcap"
    done = heliograph("run", "association", "--robots", 8, "--seed", 5, "--out", out, "--json")
    assert done.returncode == 0, done.stderr
    return out, orjson.loads(done.stdout)


def test_json_of_a_run(finished: tuple[Path, dict[str, Any]]) -> None:
    out, result = finished
    assert list(result) == [
        "scenario", "seed", "robots", "fleet", "log", "digest", "virtual_s", "wall_s", "startup_s", "activations",
        "messages", "score",
    ]  # fmt: skip
    assert (result["scenario"], result["seed"], result["robots"], result["fleet"]) == (
        "association",
        5,
        8,
        "zenoh",
    )
    assert result["log"] == str(out)
    assert result["digest"] == hashlib.sha256(out.read_bytes()).hexdigest()
    messages = result["messages"]
    assert messages["sent"] * 7 == messages["delivered"] + sum(messages["dropped"].values())
    assert result["score"]["messages_sent"] == messages["sent"]
    assert result["score"]["false_matches"] == 0
    assert result["score"]["steps_to_completion"]["completed"] == 8
    assert result["virtual_s"] == 0.5 * (1 + result["score"]["steps_to_completion"]["max"])
    assert result["activations"] == 8 * (2 + result["score"]["steps_to_completion"]["max"])


def test_score_of_a_log_is_the_score_of_its_run(finished: tuple[Path, dict[str, Any]]) -> None:
    out, result = finished
    done = heliograph("score", out, "--json")
    assert orjson.loads(done.stdout) == result["score"]


def scored(folder: Path, body: str) -> list[object]:
    """Arguments of a run whose scoring function has this body."""
    code = f"{BEHAVIOUR}\n\ndef score(log):\n    print('scoring')\n    {body}\n"
    write_scenario(folder, code, 'score = "my_robot.py:score"\n' + GOOD)
    return ["run", "mine.toml", "--fleet", "in_process", "--out", "log.mcap"]


@pytest.mark.parametrize(
    ("body", "sentence"),
    [
        ("return {}['x']", "my_robot.py:score fails on log.mcap with KeyError: 'x' (line 7 of my_robot.py)"),
        ("raise SystemExit(3)", "my_robot.py:score fails on log.mcap with SystemExit: 3 (line 7 of my_robot.py)"),
        ("return list(log.records('/nothing'))", "my_robot.py:score fails on log.mcap with LogError: "),
        ("return 5", "my_robot.py:score returns int instead of a dict of results for log.mcap"),
        ("return {'x': object()}", "my_robot.py:score returns what JSON has no form for (Type is not JSON serializable: object) for log.mcap"),
        ("return {1: 2}", "my_robot.py:score returns what JSON has no form for (Dict key must be str) for log.mcap"),
    ],
)  # fmt: skip
def test_a_score_that_fails_loses_nothing(body: str, sentence: str, tmp_path: Path) -> None:
    done = heliograph(*scored(tmp_path, body), "--json", "--stats", "stats.json", cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    told = done.stderr.strip().splitlines()
    assert told[0] == "scoring"
    assert told[1].startswith(f"heliograph: score: {sentence}")
    assert told[1].endswith("; mend it, and score the log with --source FOLDER; the log is whole: log.mcap")
    assert len(told) == 2
    result = orjson.loads(done.stdout)
    assert result["score"] is None
    assert result["digest"] == hashlib.sha256((tmp_path / "log.mcap").read_bytes()).hexdigest()
    assert orjson.loads((tmp_path / "stats.json").read_bytes())["activations"] == result["activations"]
    with LogReader(tmp_path / "log.mcap") as log:
        assert log.complete
    table = heliograph(*scored(tmp_path, body), "--force", cwd=tmp_path)
    assert table.returncode == 2
    assert result["digest"] in table.stdout


def test_score_needs_the_log_alone(tmp_path: Path) -> None:
    """Or a folder with a function that has been mended since."""
    (tmp_path / "helper.py").write_text("ANSWER = 42\n")
    arguments = scored(tmp_path, "import helper; return {'answer': helper.ANSWER}")
    code = (tmp_path / "my_robot.py").read_text()
    (tmp_path / "my_robot.py").write_text("import helper\n" + code)
    done = heliograph(*arguments, "--json", cwd=tmp_path)
    assert orjson.loads(done.stdout)["score"] == {"answer": 42}, done.stderr
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (tmp_path / "log.mcap").rename(elsewhere / "log.mcap")
    (tmp_path / "my_robot.py").rename(elsewhere / "my_robot.py")
    (tmp_path / "helper.py").unlink()
    (elsewhere / "helper.py").write_text("ANSWER = 43\n")
    alone = heliograph("score", elsewhere / "log.mcap", "--json", cwd=tmp_path)
    assert orjson.loads(alone.stdout) == {"answer": 42}, alone.stderr
    mended = heliograph("score", elsewhere / "log.mcap", "--json", "--source", elsewhere, cwd=tmp_path)
    assert orjson.loads(mended.stdout) == {"answer": 43}, mended.stderr


def test_interrupted_before_there_is_a_log(tmp_path: Path) -> None:
    """Ctrl-C while behaviours are imported: nothing is said of a log that nobody began."""
    code = f"import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n{BEHAVIOUR}"
    write_scenario(tmp_path, code, GOOD)
    done = heliograph("run", "mine.toml", "--fleet", "in_process", "--out", "log.mcap", cwd=tmp_path)
    assert done.returncode == 130
    assert done.stderr == "heliograph: interrupted\n"
    assert not (tmp_path / "log.mcap").exists()


def test_info(finished: tuple[Path, dict[str, Any]]) -> None:
    out, result = finished
    about = orjson.loads(heliograph("info", out, "--json").stdout)
    with LogReader(out) as log:
        assert {topic["topic"]: topic["messages"] for topic in about["topics"]} == {
            name: topic.messages for name, topic in log.topics.items()
        }
    assert about["duration_s"] == pytest.approx(result["virtual_s"])
    assert about["version"] == metadata.version("heliograph")
    text = heliograph("info", out).stdout
    assert "/radio" in text
    assert f"version:     {about['version']}\n" in text


def test_a_validator_that_is_not_ours_finds_nothing(finished: tuple[Path, dict[str, Any]]) -> None:
    tool = Path(databeam_mcap_reader.__file__).parent / "mcap_cli"  # the official `mcap` command
    done = subprocess.run([tool, "doctor", finished[0]], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout + done.stderr) == (0, "")


def test_scenarios_and_check() -> None:
    assert heliograph("scenarios").stdout.split()[:2] == ["association", "Stationary"]
    assert orjson.loads(heliograph("scenarios", "--json").stdout)[0]["name"] == "association"
    for robots in (20, 100):
        side = side_for_neighbours(robots, 13.0, 16.0)
        done = heliograph("check", "association", "--robots", robots)
        assert (
            done.stdout
            == f"association: fine; {robots} robots on {side:.1f} m x {side:.1f} m, at most 60 s\n"
        )


def test_duration_is_exact_whatever_the_stop_rule(tmp_path: Path) -> None:
    done = heliograph(
        "run", "association", "--robots", 3, "--duration", 7.25, "--fleet", "in_process",
        "--out", tmp_path / "log.mcap", "--json",
    )  # fmt: skip
    assert orjson.loads(done.stdout)["virtual_s"] == 7.25
    assert orjson.loads(done.stdout)["activations"] == 3 * 15


def test_set_is_typed_by_the_schema(tmp_path: Path) -> None:
    out = tmp_path / "log.mcap"
    done = heliograph(
        "run", "association", "--robots", 6, "--fleet", "in_process", "--out", out, "--json",
        "--set", "radio.loss=1", "--set", "params.transmission_probability=1.0", "--duration", 2,
    )  # fmt: skip
    messages = orjson.loads(done.stdout)["messages"]
    assert messages == {"sent": 30, "delivered": 0, "dropped": {"loss": 150}}


def test_default_place_and_table(tmp_path: Path) -> None:
    done = heliograph("run", "association", "--robots", 3, "--fleet", "in_process", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "runs" / "association-1.mcap").is_file()
    assert "steps_to_completion" in done.stdout
    assert "runs/association-1.mcap" in done.stdout


def test_stats(tmp_path: Path) -> None:
    stats = tmp_path / "stats.json"
    heliograph(
        "run",
        "association",
        "--robots",
        3,
        "--fleet",
        "in_process",
        "--out",
        tmp_path / "a.mcap",
        "--stats",
        stats,
    )
    assert orjson.loads(stats.read_bytes())["activations"] > 0


def test_recover(finished: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(finished[0].read_bytes()[:-3000])
    assert heliograph("recover", torn, "--out", tmp_path / "whole.mcap").returncode == 0
    with LogReader(tmp_path / "whole.mcap") as log:
        assert not log.torn
        assert len(list(log.records("/radio"))) > 10


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["run", "asociation"], "asociation: there is no such scenario, did you mean association or association-"),
        (["run", "nowhere.toml"], "nowhere.toml: there is no such file"),
        (["check", "association", "--set", "radio.rang_m=3"], "--set: unknown key radio.rang_m, did you mean range_m"),
        (["check", "association", "--set", "radio.range_km=3"], "--set: unknown key radio.range_km, did you mean range_m"),
        (["check", "association", "--set", "radio.range_m=-3"], "--set radio.range_m=-3: must be a number of metres greater than 0"),
        (["check", "association", "--set", "radio.range_m=3 km"], "--set radio.range_m=3 km: must be a number"),
        (["check", "association", "--set", "radio.loss=1.5"], "--set radio.loss=1.5: must be a number from 0 to 1"),
        (["check", "association", "--set", "params.speed=1"], "--set: params.speed: association has no such key under [params]; copy "),
        (["check", "association", "--robots", "0"], "--robots 0: must be"),
        (["check", "association", "--duration", "-1"], "--duration -1: is a number of seconds greater than 0"),
        (["check", "association", "--set", "behaviour=agent.nothing:main"], "association: agent.nothing fails to import"),
        (["score", "nothing.mcap"], "cannot read nothing.mcap"),
        (["info", "/dev/null"], "/dev/null"),
        (["verify", "nothing.mcap"], "cannot read nothing.mcap"),
    ],
)  # fmt: skip
def test_what_is_refused(arguments: list[str], sentence: str, tmp_path: Path) -> None:
    assert refused(*arguments, cwd=tmp_path).startswith(sentence)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (
            ("range_m = 20.0", "range_m = -20.0"),
            "mine.toml: radio.range_m: must be a number of metres greater than 0",
        ),
        (("range_m = 20.0", "rang_m = 20.0"), "mine.toml: unknown key radio.rang_m, did you mean range_m"),
        (("robots = 2", 'robots = ["a", "b", "a"]'), "mine.toml: robots"),
        (("robots = 2", "robots = 2.5"), "mine.toml: robots: must be"),
        (("range_m = 20.0", "range_m = 20.0 m"), "mine.toml: line 9"),
        (
            (
                "range_m = 20.0",
                'range_m = 20.0\naccess = "tdma"\nbit_rate_bps = 3000\ntdma = { slot_s = 0.01 }',
            ),
            "mine.toml: radio.tdma.slot_s: a slot of 0.01 s is too short for one message of 1024 bytes",
        ),
        (("my_robot.py:main", "my_robt.py:main"), "mine.toml: behaviour: there is no file my_robt.py"),
    ],
)
def test_what_is_refused_in_a_file(change: tuple[str, str], sentence: str, tmp_path: Path) -> None:
    write_scenario(tmp_path, BEHAVIOUR, GOOD.replace(*change))
    told = refused("run", "mine.toml", "--out", "log.mcap", cwd=tmp_path)
    assert told.startswith(sentence), told
    assert not (tmp_path / "log.mcap").exists()


def test_an_existing_log_is_not_overwritten(tmp_path: Path) -> None:
    write_scenario(tmp_path, BEHAVIOUR, GOOD)
    (tmp_path / "log.mcap").write_text("precious")
    told = refused("run", "mine.toml", "--out", "log.mcap", cwd=tmp_path)
    assert told == "log.mcap exists; choose another --out or add --force"
    assert (tmp_path / "log.mcap").read_text() == "precious"
    assert heliograph("run", "mine.toml", "--out", "log.mcap", "--force", cwd=tmp_path).returncode == 0
    with LogReader(tmp_path / "log.mcap") as log:
        assert log.complete


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--out", "mine.toml", "--force"], "--out mine.toml: is the scenario itself"),
        (["--out", "a.mcap", "--stats", "a.mcap"], "--stats a.mcap: is the log or the scenario"),
        (["--out", "a.mcap", "--stats", "no/a.json"], "--stats no/a.json: there is no folder no"),
        (
            ["--out", "a.mcap", "--listen", "tcp/127.0.0.1:0"],
            "--listen tcp/127.0.0.1:0: robots must know the port",
        ),
    ],
)
def test_nothing_is_lost_to_a_wrong_option(arguments: list[str], sentence: str, tmp_path: Path) -> None:
    write_scenario(tmp_path, BEHAVIOUR, GOOD)
    assert refused("run", "mine.toml", *arguments, cwd=tmp_path).startswith(sentence)
    assert (tmp_path / "mine.toml").read_text() == GOOD
    assert not (tmp_path / "a.mcap").exists()


def test_scoring_a_torn_log_says_so(finished: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(finished[0].read_bytes()[:-3000])
    done = heliograph("score", torn, "--json")
    assert done.returncode == 0
    assert "is torn or damaged; this scores what can be read" in done.stderr
    assert refused("verify", torn).startswith(f"{torn}: is torn or damaged")


def test_a_thread_that_never_ends_does_not_keep_the_command(tmp_path: Path) -> None:
    code = "import asyncio, time\nasync def main(robot):\n    await asyncio.to_thread(time.sleep, 1000)\n"
    write_scenario(tmp_path, code, GOOD + "[limits]\nanswer_timeout_s = 1.0\n")
    done = heliograph("run", "mine.toml", "--fleet", "in_process", "--out", "a.mcap", cwd=tmp_path)
    assert done.returncode == 1
    assert done.stderr.strip().splitlines()[-1].startswith("heliograph: robot r00 did not answer within 1 s")


def test_a_place_that_cannot_be_written(tmp_path: Path) -> None:
    write_scenario(tmp_path, BEHAVIOUR, GOOD)
    (tmp_path / "file").write_text("")
    told = refused("run", "mine.toml", "--out", "file/log.mcap", cwd=tmp_path)
    assert told.startswith("cannot write file/log.mcap: ")
    assert told.endswith("choose another --out")


def test_a_full_disk(tmp_path: Path) -> None:
    """A file system that lets no file grow past 600 KiB, as a full one would."""
    endless = "import asyncio\nasync def main(robot):\n    while True:\n        await asyncio.sleep(0.01)\n"
    endless += "        robot.radio.broadcast(robot.rng.bytes(500))\n"
    write_scenario(tmp_path, endless, GOOD)
    command = [sys.executable, "-m", "emulator", "run", "mine.toml", "--out", "log.mcap", "--duration", "100"]
    limited = ["bash", "-c", 'ulimit -f 600; exec "$@"', "limited", *command]  # in blocks of 1024 bytes
    done = subprocess.run(
        limited, cwd=tmp_path, capture_output=True, text=True, timeout=TIMEOUT_S, check=False,
        env={**os.environ, "PYTHONPATH": os.getcwd()},
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    last = done.stderr.strip().splitlines()[-1]
    assert (
        last == "heliograph: cannot write log.mcap: File too large; free some space or choose another --out"
    )
    with LogReader(tmp_path / "log.mcap") as log:  # what was written before is there
        assert log.torn
        assert len(list(log.records("/radio"))) > 10
    assert heliograph("recover", "log.mcap", "--out", "whole.mcap", cwd=tmp_path).returncode == 0
