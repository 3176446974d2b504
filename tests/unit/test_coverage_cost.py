"""The coverage cost against sums over a fine grid, and the least there is."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agent.behaviours.coverage.density import UNIFORM, Density, Hill
from scenarios.coverage import cost as module
from scenarios.coverage.cost import GRID_IS_BEST, cost, mean_until, optimum
from scenarios.coverage.kernels import lloyd_step

UNIT = (1.0, 1.0)
SQUARE = (90.0, 90.0)
HILLY = Density(0.5, (Hill(20.0, 60.0, 12.0, 3.0), Hill(70.0, 70.0, 25.0, 1.0)))


def summed(places: np.ndarray, area: tuple[float, float], density: Density, cells: int = 600) -> float:
    """The definition: the least square distance at the middle of each of cells x cells pixels."""
    x, y = np.meshgrid(*((np.arange(cells) + 0.5) * side / cells for side in area))
    squares = (x[..., np.newaxis] - places[:, 0]) ** 2 + (y[..., np.newaxis] - places[:, 1]) ** 2
    return float((squares.min(axis=-1) * density(x, y)).sum()) * area[0] * area[1] / cells**2


@pytest.mark.parametrize("density", [UNIFORM, HILLY], ids=["uniform", "hilly"])
@pytest.mark.parametrize("area", [SQUARE, (90.0, 55.0)])
def test_cells_and_pixels_agree(area: tuple[float, float], density: Density) -> None:
    places = np.random.default_rng(3).random((7, 2)) * (100.0, 80.0) - 5.0  # some lie outside
    assert cost(places, area, density) == pytest.approx(summed(places, area, density), rel=1e-4)


def test_compiled_cost_is_the_same() -> None:
    for seed in range(20):
        places = np.random.default_rng(seed).random((9, 2)) * 90
        assert lloyd_step(places, np.array(SQUARE))[1] == pytest.approx(cost(places, SQUARE), rel=1e-12)


def test_costs_by_hand() -> None:
    assert cost([(0.5, 0.5)], UNIT) == pytest.approx(1 / 6, rel=1e-12)
    assert cost([(0.0, 0.0)], UNIT) == pytest.approx(2 / 3, rel=1e-12)
    assert cost([(0.25, 0.5), (0.75, 0.5)], UNIT) == pytest.approx(5 / 48, rel=1e-12)
    assert cost([(-1.0, 0.5)], UNIT) == pytest.approx(1 / 6 + 1.5**2, rel=1e-12)


def test_robots_at_one_place_cost_as_one() -> None:
    assert cost([(0.5, 0.5)] * 3, UNIT) == pytest.approx(1 / 6, rel=1e-12)
    twins = np.array([(0.25, 0.5), (0.75, 0.5), (0.25, 0.5)])
    assert cost(twins, UNIT) == pytest.approx(5 / 48, rel=1e-12)
    assert lloyd_step(twins, np.array(UNIT))[1] == pytest.approx(5 / 48, rel=1e-12)


def test_without_robots_there_is_no_cost() -> None:
    with pytest.raises(ValueError, match="positions: nobody covers the area"):
        cost([], UNIT)


def test_the_least_of_nine_in_the_unit_square_is_a_54th() -> None:
    least = optimum(9, UNIT)
    assert least.exact
    assert least.value == 1 / 54
    assert cost(least.positions, UNIT) == pytest.approx(1 / 54, rel=1e-12)
    assert optimum(9, SQUARE).value == pytest.approx(90**4 / 54, rel=1e-12)
    assert optimum(9, UNIT, Density(2.5)).value == pytest.approx(2.5 / 54, rel=1e-12)


@pytest.mark.parametrize("k", GRID_IS_BEST[1:])
def test_where_the_grid_is_best_the_search_finds_nothing_better(k: int) -> None:
    found = module._searched(k * k, UNIT, UNIFORM).value
    assert found == pytest.approx(1 / (6 * k * k), rel=1e-8)
    assert found >= 1 / (6 * k * k) * (1 - 1e-12)


def test_sixteen_robots_do_better_than_a_grid() -> None:
    least = optimum(16, UNIT)
    assert not least.exact
    assert least.value < 0.998 / 96
    assert cost(least.positions, UNIT) == pytest.approx(least.value, rel=1e-12)


def test_the_best_places_of_two_are_halves() -> None:
    assert optimum(2, UNIT).value == pytest.approx(5 / 48, rel=1e-12)
    assert optimum(2, (2.0, 1.0)).value == pytest.approx(2 / 6, rel=1e-12)
    assert optimum(2, UNIT, Density(3.0)).value == pytest.approx(3 * 5 / 48, rel=1e-12)


def test_a_rectangle_is_searched() -> None:
    least = optimum(9, (2.0, 1.0))
    assert not least.exact
    assert all(0 < x < 2 and 0 < y < 1 for x, y in least.positions)
    assert least.value == pytest.approx(cost(least.positions, (2.0, 1.0)), rel=1e-9)


def test_one_robot_stands_at_the_centroid() -> None:
    least = optimum(1, SQUARE, HILLY)
    assert least.exact
    x, y = least.positions[0]
    around = [
        cost([(x + dx, y + dy)], SQUARE, HILLY) for dx, dy in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))
    ]
    assert least.value == pytest.approx(around[0], rel=1e-9)
    assert min(around[1:]) > around[0]


def test_the_search_for_hills_ends_where_nobody_gains_by_moving() -> None:
    least = optimum(2, SQUARE, HILLY)
    assert not least.exact
    places = np.array(least.positions)
    assert least.value == pytest.approx(cost(places, SQUARE, HILLY), rel=1e-9)
    rng = np.random.default_rng(5)
    moved = [cost(places + rng.normal(size=(2, 2)), SQUARE, HILLY) for _ in range(50)]
    assert min(moved) > least.value
    anywhere = [cost(rng.random((2, 2)) * 90, SQUARE, HILLY) for _ in range(50)]
    assert min(anywhere) > least.value


@pytest.mark.parametrize("robots", [0, 101])
def test_a_number_of_robots_out_of_bounds_is_refused(robots: int) -> None:
    with pytest.raises(
        ValueError, match=f"robots: the least cost is known or searched for 1 to 100, not {robots}"
    ):
        optimum(robots, UNIT)


def test_a_mean_over_time_is_an_area_under_straight_lines() -> None:
    assert mean_until(4.0, [0, 1, 4, 9], [2.0, 4.0, 1.0, 7.0]) == pytest.approx((3.0 + 7.5) / 4)
    assert mean_until(3.0, [0, 1, 4, 9], [2.0, 4.0, 1.0, 7.0]) == pytest.approx((3.0 + 6.0) / 3)
    assert mean_until(4.0, [1, 3, 4], [2.0, 4.0, 6.0]) == pytest.approx((6.0 + 5.0) / 3)  # from 1 on
    assert mean_until(10.0, [0, 1, 4, 9], [2.0, 4.0, 1.0, 7.0]) is None
    assert mean_until(2.0, [2, 3], [1.0, 1.0]) is None


def test_hexagons_cost_less_than_squares() -> None:
    """The figures that the reason for `GRID_IS_BEST` rests on, in units of area squared."""
    side = math.sqrt(2 / (3 * math.sqrt(3)))
    hexagon = np.array([(side * math.cos(a), side * math.sin(a)) for a in np.arange(6) * math.pi / 3])
    moments = UNIFORM.moments(hexagon, (0.0, 0.0))
    assert moments.mass == pytest.approx(1, rel=1e-12)
    assert moments.square == pytest.approx(5 * math.sqrt(3) / 54, rel=1e-12)
    assert moments.square < 1 / 6
