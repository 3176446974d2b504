"""The own Voronoi cell: by hand, at the edges, and where a general Voronoi diagram goes wrong."""

from __future__ import annotations

import math

import numpy as np
import pytest
from shapely import Point, box

from agent.behaviours.coverage.cells import SAME_PLACE_M, own_cell, ring
from scenarios.coverage import kernels

SQUARE = (90.0, 90.0)
GRID = [(15.0 + 30 * x, 15.0 + 30 * y) for y in range(3) for x in range(3)]


def test_a_robot_alone_has_the_whole_area() -> None:
    assert own_cell((10.0, 20.0), [], (90.0, 60.0)).equals(box(0, 0, 90, 60))


def test_two_robots_share_the_area_along_the_line_between_them() -> None:
    assert own_cell((20.0, 45.0), [(60.0, 45.0)], SQUARE).equals(box(0, 0, 40, 90))
    assert own_cell((60.0, 45.0), [(20.0, 45.0)], SQUARE).equals(box(40, 0, 90, 90))


@pytest.mark.parametrize("number", range(9))
def test_nine_robots_on_a_grid_have_a_square_each(number: int) -> None:
    x, y = GRID[number]
    others = GRID[:number] + GRID[number + 1 :]
    cell = own_cell((x, y), others, SQUARE)
    assert cell.symmetric_difference(box(x - 15, y - 15, x + 15, y + 15)).area < 1e-9


def test_a_cell_by_hand_in_a_corner_with_a_slanting_neighbour() -> None:
    # Nearer to (0, 0) than to (30, 40): 30 x + 40 y < 1250, a triangle to (125/3, 0) and (0, 31.25).
    cell = own_cell((0.0, 0.0), [(30.0, 40.0)], SQUARE)
    assert cell.area == pytest.approx(1250 / 30 * 1250 / 40 / 2, rel=1e-12)
    assert cell.centroid.distance(Point(1250 / 90, 1250 / 120)) < 1e-9


def test_collinear_robots_have_strips() -> None:
    cell = own_cell((30.0, 45.0), [(10.0, 45.0), (40.0, 45.0), (80.0, 45.0)], SQUARE)
    assert cell.equals(box(20, 0, 35, 90))


@pytest.mark.parametrize("own", [(0.0, 45.0), (90.0, 45.0), (45.0, 0.0), (0.0, 0.0), (90.0, 90.0)])
def test_a_robot_on_a_wall_has_a_cell(own: tuple[float, float]) -> None:
    cell = own_cell(own, [(45.0, 45.0)], SQUARE)
    assert cell.area > 1000
    assert cell.distance(Point(own)) == 0


def test_robots_at_one_place_both_have_the_whole_cell() -> None:
    alone = own_cell((20.0, 45.0), [(60.0, 45.0)], SQUARE)
    assert own_cell((20.0, 45.0), [(20.0, 45.0), (60.0, 45.0)], SQUARE).equals(alone)
    hardly = (20.0 + SAME_PLACE_M / 2, 45.0)
    assert own_cell((20.0, 45.0), [hardly, (60.0, 45.0)], SQUARE).equals(alone)


def test_a_robot_almost_at_the_own_place_takes_half() -> None:
    cell = own_cell((20.0, 45.0), [(20.0 + 4 * SAME_PLACE_M, 45.0)], SQUARE)
    assert cell.area == pytest.approx(20 * 90, abs=1e-3)


def test_others_may_be_outside_the_area() -> None:
    assert own_cell((20.0, 45.0), [(-10.0, 45.0)], SQUARE).equals(box(5, 0, 90, 90))
    assert own_cell((20.0, 45.0), [(1e9, 45.0), (45.0, -1e300)], SQUARE).equals(box(0, 0, 90, 90))


def test_a_robot_outside_has_what_is_nearest_to_it_and_perhaps_nothing() -> None:
    assert own_cell((-10.0, 45.0), [(30.0, 45.0)], SQUARE).equals(box(0, 0, 10, 90))
    assert own_cell((-30.0, 45.0), [(10.0, 45.0)], SQUARE).is_empty
    assert own_cell((-30.0, 45.0), [(30.0, 45.0)], SQUARE).is_empty  # a touched edge is no cell


def test_robots_on_a_circle_but_for_the_last_digits() -> None:
    """For 1e-15 and 1e-14 the cells of GEOS 3.14's Voronoi diagram overlap: up to three times the area."""
    angles = np.array([0.3, 1.1, 2.0, 2.7, 3.6, 4.4, 5.5])
    for size in 10.0 ** np.arange(-15, -3):
        radii = 20 + size * np.array([0.4, -0.9, 0.1, 0.7, -0.3, 0.9, -0.6])
        circle = [(45 + r * math.cos(a), 45 + r * math.sin(a)) for r, a in zip(radii, angles, strict=True)]
        cells = [own_cell(place, circle[:i] + circle[i + 1 :], SQUARE) for i, place in enumerate(circle)]
        assert sum(cell.area for cell in cells) == pytest.approx(8100, rel=1e-12)


def test_the_ring_is_counterclockwise_and_closes_by_itself() -> None:
    corners = ring(own_cell((20.0, 45.0), [(60.0, 45.0)], SQUARE))
    assert corners.shape == (4, 2)
    x, y = corners.T
    assert (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2 == 40 * 90


@pytest.mark.parametrize("area", [(0.0, 90.0), (90.0, -1.0), (math.inf, 90.0), (math.nan, 90.0)])
def test_an_area_without_an_inside_is_refused(area: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="area_m: both sides must be greater than 0 m and finite"):
        own_cell((0.0, 0.0), [], area)


@pytest.mark.parametrize("place", [(math.nan, 0.0), (0.0, math.inf)])
def test_places_that_are_no_numbers_are_refused(place: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="places: must be finite numbers; leave out"):
        own_cell(place, [], SQUARE)
    with pytest.raises(ValueError, match="places: must be finite numbers; leave out"):
        own_cell((1.0, 1.0), [place], SQUARE)


def test_compiled_cells_use_the_same_smallest_distance() -> None:
    assert kernels.SAME_PLACE_M == SAME_PLACE_M
