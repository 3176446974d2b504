"""The README is what a newcomer copies: its own lines are run, literally."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from logs.reader import LogReader
from tests.support import TIMEOUT_S

pytestmark = pytest.mark.processes

README = (Path(__file__).parents[2] / "README.md").read_text()


def blocks(section: str, language: str) -> list[str]:
    """Fenced blocks of one language in one section, in order."""
    text = README.split(f"\n## {section}\n")[1].split("\n## ")[0]
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


def shell(commands: str, folder: Path) -> subprocess.CompletedProcess[str]:
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    return subprocess.run(
        ["bash", "-e", "-c", commands], cwd=folder, env={**os.environ, "PATH": path},
        capture_output=True, text=True, timeout=TIMEOUT_S, check=False,
    )  # fmt: skip


def test_from_nothing_to_a_scored_log(tmp_path: Path) -> None:
    behaviour, score = blocks("Your own robot", "python")
    (toml,) = blocks("Your own robot", "toml")
    (commands,) = blocks("Your own robot", "sh")
    assert len((behaviour + toml).splitlines()) <= 20
    (tmp_path / "my_robot.py").write_text(behaviour)
    (tmp_path / "my_team.toml").write_text(toml)
    done = shell(commands, tmp_path)
    assert done.returncode == 0, done.stderr
    assert "messages_sent" in done.stdout

    (tmp_path / "my_robot.py").write_text(behaviour + "\n" + score)
    (tmp_path / "my_team.toml").write_text('score = "my_robot.py:score"\n' + toml)
    own = shell(
        "heliograph run my_team.toml --seed 7 --out third.mcap && heliograph score third.mcap", tmp_path
    )
    assert own.returncode == 0, own.stderr
    assert own.stdout.count("known at the end") == 2

    (reading,) = blocks("The log", "python")
    (tmp_path / "reading.py").write_text(reading)
    read = shell("python reading.py", tmp_path)
    assert read.returncode == 0, read.stderr
    assert read.stdout.startswith("0 r0")


@pytest.mark.parametrize(
    ("section", "said", "files"),
    [
        (
            "Channel association",
            "expected_steps",
            {"stationary.mcap", "mobile.mcap", "figure-07.png", "figure-07.svg", "figure-07.csv"},
        ),
        (
            "State estimates across a team",
            "frame_rate_hz  0.5787",
            {"mixed.mcap", "coverage.mcap", "figure-02.png", "figure-02.svg", "figure-02.csv"},
        ),
        (
            "Finding each other again",
            "reached           True",
            {"found.mcap", "persistent.mcap", "beliefs.png", "beliefs.svg", "beliefs.csv"},
        ),
    ],
)
def test_the_commands_of_an_experiment(section: str, said: str, files: set[str], tmp_path: Path) -> None:
    (commands,) = blocks(section, "sh")
    done = shell(commands, tmp_path)
    assert done.returncode == 0, done.stderr
    assert said in done.stdout
    assert {path.name for path in tmp_path.rglob("*") if path.is_file()} == files


SEARCH = """
behaviour = "wrapper.py:main"
robots = 3
[run]
duration_s = 100.0
stop = {{ entry = "reconnection", field = "whole", of = "running" }}
[world]
placement = "graph"
motion = {{ kind = "commanded", max_speed_mps = 1.0 }}
[world.graph]
vertices = {vertices}
edges = {edges}
[radio]
link = "graph"
max_payload_bytes = 65536
[params]
travel_steps = 2.0
random_steps = 5
targets = "upwards"
enough = {enough}
{more}
"""
PATH = {"vertices": [[x, 0] for x in range(8)], "edges": [[x, x + 1, 1.0] for x in range(7)]}


@pytest.mark.parametrize(
    ("section", "enough", "more"),
    [
        ("Finding each other again", 3, ""),
        ("Questions", 2, '[[robot]]\nid = "r01"\nparams = { lives_s = 4.0 }'),
    ],
    ids=["a model of one's own", "a robot that dies"],
)
def test_what_wraps_a_search(section: str, enough: int, more: str, tmp_path: Path) -> None:
    (wrapper,) = blocks(section, "python")
    (tmp_path / "wrapper.py").write_text(wrapper)
    (tmp_path / "team.toml").write_text(SEARCH.format(**PATH, enough=enough, more=more))
    done = shell("heliograph run team.toml --out team.mcap --json", tmp_path)
    assert done.returncode == 0, done.stderr
    with LogReader(tmp_path / "team.mcap") as log:
        told = [
            (each["robot"], each["data"])
            for _, each in log.records("/robot")
            if each["entry"] == "reconnection"
        ]
    assert told[-1][1]["whole"]
    assert (max(data["step"] for robot, data in told if robot == "r01") < 5) == (enough == 2)


def test_every_command_is_described() -> None:
    listed = set(re.findall(r"^heliograph (\w+)", README.split("\n## The command\n")[1], re.MULTILINE))
    help_text = shell("heliograph --help", Path.cwd()).stdout
    offered = set(re.findall(r"^    (\w+)\s", help_text, re.MULTILINE))
    assert listed == offered
