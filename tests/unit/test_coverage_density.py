"""Densities: their moments against closed forms, and the sentences for what makes no sense."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from agent.behaviours.coverage.density import UNIFORM, Density, Hill, Moments, density_from

AREA = (90.0, 60.0)


def rectangle(x0: float, x1: float, y0: float, y1: float) -> np.ndarray:
    return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])


def one_dimension(begin: float, end: float, sigma: float) -> tuple[float, float, float]:
    """Integrals of g, t g and t^2 g over [begin, end], g = exp(-t^2 / (2 sigma^2))."""
    heights = [math.exp(-(t**2) / (2 * sigma**2)) for t in (begin, end)]
    mass = (
        sigma * math.sqrt(math.pi / 2) * (math.erf(end / sigma / 2**0.5) - math.erf(begin / sigma / 2**0.5))
    )
    first = -(sigma**2) * (heights[1] - heights[0])
    second = sigma**2 * (mass - (end * heights[1] - begin * heights[0]))
    return mass, first, second


def values(moments: Moments) -> list[float]:
    return [moments.mass, moments.x, moments.y, moments.square]


def test_uniform_moments_of_a_square_by_hand() -> None:
    square = rectangle(2.0, 4.0, 1.0, 3.0)
    assert values(UNIFORM.moments(square, (3.0, 2.0))) == pytest.approx([4, 0, 0, 2 * 4 * 4 / 12], abs=1e-12)
    # Steiner: 4 (1^2 + 2^2) more about a point one to the left and two below.
    assert values(UNIFORM.moments(square, (2.0, 0.0))) == pytest.approx([4, 4, 8, 8 / 3 + 4 * 5], abs=1e-12)


def test_uniform_moments_of_a_triangle_by_hand() -> None:
    triangle = np.array([(0.0, 0.0), (6.0, 0.0), (0.0, 3.0)])
    about_corner = UNIFORM.moments(triangle, (0.0, 0.0))
    assert values(about_corner) == pytest.approx([9, 18, 9, 6 * 3 * (36 + 9) / 12], abs=1e-12)


CENTRES = {
    "inside": (30.0, 25.0),
    "on a corner": (10.0, 5.0),
    "on an edge": (40.0, 5.0),
    "on a corner's line": (10.0, 50.0),
    "outside": (-25.0, 70.0),
}


@pytest.mark.parametrize("centre", CENTRES.values(), ids=CENTRES)
@pytest.mark.parametrize("sigma", [0.9, 7.0, 10.01, 15.01, 60.0, 2000.0])
def test_gaussian_moments_of_a_rectangle_are_products_of_error_functions(
    centre: tuple[float, float], sigma: float
) -> None:
    x0, x1, y0, y1 = 10.0, 70.0, 5.0, 45.0
    x = one_dimension(x0 - centre[0], x1 - centre[0], sigma)
    y = one_dimension(y0 - centre[1], y1 - centre[1], sigma)
    exact = 3.0 * np.array([x[0] * y[0], x[1] * y[0], x[0] * y[1], x[2] * y[0] + x[0] * y[2]])
    density = Density(1e-300, (Hill(*centre, sigma, 3.0),))
    found = np.array(values(density.moments(rectangle(x0, x1, y0, y1), centre)))
    scale = 3.0 * 2 * math.pi * sigma**2 * np.array([1, sigma, sigma, sigma**2])
    assert np.abs((found - exact) / scale).max() < 1e-14


def test_moments_of_a_slanting_cell_agree_with_a_fine_grid() -> None:
    density = Density(0.3, (Hill(30.0, 20.0, 9.0, 2.0), Hill(50.0, 40.0, 15.0, 1.0)))
    cell = np.array([(5.0, 3.0), (61.0, 12.0), (48.0, 51.0), (20.0, 44.0)])
    step = 0.1
    x, y = np.meshgrid(np.arange(0, 90, step) + step / 2, np.arange(0, 60, step) + step / 2)
    inside = np.ones_like(x, dtype=bool)
    for begin, end in zip(cell, np.roll(cell, -1, axis=0), strict=True):
        inside &= (end[0] - begin[0]) * (y - begin[1]) - (end[1] - begin[1]) * (x - begin[0]) > 0
    phi = density(x, y) * inside * step**2
    about = (11.0, 22.0)
    east, north = x - about[0], y - about[1]
    counted = [phi.sum(), (east * phi).sum(), (north * phi).sum(), ((east**2 + north**2) * phi).sum()]
    assert values(density.moments(cell, about)) == pytest.approx(counted, rel=2e-4)


def test_hills_add_up_and_the_point_of_reference_does_not_matter() -> None:
    one, other = Hill(20.0, 30.0, 5.0, 2.0), Hill(80.0, 10.0, 12.0, 0.5)
    cell = rectangle(10.0, 60.0, 0.0, 50.0)
    both = Density(1.5, (one, other)).moments(cell, (33.0, 44.0))
    apart = [
        Density(0.5, (one,)).moments(cell, (33.0, 44.0)),
        Density(1.0, (other,)).moments(cell, (33.0, 44.0)),
    ]
    assert values(both) == pytest.approx(np.sum([values(each) for each in apart], axis=0), rel=1e-12)
    moved = Density(1.5, (one, other)).moments(cell, (0.0, 0.0))
    assert moved.x - 33 * moved.mass == pytest.approx(both.x, rel=1e-9)
    assert moved.square - 2 * (33 * moved.x + 44 * moved.y) + (33**2 + 44**2) * moved.mass == pytest.approx(
        both.square, rel=1e-9
    )


def test_densities_are_read_from_params() -> None:
    assert density_from({}, AREA) == UNIFORM == density_from({"density": "uniform"}, AREA)
    hill = {"x_m": 20, "y_m": -5.0, "sigma_m": 10.0, "weight": 5}
    assert density_from({"density": {"hills": [hill]}}, AREA) == Density(1.0, (Hill(20.0, -5.0, 10.0, 5.0),))
    assert density_from({"density": {"floor": 2}}, AREA) == Density(2.0)


GOOD = {"x_m": 20.0, "y_m": 5.0, "sigma_m": 10.0, "weight": 5.0}


@pytest.mark.parametrize(
    ("described", "sentence"),
    [
        ("flat", 'params.density: must be "uniform" or a table of floor and hills, is \'flat\''),
        ({"peak": 1}, "params.density.peak: is not known here; there are floor, hills"),
        ({"floor": 0}, "params.density.floor: must be greater than 0"),
        ({"floor": True}, "params.density.floor: must be a number of at least 0, is True"),
        ({"floor": 1e-6, "hills": [GOOD]}, "params.density.floor: must be greater than 0 and at least 1e-06 of"),
        ({"hills": GOOD}, "params.density.hills: must be a list of at most 64 tables"),
        ({"hills": [GOOD] * 65}, "params.density.hills: must be a list of at most 64 tables"),
        ({"hills": [3]}, "params.density.hills[0]: must be a table of x_m, y_m, sigma_m and weight, is 3"),
        ({"hills": [GOOD, {**GOOD, "z_m": 1}]}, "params.density.hills[1].z_m: is not known here"),
        ({"hills": [{"x_m": 1.0}]}, "params.density.hills[0].y_m: is missing; write a number"),
        ({"hills": [{**GOOD, "sigma_m": 0.5}]}, "sigma_m: must be a number of at least 0.9 and at most 9000, is 0.5"),
        ({"hills": [{**GOOD, "weight": -1}]}, "weight: must be a number of at least 0, is -1"),
        ({"hills": [{**GOOD, "x_m": math.inf}]}, "x_m: must be a number, is inf"),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused_in_one_sentence(described: Any, sentence: str) -> None:
    with pytest.raises(ValueError) as failure:  # noqa: PT011 - the sentence is compared below
        density_from({"density": described}, AREA)
    assert sentence in str(failure.value)


def test_the_ends_of_what_is_allowed() -> None:
    area = (10.0, 100.0)

    def read(sigma_m: float, floor: float) -> Density:
        hill = {"x_m": 1.0, "y_m": 2.0, "sigma_m": sigma_m, "weight": 8.0}
        return density_from({"density": {"floor": floor, "hills": [hill]}}, area)

    for sigma_m, floor in ((1.0, 1.0), (10_000.0, 1.0), (5.0, 8e-6)):
        assert read(sigma_m, floor) == Density(floor, (Hill(1.0, 2.0, sigma_m, 8.0),))
    for sigma_m, floor in ((0.99, 1.0), (10_001.0, 1.0), (5.0, 7.9e-6)):
        with pytest.raises(ValueError, match=r"^params\.density\.(hills\[0\]\.sigma_m|floor): must be"):
            read(sigma_m, floor)
