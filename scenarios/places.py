"""Where robots were at any instant of a run, exactly, from what /truth of its log tells."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from channels.graphs import Graph
from channels.messages import MotionCommand
from emulator.scenario import Motion, RobotSpec
from emulator.world import World
from scenarios.runs import start_of


def positions(
    truth: Sequence[tuple[int, Mapping[str, Any]]], motion: Mapping[str, Any], times_ns: Iterable[int]
) -> Iterator[NDArray[Any]]:
    """x, y [m] of every robot, (N, 2), at each of these instants, which must not go back.

    `truth`: (log time [ns], record) of all /truth; `motion`: the scenario's `world.motion`.
    """
    return (world.positions(now_ns) for now_ns, world in _worlds(truth, motion, None, times_ns))


def vertices(
    truth: Sequence[tuple[int, Mapping[str, Any]]],
    motion: Mapping[str, Any],
    graph: Graph,
    times_ns: Iterable[int],
) -> Iterator[NDArray[np.int64]]:
    """The vertex of this graph that every robot counts as being at, (N,); otherwise as `positions`.

    See `emulator.graph_places.Places`; -1 for a robot that has stood at none.
    """
    for now_ns, world in _worlds(truth, motion, graph, times_ns):
        places = world.places(now_ns)
        assert places is not None  # the world has a graph
        yield places


def altitudes(truth: Sequence[tuple[int, Mapping[str, Any]]]) -> list[float]:
    """Height [m] of every robot, which never changes."""
    return [robot.get("altitude_m", 0.0) for robot in start_of(truth)["robots"]]


def _worlds(
    truth: Sequence[tuple[int, Mapping[str, Any]]],
    motion: Mapping[str, Any],
    graph: Graph | None,
    times_ns: Iterable[int],
) -> Iterator[tuple[int, World]]:
    """The world at each of these instants, in turn."""
    start = start_of(truth)
    number = {robot["robot"]: index for index, robot in enumerate(start["robots"])}
    specs = [_spec(robot) for robot in start["robots"]]
    world = World(tuple(start["area_m"]), specs, _motion(motion), graph)
    commands = [(time_ns, record) for time_ns, record in truth if record["kind"] == "motion"]
    applied = 0
    for now_ns in times_ns:
        while applied < len(commands) and commands[applied][0] <= now_ns:
            time_ns, record = commands[applied]
            world.command(number[record["robot"]], time_ns, _command(record))
            applied += 1
        yield now_ns, world


def _motion(motion: Mapping[str, Any]) -> Motion:
    converted: Motion = msgspec.convert(motion, Motion)
    return converted


def _spec(robot: Mapping[str, Any]) -> RobotSpec:
    x, y = robot["position_m"]
    vx, vy = robot["velocity_mps"]
    return RobotSpec(robot["robot"], (x, y), robot["heading_rad"], (vx, vy), "", {})


def _command(record: Mapping[str, Any]) -> MotionCommand:
    x, y = record["velocity_mps"]
    return MotionCommand((x, y), record["towards_m"] and tuple(record["towards_m"]), record["speed_mps"])
