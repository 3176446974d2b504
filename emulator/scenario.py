"""What a scenario is: the schema of its TOML file, and the team of robots it describes.

Loading one from a file is in `emulator.scenario_file`, what has to hold between its keys in
`emulator.scenario_checks`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

from channels.graphs import Graph, Rectangle
from channels.settings import (
    CameraSettings,
    ClockSettings,
    LampSettings,
    Positive,
    RadioSettings,
)
from emulator.graphs import GraphSettings, graph_of
from emulator.groups import MAX_SPEED_MPS, Altitude, CruiseSpeed, GroupSettings, Name, group_of_each
from emulator.placement import (
    Placement,
    Vector,
    along,
    drawn_headings,
    heading_of,
    places,
    side_for_neighbours,
)

MAX_ROBOTS = 1000
MIN_SIDE_M = 0.001
MAX_SIDE_M = 10_000_000.0

Side = Annotated[float, Meta(ge=MIN_SIDE_M, le=MAX_SIDE_M)]
Speed = Annotated[float, Meta(gt=0, le=MAX_SPEED_MPS)]
Velocity = Annotated[float, Meta(ge=-MAX_SPEED_MPS, le=MAX_SPEED_MPS)]
Size = Annotated[int, Meta(ge=1, le=MAX_ROBOTS)]


class StaticMotion(Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="static"):
    """Robots stay where they are."""


class BounceMotion(Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="bounce"):
    """Straight lines, reflected at the walls of the area."""

    speed_mps: CruiseSpeed
    """Of all whose group or own table says nothing else."""


class CommandedMotion(Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="commanded"):
    """Robots stand until their behaviour tells them to move."""

    max_speed_mps: Speed


Motion = StaticMotion | BounceMotion | CommandedMotion


class StopSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """End the run once robots have logged an entry of this name whose field is true."""

    entry: Name
    field: Name
    of: Literal["all", "running"] = "all"
    """Which robots: every one, or every one whose behaviour has not ended."""


class RunSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """How long a run lasts, in virtual time."""

    duration_s: Positive
    stop: StopSettings | None = None


class WorldSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """Where the robots are. Exactly one of `area_m`, `neighbours` and `graph` sets the size of the area, or
    `area_m` does with a graph that fits in.
    """

    area_m: tuple[Side, Side] | None = None
    """Width and height of a rectangle with one corner at (0, 0)."""
    neighbours: Positive | None = None
    """Mean number of robots in radio range of one, for robots placed uniformly in a square."""
    start_area_m: tuple[Side, Side] | None = None
    """Width and height of the corner at (0, 0) in which robots start; None: anywhere in the area."""
    placement: Placement = "uniform"
    """Cells of a grid are those of the whole team, in team order, whoever else is placed otherwise."""
    heading: Literal["drawn", "zero"] = "drawn"
    motion: Motion = StaticMotion()
    graph: GraphSettings | None = None
    obstacles: list[Rectangle] = []
    """Rectangles x0, y0, x1, y1 [m] that shadow the radio, besides those of the graph."""


class RobotSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """What is special about one robot; everything left out is as for all others."""

    id: Name
    position_m: Vector | None = None
    altitude_m: Altitude | None = None
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
    group: Annotated[list[GroupSettings], Meta(max_length=MAX_ROBOTS)] = []
    """Never overlapping, drawn in this order."""
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
    altitude_m: float = 0.0


def team_ids(settings: Settings) -> list[str]:
    """Ids of all robots, in robot order; empty where the scenario names none."""
    if settings.robots is None:
        return [robot.id for robot in settings.robot]
    if isinstance(settings.robots, list):
        return list(settings.robots)
    return numbered_ids(settings.robots)


def numbered_ids(robots: int) -> list[str]:
    """Ids of robots that a scenario counts and does not name."""
    # The same robot has the same id in a team of any size: draws are made by id.
    return [f"r{number:02d}" for number in range(robots)]


def area_m(settings: Settings) -> Vector:
    """Width and height of the area, computed from `world.neighbours` where that is given."""
    if settings.world.area_m is not None:
        return settings.world.area_m
    assert settings.world.neighbours is not None
    assert settings.radio.range_m is not None
    side = side_for_neighbours(len(team_ids(settings)), settings.world.neighbours, settings.radio.range_m)
    return side, side


def world_graph(settings: Settings) -> Graph | None:
    """The world's graph, in metres; None where it has none."""
    return graph_of(settings.world.graph)


def obstacles(settings: Settings) -> list[Rectangle]:
    """All obstacles there are: the world's own, and those of its graph."""
    graph = world_graph(settings)
    return [*settings.world.obstacles, *(graph.obstacles if graph is not None else ())]


def groups(settings: Settings) -> dict[str, GroupSettings]:
    """The group of every robot, in robot order; `groups.NO_GROUP` for those in none."""
    return group_of_each(settings.group, settings.seed, team_ids(settings))


def team(settings: Settings) -> list[RobotSpec]:
    """Every robot of a scenario that has passed `scenario_checks.check`, in robot order.

    What is drawn for a robot depends on the seed and on its own id only, so another robot more or less
    moves nobody in units of the area, except within a grid or into and out of a group.
    """
    group_of = groups(settings)
    headings = _headings(settings, list(group_of))
    starts = zip(_own_tables(settings, group_of), _places(settings, group_of), headings, strict=True)
    return [_spec(settings, own, group_of[own.id], place, heading) for own, place, heading in starts]


def resolved(scenario: Scenario) -> Settings:
    """The same scenario with team, places and area written out, robot by robot, and hence no groups."""
    bouncing = isinstance(scenario.world.motion, BounceMotion)
    specs = team(scenario)
    robots = [
        RobotSettings(
            id=spec.id,
            position_m=spec.position_m,
            altitude_m=spec.altitude_m or None,
            heading_rad=spec.heading_rad,
            velocity_mps=spec.velocity_mps if bouncing else None,
            behaviour=spec.behaviour,
            params=own.params,
        )
        for spec, own in zip(specs, _own_tables(scenario, groups(scenario)), strict=True)
    ]
    # What nobody runs is no part of the run: a log does not carry its file.
    used = scenario.behaviour in {spec.behaviour for spec in specs}
    fields = {name: getattr(scenario, name) for name in Settings.__struct_fields__} | {
        "behaviour": scenario.behaviour if used else None,
        "robots": team_ids(scenario),
        "robot": robots,
        "group": [],
        "world": msgspec.structs.replace(scenario.world, area_m=area_m(scenario), neighbours=None),
    }
    return Settings(**fields)


def resolved_json(scenario: Scenario) -> str:
    """All of a scenario as JSON, the same text on every machine; paths stay relative.

    `scenario_file.from_resolved` reads it back. Limits are left out: how long a machine may take is no
    part of what was run.
    """
    document = {"name": scenario.name} | msgspec.structs.asdict(resolved(scenario))
    del document["limits"], document["group"]
    return msgspec.json.encode(document).decode()


def _own_tables(settings: Settings, group_of: Mapping[str, GroupSettings]) -> list[RobotSettings]:
    """The table of every robot, with behaviour and params of its group where it has none of its own."""
    special = {robot.id: robot for robot in settings.robot}
    own = [special.get(name) or RobotSettings(name) for name in group_of]
    return [
        msgspec.structs.replace(
            table,
            behaviour=table.behaviour or group_of[table.id].behaviour,
            params=group_of[table.id].params | table.params,
        )
        for table in own
    ]


def _spec(
    settings: Settings, own: RobotSettings, group: GroupSettings, place: Vector, heading: float
) -> RobotSpec:
    heading = heading if own.heading_rad is None else own.heading_rad
    velocity = (0.0, 0.0)
    if isinstance(settings.world.motion, BounceMotion):
        speed = settings.world.motion.speed_mps if group.speed_mps is None else group.speed_mps
        velocity = along(heading, speed) if own.velocity_mps is None else own.velocity_mps
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
        altitude_m=_altitude(own, group),
    )


def _altitude(own: RobotSettings, group: GroupSettings) -> float:
    if own.altitude_m is not None:
        return own.altitude_m
    return group.altitude_m or 0.0


def _headings(settings: Settings, ids: Sequence[str]) -> list[float]:
    if settings.world.heading == "zero":
        return [0.0] * len(ids)
    return drawn_headings(settings.seed, ids)


def _places(settings: Settings, group_of: Mapping[str, GroupSettings]) -> list[Vector]:
    """Each robot's place in its own placement of the whole team: a cell whose robot is elsewhere is empty."""
    ids = list(group_of)
    wanted = [group_of[name].placement or settings.world.placement for name in ids]
    corner = settings.world.start_area_m or area_m(settings)
    graph = world_graph(settings)
    of_team = {way: places(way, settings.seed, ids, *corner, graph) for way in dict.fromkeys(wanted)}
    return [of_team[way][index] for index, way in enumerate(wanted)]
