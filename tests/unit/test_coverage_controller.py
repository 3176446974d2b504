"""The coverage controller: where it drives, and how fast."""

from __future__ import annotations

import math

import pytest

from agent.behaviours.coverage.cells import Place
from agent.behaviours.coverage.controller import centroid, towards, velocity
from agent.behaviours.coverage.density import UNIFORM, Density, Hill

SQUARE = (90.0, 90.0)


def test_a_robot_alone_drives_to_the_middle() -> None:
    assert velocity((43.0, 46.0), [], SQUARE, UNIFORM, 0.5, 4.0) == pytest.approx((1.0, -0.5), abs=1e-12)


def test_with_a_neighbour_it_drives_to_the_middle_of_its_half() -> None:
    assert centroid((20.0, 45.0), [(60.0, 45.0)], SQUARE) == pytest.approx((20.0, 45.0), abs=1e-12)
    assert velocity((22.0, 44.0), [(58.0, 44.0)], SQUARE, UNIFORM, 1.0, 9.0) == pytest.approx((-2.0, 1.0))


def test_speed_is_limited_and_the_direction_stays() -> None:
    x, y = velocity((5.0, 15.0), [], SQUARE, UNIFORM, 0.5, 4.0)
    assert math.hypot(x, y) == pytest.approx(4.0, rel=1e-12)
    assert y / x == pytest.approx(30 / 40, rel=1e-12)


def test_who_has_arrived_stays() -> None:
    assert towards((1.0, 2.0), (1.0, 2.0), 0.5, 4.0) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("own", "goal"), [((-30.0, 45.0), (0.0, 45.0)), ((95.0, 99.0), (90.0, 90.0)), ((50.0, -9.0), (50.0, 0.0))]
)
def test_outside_without_a_cell_it_drives_back_in(
    own: tuple[float, float], goal: tuple[float, float]
) -> None:
    inside = (min(max(own[0], 1.0), 89.0), min(max(own[1], 1.0), 89.0))
    assert centroid(own, [inside], SQUARE) == goal


@pytest.mark.parametrize(
    ("own", "other", "goal"),
    [((45.0, 50.0), (45.0, 29.0), (45.0, 30.0)), ((120.0, 15.0), (89.0, 15.0), (90.0, 15.0)), ((-9.0, -9.0), (1.0, 1.0), (0.0, 0.0))],
)  # fmt: skip
def test_back_in_is_the_nearest_point_of_a_rectangle(own: Place, other: Place, goal: Place) -> None:
    assert centroid(own, [other], (90.0, 30.0)) == goal


def test_a_hill_draws_robots_to_it() -> None:
    hill = Density(1e-3, (Hill(70.0, 20.0, 5.0, 1.0),))
    x, y = centroid((45.0, 45.0), [], SQUARE, hill)
    floor, top = 1e-3 * 8100, 2 * math.pi * 25
    assert x == pytest.approx((45 * floor + 70 * top) / (floor + top), rel=1e-3)
    assert y == pytest.approx((45 * floor + 20 * top) / (floor + top), rel=1e-3)


def test_the_floors_height_does_not_matter_by_itself() -> None:
    others = [(60.0, 70.0), (10.0, 80.0)]
    assert centroid((30.0, 20.0), others, SQUARE, Density(7.0)) == pytest.approx(
        centroid((30.0, 20.0), others, SQUARE), abs=1e-12
    )


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan])
def test_gain_and_speed_must_be_positive(bad: float) -> None:
    with pytest.raises(ValueError, match="gain: must be greater than 0 1/s"):
        towards((0.0, 0.0), (1.0, 1.0), bad, 4.0)
    with pytest.raises(ValueError, match="max_speed: must be greater than 0 m/s"):
        towards((0.0, 0.0), (1.0, 1.0), 0.5, bad)
