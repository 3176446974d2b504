"""The naive algorithm (Ivanov & Shell 2014, Algorithm 1): one robot at a time.

In step t = 1, ..., n the robot with number t - 1 flashes, and whoever sees a light knows whose it is. That
takes n steps, one flash per robot, and no radio after the roll call; see `numbered` for the roll call, the
params and the log.
"""

from __future__ import annotations

from agent.behaviours.association.numbered import Timetable, run
from agent.robot import Robot


class NaiveTable(Timetable):
    """Which light was lit in whose step."""

    @staticmethod
    def steps(ids: int) -> int:
        """One for every number."""
        return ids

    @staticmethod
    def flashes(number: int, step: int) -> bool:
        """Number k flashes in step k + 1."""
        return number == step - 1


async def associate(robot: Robot) -> None:
    """Associate the voices and the lights in range."""
    await run(robot, NaiveTable)
