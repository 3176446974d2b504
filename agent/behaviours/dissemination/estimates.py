"""What a robot knows of where everybody is (Julian et al. 2009, sec. 2.1).

One table per robot, shared by all schemes of selection. Pure bookkeeping: no radio, no clock.
"""

from __future__ import annotations

from enum import IntEnum

from msgspec import Struct


class Estimate(Struct, frozen=True, gc=False):
    """Where a robot was, and when: p_j(t_ij)."""

    number: int
    """The robot's place in the team, 0 ... n - 1."""
    time_ms: int
    """When it was there, by its own clock [ms]."""
    x_m: float
    y_m: float
    z_m: float
    """Altitude."""
    yaw_rad: float


class News(IntEnum):
    """What a received estimate was to its receiver."""

    nothing = 0
    """Not newer than what was known, or of the receiver itself."""
    newer = 1
    first = 2
    """The first ever of this robot."""


class EstimateTable:
    """The newest estimate of each robot; unknown is unknown. The own state comes from the robot alone.

    `own`: the robot's number; `team`: n, the size of the team. Numbers are 0 ... n - 1. Raises ValueError
    where the own number is none of them.
    """

    def __init__(self, own: int, team: int) -> None:
        if not 0 <= own < team:
            raise ValueError(f"number: a team of {team} has the numbers 0 to {team - 1}, not {own}")
        self.own = own
        self._estimates: list[Estimate | None] = [None] * team
        self._unknown = team

    def __getitem__(self, number: int) -> Estimate | None:
        return self._estimates[number]

    @property
    def complete(self) -> bool:
        """Whether all n are known."""
        return self._unknown == 0

    def update_own(self, estimate: Estimate) -> None:
        """The own state as it is now, whatever its time stamp. Raises ValueError for somebody else's."""
        if estimate.number != self.own:
            raise ValueError(f"number: the own estimate of robot {self.own} says {estimate.number}")
        self._put(estimate)

    def receive(self, estimate: Estimate) -> News:
        """Take in what somebody broadcast. Strictly newer wins; about itself a robot knows better.

        Raises ValueError for a number that is none of the team's.
        """
        number = estimate.number
        if not 0 <= number < len(self._estimates):
            last = len(self._estimates) - 1
            raise ValueError(f"number: an estimate of robot {number}, but the team's are 0 to {last}")
        if number == self.own:
            return News.nothing
        known = self._estimates[number]
        if known is not None and estimate.time_ms <= known.time_ms:
            return News.nothing
        self._put(estimate)
        return News.first if known is None else News.newer

    def known(self) -> list[int]:
        """Numbers of the others that are known, ascending."""
        return [estimate.number for estimate in self.others()]

    def others(self) -> list[Estimate]:
        """Estimates of the others that are known, by number."""
        return [each for each in self._estimates if each is not None and each.number != self.own]

    def listed(self) -> list[Estimate | None]:
        """Everybody's by number, the own included; None: unknown."""
        return list(self._estimates)

    def stamps(self) -> list[int | None]:
        """Everybody's time stamp [ms] by number, the own included; None: unknown."""
        return [None if each is None else each.time_ms for each in self._estimates]

    def _put(self, estimate: Estimate) -> None:
        self._unknown -= self._estimates[estimate.number] is None
        self._estimates[estimate.number] = estimate
