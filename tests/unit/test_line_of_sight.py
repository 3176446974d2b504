"""Obstacles: who sees whom, and what that does to the radio. Independent judge: exact predicates of GEOS."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from shapely import LineString, Point, box

from channels.graphs import Rectangle, in_sight
from channels.medium import Medium
from channels.settings import RadioSettings, TdmaSettings
from channels.units import NS_PER_S
from emulator.run import Options, run
from emulator.scenario import RobotSpec, team
from emulator.scenario_file import load
from emulator.slots import connectivity
from emulator.world import World
from logs.reader import LogReader
from tests.traffic import BYTE_A_NANOSECOND, Send, medium_of, play

SQUARE: Rectangle = (2.0, 2.0, 4.0, 4.0)
OK, ME, OUT, DARK, HIT = "delivered", "not_a_candidate", "out_of_range", "no_line_of_sight", "collision"

whole = st.integers(-6, 6).map(float)
points = st.tuples(whole, whole)
rectangles = st.tuples(whole, whole, st.integers(1, 5), st.integers(1, 5)).map(
    lambda r: (r[0], r[1], r[0] + r[2], r[1] + r[3])
)


def sees(one: tuple[float, float], other: tuple[float, float], *obstacles: Rectangle) -> bool:
    return bool(in_sight(np.array(one), np.array(other), obstacles))


@pytest.mark.parametrize(
    ("one", "other", "clear"),
    [
        ((0, 3), (6, 3), False),  # right through
        ((3, 0), (3, 6), False),
        ((0, 0), (6, 6), False),  # from corner to corner
        ((0, 2), (6, 2), True),  # along a side
        ((4, 0), (4, 6), True),
        ((0, 4), (4, 0), True),  # short of it
        ((0, 8), (8, 0), True),  # through a corner
        ((0, 3), (2, 3), True),  # up to it
        ((0, 3), (2.001, 3), False),
        ((2.5, 3), (3.5, 3), False),  # within
        ((3, 3), (3, 3), False),
        ((2, 3), (2, 3), True),
        ((0, 0), (0, 0), True),
        ((0, 5), (6, 5), True),
    ],
)
def test_by_hand(one: tuple[float, float], other: tuple[float, float], clear: bool) -> None:
    assert sees(one, other, SQUARE) == sees(other, one, SQUARE) == clear
    assert sees(one, other)


@given(points, points, st.lists(rectangles, max_size=4))
@example((0.0, 1.0), (3.0, 0.0), [(-3.0, -4.0, 0.0, 1.0)])
def test_against_exact_predicates(
    one: tuple[float, float], other: tuple[float, float], obstacles: list[Rectangle]
) -> None:
    way = Point(one) if one == other else LineString([one, other])
    # Whether the interiors of the two have a point in common.
    crossed = any(way.relate_pattern(box(*obstacle), "T********") for obstacle in obstacles)
    assert sees(one, other, *obstacles) == (not crossed)


reals = st.floats(-10, 10)
anywhere = st.tuples(reals, reals)


@given(
    st.lists(anywhere, min_size=2, max_size=6), st.lists(st.tuples(reals, reals, reals, reals), max_size=5)
)
def test_sight_is_mutual_and_asking_for_many_is_asking_for_each(
    places: list[tuple[float, float]], corners: list[tuple[float, float, float, float]]
) -> None:
    obstacles = [(min(a, c), min(b, d), max(a, c), max(b, d)) for a, b, c, d in corners if a != c and b != d]
    at = np.array(places)
    matrix = in_sight(at[:, None], at[None], obstacles)
    assert (matrix == matrix.T).all()
    for i, one in enumerate(places):
        for j, other in enumerate(places):
            assert matrix[i, j] == all(sees(one, other, obstacle) for obstacle in obstacles)


def test_so_many_that_they_are_taken_in_parts() -> None:
    rng = np.random.default_rng(1)
    at = rng.uniform(0, 100, (400, 2))
    obstacles = [(x, y, x + 2, y + 1) for x, y in rng.uniform(0, 98, (20, 2)).tolist()]
    whole_matrix = in_sight(at[:, None], at[None], obstacles)
    assert (whole_matrix[7] == in_sight(at[7], at, obstacles)).all()
    assert 0.2 < whole_matrix.mean() < 0.95


# --- radio -------------------------------------------------------------------------------------------

# Four robots on a line 3 m apart, the radio reaches 7 m; between the first two a wall.
LINE = np.array([[0.0, 0.0], [3.0, 0.0], [6.0, 0.0], [9.0, 0.0]])
WALL: Rectangle = (1.0, -1.0, 2.0, 1.0)


def reasons(*, repeat: int = 1, obstacles: list[Rectangle] | None = None, **settings: Any) -> list[list[str]]:
    chosen = {"range_m": 7.0, "line_of_sight": True, "collisions": False} | settings
    medium = medium_of(4, obstacles=[WALL] if obstacles is None else obstacles, **chosen)
    sends = [Send(100 * turn + 10 * robot, robot, 5) for turn in range(repeat) for robot in range(4)]
    heard = play(medium, sends, lambda _now: LINE)
    found = [[heard[robot, turn].reasons for robot in range(4)] for turn in range(repeat)]
    assert all(one == other for one, other in pairwise(found))
    return found[0]


def test_who_is_behind_an_obstacle_hears_nothing_and_who_is_out_of_range_as_well_is_that() -> None:
    expected = [[ME, DARK, DARK, OUT], [DARK, ME, OK, OK], [DARK, OK, ME, OK], [OUT, OK, OK, ME]]
    assert reasons() == expected
    assert reasons(repeat=4) == expected  # rows, then the matrix, then what is remembered of it


def test_obstacles_count_where_the_radio_says_so() -> None:
    clear = [[ME, OK, OK, OUT], [OK, ME, OK, OK], [OK, OK, ME, OK], [OUT, OK, OK, ME]]
    assert reasons(line_of_sight=False) == reasons(obstacles=[]) == clear


def test_what_is_behind_an_obstacle_is_not_disturbed() -> None:
    def at_once(*obstacles: Rectangle) -> list[str]:
        medium = medium_of(4, range_m=7.0, line_of_sight=True, obstacles=obstacles)
        return play(medium, [Send(0, 0, 10), Send(5, 3, 10)], lambda _now: LINE)[3, 0].reasons

    assert at_once() == [OUT, HIT, HIT, ME]
    assert at_once(WALL) == [OUT, OK, OK, ME]


def test_obstacles_are_of_any_height() -> None:
    radio = RadioSettings(range_m=7.0, line_of_sight=True)
    medium = Medium(radio, ["a", "b"], 1, altitudes_m=[5.0, 5.0], obstacles=[WALL])
    heard = play(medium, [Send(0, 0, 0)], lambda _now: LINE[:2])
    assert heard[0, 0].reasons == [ME, DARK]


def test_who_cannot_hear_each_other_may_share_a_slot() -> None:
    specs = [RobotSpec(f"r{i}", (3.0 * i, 0.0), 0.0, (0.0, 0.0), "m:f", {}) for i in range(4)]
    tdma = TdmaSettings(slot_s=1e-8, reuse="distance_one")
    radio = RadioSettings(7.0, "tdma", tdma, BYTE_A_NANOSECOND, line_of_sight=True)
    assert {tuple(edge) for edge in connectivity(radio, specs, None, [WALL]).edges} == {
        (1, 2),
        (1, 3),
        (2, 3),
    }


# --- a run -------------------------------------------------------------------------------------------

SCENARIO = """
behaviour = "talk.py:talk"
robots = 6
[run]
duration_s = 12
[world]
area_m = [20, 20]
motion = { kind = "bounce", speed_mps = 2.0 }
obstacles = [[4, 4, 8, 8], [12, 3, 14, 17]]
[radio]
range_m = 12
line_of_sight = true
"""
TALK = """
async def talk(robot):
    async for step in robot.steps(0.31):
        robot.radio.broadcast({"step": step.index})
"""


def test_a_run_hears_and_is_silent_where_straight_lines_say(tmp_path: Path) -> None:
    (tmp_path / "talk.py").write_text(TALK)
    (tmp_path / "x.toml").write_text(SCENARIO)
    scenario = load(str(tmp_path / "x.toml"))
    outcome = run(scenario, Options(out=tmp_path / "log.mcap", fleet="in_process", echo=None))
    walls = [box(*obstacle) for obstacle in scenario.world.obstacles]
    specs = team(scenario)
    names = [spec.id for spec in specs]
    assert scenario.world.area_m is not None
    world = World(scenario.world.area_m, specs, scenario.world.motion)
    hidden = heard = 0
    with LogReader(tmp_path / "log.mcap") as log:
        for t_ns, record in log.records("/radio"):
            at = world.positions(t_ns)
            sender = names.index(record["from"])
            near = [i for i in range(6) if i != sender and ((at[i] - at[sender]) ** 2).sum() <= 144]
            lines = {i: LineString([at[sender], at[i]]) for i in near}
            clear = [
                names[i]
                for i in near
                if not any(lines[i].crosses(wall) or lines[i].within(wall) for wall in walls)
            ]
            assert record["delivered"] == clear
            dark = [names[i] for i in near if names[i] not in clear]
            assert record["dropped"] == ({DARK: dark} if dark else {})
            hidden, heard = hidden + len(dark), heard + len(clear)
    assert (outcome.progress.dropped[DARK], outcome.progress.delivered) == (hidden, heard)
    assert min(hidden, heard) > 50
    assert outcome.progress.now_ns == 12 * NS_PER_S
