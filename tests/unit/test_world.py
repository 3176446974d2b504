"""The world, against trajectories worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from channels.messages import MotionCommand
from channels.units import NS_PER_S
from emulator.scenario import BounceMotion, CommandedMotion, Motion, RobotSpec, StaticMotion
from emulator.world import World

S = NS_PER_S
QUARTER = 1.570796327
"""Half of pi, to the nanoradian."""


def spec(
    x: float, y: float, velocity: tuple[float, float] = (0.0, 0.0), heading: float = 0.5, name: str = "a"
) -> RobotSpec:
    return RobotSpec(name, (x, y), heading, velocity, "module:function", {})


def world(motion: Motion, *specs: RobotSpec) -> World:
    return World((10.0, 6.0), specs, motion)


def commanded(x: float = 2.0, y: float = 3.0) -> World:
    return world(CommandedMotion(max_speed_mps=2.0), spec(x, y))


def pose(of: World, t_ns: int, robot: int = 0) -> tuple[float, ...]:
    return tuple(of.poses(t_ns)[robot].tolist())


def test_static_robots_stay() -> None:
    still = world(StaticMotion(), spec(1, 2), spec(3, 4, heading=-1.0, name="b"))
    assert still.poses(0).tolist() == [[1, 2, 0.5], [3, 4, -1.0]]
    assert still.positions(7 * S).tolist() == [[1, 2], [3, 4]]
    assert still.positions(0) is still.positions(10**15)
    assert still.poses(0) is still.poses(10**15)


def test_shapes_and_types() -> None:
    moving = world(BounceMotion(speed_mps=1), spec(1, 2, (1, 0)), spec(3, 4, (0, 1), name="b"))
    assert moving.positions(5).shape == (2, 2)
    assert moving.poses(5).shape == (2, 3)
    assert moving.positions(5).dtype == moving.poses(5).dtype == np.float64


@pytest.mark.parametrize(
    "motion", [StaticMotion(), BounceMotion(speed_mps=1), CommandedMotion(max_speed_mps=1)]
)
def test_arrays_are_read_only(motion: Motion) -> None:
    some = world(motion, spec(1, 2, (1, 0)))
    for array in (some.positions(3), some.poses(3)):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 5.0


def test_one_instant_is_computed_once_and_another_is_another_array() -> None:
    moving = world(BounceMotion(speed_mps=1), spec(1, 2, (1, 0)))
    assert moving.positions(S) is moving.positions(S)
    before = moving.positions(S)
    assert moving.positions(2 * S) is not before
    assert before.tolist() == [[2, 2]]


@pytest.mark.parametrize(
    ("t_s", "x", "heading"),
    [
        (0, 8.0, 0.0),
        (1, 9.0, 0.0),
        (2, 10.0, 3.141592654),  # at the wall it has turned
        (3, 9.0, 3.141592654),
        (12, 0.0, 0.0),
        (13, 1.0, 0.0),
        (20, 8.0, 0.0),  # one whole period of 2 x 10 m
        (2 + 20 * 1000, 10.0, 3.141592654),
    ],
)
def test_bounce_to_the_right(t_s: int, x: float, heading: float) -> None:
    assert pose(world(BounceMotion(speed_mps=1), spec(8, 2, (1, 0))), t_s * S) == (x, 2.0, heading)


@pytest.mark.parametrize(
    ("t_s", "y", "heading"),
    [
        (0, 4.0, -QUARTER),
        (1, 2.0, -QUARTER),
        (2, 0.0, QUARTER),
        (3, 2.0, QUARTER),
        (5, 6.0, -QUARTER),
        (6, 4.0, -QUARTER),
        (8, 0.0, QUARTER),
    ],
)
def test_bounce_downwards(t_s: int, y: float, heading: float) -> None:
    assert pose(world(BounceMotion(speed_mps=2), spec(1, 4, (0, -2))), t_s * S) == (1.0, y, heading)


def test_bounce_in_both_axes() -> None:
    both = world(BounceMotion(speed_mps=5), spec(8, 5, (4, 3)))
    assert pose(both, 0) == (8, 5, 0.643501109)
    # x turns at 0.5 s, y at 1/3 s
    assert pose(both, S) == (8, 4, round(math.atan2(-3, -4), 9))
    assert pose(both, 2 * S) == (4, 1, round(math.atan2(-3, -4), 9))
    assert pose(both, 3 * S) == (0, 2, round(math.atan2(3, 4), 9))


def test_bounce_back_from_a_corner() -> None:
    corner = world(BounceMotion(speed_mps=5), spec(6, 3, (4, 3)))
    assert pose(corner, S) == (10, 6, round(math.atan2(-3, -4), 9))
    assert pose(corner, 2 * S) == (6, 3, round(math.atan2(-3, -4), 9))


def test_bounce_that_starts_at_a_wall_turns_at_once() -> None:
    assert pose(world(BounceMotion(speed_mps=1), spec(0, 2, (-1, 0))), S) == (1, 2, 0)
    assert pose(world(BounceMotion(speed_mps=1), spec(10, 2, (1, 0))), S) == (9, 2, 3.141592654)
    assert pose(world(BounceMotion(speed_mps=1), spec(10, 2, (-1, 0))), S) == (9, 2, 3.141592654)
    assert pose(world(BounceMotion(speed_mps=1), spec(0, 2, (1, 0))), S) == (1, 2, 0)


def test_bounce_begins_exactly_where_it_was_put() -> None:
    assert pose(world(BounceMotion(speed_mps=1), spec(0.1, 0.3, (-0.6, -0.8))), 0)[:2] == (0.1, 0.3)


def test_bounce_at_rest_keeps_its_heading() -> None:
    resting = world(BounceMotion(speed_mps=1), spec(10, 6))
    assert pose(resting, 5 * S) == (10, 6, 0.5)
    assert resting.positions(S) is resting.positions(9 * S)


def test_some_stand_where_others_bounce() -> None:
    specs = [spec(10, 6, name="a"), spec(8, 2, (1, 0), name="b"), spec(0, 0, heading=-3.0, name="c")]
    mixed = world(BounceMotion(speed_mps=1), *specs)
    for t_s in (0, 1, 2, 3, 12, 20_002):
        assert pose(mixed, t_s * S, 0) == (10, 6, 0.5)
        assert pose(mixed, t_s * S, 2) == (0, 0, -3.0)
    assert pose(mixed, 3 * S, 1) == (9, 2, 3.141592654)


def test_a_velocity_of_minus_zero_is_none() -> None:
    resting = world(BounceMotion(speed_mps=0), spec(10, 0, (-0.0, -0.0)))
    assert pose(resting, 5 * S) == (10, 0, 0.5)
    assert not np.signbit(resting.positions(5 * S)).any()


def test_commanded_robots_stand_until_told() -> None:
    assert pose(commanded(), 100 * S) == (2, 3, 0.5)


def test_velocity_from_the_instant_of_the_command() -> None:
    driven = commanded()
    driven.command(0, 5 * S, MotionCommand(velocity_mps=(1.5, 0.0)))
    assert pose(driven, 5 * S) == (2, 3, 0)
    assert pose(driven, 7 * S) == (5, 3, 0)


def test_velocity_stops_at_the_wall_and_does_not_slide() -> None:
    driven = commanded()
    driven.command(0, 0, MotionCommand(velocity_mps=(0.5, 1.0)))
    assert pose(driven, 2 * S) == (3, 5, round(math.atan2(1, 0.5), 9))
    assert pose(driven, 3 * S)[:2] == (3.5, 6)
    assert pose(driven, 9 * S)[:2] == (3.5, 6)
    assert driven.positions(3 * S) is driven.positions(9 * S)


def test_velocity_is_clipped_to_the_greatest_speed() -> None:
    driven = commanded(0, 0)
    driven.command(0, 0, MotionCommand(velocity_mps=(4.0, 3.0)))  # 5 m/s, 2 allowed
    assert pose(driven, S)[:2] == pytest.approx((1.6, 1.2), abs=1e-15)


def test_greatest_doubles_do_not_overflow() -> None:
    driven = commanded()
    driven.command(0, 0, MotionCommand(velocity_mps=(1e308, 1e308)))
    assert pose(driven, S)[:2] == pytest.approx((2 + math.sqrt(2), 3 + math.sqrt(2)))
    driven.command(0, S, MotionCommand(towards_m=(-1e308, 1e308), speed_mps=math.inf))
    assert driven.positions(20 * S).tolist()[0][1] == 6.0


def test_smallest_doubles_do_not_overflow() -> None:
    driven = commanded()
    driven.command(0, 0, MotionCommand(velocity_mps=(5e-324, -5e-324)))
    assert pose(driven, 10**15)[:2] == (2, 3)
    driven.command(0, 10**15, MotionCommand(towards_m=(9, 3), speed_mps=5e-324))
    assert pose(driven, 10**15 + S)[:2] == (2, 3)


def test_go_to_arrives_and_stands() -> None:
    driven = commanded()
    driven.command(0, S, MotionCommand(towards_m=(6.0, 6.0), speed_mps=1.25))  # 5 m in 4 s
    assert pose(driven, 3 * S) == (4, 4.5, 0.643501109)
    arrival = 5 * S
    x_before, y_before, _ = pose(driven, arrival - 1)
    assert x_before < 6
    assert y_before < 6
    assert pose(driven, arrival) == (6, 6, 0.643501109)
    assert driven.positions(arrival) is driven.positions(50 * S)


def test_arrival_is_exact_in_place_and_to_the_nanosecond_in_time() -> None:
    driven = commanded(2.3)
    driven.command(0, 0, MotionCommand(towards_m=(6.1, 3.0), speed_mps=1.8))  # 19/9 s, a little after:
    assert pose(driven, 2_111_111_111) == (6.1, 3, 0)
    assert pose(driven, 2_111_111_110)[0] < 6.1


@pytest.mark.parametrize(("x", "speed_mps", "arrival_ns"), [(6.7, 0.7, 4_714_285_714), (2.9, 0.1, 71 * S)])
def test_a_wall_is_reached_exactly(x: float, speed_mps: float, arrival_ns: int) -> None:
    driven = commanded(x)
    driven.command(0, 0, MotionCommand(velocity_mps=(speed_mps, 0.0)))
    assert pose(driven, arrival_ns - 1)[0] < 10
    assert pose(driven, arrival_ns) == (10, 3, 0)
    assert pose(driven, 2 * arrival_ns) == (10, 3, 0)


def test_go_to_as_fast_as_allowed() -> None:
    driven = commanded()
    driven.command(0, 0, MotionCommand(towards_m=(8.0, 3.0), speed_mps=100.0))
    assert pose(driven, 2 * S) == (6, 3, 0)
    assert pose(driven, 3 * S) == (8, 3, 0)


def test_go_to_a_place_outside_stops_at_the_wall() -> None:
    driven = commanded()
    driven.command(0, 0, MotionCommand(towards_m=(2.0, -9.0), speed_mps=1.0))
    assert pose(driven, 2 * S) == (2, 1, -QUARTER)
    assert pose(driven, 4 * S) == (2, 0, -QUARTER)


def test_go_to_where_it_is_changes_nothing() -> None:
    driven = commanded()
    before = driven.poses(S)
    driven.command(0, S, MotionCommand(towards_m=(2.0, 3.0), speed_mps=1.0))
    assert driven.poses(S) is before


def test_a_stop_on_the_way_keeps_place_and_heading() -> None:
    driven = commanded()
    driven.command(0, 0, MotionCommand(velocity_mps=(0.0, 1.0)))
    driven.command(0, S, MotionCommand())
    assert pose(driven, 8 * S) == (2, 4, QUARTER)
    assert driven.positions(S) is driven.positions(8 * S)


def test_a_turn_on_the_way() -> None:
    driven = commanded()
    driven.command(0, 0, MotionCommand(towards_m=(9.0, 3.0), speed_mps=2.0))
    driven.command(0, 2 * S, MotionCommand(velocity_mps=(-1.0, 0.0)))
    assert pose(driven, 2 * S) == (6, 3, 3.141592654)
    assert pose(driven, 3 * S) == (5, 3, 3.141592654)


def test_against_the_wall_a_robot_only_turns() -> None:
    driven = commanded(10.0, 3.0)
    driven.command(0, S, MotionCommand(velocity_mps=(1.0, 0.0)))
    assert pose(driven, S) == pose(driven, 2 * S) == (10, 3, 0)


def test_one_robot_moves_and_the_other_does_not() -> None:
    pair = world(CommandedMotion(max_speed_mps=2), spec(1, 1), spec(5, 5, name="b"))
    pair.command(1, 0, MotionCommand(velocity_mps=(-1.0, 0.0)))
    assert pair.positions(2 * S).tolist() == [[1, 1], [3, 5]]


def test_an_array_handed_out_never_changes() -> None:
    driven = commanded()
    before = driven.poses(S)
    driven.command(0, S, MotionCommand(velocity_mps=(1.0, 0.0)))
    assert driven.poses(2 * S).tolist() == [[3, 3, 0]]
    assert before.tolist() == [[2, 3, 0.5]]


@pytest.mark.parametrize("motion", [StaticMotion(), BounceMotion(speed_mps=1)])
def test_worlds_that_take_no_commands(motion: Motion) -> None:
    with pytest.raises(ValueError, match="world\\.motion\\.kind"):
        world(motion, spec(1, 1)).command(0, 0, MotionCommand())


@pytest.mark.parametrize(
    "command",
    [
        MotionCommand(velocity_mps=(math.nan, 0.0)),
        MotionCommand(velocity_mps=(math.inf, 0.0)),
        MotionCommand(towards_m=(0.0, math.nan), speed_mps=1.0),
    ],
)
def test_numbers_that_are_none_are_refused_and_change_nothing(command: MotionCommand) -> None:
    driven = commanded()
    with pytest.raises(ValueError, match="finite"):
        driven.command(0, S, command)
    assert pose(driven, 0) == (2, 3, 0.5)


def test_the_past_is_refused() -> None:
    driven = commanded()
    driven.command(0, 2 * S, MotionCommand(velocity_mps=(1.0, 0.0)))
    with pytest.raises(ValueError, match="before the latest command"):
        driven.positions(2 * S - 1)
    with pytest.raises(ValueError, match="before the latest command"):
        driven.command(0, S, MotionCommand())


def test_robots_start_inside() -> None:
    with pytest.raises(ValueError, match="outside"):
        world(StaticMotion(), spec(10.5, 1))
