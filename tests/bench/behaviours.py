"""Robots that exist to be measured."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Any

from agent.robot import Robot
from channels.units import to_ns
from logs.reader import LogReader

IDLE_PERIOD_S = 0.5


@dataclass
class Turn:
    """Ends when the same robot's next turn begins."""

    end_ns: int


async def take_turns(robot: Robot) -> None:
    """What association does in a step, but at every instant exactly one robot of the team is due.

    Params: those of association, and `team`, the number of robots.
    """
    period_s = float(robot.params["step_s"])
    probability = float(robot.params["transmission_probability"])
    await asyncio.sleep(period_s * (int(robot.id[1:]) + 0.5) / int(robot.params["team"]))
    while True:
        if robot.rng.random() < probability:
            robot.radio.broadcast({"id": robot.id})
            robot.lamp.flash(Turn(robot.now_ns + to_ns(period_s)))
        heard = sorted({message.sender for message in robot.radio.received()})
        lit = sum(colour > 0 for frame in robot.camera.frames() for colour in frame.lamps)
        robot.log("turn", {"heard": heard, "lit": lit})
        await asyncio.sleep(period_s)


async def idle(robot: Robot) -> None:
    """Nothing but time passing."""
    while True:
        await asyncio.sleep(IDLE_PERIOD_S)


def no_score(_log: LogReader) -> dict[str, Any]:
    """Scoring comes after the run and is not what is measured."""
    return {}
