"""What has to hold between the keys of a scenario, beyond the type and range of each.

Every check raises `InvalidError` with the key to mend and a clause that says what is wrong and what helps.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from difflib import get_close_matches
from pathlib import PurePosixPath, PureWindowsPath
from typing import Any

import msgspec

from channels.keys import ROBOT_ID
from channels.settings import RadioSettings, TdmaSettings, payload_limit
from channels.tdma import slot_length_ns
from channels.units import MAX_TIME_NS, NS_PER_S, airtime_ns, to_ns
from emulator.errors import InvalidError
from emulator.graph_checks import check_link, check_starts, check_world_graph
from emulator.groups import GroupSettings, size
from emulator.placement import Vector, heading_of
from emulator.scenario import (
    MAX_SIDE_M,
    MIN_SIDE_M,
    BounceMotion,
    RobotSettings,
    Settings,
    area_m,
    groups,
    team_ids,
)

__all__ = ["InvalidError", "check", "file_of"]

FUNCTION = re.compile(r"([A-Za-z_]\w*(\.[A-Za-z_]\w*)*|[^:]+\.py):[A-Za-z_]\w*", re.ASCII)


def check(settings: Settings) -> None:
    """Raises InvalidError at the first thing that does not hold."""
    for section in ("run", "radio", "camera", "lamp", "clock", "limits", "record"):
        _check_spans(section, msgspec.to_builtins(getattr(settings, section)))
    _check_team(settings)
    _check_groups(settings)
    check_link(settings)
    _check_area(settings)
    check_world_graph(settings, area_m(settings))
    _check_start_area(settings)
    _check_radio(settings.radio)
    for robot in settings.robot:
        _check_robot(settings, robot)
    check_starts(settings)
    _check_functions(settings)


def file_of(function: str) -> str | None:
    """The file of a "file.py:function"; None for a "module:function"."""
    place = function.rpartition(":")[0]
    return place if place.endswith(".py") else None


def _check_spans(key: str, value: Any) -> None:
    """Every duration and every period is a whole number of nanoseconds within what time can hold."""
    if isinstance(value, dict):
        for name, inner in value.items():
            _check_spans(f"{key}.{name}", inner)
    elif isinstance(value, float) and value > 0 and key.endswith("_s"):
        if value > MAX_TIME_NS / NS_PER_S:
            raise InvalidError(key, f"must be at most {MAX_TIME_NS // NS_PER_S} s, is {value:.12g} s")
        if to_ns(value) < 1:
            raise InvalidError(key, f"must be at least 1e-09 s, in which time is counted, is {value:.12g} s")
    elif isinstance(value, float) and key.endswith("_hz") and not 1e-6 <= value <= 1e6:
        raise InvalidError(key, f"must be from 1e-06 to 1e+06 Hz, is {value:.12g} Hz")


def _check_team(settings: Settings) -> None:
    if settings.robots is None and not settings.robot:
        why = 'missing key robots: say how many there are (robots = 20), or name them (robots = ["alice"])'
        raise InvalidError("robots", why, names_key=True)
    tables = [robot.id for robot in settings.robot]
    _check_ids("robot.id", tables)
    ids = team_ids(settings)
    _check_ids("robots", ids)
    strangers = [name for name in tables if name not in set(ids)]
    if strangers:
        near = get_close_matches(strangers[0], ids, n=1)
        hint = f"did you mean {near[0]}?" if near else "take its table out, or add it to robots"
        team = f"{ids[0]} to {ids[-1]}" if len(ids) > 1 else ids[0]
        raise InvalidError(f"robot.{strangers[0]}", f"is not in the team ({team}), {hint}")


def _check_ids(key: str, ids: list[str]) -> None:
    for name, times in Counter(ids).items():
        _check_name(key, name, "a robot's id")
        if times > 1:
            raise InvalidError(key, f"{times} robots are called {name}; give each robot an id of its own")


def _check_name(key: str, name: str, of: str) -> None:
    if not ROBOT_ID.fullmatch(name):
        raise InvalidError(
            key,
            f"{_quoted(name)} cannot be {of}; use up to 32 letters, digits, - and _, "
            "of which the first is a letter or digit",
        )


def _check_groups(settings: Settings) -> None:
    for name, times in Counter(group.name for group in settings.group).items():
        _check_name("group.name", name, "a group's name")
        if times > 1:
            raise InvalidError("group.name", f"{times} groups are called {name}; give each a name of its own")
    for group in settings.group:
        _check_group(settings, group)
    team = len(team_ids(settings))
    sizes = {group.name: size(group, team) for group in settings.group}
    if sum(sizes.values()) > team:
        listed = ", ".join(f"{name} {number}" for name, number in sizes.items())
        raise InvalidError(
            "group",
            f"needs {sum(sizes.values())} robots ({listed}), the team has {team}; make a group smaller",
        )


def _check_group(settings: Settings, group: GroupSettings) -> None:
    key = f"group.{group.name}"
    if group.robots is None and group.share is None:
        why = f"missing key {key}.robots: say how many robots it has, or {key}.share instead"
        raise InvalidError(f"{key}.robots", why, names_key=True)
    if group.robots is not None and group.share is not None:
        raise InvalidError(f"{key}.share", f"{key}.robots sets its size as well; keep one of them")
    if group.speed_mps is not None and not isinstance(settings.world.motion, BounceMotion):
        raise InvalidError(
            f"{key}.speed_mps",
            'only robots that bounce have one; set world.motion.kind to "bounce", or leave it out',
        )


def _check_area(settings: Settings) -> None:
    world = settings.world
    if world.area_m is None and world.neighbours is None:
        why = "missing key world.area_m: give the area as [width, height], or world.neighbours instead"
        raise InvalidError("world.area_m", why, names_key=True)
    if world.graph is not None and world.neighbours is not None:
        raise InvalidError(
            "world.neighbours", "world.graph sets the size of the area as well; keep one of them"
        )
    if world.area_m is not None and world.neighbours is not None:
        raise InvalidError(
            "world.neighbours", "world.area_m sets the size of the area as well; keep one of them"
        )
    side = area_m(settings)[0]
    if not MIN_SIDE_M <= side <= MAX_SIDE_M:
        raise InvalidError(
            "world.neighbours",
            f"needs an area with sides of {side:g} m, possible are {MIN_SIDE_M:g} to {MAX_SIDE_M:g} m; "
            "change it or radio.range_m",
        )


def _check_start_area(settings: Settings) -> None:
    start, area = settings.world.start_area_m, area_m(settings)
    if start is not None and (start[0] > area[0] or start[1] > area[1]):
        raise InvalidError(
            "world.start_area_m",
            f"[{start[0]:.12g}, {start[1]:.12g}] is larger than the area, [{area[0]:.12g}, {area[1]:.12g}]; "
            "make it smaller",
        )


def _check_radio(radio: RadioSettings) -> None:
    bursts = radio.bursts
    if bursts is not None and bursts.enter + bursts.leave > 1:
        raise InvalidError(
            "radio.bursts.enter",
            f"is {bursts.enter:g} and radio.bursts.leave {bursts.leave:g}, together more than 1, "
            "which no burst can be like; lower one of them",
        )
    if radio.bit_rate_bps is not None and _airtime_ns(radio) > MAX_TIME_NS:
        raise InvalidError(
            "radio.bit_rate_bps", "is so low that one message takes longer than any run; raise it"
        )
    if radio.collisions and radio.bit_rate_bps is None:
        raise InvalidError(
            "radio.collisions",
            "needs a bit rate: messages that take no time cannot overlap; set radio.bit_rate_bps",
        )
    if radio.access != "tdma":
        return
    if radio.tdma is None:
        why = 'access = "tdma" needs slots; add [radio.tdma] with slot_s, or with units and unit_bits'
        raise InvalidError("radio.tdma", why)
    if radio.bit_rate_bps is None:
        raise InvalidError(
            "radio.bit_rate_bps", 'access = "tdma" needs a bit rate, or messages would take no time; add one'
        )
    _check_units(radio.tdma)
    _check_slot(radio, radio.tdma)


def _check_units(tdma: TdmaSettings) -> None:
    if tdma.units is None and tdma.slot_s is None:
        why = (
            "missing key radio.tdma.slot_s: give the length of a slot, or what it carries "
            "as radio.tdma.units and radio.tdma.unit_bits"
        )
        raise InvalidError("radio.tdma.slot_s", why, names_key=True)
    if tdma.units is not None and tdma.slot_s is not None:
        raise InvalidError(
            "radio.tdma.units", "radio.tdma.slot_s sets the length of a slot as well; keep one of them"
        )
    if tdma.units is not None and tdma.unit_bits is None:
        why = "missing key radio.tdma.unit_bits: say how many bits a unit has"
        raise InvalidError("radio.tdma.unit_bits", why, names_key=True)


def _check_slot(radio: RadioSettings, tdma: TdmaSettings) -> None:
    slot_ns = slot_length_ns(radio, tdma)
    if slot_ns > MAX_TIME_NS:
        raise InvalidError("radio.tdma.units", "make a slot that lasts longer than any run; set fewer")
    if payload_limit(radio) < 1:
        why = f"{tdma.units} units of {tdma.unit_bits} bits hold no whole byte; set more or larger ones"
        raise InvalidError("radio.tdma.units", why)
    needed_ns = _airtime_ns(radio) + to_ns(tdma.guard_s)
    if needed_ns <= slot_ns:
        return
    if tdma.slot_s is None:
        raise InvalidError(
            "radio.max_payload_bytes",
            f"is {payload_limit(radio)}, and {tdma.units} units of {tdma.unit_bits} bits hold no more than "
            f"{(tdma.units or 0) * (tdma.unit_bits or 0) // 8} bytes; leave it out, or set more units",
        )
    # Rounded up, so that the number shown is one that works.
    needed_s = math.ceil(needed_ns / 1000) / 1e6
    guard = f" with a guard of {tdma.guard_s:g} s" if tdma.guard_s else ""
    raise InvalidError(
        "radio.tdma.slot_s",
        f"a slot of {tdma.slot_s:g} s is too short for one message of {payload_limit(radio)} bytes{guard} "
        f"(needs at least {needed_s:.12g} s at {radio.bit_rate_bps:.12g} bit/s); lengthen the slot, "
        "raise bit_rate_bps or lower max_payload_bytes",
    )


def _airtime_ns(radio: RadioSettings) -> int:
    return airtime_ns(8 * payload_limit(radio) + radio.overhead_bits, radio.bit_rate_bps)


def _check_robot(settings: Settings, robot: RobotSettings) -> None:
    key = f"robot.{robot.id}"
    width, height = area_m(settings)
    if robot.position_m is not None:
        x, y = robot.position_m
        if not (0 <= x <= width and 0 <= y <= height):
            raise InvalidError(
                f"{key}.position_m",
                f"[{x:.12g}, {y:.12g}] lies outside the area, which reaches from [0, 0] to "
                f"[{width:.12g}, {height:.12g}]; move the robot or enlarge the area",
            )
    if robot.velocity_mps is not None:
        _check_velocity(settings, robot, key, robot.velocity_mps)


def _check_velocity(settings: Settings, robot: RobotSettings, key: str, velocity: Vector) -> None:
    if not isinstance(settings.world.motion, BounceMotion):
        raise InvalidError(
            f"{key}.velocity_mps",
            'only robots that bounce have one; set world.motion.kind to "bounce", or leave it out',
        )
    heading = robot.heading_rad
    if heading is not None and heading != heading_of(velocity, otherwise=heading):
        raise InvalidError(
            f"{key}.heading_rad", "a bouncing robot faces where velocity_mps points; leave it out"
        )


def _check_functions(settings: Settings) -> None:
    if settings.behaviour is not None:
        _check_function("behaviour", settings.behaviour)
    if settings.score is not None:
        _check_function("score", settings.score)
    for group in settings.group:
        if group.behaviour is not None:
            _check_function(f"group.{group.name}.behaviour", group.behaviour)
    own = {robot.id: robot.behaviour for robot in settings.robot}
    for robot, group in groups(settings).items():
        behaviour = own.get(robot)
        if behaviour is not None:
            _check_function(f"robot.{robot}.behaviour", behaviour)
        elif group.behaviour is None and settings.behaviour is None:
            why = f'missing key behaviour: {robot} has nothing to run; write behaviour = "file.py:function"'
            raise InvalidError("behaviour", why, names_key=True)


def _check_function(key: str, name: str) -> None:
    if not FUNCTION.fullmatch(name):
        raise InvalidError(key, f'must look like "module:function" or "file.py:function", is {_quoted(name)}')
    file = file_of(name)
    if file is not None and (PurePosixPath(file).is_absolute() or PureWindowsPath(file).drive):
        raise InvalidError(key, f"{_quoted(file)} is an absolute path; give it relative to the scenario file")


def _quoted(text: str) -> str:
    return msgspec.json.encode(text[:60]).decode()
