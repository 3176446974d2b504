"""Cells, controller and cost for any places: a library, compiled code and definitions must agree."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agent.behaviours.coverage.cells import SAME_PLACE_M, own_cell, ring
from agent.behaviours.coverage.controller import centroid, velocity
from agent.behaviours.coverage.density import UNIFORM, Density, Hill
from scenarios.coverage.cost import cost
from scenarios.coverage.kernels import cell_ring, centroids, lloyd_step, moments

AREA = (90.0, 60.0)
AREA_ARRAY = np.array(AREA)
FEW = settings(max_examples=60, deadline=None)  # first calls compile
HILLY = Density(0.2, (Hill(30.0, 30.0, 8.0, 2.0),))

# Round numbers meet on lines, circles and walls; the others hardly ever do.
inside = st.one_of(
    st.tuples(st.floats(0, 90), st.floats(0, 60)),
    st.tuples(st.sampled_from([0.0, 15.0, 30.0, 45.0, 60.0, 90.0]), st.sampled_from([0.0, 15.0, 30.0, 60.0])),
    st.tuples(
        st.integers(-9, 9).map(lambda k: 45 + k * 1e-6), st.integers(-9, 9).map(lambda k: 30 + k * 1e-14)
    ),
)
anywhere = st.one_of(inside, st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)))


def apart(places: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Without those that share a place with an earlier one."""
    kept: list[tuple[float, float]] = []
    for place in places:
        if all(math.dist(place, other) > 2 * SAME_PLACE_M for other in kept):
            kept.append(place)
    return kept


@FEW
@given(st.lists(inside, min_size=1, max_size=12).map(apart))
def test_cells_share_out_the_area(places: list[tuple[float, float]]) -> None:
    cells = [own_cell(place, places[:i] + places[i + 1 :], AREA) for i, place in enumerate(places)]
    assert sum(cell.area for cell in cells) == pytest.approx(90 * 60, rel=1e-9)
    for place, cell in zip(places, cells, strict=True):
        corners = ring(cell)
        own = np.hypot(*(corners - place).T)
        nearest = np.min([np.hypot(*(corners - other).T) for other in places], axis=0)
        assert (own <= nearest + 1e-4).all()  # robots 1e-6 m apart: the line between them turns easily


@FEW
@given(inside, st.lists(anywhere, max_size=12))
def test_library_and_compiled_code_cut_the_same_cells(
    own: tuple[float, float], others: list[tuple[float, float]]
) -> None:
    places = np.array([own, *others, (math.nan, math.nan)])
    corners = cell_ring(0, places, AREA_ARRAY)
    cell = own_cell(own, others, AREA)
    found = UNIFORM.moments(ring(cell), own)
    mass, x, y, square = moments(corners, *own)
    assert mass == pytest.approx(found.mass, rel=1e-9, abs=1e-9)
    assert (x, y) == pytest.approx((found.x, found.y), rel=1e-9, abs=1e-6)
    assert square == pytest.approx(found.square, rel=1e-9, abs=1e-6)


@FEW
@given(st.lists(inside, min_size=1, max_size=8).map(apart), st.data())
def test_each_robot_is_drawn_by_its_own_picture(
    places: list[tuple[float, float]], data: st.DataObject
) -> None:
    n = len(places)
    known = data.draw(st.lists(st.booleans(), min_size=n * n, max_size=n * n))
    pictures = np.broadcast_to(np.array(places), (n, n, 2)).copy()
    pictures[~(np.array(known).reshape(n, n) | np.eye(n, dtype=bool))] = math.nan
    goals = centroids(pictures, AREA_ARRAY)
    for own in range(n):
        others = [place for j, place in enumerate(places) if known[own * n + j] and j != own]
        # Of robots 2e-6 m apart the cell is known to 1e-16 / 2e-6 of its size.
        assert goals[own] == pytest.approx(centroid(places[own], others, AREA), abs=1e-6)


@FEW
@given(anywhere, st.lists(anywhere, max_size=8), st.sampled_from([UNIFORM, HILLY]))
def test_robots_drive_into_the_area_and_no_faster_than_they_may(
    own: tuple[float, float], others: list[tuple[float, float]], density: Density
) -> None:
    x, y = centroid(own, others, AREA, density)
    assert -1e-9 <= x <= 90 + 1e-9
    assert -1e-9 <= y <= 60 + 1e-9
    speed = math.hypot(*velocity(own, others, AREA, density, 0.5, 4.0))
    assert speed <= 4.0 * (1 + 1e-12)
    assert speed == pytest.approx(min(4.0, 0.5 * math.dist(own, (x, y))), rel=1e-9, abs=1e-12)


@FEW
@given(st.lists(inside, min_size=1, max_size=9), st.sampled_from([UNIFORM, HILLY]))
def test_costs_do_not_rise_when_all_go_to_their_centroids(
    places: list[tuple[float, float]], density: Density
) -> None:
    before = cost(places, AREA, density)
    goals = [centroid(place, places[:i] + places[i + 1 :], AREA, density) for i, place in enumerate(places)]
    if len(apart(places)) == len(places):  # who shares a place shares a cell, which costs once
        assert cost(goals, AREA, density) <= before * (1 + 1e-9)
    _, compiled = lloyd_step(np.array(places), AREA_ARRAY)
    assert compiled == pytest.approx(cost(places, AREA), rel=1e-9)


@FEW
@given(st.lists(inside, min_size=2, max_size=9))
def test_one_robot_more_never_costs_more(places: list[tuple[float, float]]) -> None:
    assert cost(places, AREA) <= cost(places[:-1], AREA) * (1 + 1e-9)
