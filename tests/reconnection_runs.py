"""Runs of robots that search for each other, in one process, and beside what the simulation says of them."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from emulator.run import FleetName, Options, run
from emulator.scenario_file import load
from logs.reader import LogReader
from scenarios.reconnection.emulated import EmulatedParameters, overrides
from scenarios.reconnection.score_history import History, read
from scenarios.reconnection.simulation import Result, Search
from scenarios.reconnection.study_reconnection import search_of

SHIPPED = (files("scenarios.reconnection") / "reconnection.toml").read_text()
BEHAVIOUR = 'behaviour = "agent.behaviours.reconnection.reconnect:reconnect"'
assert BEHAVIOUR in SHIPPED

Told = list[tuple[tuple[int, ...], list[tuple[int, ...]]]]
"""At each step: the place of every robot, and the networks."""


def emulated(
    folder: Path,
    parameters: EmulatedParameters,
    seed: int,
    *more: str,
    behaviour: str | None = None,
    fleet: FleetName = "in_process",
) -> History:
    """The log of a run. `behaviour`: Python code whose `main` takes the place of the behaviour."""
    folder.mkdir(exist_ok=True)
    text = SHIPPED
    if behaviour is not None:
        (folder / "my_robot.py").write_text(behaviour)
        text = text.replace(BEHAVIOUR, 'behaviour = "my_robot.py:main"')
    (folder / "x.toml").write_text(text)
    changes = [*overrides(parameters), *more]
    scenario = load(str(folder / "x.toml"), robots=parameters.robots, seed=seed, overrides=changes)
    run(scenario, Options(out=folder / "run.mcap", fleet=fleet, echo=None, force=True))
    with LogReader(folder / "run.mcap") as log:
        return read(log)


def simulated(parameters: EmulatedParameters, seed: int) -> tuple[Result, Told]:
    """The same by the simulation."""
    told: Told = []

    def watch(_step: int, search: Search) -> None:
        places = tuple(member.motion.place for member in search.members)
        told.append((places, sorted(tuple(sorted(group)) for group in search.groups)))

    return search_of(parameters, seed).run(parameters.random_steps, parameters.limit, watch), told


def told_by(history: History) -> Told:
    """The same from a log: true places, and the networks that robots logged."""
    return [
        (moment.places, sorted({tuple(entry["network"]) for entry in moment.told.values()}))
        for moment in history.moments
    ]
