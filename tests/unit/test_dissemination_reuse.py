"""Sharing slots: what colouring promises, judged by the medium's own gates."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import pytest

from emulator.placement import side_for_neighbours
from scenarios.dissemination.study_reuse import STUDY, ReuseParameters, check, simulate
from scenarios.study import run_study


def result(samples: int = 4, **parameters: Any) -> dict[str, Any]:
    return run_study(STUDY, ReuseParameters(**parameters), samples=samples, jobs=1)


def means(samples: int = 4, **parameters: Any) -> dict[str, float]:
    found = result(samples, **parameters)
    return {key: value["mean"] for key, value in found.items() if key != "samples"}


def test_a_slot_each_and_nobody_collides() -> None:
    found = means(robots=25, reuse="none")
    assert (found["slots_per_frame"], found["collided"], found["deaf"]) == (25, 0, 0)
    # 7 units of 192 bits at 3000 bit/s are 0.448 s; 25 of them a frame.
    assert found["frame_rate_hz"] == pytest.approx(1 / (25 * 0.448))
    assert found["receptions_per_robot_s"] == pytest.approx(found["neighbours"] * found["frame_rate_hz"])


@pytest.mark.parametrize("robots", [25, 100])
def test_two_hops_apart_is_enough_and_one_hop_is_not(robots: int) -> None:
    alone, two, one = (
        means(robots=robots, reuse=reuse) for reuse in ("none", "distance_two", "distance_one")
    )
    assert (two["collided"], two["deaf"]) == (0, 0)
    assert one["deaf"] == 0  # neighbours have different slots
    assert one["collided"] > 0.4  # but whoever is between two that share one hears neither
    assert one["slots_per_frame"] < two["slots_per_frame"] < alone["slots_per_frame"]
    assert two["receptions_per_robot_s"] > one["receptions_per_robot_s"]
    assert two["receptions_per_robot_s"] > alone["receptions_per_robot_s"]


def test_drawn_slots_collide_and_deafen() -> None:
    drawn, coloured = means(robots=100, reuse="random"), means(robots=100, reuse="distance_two")
    assert drawn["collided"] > 0.2
    assert drawn["deaf"] > 0
    # The last slot may be nobody's, so that a frame is no longer than with colours.
    assert drawn["slots_per_frame"] <= coloured["slots_per_frame"]


def test_a_grid_takes_five_slots_however_large_it_is() -> None:
    # A robot and its four neighbours need five, and the plane can be tiled with such crosses.
    for robots in (25, 100, 225):
        found = means(1, robots=robots, placement="grid")
        assert 5 <= found["slots_per_frame"] <= 8
        assert found["collided"] == 0
    bipartite = means(1, robots=100, placement="grid", reuse="distance_one")
    assert bipartite["slots_per_frame"] == 2
    # Neighbours of a robot are all of the other colour, and nobody on a square grid has only one.
    assert bipartite["collided"] == 1
    assert bipartite["receptions_per_robot_s"] == 0


def test_robots_that_move_outgrow_their_slots() -> None:
    shares = [means(6, robots=100, speed=2.0, after=after)["collided"] for after in (0.0, 10.0, 300.0)]
    assert shares[0] < shares[1] < shares[2]
    assert shares[2] > 0.1


def test_errors_of_a_single_team_are_unknown() -> None:
    assert result(1, robots=9)["neighbours"]["se"] is None


def test_random_slots_are_drawn_of_as_many_as_colours_take() -> None:
    """Of 100 robots hardly ever nobody draws the last one."""
    of: list[Literal["random", "distance_two"]] = ["random", "distance_two"]
    drawn, coloured = (
        [
            frame.slots
            for frame in simulate(ReuseParameters(neighbours=4.0, reuse=reuse), np.random.default_rng(1), 1)
        ]
        for reuse in of
    )
    assert drawn == coloured


def test_what_a_robot_gets_to_hear_is_what_is_neither_lost_nor_missed() -> None:
    found = means(1, robots=100, reuse="random")
    heard = found["neighbours"] * (1 - found["collided"] - found["deaf"])
    assert found["receptions_per_robot_s"] == pytest.approx(heard * found["frame_rate_hz"])


def test_robots_have_gone_their_ways_when_the_next_whole_frame_begins() -> None:
    """Five slots of 64 ms; from 1 s on the first frame begins at 1.28 s. Each is judged as it ends."""
    parameters = ReuseParameters(robots=5, reuse="none", m=1, neighbours=2.0, speed=40.0, after=1.0)
    for seed in range(5):
        (frame,) = simulate(parameters, np.random.default_rng(seed), 1)
        rng, side = np.random.default_rng(seed), side_for_neighbours(5, 2.0, 36.0)
        places, angles = rng.random((5, 2)) * side, rng.uniform(0, 2 * np.pi, 5)
        links = 0
        for sender in range(5):
            way = 40.0 * (1.28 + 0.064 * (sender + 1)) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
            folded = np.abs((places + way + side) % (2 * side) - side)  # there and back between walls
            links += int(np.count_nonzero(np.hypot(*(folded - folded[sender]).T) <= 36.0)) - 1
        assert frame.links == links


@pytest.mark.parametrize(
    ("parameters", "sentence"),
    [
        ({"robots": 10, "placement": "grid"}, "robots: a square grid has 4, 9, 16, ... robots, not 10"),
        ({"after": 5.0}, "after: nothing changes while robots stand still; set speed as well"),
    ],
)
def test_what_makes_no_sense_is_refused(parameters: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        check(ReuseParameters(**parameters))


def test_neighbours_are_those_of_the_geometry() -> None:
    # An independent count: pairs at most 36 m apart, from the generator's own first draws.
    parameters = ReuseParameters(robots=30, reuse="none")
    (frame,) = simulate(parameters, np.random.default_rng(5), 1)
    places = np.random.default_rng(5).random((30, 2)) * side_for_neighbours(30, 8.0, 36.0)
    apart = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
    assert frame.links == np.count_nonzero(apart <= 36.0) - 30
    assert frame.delivered == frame.links
