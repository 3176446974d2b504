"""Where every robot is at any instant, in closed form: no tick, no accumulated state.

Positions come from + - * / sqrt and fmod alone, which IEEE 754 rounds alike everywhere, so they are equal on
every machine; headings come from atan2 and are therefore quantised to 1e-9 rad.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from channels.graphs import Graph
from channels.messages import MotionCommand
from channels.units import MAX_TIME_NS, NS_PER_S, to_ns
from emulator.graph_places import Places
from emulator.placement import Vector, heading_of
from emulator.scenario import BounceMotion, CommandedMotion, Motion, RobotSpec

Floats: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int64]

NEVER_NS = 2 * MAX_TIME_NS
"""An instant no run reaches."""


class World:
    """A rectangle [0, width] x [0, height] of metres with robots in it, indexed in the order of `specs`.

    `graph`, in metres: `places` are its vertices. Raises ValueError for a robot that starts outside.
    """

    def __init__(
        self, area_m: Vector, specs: Sequence[RobotSpec], motion: Motion, graph: Graph | None = None
    ) -> None:
        starts = np.array([spec.position_m for spec in specs], dtype=np.float64).reshape(-1, 2)
        for spec, start in zip(specs, starts, strict=True):
            if not ((start >= 0).all() and (start <= area_m).all()):
                raise ValueError(f"robot {spec.id} starts at {spec.position_m}, outside the area {area_m}")
        self._movement: _Movement
        if isinstance(motion, BounceMotion):
            self._movement = _Bouncing(area_m, starts, specs)
        else:
            max_speed_mps = motion.max_speed_mps if isinstance(motion, CommandedMotion) else 0.0
            self._movement = _Legs(area_m, starts, [spec.heading_rad for spec in specs], max_speed_mps)
        self._places = None if graph is None else Places(graph, starts)
        self._takes_commands = isinstance(motion, CommandedMotion)
        self._commanded_ns = 0
        self._computed_ns = -1
        self._positions = self._poses = starts

    def positions(self, t_ns: int) -> Floats:
        """x, y [m] of every robot, float64 (N, 2), read-only.

        The same array object comes back for as long as nothing moves. Raises ValueError for an instant
        before the latest command: what was true then is forgotten.
        """
        self._compute(t_ns)
        return self._positions

    def poses(self, t_ns: int) -> Floats:
        """x, y [m], heading [rad] of every robot, float64 (N, 3); otherwise as `positions`."""
        self._compute(t_ns)
        return self._poses

    def places(self, t_ns: int) -> Ints | None:
        """The vertex that every robot communicates from, int64 (N,), read-only; otherwise as `positions`.

        See `graph_places.Places`; -1 for a robot that has stood at none, None for a world without a graph.
        """
        if self._places is None:
            return None
        self._check_instant(t_ns)
        return self._places.at(t_ns)

    def command(self, robot: int, t_ns: int, command: MotionCommand) -> None:
        """From `t_ns` on a robot drives with a velocity, or straight to a place where it stops.

        Faster than the world allows becomes as fast as it allows. A robot that reaches a wall stops
        there; it does not slide along it. Raises ValueError for a world that takes no commands, a
        command before an earlier one, or numbers that are not finite.
        """
        if not self._takes_commands:
            raise ValueError('robots cannot be moved in this world; it needs world.motion.kind = "commanded"')
        self._check_instant(t_ns)
        numbers = (*command.velocity_mps, *(command.towards_m or ()))
        if not all(math.isfinite(number) for number in numbers):
            raise ValueError(f"{numbers} are not all finite numbers")
        self._commanded_ns = t_ns
        if self._movement.command(robot, t_ns, command):
            self._computed_ns = -1
            if self._places is not None:
                self._places.depart(robot, t_ns, *self._movement.leg(robot))

    def _compute(self, t_ns: int) -> None:
        self._check_instant(t_ns)
        # All instants from then on look alike.
        t_ns = min(t_ns, self._movement.moving_until_ns)
        if t_ns == self._computed_ns:
            return
        positions, headings = self._movement.at(t_ns)
        self._positions, self._poses = positions, np.column_stack((positions, headings))
        self._positions.flags.writeable = self._poses.flags.writeable = False
        self._computed_ns = t_ns

    def _check_instant(self, t_ns: int) -> None:
        if t_ns < self._commanded_ns:
            raise ValueError(f"instant {t_ns} ns lies before the latest command, at {self._commanded_ns} ns")


class _Movement(Protocol):
    moving_until_ns: int
    """Nothing moves or turns from this instant on."""

    def at(self, t_ns: int) -> tuple[Floats, Floats]:
        """Positions (N, 2) and headings (N,), as new arrays."""

    def command(self, robot: int, t_ns: int, command: MotionCommand) -> bool:
        """Whether it changes anything."""

    def leg(self, robot: int) -> tuple[Vector, Vector, int]:
        """Where the robot's present leg begins, where it ends, and when."""


class _Bouncing:
    """Straight lines, reflected at the walls.

    Unfolded at its walls, an axis of length L is a line on which a robot drives on for ever; the place in
    the area is an even triangle wave of period 2 L along that line.
    """

    def __init__(self, area_m: Vector, starts: Floats, specs: Sequence[RobotSpec]) -> None:
        velocities = np.array([spec.velocity_mps for spec in specs], dtype=np.float64).reshape(-1, 2)
        self._lengths = np.array(area_m)
        self._starts, self._velocities = starts, velocities
        self._headings = _reflected_headings(specs)
        self._robots = np.arange(len(specs))
        self.moving_until_ns = NEVER_NS if velocities.any() else 0

    def at(self, t_ns: int) -> tuple[Floats, Floats]:
        unfolded = self._starts + self._velocities * (t_ns / NS_PER_S)
        phases = np.abs(np.fmod(unfolded, 2.0 * self._lengths))
        second_half = phases >= self._lengths
        positions = np.where(second_half, 2.0 * self._lengths - phases, phases)
        # Before its first wall a robot that starts backwards runs through a first half against the wave.
        back = (second_half | ((self._velocities < 0) & (unfolded > 0))).astype(np.intp)
        return positions, self._headings[self._robots, back[:, 0], back[:, 1]]

    def command(self, robot: int, t_ns: int, command: MotionCommand) -> bool:
        raise NotImplementedError

    def leg(self, robot: int) -> tuple[Vector, Vector, int]:
        raise NotImplementedError


def _reflected_headings(specs: Sequence[RobotSpec]) -> Floats:
    """Heading of each robot by whether it moves back in x and in y: (N, 2, 2)."""
    headings = np.empty((len(specs), 2, 2))
    for robot, spec in enumerate(specs):
        x, y = abs(spec.velocity_mps[0]), abs(spec.velocity_mps[1])
        for back_x, back_y in np.ndindex(2, 2):
            velocity = (-x if back_x else x, -y if back_y else y)
            headings[robot, back_x, back_y] = heading_of(velocity, otherwise=spec.heading_rad)
    return headings


class _Legs:
    """Every robot drives one straight leg, from where it was told to until the leg ends, and then stands."""

    def __init__(
        self, area_m: Vector, starts: Floats, headings: Sequence[float], max_speed_mps: float
    ) -> None:
        robots = len(starts)
        self._area_m = area_m
        self._max_speed_mps = max_speed_mps
        self._starts, self._ends = starts.copy(), starts.copy()
        self._velocities = np.zeros((robots, 2))
        self._starts_ns = np.zeros(robots, dtype=np.int64)
        self._ends_ns = np.zeros(robots, dtype=np.int64)
        self._headings = np.array(headings, dtype=np.float64)
        self.moving_until_ns = 0

    def at(self, t_ns: int) -> tuple[Floats, Floats]:
        elapsed_s = (t_ns - self._starts_ns) / NS_PER_S
        driven = np.clip(self._starts + self._velocities * elapsed_s[:, None], 0.0, self._area_m)
        arrived = t_ns >= self._ends_ns
        return np.where(arrived[:, None], self._ends, driven), self._headings.copy()

    def command(self, robot: int, t_ns: int, command: MotionCommand) -> bool:
        here = self._position(robot, t_ns)
        velocity = self._velocity(here, command)
        if velocity == (0.0, 0.0) and t_ns >= self._ends_ns[robot]:
            return False
        end, duration_s = self._end(here, velocity, command.towards_m)
        self._starts[robot], self._ends[robot], self._velocities[robot] = here, end, velocity
        self._starts_ns[robot] = t_ns
        self._ends_ns[robot] = t_ns + to_ns(min(duration_s, NEVER_NS / NS_PER_S))
        self._headings[robot] = heading_of(velocity, otherwise=float(self._headings[robot]))
        self.moving_until_ns = int(self._ends_ns.max())
        return True

    def leg(self, robot: int) -> tuple[Vector, Vector, int]:
        (x0, y0), (x1, y1) = self._starts[robot].tolist(), self._ends[robot].tolist()
        return (x0, y0), (x1, y1), int(self._ends_ns[robot])

    def _position(self, robot: int, t_ns: int) -> Vector:
        positions, _ = self.at(t_ns)
        x, y = positions[robot].tolist()
        return x, y

    def _velocity(self, here: Vector, command: MotionCommand) -> Vector:
        if command.towards_m is None:
            wanted = command.velocity_mps
            return _scaled(wanted, self._max_speed_mps) if _length(wanted) > self._max_speed_mps else wanted
        way = (command.towards_m[0] - here[0], command.towards_m[1] - here[1])
        return _scaled(way, min(command.speed_mps, self._max_speed_mps))

    def _end(self, here: Vector, velocity: Vector, towards_m: Vector | None) -> tuple[Vector, float]:
        """Where a leg ends, and after how many seconds."""
        if velocity == (0.0, 0.0):
            return here, 0.0
        if towards_m is not None and all(0 <= towards_m[axis] <= self._area_m[axis] for axis in (0, 1)):
            way = (towards_m[0] - here[0], towards_m[1] - here[1])
            return towards_m, _length(way) / _length(velocity)
        times = [_time_to_wall(here[axis], velocity[axis], self._area_m[axis]) for axis in (0, 1)]
        duration_s = min(times)
        x, y = (
            (self._area_m[axis] if velocity[axis] > 0 else 0.0)
            if times[axis] == duration_s
            else min(max(here[axis] + velocity[axis] * duration_s, 0.0), self._area_m[axis])
            for axis in (0, 1)
        )
        return (x, y), duration_s


def _time_to_wall(place_m: float, velocity_mps: float, length_m: float) -> float:
    if velocity_mps == 0:
        return math.inf
    return (length_m - place_m if velocity_mps > 0 else place_m) / abs(velocity_mps)


def _length(vector: Vector) -> float:
    """Euclidean norm by sqrt, and without overflow; hypot's last bit differs between machines."""
    largest = max(abs(vector[0]), abs(vector[1]))
    if largest == 0:
        return 0.0
    x, y = vector[0] / largest, vector[1] / largest
    return largest * math.sqrt(x * x + y * y)


def _scaled(vector: Vector, length: float) -> Vector:
    """The vector brought to a length; zero stays zero."""
    largest = max(abs(vector[0]), abs(vector[1]))
    if largest == 0 or length == 0:
        return 0.0, 0.0
    x, y = vector[0] / largest, vector[1] / largest
    unit = math.sqrt(x * x + y * y)
    return x / unit * length, y / unit * length
