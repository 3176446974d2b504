"""The world of mobile association: a jittered grid of standing robots, and robots that drive through it.

Ivanov & Shell 2016, sec. 5.4. Lengths are in robot diameters, times in steps.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

BLOCK = 2**21
"""Pairs of an observer and a cell that are looked at together."""


def cells_per_side(side: float, separation: float) -> int:
    """Grid positions along one side, of the whole number nearest to `separation`.

    Where the side is no multiple of the separation the cells are stretched or squeezed to fill it evenly.
    """
    return max(1, round(side / separation))


def robots_in(side: float, separation: float, mobile_fraction: float) -> tuple[int, int]:
    """How many robots there are, and how many of them, at least one, are mobile."""
    robots = cells_per_side(side, separation) ** 2
    return robots, min(robots, max(1, round(mobile_fraction * robots)))


class World:
    """Robots 0 ... mobile - 1 drive and observe, mobile ... robots - 1 stand.

    A square of `side` diameters with one grid position every `separation` diameters. Mobile robots take
    the place of grid robots drawn at random, but start anywhere in the world, in any direction, drive
    `speed` diameters a step and bounce off the walls. A standing robot is displaced from the centre of its
    cell by up to half a cell along each axis, uniformly.
    """

    def __init__(
        self,
        generator: np.random.Generator,
        *,
        side: float,
        separation: float,
        mobile_fraction: float,
        speed: float,
    ) -> None:
        self.side = side
        self.robots, self.mobile = robots_in(side, separation, mobile_fraction)
        self._per_side = cells_per_side(side, separation)
        self._spacing = side / self._per_side
        # In order: what is known of robots with numbers close to each other is found together in memory.
        cells = np.sort(generator.permutation(self.robots)[self.mobile :])
        corners = np.stack(np.divmod(cells, self._per_side), axis=1)
        self.standing: Floats = (corners + generator.random((len(cells), 2))) * self._spacing
        """Shape (robots - mobile, 2)."""
        self.position: Floats = generator.random((self.mobile, 2)) * side
        """Of the mobile robots; shape (mobile, 2)."""
        heading = generator.random(self.mobile) * 2 * math.pi
        self.velocity: Floats = speed * np.stack([np.cos(heading), np.sin(heading)], axis=1)
        self._cells = cells
        self._windows: dict[float, _Window] = {}

    def move(self) -> None:
        """One step ahead, bouncing off the walls; no step is longer than the side."""
        self.position += self.velocity
        outside = (self.position < 0) | (self.position > self.side)
        self.velocity[outside] *= -1
        below = self.position < 0
        self.position[below] *= -1
        above = self.position > self.side
        self.position[above] = 2 * self.side - self.position[above]

    def in_range(self, reach: float) -> Ints:
        """Pairs of an observer and another robot at most `reach` apart: observer * robots + other, sorted."""
        if reach not in self._windows:
            self._windows[reach] = _Window(self, self._cells, self._per_side, self._spacing, reach)
        standing = self._windows[reach].standing_around(self.position)
        met = cKDTree(self.position).query_pairs(reach, output_type="ndarray").astype(np.int64)
        one, other = met[:, 0], met[:, 1]
        pairs = np.concatenate([one * self.robots + other, other * self.robots + one, *standing])
        pairs.sort()
        return pairs

    def deep(self, depth: float) -> NDArray[np.bool_]:
        """Which observers are farther than `depth` from every wall; shape (mobile,)."""
        inside = (self.position > depth) & (self.position < self.side - depth)
        return np.asarray(inside.all(axis=1))


class _Window:
    """Finds standing robots in range: each stays in its own cell, so only the cells around are asked."""

    def __init__(self, world: World, cells: Ints, per_side: int, spacing: float, reach: float) -> None:
        self._robots = world.robots
        self._reach = reach
        self._spacing = spacing
        self._per_side = per_side
        self._margin = min(per_side, math.floor(reach / spacing) + 1)
        self._width = per_side + 2 * self._margin
        row, column = np.divmod(cells, per_side)
        places = (row + self._margin) * self._width + column + self._margin
        self._tenant = np.full(self._width**2, -1)
        self._tenant[places] = np.arange(world.mobile, world.robots)
        self._x = np.full(self._width**2, np.inf)
        self._x[places] = world.standing[:, 0]
        self._y = np.full(self._width**2, np.inf)
        self._y[places] = world.standing[:, 1]
        self._offsets = self._offsets_in_reach()

    def _offsets_in_reach(self) -> Ints:
        away = np.arange(-self._margin, self._margin + 1)
        least = np.maximum(np.abs(away) - 1, 0) * self._spacing
        rows, columns = np.nonzero(np.add.outer(least**2, least**2) <= self._reach**2)
        return np.asarray(away[rows] * self._width + away[columns])

    def standing_around(self, position: Floats) -> Iterator[Ints]:
        """Pairs of an observer and a standing robot, as observer * robots + other; block by block."""
        corner = np.minimum((position / self._spacing).astype(np.int64), self._per_side - 1) + self._margin
        centres = corner[:, 0] * self._width + corner[:, 1]
        block = max(1, BLOCK // len(self._offsets))
        for start in range(0, len(position), block):
            part = slice(start, start + block)
            places = centres[part, np.newaxis] + self._offsets
            away_x = self._x[places] - position[part, :1]
            away_y = self._y[places] - position[part, 1:]
            near = away_x**2 + away_y**2 <= self._reach**2
            yield (np.nonzero(near)[0] + start) * self._robots + self._tenant[places[near]]
