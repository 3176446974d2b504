"""What sharing slots gives and costs: frame rate and collisions, by the medium's own gates.

Julian et al. 2009 name it as future work (sec. 5). Robots are placed, slots are given as the emulator gives
them, and everybody transmits in its slot for a whole frame through `channels.medium`, with collisions. With
`after` and `speed` the robots move meanwhile: the slots are those of where they started.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from channels.fates import OnAir, Reason
from channels.medium import Medium
from channels.settings import RadioSettings, TdmaSettings
from channels.units import NS_PER_S
from emulator.placement import side_for_neighbours
from emulator.scenario import MAX_ROBOTS, BounceMotion, RobotSpec
from emulator.slots import shared_slots
from emulator.world import World
from scenarios.dissemination.parameters import SlotLength
from scenarios.study import Study, described, one_each

Floats = NDArray[np.float64]

RANGE_M = 36.0
SPACING_M = 30.0


class ReuseParameters(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A team and its slots. The radio is the paper's: range 36 m, 3000 bit/s, 192 bits."""

    robots: Annotated[int, Meta(ge=2, le=MAX_ROBOTS, description="how many")] = 100
    placement: Annotated[
        Literal["uniform", "grid"],
        Meta(description="anywhere in a square; or a square grid, spacing 30 m, with four neighbours"),
    ] = "uniform"
    neighbours: Annotated[
        float, Meta(gt=0, le=100, description="robots in range of one, in the mean, where they are anywhere")
    ] = 8.0
    reuse: Annotated[
        Literal["none", "distance_two", "distance_one", "random"],
        Meta(description="who shares a slot; random: drawn, of as many as distance_two takes"),
    ] = "distance_two"
    m: SlotLength = 7
    speed: Annotated[
        float, Meta(ge=0, le=1000, description="of the robots, in directions of their own [m/s]")
    ] = 0.0
    after: Annotated[float, Meta(ge=0, le=100_000, description="time since slots were given [s]")] = 0.0


class Frame(NamedTuple):
    """What one frame came to."""

    slots: int
    links: int
    """Ordered pairs in range as one of them transmits."""
    delivered: int
    collided: int
    """Lost to another transmission."""
    deaf: int
    """Lost because the receiver was transmitting."""
    frame_ns: int


def check(parameters: ReuseParameters) -> None:
    """Raises ValueError for parameters that do not go together, naming the key."""
    if parameters.placement == "grid" and math.isqrt(parameters.robots) ** 2 != parameters.robots:
        raise ValueError(
            f"robots: a square grid has 4, 9, 16, ... robots, not {parameters.robots}; choose such a number"
        )
    if parameters.after > 0 and parameters.speed == 0:
        raise ValueError("after: nothing changes while robots stand still; set speed as well")


def simulate(parameters: ReuseParameters, generator: np.random.Generator, samples: int) -> list[Frame]:
    """A frame of each of so many teams."""
    return [_frame(parameters, generator) for _ in range(samples)]


def summarise(_parameters: ReuseParameters, partials: Sequence[list[Frame]]) -> dict[str, Any]:
    """`mean` and `se` over teams (None for a single one), except for `samples`, the teams.

    - `slots_per_frame`; `frame_rate_hz`;
    - `neighbours`: robots in range of a transmission;
    - `collided`, `deaf`: shares of receptions in range that another transmission destroyed, or that the
      receiver missed because it was transmitting itself;
    - `receptions_per_robot_s`: what a robot gets to hear, in packets a second.
    """
    frames = [frame for partial in partials for frame in partial]
    in_range = [max(frame.links, 1) for frame in frames]
    robots = _parameters.robots
    return {
        "slots_per_frame": described([frame.slots for frame in frames]),
        "frame_rate_hz": described([NS_PER_S / frame.frame_ns for frame in frames]),
        "neighbours": described([frame.links / robots for frame in frames]),
        "collided": described(
            [frame.collided / links for frame, links in zip(frames, in_range, strict=True)]
        ),
        "deaf": described([frame.deaf / links for frame, links in zip(frames, in_range, strict=True)]),
        "receptions_per_robot_s": described(
            [frame.delivered / robots * NS_PER_S / frame.frame_ns for frame in frames]
        ),
        "samples": len(frames),
    }


def _frame(parameters: ReuseParameters, generator: np.random.Generator) -> Frame:
    specs, side = _team(parameters, generator)
    radio = _radio(parameters, "distance_two" if parameters.reuse == "random" else parameters.reuse)
    slots = shared_slots(radio, specs, 0)
    if parameters.reuse == "random":
        assert slots is not None
        slots = generator.integers(0, max(slots) + 1, len(specs)).tolist()
    medium = Medium(radio, [spec.id for spec in specs], 0, slots=slots)
    world = World((side, side), specs, BounceMotion(parameters.speed))
    return _transmitted(medium, world, round(parameters.after * NS_PER_S))


def _team(parameters: ReuseParameters, generator: np.random.Generator) -> tuple[list[RobotSpec], float]:
    """The robots, and the side of their square [m]."""
    count = parameters.robots
    if parameters.placement == "grid":
        row = math.isqrt(count)
        side = SPACING_M * row
        places = [(SPACING_M * (k % row + 0.5), SPACING_M * (k // row + 0.5)) for k in range(count)]
    else:
        side = side_for_neighbours(count, parameters.neighbours, RANGE_M)
        places = [(x, y) for x, y in (generator.random((count, 2)) * side).tolist()]
    angles = generator.uniform(0, math.tau, count)
    velocities = parameters.speed * np.column_stack((np.cos(angles), np.sin(angles)))
    return [
        RobotSpec(f"r{k:02d}", place, 0.0, (vx, vy), "", {})
        for k, (place, (vx, vy)) in enumerate(zip(places, velocities.tolist(), strict=True))
    ], side


def _radio(
    parameters: ReuseParameters, reuse: Literal["none", "distance_two", "distance_one"]
) -> RadioSettings:
    return RadioSettings(
        range_m=RANGE_M,
        access="tdma",
        bit_rate_bps=3000.0,
        collisions=True,
        tdma=TdmaSettings(units=parameters.m, unit_bits=192, reuse=reuse),
    )


def _transmitted(medium: Medium, world: World, from_ns: int) -> Frame:
    """Everybody transmits once, in its slot of the first whole frame from an instant on."""
    schedule = medium.schedule
    assert schedule is not None
    slots = np.array(medium.slots)
    begin_ns = -(-from_ns // schedule.frame_ns) * schedule.frame_ns
    counts = np.zeros(256, dtype=np.int64)
    for slot in range(schedule.slots):
        senders = np.flatnonzero(slots == slot)
        start_ns = begin_ns + slot * schedule.slot_ns
        end_ns = start_ns + schedule.slot_ns
        air = OnAir(senders, np.full_like(senders, start_ns), np.full_like(senders, end_ns))
        fates = medium.transmit(
            end_ns, senders, np.zeros_like(senders), air.ends_ns - air.starts_ns,
            np.zeros(len(senders), dtype=bool), world.positions(end_ns), np.ones(len(slots), dtype=bool), air,
        )  # fmt: skip
        counts += np.bincount(fates.reason.ravel(), minlength=256)
    delivered, collided, deaf = (
        int(counts[reason]) for reason in (Reason.delivered, Reason.collision, Reason.half_duplex)
    )
    links = delivered + collided + deaf
    return Frame(schedule.slots, links, delivered, collided, deaf, schedule.frame_ns)


STUDY = Study(
    name="reuse",
    title="Slots shared by robots: frame rate and collisions",
    parameters=ReuseParameters,
    samples=20,
    unit="teams",
    chunk=one_each,
    simulate=simulate,
    summarise=summarise,
    check=check,
)
