"""The coverage cost, and the least there is (Cortes et al. 2004; Julian et al. 2009, Fig. 3).

H(p) = integral over the area of min_i |q - p_i|^2 phi(q) dq, without a factor 1/2: for nine robots in the
unit square, uniformly, the least is 1/54.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from scipy.stats.qmc import Halton

from agent.behaviours.coverage.cells import SAME_PLACE_M, Place, check_area, own_cell, ring
from agent.behaviours.coverage.density import UNIFORM, Density
from scenarios.coverage.kernels import cell_ring, lloyd_step

Floats = NDArray[np.float64]
Area = tuple[float, float]

GRID_IS_BEST = (1, 2, 3)
"""k for which k x k robots cannot do better, as far as anybody knows, than as a square grid in a square.

Julian et al. state it of k = 3. The search below finds nothing better for any of these, and it does for
k = 4 (0.010394 of the unit square against 1/96) and k = 5 (0.006626 against 1/150): the more robots, the more
hexagons pay, which cost 5 sqrt(3) / 54 = 0.1604 of the square of their area, where squares cost 1/6.
"""
MOST_ROBOTS = 100
STARTS = 48
FINALISTS = 4
MOST_STEPS = 3000
NEARLY = 1e-4
SETTLED = 1e-8
"""Of the longer side: when nobody moves farther in a step, a search has arrived; at first only nearly."""


class Optimum(Struct, frozen=True):
    """The least cost, and places that have it."""

    value: float
    """[m^4] times the unit of phi."""
    positions: tuple[Place, ...]
    exact: bool
    """In closed form; otherwise the best that a search found."""


def cost(positions: Sequence[Place] | Floats, area_m: Area, density: Density = UNIFORM) -> float:
    """H of robots at these places, which may lie outside the area; shape (robots, 2) [m].

    By cells: exact for a uniform density, and as exact as `Density.moments` for others. Raises ValueError
    without robots, and as `own_cell` does.
    """
    places: list[Place] = []
    for x, y in positions:
        if all(math.dist((x, y), place) > SAME_PLACE_M for place in places):
            places.append((float(x), float(y)))
    if not places:
        raise ValueError("positions: nobody covers the area; give at least one robot's place")
    total = 0.0
    for number, place in enumerate(places):
        cell = own_cell(place, places[:number] + places[number + 1 :], area_m)
        if not cell.is_empty:
            total += density.moments(ring(cell), place).square
    return total


def mean_until(end_s: float, times_s: Sequence[float], values: Sequence[float]) -> float | None:
    """Mean over time from the first of `times_s` to `end_s`, straight lines between; None if they end before.

    By trapezoids, so that it hardly depends on how often one looked.
    """
    if times_s[-1] < end_s or times_s[0] >= end_s:
        return None
    times, inside = np.asarray(times_s), np.asarray(times_s) < end_s
    xs = np.append(times[inside], end_s)
    ys = np.append(np.asarray(values)[inside], np.interp(end_s, times, values))
    return float(np.trapezoid(ys, xs)) / (end_s - float(times[0]))


@lru_cache(maxsize=64)
def optimum(robots: int, area_m: Area, density: Density = UNIFORM) -> Optimum:
    """The least cost of so many robots, and places that have it.

    In closed form for one robot (the centroid) and for k x k robots in a square of uniform density, k in
    `GRID_IS_BEST`. Otherwise by Lloyd's algorithm from `STARTS` sets of points of a Halton sequence, of
    which the best `FINALISTS` go on to the end: the same every time, never less than the least, and not
    proven to be the least. Raises ValueError for a number of robots that is not 1 to `MOST_ROBOTS`, and as
    `own_cell` does.
    """
    check_area(area_m)
    if not 1 <= robots <= MOST_ROBOTS:
        raise ValueError(f"robots: the least cost is known or searched for 1 to {MOST_ROBOTS}, not {robots}")
    if robots == 1:
        return _of_one(area_m, density)
    k = math.isqrt(robots)
    if k * k == robots and k in GRID_IS_BEST and area_m[0] == area_m[1] and not density.hills:
        cell = area_m[0] / k
        grid = tuple(((x + 0.5) * cell, (y + 0.5) * cell) for y in range(k) for x in range(k))
        return Optimum(density.floor * area_m[0] ** 4 / (6 * robots), grid, True)
    return _searched(robots, area_m, density)


def _of_one(area_m: Area, density: Density) -> Optimum:
    width, height = area_m
    corners = np.array([(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)])
    about = density.moments(corners, (0.0, 0.0))
    place = (about.x / about.mass, about.y / about.mass)
    return Optimum(density.moments(corners, place).square, (place,), True)


def _searched(robots: int, area_m: Area, density: Density) -> Optimum:
    area = np.array(area_m)
    points = Halton(2, scramble=False)
    points.fast_forward(1)  # the first is a corner
    starts = [points.random(robots) * area for _ in range(STARTS)]
    descents = [_descended(places, area, density, NEARLY) for places in starts]
    finalists = sorted(descents, key=lambda descent: descent[0])[:FINALISTS]
    ends = [_descended(places, area, density, SETTLED) for _, places in finalists]
    value, places = min(ends, key=lambda end: end[0])
    return Optimum(value, tuple((x, y) for x, y in places.tolist()), False)


def _descended(places: Floats, area: Floats, density: Density, settled: float) -> tuple[float, Floats]:
    """Lloyd's algorithm: everybody to the centroid of its cell, until nobody moves; cost and places."""
    for _ in range(MOST_STEPS):
        found, value = _step(places, area, density)
        if np.abs(found - places).max() <= settled * area.max():
            break
        places = found
    return value, places


def _step(places: Floats, area: Floats, density: Density) -> tuple[Floats, float]:
    if not density.hills:
        found, value = lloyd_step(places, area)
        return found, density.floor * value
    found, value = places.copy(), 0.0
    for number, (x, y) in enumerate(places.tolist()):
        cell = cell_ring(number, places, area)
        if len(cell):
            moments = density.moments(cell, (x, y))
            found[number] = x + moments.x / moments.mass, y + moments.y / moments.mass
            value += moments.square
    return found, value
