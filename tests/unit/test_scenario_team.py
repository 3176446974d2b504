"""The team a scenario describes: who is in it, and where each one starts."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest

from emulator.placement import along, grid, heading_of, probability_in_range, side_for_neighbours
from emulator.scenario import RobotSpec, Settings, area_m, team, team_ids
from emulator.scenario_checks import check

BOUNCE = {"kind": "bounce", "speed_mps": 2.0}


def settings(world: dict[str, Any] | None = None, **keys: Any) -> Settings:
    raw: dict[str, Any] = {
        "behaviour": "module:function",
        "run": {"duration_s": 1},
        "world": {"area_m": [20, 10]} | (world or {}),
        "radio": {"range_m": 16},
    }
    made = msgspec.convert(raw | keys, Settings)
    check(made)
    return made


def robots(of: Settings) -> dict[str, RobotSpec]:
    return {spec.id: spec for spec in team(of)}


@pytest.mark.parametrize(
    ("number", "first", "last"),
    [(1, "r00", "r00"), (100, "r00", "r99"), (101, "r00", "r100"), (1000, "r00", "r999")],
)
def test_ids_by_number(number: int, first: str, last: str) -> None:
    ids = team_ids(settings(robots=number))
    assert (len(ids), ids[0], ids[-1]) == (number, first, last)


def test_ids_by_name_and_by_table() -> None:
    assert team_ids(settings(robots=["bob", "alice"])) == ["bob", "alice"]
    assert team_ids(settings(robot=[{"id": "bob"}, {"id": "alice"}])) == ["bob", "alice"]


def test_a_table_overrides_one_robot_of_the_team() -> None:
    own = {"id": "r01", "position_m": [3, 4], "heading_rad": 1.0, "behaviour": "a:b", "params": {"b": 3}}
    plain = robots(settings(robots=3, params={"a": 1, "b": 2}))
    team_of_three = robots(settings(robots=3, robot=[own], params={"a": 1, "b": 2}))
    assert team_of_three["r01"] == RobotSpec("r01", (3, 4), 1.0, (0, 0), "a:b", {"a": 1, "b": 3})
    assert team_of_three["r00"] == plain["r00"]
    assert team_of_three["r02"] == plain["r02"]
    assert plain["r01"].params == {"a": 1, "b": 2}


def test_another_robot_moves_nobody() -> None:
    three, five = robots(settings(robots=3)), robots(settings(robots=5))
    assert all(five[name] == three[name] for name in three)


def test_another_robot_moves_nobody_in_units_of_the_area() -> None:
    # The team makes the area grow, and all places with it.
    world = {"area_m": None, "neighbours": 2.0}
    few, many = settings(world, robots=5), settings(world, robots=50)
    scale = area_m(many)[0] / area_m(few)[0]
    assert scale > 2
    for name, spec in robots(few).items():
        x, y = spec.position_m
        assert robots(many)[name].position_m == pytest.approx((x * scale, y * scale))


def test_another_seed_is_another_placement() -> None:
    assert (
        robots(settings(robots=1))["r00"].position_m != robots(settings(robots=1, seed=2))["r00"].position_m
    )


def test_places_and_headings_are_spread_over_all_there_is() -> None:
    specs = team(settings(robots=1000))
    x, y = np.array([spec.position_m for spec in specs]).T
    heading = np.array([spec.heading_rad for spec in specs])
    for values, low, high in ((x, 0, 20), (y, 0, 10), (heading, -math.pi, math.pi)):
        counts, _ = np.histogram(values, bins=10, range=(low, high))
        assert counts.sum() == 1000
        assert counts.min() > 60  # 100 expected, standard deviation 9.5
    assert abs(np.corrcoef([x, y, heading])[np.triu_indices(3, 1)]).max() < 0.1


def test_headings_of_zero() -> None:
    assert {spec.heading_rad for spec in team(settings({"heading": "zero"}, robots=5))} == {0.0}


def test_bouncing_robots_drive_where_they_look() -> None:
    for spec in team(settings({"motion": BOUNCE}, robots=50)):
        assert math.hypot(*spec.velocity_mps) == pytest.approx(2.0, abs=1e-8)
        assert math.atan2(spec.velocity_mps[1], spec.velocity_mps[0]) == pytest.approx(
            spec.heading_rad, abs=1e-8
        )


def test_bouncing_robots_of_given_heading_or_velocity() -> None:
    tables = [{"id": "a", "heading_rad": 0.0}, {"id": "b", "velocity_mps": [0, -3]}]
    a, b = team(settings({"motion": BOUNCE}, robot=tables))
    assert (a.velocity_mps, a.heading_rad) == ((2.0, 0.0), 0.0)
    assert (b.velocity_mps, b.heading_rad) == ((0.0, -3.0), round(-math.pi / 2, 9))


def test_placement_on_a_grid() -> None:
    specs = team(settings({"placement": "grid"}, robots=8))
    assert [spec.position_m for spec in specs] == [
        (2.5, 2.5), (7.5, 2.5), (12.5, 2.5), (17.5, 2.5),
        (2.5, 7.5), (7.5, 7.5), (12.5, 7.5), (17.5, 7.5),
    ]  # fmt: skip


def test_grids_of_odd_shapes() -> None:
    assert grid(1, 4, 2) == [(2, 1)]
    assert grid(3, 100, 1) == [(100 / 6, 0.5), (50, 0.5), (pytest.approx(500 / 6), 0.5)]
    assert grid(2, 1, 8) == [(0.5, 2), (0.5, 6)]
    assert grid(3, 4, 4) == [(1, 1), (3, 1), (1, 3)]


@pytest.mark.parametrize(("robots_in_team", "columns", "rows"), [(8, 4, 2), (1, 1, 1), (1000, 45, 23)])
def test_a_jittered_grid_is_uniform_in_the_cell_of_each_robot(
    robots_in_team: int, columns: int, rows: int
) -> None:
    specs = team(settings({"placement": "jittered_grid"}, robots=robots_in_team))
    x, y = np.array([spec.position_m for spec in specs]).T / [[20 / columns], [10 / rows]]
    index = np.arange(robots_in_team)
    within = np.array([x - index % columns, y - index // columns])
    assert ((within >= 0) & (within <= 1)).all()
    assert len(np.unique(within)) == 2 * robots_in_team
    if robots_in_team == 1000:
        for values in within:
            counts, _ = np.histogram(values, bins=10, range=(0, 1))
            assert counts.min() > 60  # 100 expected, standard deviation 9.5
        uniform = np.array([spec.position_m for spec in team(settings(robots=1000))]).T
        assert abs(np.corrcoef([*within, *uniform])[np.triu_indices(4, 1)]).max() < 0.12


def test_jitter_goes_with_the_robot() -> None:
    one = team(settings({"placement": "jittered_grid"}, robots=["a", "b", "c", "d"]))
    other = team(settings({"placement": "jittered_grid"}, robots=["d", "c", "b", "a"]))
    for spec, index, same, index_of_same in zip(one, range(4), reversed(other), (3, 2, 1, 0), strict=True):
        assert spec.id == same.id
        cells = np.array([[index % 3, index // 3], [index_of_same % 3, index_of_same // 3]]) * (20 / 3, 5)
        moved = np.array([spec.position_m, same.position_m]) - cells
        assert moved[0] == pytest.approx(moved[1], abs=1e-12)


@pytest.mark.parametrize("side", [0.9, 3.9, 7.2])
def test_rounding_carries_nobody_out_of_a_grid(side: float) -> None:
    last = 1 - 2**-53  # the largest draw there is
    assert (6 + last) * (side / 7) > side
    assert max(x for x, _ in grid(49, side, 2 * side, [(last, last)] * 49)) <= side
    assert max(y for _, y in grid(49, side, side, [(last, last)] * 49)) == side


def test_bouncing_robots_may_stand() -> None:
    still = {"kind": "bounce", "speed_mps": 0}
    drawn = robots(settings(robots=3))
    table = {"id": "r01", "velocity_mps": [0, -3]}
    for name, spec in robots(settings({"motion": still}, robots=3, robot=[table])).items():
        if name != "r01":
            assert spec == drawn[name]
            assert not np.signbit(spec.velocity_mps).any()
        else:
            assert spec.velocity_mps == (0, -3)
    standing = {"id": "r01", "velocity_mps": [0, 0]}
    one = robots(settings({"motion": BOUNCE}, robots=3, robot=[standing]))["r01"]
    assert one == drawn["r01"]


def test_headings_of_velocities() -> None:
    assert heading_of((0.0, 0.0), otherwise=0.25) == 0.25
    assert heading_of((1.0, 1.0), otherwise=0) == 0.785398163
    assert heading_of((-1.0, 0.0), otherwise=0) == heading_of((-1.0, -0.0), otherwise=0) == 3.141592654
    assert along(round(math.pi / 2, 9), 3.0) == (0.0, 3.0)


def test_probability_in_range_against_quadrature() -> None:
    # |x1 - x2| of two uniform points has the density 2 (1 - x); the inner integral over y is elementary.
    x = (np.arange(200_000) + 0.5) / 200_000
    for reach in (0.1, 0.5, 1.0, 1.1, 1.3, 1.41):
        y = np.minimum(1.0, np.sqrt(np.maximum(reach**2 - x**2, 0.0)))
        assert probability_in_range(reach) == pytest.approx(np.mean(4 * (1 - x) * (y - y**2 / 2)), abs=1e-6)
    assert probability_in_range(2.0) == 1.0


def test_side_for_neighbours_solves_the_published_equation() -> None:
    side = side_for_neighbours(20, 13.0, 16.0)
    r = 16.0
    assert side > r
    mean = 19 * (math.pi * r**2 / side**2 - 8 * r**3 / (3 * side**3) + r**4 / (2 * side**4))
    assert mean == pytest.approx(13.0, abs=1e-7)


def test_side_for_neighbours_where_the_square_is_smaller_than_the_range() -> None:
    side = side_for_neighbours(11, 9.9, 1.0)
    assert math.sqrt(0.5) < side < 1
    assert 10 * probability_in_range(1 / side) == pytest.approx(9.9, abs=1e-7)


def test_side_for_as_many_neighbours_as_there_are() -> None:
    for robots_in_team in (1, 2, 14):
        assert side_for_neighbours(robots_in_team, 13.0, 16.0) == 16.0 / math.sqrt(2.0)


def test_neighbours_that_are_drawn_are_as_many_as_asked_for() -> None:
    of = settings({"area_m": None, "neighbours": 13.0}, robots=1000)
    places = np.array([spec.position_m for spec in team(of)])
    distances = np.linalg.norm(places[:, None] - places[None], axis=2)
    neighbours = (distances <= of.radio.range_m).sum(axis=1) - 1
    assert neighbours.mean() == pytest.approx(13.0, abs=0.5)
