"""Where robots were at any instant of a run, exactly, from what /truth of its log tells."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import msgspec
from numpy.typing import NDArray

from channels.messages import MotionCommand
from emulator.scenario import Motion, RobotSpec
from emulator.world import World


def positions(
    truth: Sequence[tuple[int, Mapping[str, Any]]], motion: Mapping[str, Any], times_ns: Iterable[int]
) -> Iterator[NDArray[Any]]:
    """x, y [m] of every robot, (N, 2), at each of these instants, which must not go back.

    `truth`: (log time [ns], record) of all /truth; `motion`: the scenario's `world.motion`.
    """
    start = next(record for _, record in truth if record["kind"] == "start")
    names = [robot["robot"] for robot in start["robots"]]
    world = World(tuple(start["area_m"]), [_spec(robot) for robot in start["robots"]], _motion(motion))
    commands = [(time_ns, record) for time_ns, record in truth if record["kind"] == "motion"]
    applied = 0
    for now_ns in times_ns:
        while applied < len(commands) and commands[applied][0] <= now_ns:
            time_ns, record = commands[applied]
            world.command(names.index(record["robot"]), time_ns, _command(record))
            applied += 1
        yield world.positions(now_ns)


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
