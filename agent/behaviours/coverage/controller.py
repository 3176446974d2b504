"""The coverage controller: towards the centroid of the own Voronoi cell (Cortes et al. 2004, Lloyd's law).

What it knows of the others are places, however it came by them: any dissemination scheme will do.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from agent.behaviours.coverage.cells import Place, own_cell, ring
from agent.behaviours.coverage.density import UNIFORM, Density


def velocity(
    own: Place,
    others: Iterable[Place],
    area_m: tuple[float, float],
    density: Density,
    gain: float,
    max_speed: float,
) -> tuple[float, float]:
    """How a robot moves now [m/s]: `gain` [1/s] times the way to the centroid, at `max_speed` [m/s] or less.

    `own`: its place; `others`: where it takes the others to be, of those it knows. Raises ValueError as
    `own_cell` does, and for a gain or speed that is not greater than 0.
    """
    return towards(own, centroid(own, others, area_m, density), gain, max_speed)


def centroid(
    own: Place, others: Iterable[Place], area_m: tuple[float, float], density: Density = UNIFORM
) -> Place:
    """Of the own cell within the area, weighed by the density [m].

    Where the cell is empty, because the robot is outside the area, the nearest point of the area: back in,
    first of all.
    """
    cell = own_cell(own, others, area_m)
    if cell.is_empty:
        return min(max(own[0], 0.0), area_m[0]), min(max(own[1], 0.0), area_m[1])
    moments = density.moments(ring(cell), own)
    return own[0] + moments.x / moments.mass, own[1] + moments.y / moments.mass


def towards(own: Place, goal: Place, gain: float, max_speed: float) -> tuple[float, float]:
    """`gain` times the way from `own` to `goal`, shortened to `max_speed` where it is longer [m/s].

    Raises ValueError for a gain or speed that is not greater than 0.
    """
    if not gain > 0:
        raise ValueError(f"gain: must be greater than 0 1/s, is {gain}")
    if not max_speed > 0:
        raise ValueError(f"max_speed: must be greater than 0 m/s, is {max_speed}")
    x, y = gain * (goal[0] - own[0]), gain * (goal[1] - own[1])
    speed = math.hypot(x, y)
    shortened = min(1.0, max_speed / speed) if speed else 0.0
    return x * shortened, y * shortened
