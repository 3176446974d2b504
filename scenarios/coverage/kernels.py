"""Voronoi cells compiled, for Monte Carlo and searches: what the controller has by a geometry library.

Cells are cut out of the area one half-plane after the other, as in `agent.behaviours.coverage.cells`. Uniform
density. Shapes: places (n, 2); rings (corners, 2), counterclockwise; area (2,) is (width, height). Lengths in
metres. Nothing here draws at random.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

from agent.compiling import announce

Floats = NDArray[np.float64]
F = TypeVar("F", bound=Callable[..., object])

announce()

SAME_PLACE_M = 1e-6
"""That of the controller's cells; in figures, since numba would not notice if another module's changed."""


def compiled(function: F) -> F:
    """Compile at the first call, and keep the result for other processes."""
    return cast(F, njit(cache=True, boundscheck=True)(function))


@compiled
def cell_ring(own: int, places: Floats, area: Floats) -> Floats:
    """Corners of one robot's cell among places (NaN: unknown, left out); none where the cell is empty.

    Others within `SAME_PLACE_M` of the own place are left out.
    """
    x, y = places[own, 0], places[own, 1]
    ring = np.empty((2 * len(places) + 8, 2))  # rounding apart, a cut adds one corner at most
    ring[:4] = 0.0
    ring[1:3, 0] = area[0]
    ring[2:4, 1] = area[1]
    spare = np.empty_like(ring)
    corners = 4
    for other in range(len(places)):
        ahead_x, ahead_y = places[other, 0] - x, places[other, 1] - y
        if other == own or not math.hypot(ahead_x, ahead_y) > SAME_PLACE_M:
            continue
        middle_x, middle_y = (places[other, 0] + x) / 2, (places[other, 1] + y) / 2
        kept = 0
        for corner in range(corners):
            last = corner - 1 if corner else corners - 1
            before = (ring[last, 0] - middle_x) * ahead_x + (ring[last, 1] - middle_y) * ahead_y
            beyond = (ring[corner, 0] - middle_x) * ahead_x + (ring[corner, 1] - middle_y) * ahead_y
            if (before < 0.0 < beyond) or (beyond < 0.0 < before):
                part = before / (before - beyond)
                spare[kept, 0] = ring[last, 0] + part * (ring[corner, 0] - ring[last, 0])
                spare[kept, 1] = ring[last, 1] + part * (ring[corner, 1] - ring[last, 1])
                kept += 1
            if beyond <= 0.0:
                spare[kept, 0] = ring[corner, 0]
                spare[kept, 1] = ring[corner, 1]
                kept += 1
        ring, spare, corners = spare, ring, kept
    return ring[:corners].copy()


@compiled
def moments(ring: Floats, x: float, y: float) -> tuple[float, float, float, float]:
    """Mass, x, y and square of a cell about a point, as `agent.behaviours.coverage.density.Moments`."""
    mass, first_x, first_y, square = 0.0, 0.0, 0.0, 0.0
    for corner in range(len(ring)):
        begin_x, begin_y = ring[corner - 1, 0] - x, ring[corner - 1, 1] - y
        end_x, end_y = ring[corner, 0] - x, ring[corner, 1] - y
        double = begin_x * end_y - begin_y * end_x
        mass += double / 2
        first_x += double * (begin_x + end_x) / 6
        first_y += double * (begin_y + end_y) / 6
        square += (
            double * (begin_x * (begin_x + end_x) + end_x**2 + begin_y * (begin_y + end_y) + end_y**2) / 12
        )
    return mass, first_x, first_y, square


@compiled
def centroids(pictures: Floats, area: Floats) -> Floats:
    """Where each robot is drawn to, by its own picture of the team; shape (n, 2).

    `pictures[i, j]`: where robot i takes robot j to be, NaN where it does not know; `pictures[i, i]`:
    where it is, within the area. Shape (n, n, 2). A robot whose cell has no mass stays where it is.
    """
    found = np.empty((len(pictures), 2))
    for own in range(len(pictures)):
        x, y = pictures[own, own, 0], pictures[own, own, 1]
        mass, first_x, first_y, _ = moments(cell_ring(own, pictures[own], area), x, y)
        found[own, 0] = x + (first_x / mass if mass > 0.0 else 0.0)
        found[own, 1] = y + (first_y / mass if mass > 0.0 else 0.0)
    return found


@compiled
def lloyd_step(places: Floats, area: Floats) -> tuple[Floats, float]:
    """The centroids of the cells of all places, and what the places cost before (see `cost`).

    Of several robots at one place, all but the first do without a cell and stay.
    """
    found, apart = places.copy(), places.copy()
    for own in range(len(places)):
        for other in range(own):
            if math.hypot(apart[other, 0] - places[own, 0], apart[other, 1] - places[own, 1]) <= SAME_PLACE_M:
                apart[own] = math.nan
    total = 0.0
    for own in range(len(places)):
        x, y = apart[own, 0], apart[own, 1]
        if math.isnan(x):
            continue
        mass, first_x, first_y, square = moments(cell_ring(own, apart, area), x, y)
        total += square
        if mass > 0.0:
            found[own, 0] = x + first_x / mass
            found[own, 1] = y + first_y / mass
    return found, total
