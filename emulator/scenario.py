"""What a scenario is: the schema of its TOML file, and the team of robots it describes.

Loading one from a file is in `emulator.scenario_file`, what has to hold between its keys in
`emulator.scenario_checks`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

from channels.randomness import Draws, stable_keys
from channels.settings import (
    CameraSettings,
    ClockSettings,
    LampSettings,
    Positive,
    RadioSettings,
)
from emulator.placement import Vector, along, grid, heading_of, quantised, side_for_neighbours

MAX_ROBOTS = 1000
MIN_SIDE_M = 0.001
MAX_SIDE_M = 10_000_000.0
MAX_SPEED_MPS = 10_000.0

Side = Annotated[float, Meta(ge=MIN_SIDE_M, le=MAX_SIDE_M)]
Speed = Annotated[float, Meta(gt=0, le=MAX_SPEED_MPS)]
Velocity = Annotated[float, Meta(ge=-MAX_SPEED_MPS, le=MAX_SPEED_MPS)]
Name = Annotated[str, Meta(min_length=1)]
Size = Annotated[int, Meta(ge=1, le=MAX_ROBOTS)]


class StaticMotion(Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="static"):
    """Robots stay where they are."""


class BounceMotion(Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="bounce"):
    """Straight lines at one speed, reflected at the walls of the area."""

    speed_mps: Speed


class CommandedMotion(Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="commanded"):
    """Robots stand until their behaviour tells them to move."""

    max_speed_mps: Speed


Motion = StaticMotion | BounceMotion | CommandedMotion


class StopSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """End the run once every robot has logged an entry of this name whose field is true."""

    entry: Name
    field: Name


class RunSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """How long a run lasts, in virtual time."""

    duration_s: Positive
    stop: StopSettings | None = None


class WorldSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """Where the robots are. Exactly one of `area_m` and `neighbours` sets the size of the area."""

    area_m: tuple[Side, Side] | None = None
    """Width and height of a rectangle with one corner at (0, 0)."""
    neighbours: Positive | None = None
    """Mean number of robots in radio range of one, for robots placed uniformly in a square."""
    placement: Literal["uniform", "grid"] = "uniform"
    heading: Literal["drawn", "zero"] = "drawn"
    motion: Motion = StaticMotion()


class RobotSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """What is special about one robot; everything left out is as for all others."""

    id: Name
    position_m: Vector | None = None
    heading_rad: float | None = None
    velocity_mps: tuple[Velocity, Velocity] | None = None
    behaviour: Name | None = None
    params: dict[str, Any] = {}


class LimitSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """Limits in wall-clock time; they never change what a log holds."""

    answer_timeout_s: Positive = 30.0
    """A robot that takes longer than this to answer one grant has failed."""


class RecordSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """What is recorded for viewers."""

    scene_rate_hz: Positive = 1.0


class Settings(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A scenario file, decoded."""

    title: str = ""
    behaviour: Name | None = None
    """What every robot runs, as "module:function", or "file.py:function" relative to this file."""
    score: Name | None = None
    robots: Size | Annotated[list[Name], Meta(min_length=1, max_length=MAX_ROBOTS)] | None = None
    """How many robots, or their ids; None: the `[[robot]]` tables are the team."""
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 1
    run: RunSettings
    world: WorldSettings
    robot: Annotated[list[RobotSettings], Meta(max_length=MAX_ROBOTS)] = []
    radio: RadioSettings
    camera: CameraSettings | None = None
    lamp: LampSettings = LampSettings()
    clock: ClockSettings = ClockSettings()
    params: dict[str, Any] = {}
    limits: LimitSettings = LimitSettings()
    record: RecordSettings = RecordSettings()


class Scenario(Settings, frozen=True, kw_only=True):
    """A scenario that holds together, and where it comes from."""

    name: str
    """Stem of its file name."""
    text: bytes = b""
    """The file as it was read, before any override."""
    folder: Path | None = None
    """Folder in which file behaviours are found; None where all are modules."""


class RobotSpec(Struct, frozen=True):
    """One robot at the start of a run, with nothing left open."""

    id: str
    position_m: Vector
    heading_rad: float
    velocity_mps: Vector
    """Zero unless the world's motion is `bounce`."""
    behaviour: str
    params: dict[str, Any]


def team_ids(settings: Settings) -> list[str]:
    """Ids of all robots, in robot order; empty where the scenario names none."""
    if settings.robots is None:
        return [robot.id for robot in settings.robot]
    if isinstance(settings.robots, list):
        return list(settings.robots)
    # The same robot has the same id in a team of any size: draws are made by id.
    return [f"r{number:02d}" for number in range(settings.robots)]


def area_m(settings: Settings) -> Vector:
    """Width and height of the area, computed from `world.neighbours` where that is given."""
    if settings.world.area_m is not None:
        return settings.world.area_m
    assert settings.world.neighbours is not None
    side = side_for_neighbours(len(team_ids(settings)), settings.world.neighbours, settings.radio.range_m)
    return side, side


def team(settings: Settings) -> list[RobotSpec]:
    """Every robot of a scenario that has passed `scenario_checks.check`, in robot order.

    What is drawn depends on the seed and on the robot's own id only, so another robot more or less
    moves nobody in units of the area.
    """
    ids = team_ids(settings)
    special = {robot.id: robot for robot in settings.robot}
    places = _places(settings, ids)
    headings = _headings(settings, ids)
    return [
        _spec(settings, special.get(name) or RobotSettings(name), place, heading)
        for name, place, heading in zip(ids, places, headings, strict=True)
    ]


def resolved(scenario: Scenario) -> Settings:
    """The same scenario with team, places and area written out."""
    bouncing = isinstance(scenario.world.motion, BounceMotion)
    own_params = {robot.id: robot.params for robot in scenario.robot}
    robots = [
        RobotSettings(
            id=spec.id,
            position_m=spec.position_m,
            heading_rad=spec.heading_rad,
            velocity_mps=spec.velocity_mps if bouncing else None,
            behaviour=spec.behaviour,
            params=own_params.get(spec.id, {}),
        )
        for spec in team(scenario)
    ]
    world = msgspec.structs.replace(scenario.world, area_m=area_m(scenario), neighbours=None)
    fields = {name: getattr(scenario, name) for name in Settings.__struct_fields__}
    return Settings(**fields | {"robots": team_ids(scenario), "robot": robots, "world": world})


def resolved_json(scenario: Scenario) -> str:
    """All of a scenario as JSON, the same text on every machine; paths stay relative.

    `scenario_file.from_resolved` reads it back. Limits are left out: how long a machine may take is no
    part of what was run.
    """
    document = {"name": scenario.name} | msgspec.structs.asdict(resolved(scenario))
    del document["limits"]
    return msgspec.json.encode(document).decode()


def _spec(settings: Settings, own: RobotSettings, place: Vector, heading: float) -> RobotSpec:
    heading = heading if own.heading_rad is None else own.heading_rad
    velocity = (0.0, 0.0)
    if isinstance(settings.world.motion, BounceMotion):
        velocity = own.velocity_mps or along(heading, settings.world.motion.speed_mps)
        heading = heading_of(velocity, otherwise=heading)
    behaviour = own.behaviour or settings.behaviour
    assert behaviour is not None
    return RobotSpec(
        id=own.id,
        position_m=own.position_m or place,
        heading_rad=heading,
        velocity_mps=velocity,
        behaviour=behaviour,
        params=settings.params | own.params,
    )


def _headings(settings: Settings, ids: Sequence[str]) -> list[float]:
    if settings.world.heading == "zero":
        return [0.0] * len(ids)
    draws = Draws(settings.seed, "placement").uniform(stable_keys(ids), 2)
    return [quantised(math.pi * (2.0 * float(draw) - 1.0)) for draw in draws]


def _places(settings: Settings, ids: Sequence[str]) -> list[Vector]:
    width, height = area_m(settings)
    if settings.world.placement == "grid":
        return grid(len(ids), width, height)
    draws = Draws(settings.seed, "placement")
    xs, ys = draws.uniform(stable_keys(ids), 0), draws.uniform(stable_keys(ids), 1)
    return [(float(x) * width, float(y) * height) for x, y in zip(xs, ys, strict=True)]
