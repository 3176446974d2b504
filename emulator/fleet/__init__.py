"""The two ways to run robots. A fleet exchanges grants for reports, and does nothing else."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Protocol

from channels.messages import Hello, Report


class RobotFailure(Exception):
    """A robot that can no longer take part: which one, and why.

    `mistaken`: it cannot work with the scenario, and `cause` begins with the key.
    """

    def __init__(self, robot: str, cause: str, *, mistaken: bool = False) -> None:
        super().__init__(f"robot {robot} {cause}")
        self.robot = robot
        self.cause = cause
        self.mistaken = mistaken


class Fleet(Protocol):
    """Robots that run until idle whenever they are granted time."""

    def start(self, hellos: Sequence[Hello]) -> None:
        """Bring all robots up; returns when each has its behaviour. Raises RobotFailure."""

    def exchange(
        self, grants: Iterable[tuple[int, bytes]], meanwhile: Callable[[], None]
    ) -> Iterator[Report]:
        """Send (robot index, grant) each, call `meanwhile` once, yield the reports in that order.

        Robots compute while later grants are made and earlier reports are used. Raises RobotFailure
        in the place of the report that a robot fails to give: what came before it is the same in
        every run.
        """

    @property
    def refused(self) -> list[tuple[int, str]]:
        """Messages that were no reports, as (robot index, why), since this was last emptied."""

    def last_output(self, robot: str) -> list[str]:
        """The last lines a robot wrote, where they are known apart; complete once closed."""

    def close(self) -> None:
        """End every robot. Safe to call at any time and again."""
