"""The robot's own body: where it is, and where it drives."""

from __future__ import annotations

import math
from typing import NamedTuple

from agent.outbox import Outbox
from channels.messages import MotionCommand


class Pose(NamedTuple):
    """Place and heading in the world frame."""

    x_m: float
    y_m: float
    heading_rad: float


class Body:
    """Own pose (localisation is perfect) and motion commands; the scenario says whether it can move."""

    def __init__(self, pose: tuple[float, float, float], outbox: Outbox, altitude_m: float = 0.0) -> None:
        self.altitude_m = altitude_m
        """Height above the plane in which robots move."""
        self._pose = Pose(*pose)
        self._outbox = outbox

    @property
    def pose(self) -> Pose:
        """Where the robot is now."""
        return self._pose

    def drive(self, vx_mps: float, vy_mps: float) -> None:
        """Move with this velocity until told otherwise or stopped by a wall.

        Raises ValueError for NaN and infinity, TooMuchAtOnce past 10 000 commands at one instant.
        """
        velocity = _finite(vx_mps, "vx_mps"), _finite(vy_mps, "vy_mps")
        self._outbox.command_motion(MotionCommand(velocity))

    def go_to(self, x_m: float, y_m: float, speed_mps: float) -> None:
        """Drive straight to a place and stop there.

        Raises ValueError for NaN, infinity and a negative speed, TooMuchAtOnce as `drive`.
        """
        place, speed = (_finite(x_m, "x_m"), _finite(y_m, "y_m")), _finite(speed_mps, "speed_mps")
        if speed < 0:
            raise ValueError(f"speed_mps is 0 or more, not {speed}")
        self._outbox.command_motion(MotionCommand(towards_m=place, speed_mps=speed))

    def stop(self) -> None:
        """Stand still."""
        self.drive(0.0, 0.0)

    def deliver(self, pose: tuple[float, float, float]) -> None:
        """Called by the link: the pose has changed."""
        self._pose = Pose(*pose)


def _finite(value: float, name: str) -> float:
    if not math.isfinite(value):
        raise ValueError(f"{name} is a finite number, not {value}")
    return float(value)
