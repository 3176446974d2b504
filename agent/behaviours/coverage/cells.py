"""The own Voronoi cell of a robot within a rectangular area (Julian et al. 2009, sec. 4; Cortes et al. 2004).

The area is (width, height) in metres; its corners are (0, 0) and (width, height).
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import shapely
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Place = tuple[float, float]
"""x and y [m]."""

SAME_PLACE_M = 1e-6
"""Nearer than this, two robots are at one place, and no line between them means anything."""


def check_area(area_m: tuple[float, float]) -> None:
    """Raises ValueError for an area that has no inside."""
    if not all(0 < side < math.inf for side in area_m):
        raise ValueError(f"area_m: both sides must be greater than 0 m and finite, are {list(area_m)}")


def own_cell(own: Place, others: Iterable[Place], area_m: tuple[float, float]) -> shapely.Polygon:
    """The part of the area that is nearer to `own` than to any of the `others`.

    Others may be anywhere, outside the area too. Those at the own place (`SAME_PLACE_M`) are left out: both
    robots then have the whole cell. Empty where nothing of the area is nearest to `own`, which must then
    lie outside it. Raises ValueError for an area without an inside, and for places that are no finite
    numbers.
    """
    # One half-plane after the other, and not shapely.voronoi_polygons: where robots lie on a circle but for
    # the last digits, as on a square grid, that one fails or returns cells that are grossly wrong.
    check_area(area_m)
    here, places = np.array(own), np.array(list(others)).reshape(-1, 2)
    if not (np.isfinite(here).all() and np.isfinite(places).all()):
        raise ValueError("places: must be finite numbers; leave out robots whose place is unknown")
    cell = shapely.box(0.0, 0.0, *area_m)
    reach = _reach(here, cell)
    distances = np.hypot(*(places - here).T)
    places, distances = _that_matter(places, distances, 2 * reach)
    halves = _nearer_halves(here, places, distances, 2 * reach + math.hypot(*area_m))
    for distance, half in zip(distances.tolist(), halves, strict=True):
        if distance > 2 * reach:  # this half-plane holds all that is left, and so do all further ones
            break
        cell = _polygon(shapely.intersection(cell, half))
        if cell.is_empty:
            break
        reach = _reach(here, cell)
    return cell


def ring(cell: shapely.Polygon) -> Floats:
    """The corners of a cell that is not empty, counterclockwise, each once; shape (corners, 2) [m]."""
    corners: Floats = shapely.get_coordinates(cell)[:-1]
    return corners if cell.exterior.is_ccw else corners[::-1]


def _that_matter(places: Floats, distances: Floats, farthest: float) -> tuple[Floats, Floats]:
    """Those neither too far nor at the own place, the nearest first (equally near ones as given)."""
    order = np.argsort(distances, kind="stable")
    order = order[(distances[order] > SAME_PLACE_M) & (distances[order] <= farthest)]
    return places[order], distances[order]


def _nearer_halves(own: Floats, others: Floats, distances: Floats, size: float) -> list[shapely.Polygon]:
    """Of the plane, as far as it matters, the halves that are nearer to `own`: rectangles of this size."""
    along = (others - own) / distances[:, np.newaxis] * size
    across = along[:, ::-1] * (-1.0, 1.0)
    middle = (own + others) / 2
    corners = [middle + across, middle + across - 2 * along, middle - across - 2 * along, middle - across]
    return list(shapely.polygons(np.stack(corners, axis=1)))


def _polygon(cut: shapely.Geometry) -> shapely.Polygon:
    """What is left has an area, or nothing is left: a touched edge or corner is no cell."""
    return cut if isinstance(cut, shapely.Polygon) else shapely.Polygon()


def _reach(own: Floats, cell: shapely.Polygon) -> float:
    """Distance from `own` to the farthest point of a cell."""
    return float(np.hypot(*(shapely.get_coordinates(cell) - own).T).max())
