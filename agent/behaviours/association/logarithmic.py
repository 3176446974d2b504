"""The logarithmic algorithm (Ivanov & Shell 2014, Algorithm 2): every light shows its number in binary.

In step t the robots whose number has bit t - 1 set flash, lowest bit first; number 0 never does. Numbers 0
to n - 1 take ceil(log2 n) steps, and no radio after the roll call; see `numbered` for the roll call, the
params and the log. (The pseudo-code's `table_arr[t][j]` means `[j][t - 1]`.)
"""

from __future__ import annotations

from agent.behaviours.association.numbered import Timetable, run
from agent.robot import Robot


class LogarithmicTable(Timetable):
    """Which light has shown which bits so far."""

    @staticmethod
    def steps(ids: int) -> int:
        """One for every bit of the largest number."""
        return (ids - 1).bit_length()

    @staticmethod
    def flashes(number: int, step: int) -> bool:
        """Number k flashes in step t if its bit t - 1 is set."""
        return bool(number >> (step - 1) & 1)


async def associate(robot: Robot) -> None:
    """Associate the voices and the lights in range."""
    await run(robot, LogarithmicTable)
