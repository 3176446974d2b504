"""Searches by robot processes on the emulator, as a study that is read like the simulation.

The shipped scenario `reconnection` with another team, environment, method: run for run, the same seed gives
the same search in both. Robots find out by radio what members of the simulation share.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta, Struct

from agent.behaviours.reconnection.model import ways_of
from agent.behaviours.reconnection.planner import BUDGET, WIDTH
from channels.graphs import Graph
from channels.units import MAX_TIME_NS, NS_PER_S
from logs.reader import LogReader
from scenarios.emulated import emulated
from scenarios.reconnection.score import score
from scenarios.reconnection.study_reconnection import (
    STUDY,
    ReconnectionParameters,
    graph_of,
    middle,
    search_of,
)
from scenarios.reconnection.study_reconnection import check as check_simulated
from scenarios.study import Study, described, one_each

SCENARIO = "reconnection"
LEAVES_LATE = 0.5
"""Share of a step that a robot does not drive, at most: three phases of a tenth before it leaves, a tenth
for arriving early, and some room."""
TURNING = 2.2
"""How much faster than on its way a robot must be to turn back in the step after, with some room."""
LAST_STEP_S = 0.5
"""How much of the last step there is: all three phases, but not the next arrivals."""


class EmulatedParameters(ReconnectionParameters, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """As of the simulation, but for what only that has: `loss`, `width` and `budget`."""

    compare: Annotated[
        bool, Meta(description="simulate each run as well, and tell how many are the same")
    ] = False


class EmulatedRun(Struct, frozen=True):
    """One run: what its score says, and whether the simulation says the same."""

    seed: int
    steps: int
    """Until the team was one network, or the limit."""
    connected: bool
    moves: int
    turned: int
    broken: int
    bytes_per_step: float
    """Payload, per robot."""
    same: bool | None


def check(parameters: EmulatedParameters) -> None:
    """Raises ValueError for what the simulation or the emulator cannot do, naming the key."""
    check_simulated(parameters)
    if parameters.loss:
        raise ValueError(
            "loss: radios lose messages, not contacts; leave it 0, or run the scenario with radio.loss"
        )
    for key, usual in (("width", WIDTH), ("budget", BUDGET)):
        if getattr(parameters, key) != usual:
            raise ValueError(f"{key}: robots of the emulator search {usual} far; leave it so")
    most = int(MAX_TIME_NS / NS_PER_S)
    if parameters.random_steps + parameters.limit + LAST_STEP_S > most:
        raise ValueError(f"limit: a run of the emulator lasts {most} s at most; set less")


def simulate(
    parameters: EmulatedParameters, generator: np.random.Generator, samples: int
) -> list[EmulatedRun]:
    """So many runs."""
    return [_run(parameters, int(generator.integers(2**31))) for _ in range(samples)]


def overrides(parameters: EmulatedParameters) -> list[str]:
    """What makes the shipped scenario one of these parameters."""
    same = ("method", "travel_steps", "random_steps", "horizon", "memory", "targets", "miss", "tasks")
    settings = {key: getattr(parameters, key) for key in (*same, "task_steps", "holding")}
    settings |= {"deterministic": str(parameters.deterministic).lower(), "half_steps": parameters.half_steps}
    graph = None if parameters.graph is None else graph_of(parameters, seed=0)
    return [
        f"run.duration_s={parameters.random_steps + parameters.limit + LAST_STEP_S}",
        f"world.motion.max_speed_mps={_speed_mps(parameters, graph)}",
        f"world.graph={_table(parameters, graph)}",
        *(f"params.{key}={value}" for key, value in settings.items()),
    ]


def _speed_mps(parameters: EmulatedParameters, graph: Graph | None) -> float:
    """So fast robots must be."""
    # Half of that on the longest way of so many steps, and up to all of it to turn back in the step after.
    usual = max(1.0, 2.0 / parameters.travel_steps)
    if graph is None:
        return usual
    # A file may have ways that are shorter than the distance that robots have to drive.
    ways, points = ways_of(graph, parameters.travel_steps), np.array(graph.vertices)
    driven = np.hypot(*(points[ways.head] - points[ways.tail]).T)
    return max(usual, float((TURNING * driven / (ways.steps + 1 - LEAVES_LATE)).max()))


def _table(parameters: EmulatedParameters, graph: Graph | None) -> str:
    """The inline table `world.graph`."""
    starts = "" if parameters.starts is None else f", starts = [{parameters.starts}]"
    if graph is None:
        args = f"{{ kind = {_quoted(parameters.environment)}, vertices = {parameters.vertices} }}"
        generator = _quoted("agent.behaviours.reconnection.environments:environment")
        return f"{{ generator = {generator}, args = {args}{starts} }}"
    if min(map(min, graph.vertices)) < 0:
        return _written(_shifted(graph))
    return f"{{ file = {_quoted(str(Path(str(parameters.graph)).absolute()))}{starts} }}"


def _shifted(graph: Graph) -> Graph:
    """The graph where the emulator's area is, which begins at 0; lengths stay what they are."""
    left, down = (max(0.0, -low) for low in np.array(graph.vertices).min(axis=0).tolist())
    return msgspec.structs.replace(
        graph,
        vertices=tuple((x + left, y + down) for x, y in graph.vertices),
        obstacles=tuple((x0 + left, y0 + down, x1 + left, y1 + down) for x0, y0, x1, y1 in graph.obstacles),
    )


def _written(graph: Graph) -> str:
    """As an inline table; TOML has lists of numbers as JSON has them."""
    held = msgspec.structs.asdict(graph)
    lists = [
        f"{key} = {msgspec.json.encode(value).decode()}" for key, value in held.items() if value is not None
    ]
    return "{ " + ", ".join(lists) + " }"


def _quoted(text: str) -> str:
    """As TOML has it."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def _run(parameters: EmulatedParameters, seed: int) -> EmulatedRun:
    found = emulated(SCENARIO, _scored, seed=seed, robots=parameters.robots, overrides=overrides(parameters))
    steps = parameters.limit if found["steps"] is None else found["steps"]
    # As in the simulation: who meets in the very step of the limit meets too late.
    connected = found["reached"] and steps < parameters.limit
    moves, turned = found["moves"]["total"], found["turned_back"]
    same = None
    if parameters.compare:
        result = search_of(parameters, seed).run(parameters.random_steps, parameters.limit)
        expected = result.steps, result.connected
        same = expected == (steps, connected) and (
            result.stuck or (result.moves, result.turned) == (moves, turned)
        )
    return EmulatedRun(
        seed,
        steps,
        connected,
        moves,
        turned,
        found["broken"]["true"],
        found["radio"]["per_robot_and_step"],
        same,
    )


def _scored(log: LogReader) -> dict[str, Any]:
    return score(log)


def summarise(parameters: EmulatedParameters, partials: Sequence[list[EmulatedRun]]) -> dict[str, Any]:
    """As of `reconnection`: `steps`, `times`, `seeds`, `censored`, `moves`, `turned`, `broken`, `samples`.

    And `bytes_per_robot_and_step` (payload: `mean`, `se`); `same`: how many runs the simulation does in just
    as many steps, moves and turnings back; None unless `compare`.
    """
    runs = [run for partial in partials for run in partial]
    times = [run.steps for run in runs]
    return {
        "steps": middle(times),
        "times": times,
        "seeds": [run.seed for run in runs],
        "censored": sum(not run.connected for run in runs),
        "moves": described(run.moves for run in runs),
        "turned": described(run.turned for run in runs),
        "broken": sum(run.broken for run in runs),
        "bytes_per_robot_and_step": described(run.bytes_per_step for run in runs),
        "same": sum(bool(run.same) for run in runs) if parameters.compare else None,
        "samples": len(runs),
    }


EMULATED = Study(
    name="reconnection-emulated",
    title="Reconnection by robot processes on the emulator",
    parameters=EmulatedParameters,
    samples=4,
    unit="runs",
    chunk=one_each,
    simulate=simulate,
    summarise=summarise,
    check=check,
    max_jobs=1,  # the robots of one run keep all processors busy
    chance=STUDY.name,
)
