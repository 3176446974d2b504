"""What holds for every trajectory."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from channels.messages import MotionCommand
from channels.units import NS_PER_S
from emulator.scenario import BounceMotion, CommandedMotion, RobotSpec
from emulator.world import World

WIDTH_M, HEIGHT_M = 10.0, 6.0
MAX_SPEED_MPS = 3.0

instants = st.integers(0, 1000 * NS_PER_S)
xs = st.floats(0, WIDTH_M)
ys = st.floats(0, HEIGHT_M)
speeds = st.floats(-20, 20)
velocities = st.tuples(speeds, speeds)
anywhere = st.tuples(st.floats(-5, 15), st.floats(-5, 15))
commands = st.one_of(
    st.builds(MotionCommand, velocity_mps=velocities),
    st.builds(MotionCommand, towards_m=anywhere, speed_mps=st.floats(0, 20)),
)
journeys = st.lists(st.tuples(st.integers(0, 1), instants, commands), max_size=6).map(
    lambda journey: sorted(journey, key=lambda leg: leg[1])
)


def spec(name: str, x: float, y: float, velocity: tuple[float, float] = (0.0, 0.0)) -> RobotSpec:
    return RobotSpec(name, (x, y), 0.0, velocity, "module:function", {})


def bouncing(x: float, y: float, velocity: tuple[float, float]) -> World:
    return World((WIDTH_M, HEIGHT_M), [spec("a", x, y, velocity)], BounceMotion(speed_mps=1))


def commanded() -> World:
    specs = [spec("a", 1, 1), spec("b", 9, 5)]
    return World((WIDTH_M, HEIGHT_M), specs, CommandedMotion(max_speed_mps=MAX_SPEED_MPS))


def inside(positions: np.ndarray) -> bool:
    return bool((positions >= 0).all() and (positions <= (WIDTH_M, HEIGHT_M)).all())


def reflected(place: float, velocity: float, length: float, t_s: float) -> float:
    """Wall by wall, as one would do it by hand."""
    while velocity != 0:
        to_wall_s = ((length - place) if velocity > 0 else -place) / velocity
        if t_s <= to_wall_s:
            return place + velocity * t_s
        t_s -= to_wall_s
        place = length if velocity > 0 else 0.0
        velocity = -velocity
    return place


@given(xs, ys, velocities, st.integers(0, 20 * NS_PER_S))
def test_bounce_equals_reflection_wall_by_wall(
    x: float, y: float, velocity: tuple[float, float], t_ns: int
) -> None:
    t_s = t_ns / NS_PER_S
    expected = (reflected(x, velocity[0], WIDTH_M, t_s), reflected(y, velocity[1], HEIGHT_M, t_s))
    assert np.allclose(bouncing(x, y, velocity).positions(t_ns)[0], expected, atol=1e-9)


@given(xs, ys, velocities, instants)
def test_bounce_stays_inside(x: float, y: float, velocity: tuple[float, float], t_ns: int) -> None:
    assert inside(bouncing(x, y, velocity).positions(t_ns))


@given(xs, ys, velocities, instants, st.integers(1, NS_PER_S))
def test_bounce_keeps_to_its_speed(
    x: float, y: float, velocity: tuple[float, float], t_ns: int, step_ns: int
) -> None:
    world = bouncing(x, y, velocity)
    moved = np.abs(world.positions(t_ns + step_ns) - world.positions(t_ns))[0]
    assert (moved <= np.abs(velocity) * step_ns / NS_PER_S + 1e-9).all()


@given(xs, ys, velocities, instants)
def test_bounce_faces_where_it_goes(x: float, y: float, velocity: tuple[float, float], t_ns: int) -> None:
    speed = math.hypot(*velocity)
    if speed < 0.1:
        return
    world = bouncing(x, y, velocity)
    step_ns = 1000
    (before,), heading = world.positions(t_ns), world.poses(t_ns)[0, 2]
    (after,) = world.positions(t_ns + step_ns)
    margin = 20 * step_ns / NS_PER_S
    if (after < margin).any() or (after > (WIDTH_M - margin, HEIGHT_M - margin)).any():
        return  # it may turn within the step
    ahead = np.array([math.cos(heading), math.sin(heading)]) * speed * step_ns / NS_PER_S
    assert np.allclose(after - before, ahead, atol=1e-9)


@given(xs, ys, velocities, st.lists(instants, min_size=1, max_size=6))
def test_bounce_does_not_depend_on_what_was_asked_before(
    x: float, y: float, velocity: tuple[float, float], asked: list[int]
) -> None:
    world = bouncing(x, y, velocity)
    for t_ns in [*asked, *reversed(asked)]:
        assert np.array_equal(world.poses(t_ns), bouncing(x, y, velocity).poses(t_ns))


@given(xs, ys, st.floats(-math.pi, math.pi), velocities, instants)
def test_standing_robots_stand_whoever_bounces_around_them(
    x: float, y: float, heading: float, velocity: tuple[float, float], t_ns: int
) -> None:
    standing = RobotSpec("a", (x, y), heading, (0.0, 0.0), "module:function", {})
    mixed = World((WIDTH_M, HEIGHT_M), [standing, spec("b", y, x / 2, velocity)], BounceMotion(speed_mps=0))
    assert mixed.poses(t_ns)[0].tolist() == [x, y, heading]
    assert np.array_equal(mixed.poses(t_ns)[1], bouncing(y, x / 2, velocity).poses(t_ns)[0])


@given(journeys, instants)
def test_commanded_robots_stay_inside(journey: list[tuple[int, int, MotionCommand]], later_ns: int) -> None:
    world = commanded()
    for robot, t_ns, command in journey:
        assert inside(world.positions(t_ns))
        world.command(robot, t_ns, command)
        assert inside(world.positions(t_ns + later_ns))


@given(journeys)
def test_commanded_robots_never_jump_or_speed(journey: list[tuple[int, int, MotionCommand]]) -> None:
    world, at_ns = commanded(), 0
    before = world.positions(0)
    for robot, t_ns, command in journey:
        moved = np.linalg.norm(world.positions(t_ns) - before, axis=1)
        assert (moved <= MAX_SPEED_MPS * (t_ns - at_ns) / NS_PER_S + 1e-8).all()
        at_ns, before = t_ns, world.positions(t_ns)
        world.command(robot, t_ns, command)
        assert np.allclose(world.positions(t_ns), before, atol=1e-8)


@given(journeys, st.lists(instants, max_size=5))
def test_looking_does_not_change_what_is_seen(
    journey: list[tuple[int, int, MotionCommand]], looks: list[int]
) -> None:
    watched, alone = commanded(), commanded()
    for robot, t_ns, command in journey:
        for look_ns in looks:
            watched.poses(t_ns + look_ns)
        watched.command(robot, t_ns, command)
        alone.command(robot, t_ns, command)
    end_ns = 1000 * NS_PER_S
    assert np.array_equal(watched.poses(end_ns), alone.poses(end_ns))
    assert np.array_equal(watched.poses(end_ns + 1), alone.poses(end_ns + 1))


@given(journeys)
def test_commands_of_one_instant_commute_between_robots(
    journey: list[tuple[int, int, MotionCommand]],
) -> None:
    forwards, backwards = commanded(), commanded()
    first, second = MotionCommand(velocity_mps=(1.0, 0.5)), MotionCommand(towards_m=(3.0, 2.0), speed_mps=1.0)
    for robot, t_ns, command in journey:
        forwards.command(robot, t_ns, command)
        backwards.command(robot, t_ns, command)
    now_ns = 1000 * NS_PER_S
    forwards.command(0, now_ns, first)
    forwards.command(1, now_ns, second)
    backwards.command(1, now_ns, second)
    backwards.command(0, now_ns, first)
    assert np.array_equal(forwards.poses(now_ns + NS_PER_S), backwards.poses(now_ns + NS_PER_S))
