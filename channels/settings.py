"""What a scenario says about the media. Plain data, validated where it is decoded.

Every quantity carries its unit in its name; probabilities lie in [0, 1].
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct

Positive = Annotated[float, Meta(gt=0)]
NonNegative = Annotated[float, Meta(ge=0)]
Probability = Annotated[float, Meta(ge=0, le=1)]
Count = Annotated[int, Meta(ge=1)]

MAX_PAYLOAD_BYTES = 65_536
"""Hard limit of one radio payload, whatever a scenario allows."""
USUAL_PAYLOAD_BYTES = 1024


class TdmaSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """Time-division access: each robot owns one slot a frame, as long as one of `slot_s` and `units` says."""

    slot_s: Positive | None = None
    """Length of a slot, guard included."""
    units: Count | None = None
    """Or what a slot carries: one message of so many units of `unit_bits` (Julian et al. 2009: m)."""
    unit_bits: Count | None = None
    guard_s: NonNegative = 0.0
    """Silence in every slot, half of it before the message and half after: what clocks may be off by."""
    order: Literal["fixed", "drawn", "drawn_each_frame"] = "fixed"
    """Slots in robot order, in one order drawn from the seed for the run, or in a new one each frame."""
    reuse: Literal["none", "distance_two", "distance_one"] = "none"
    """Whether robots share a slot: nobody; those more than two hops apart, none of whose neighbours can hear
    both; or all that are no neighbours, which collide at whoever is a neighbour of both. Hops are counted
    where the robots start."""


class BurstSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """Losses that come in bursts (Gilbert 1960, Elliott 1963): each link is in a burst or it is not.

    The state of the link from a to b may change with every transmission of a. `enter` + `leave` is at
    most 1: a burst is as likely to go on as the link is to be in one, or likelier.
    """

    enter: Annotated[float, Meta(gt=0, le=1)]
    """Probability that a burst begins, per transmission."""
    leave: Annotated[float, Meta(gt=0, le=1)]
    """Probability that it ends, per transmission: 1 / leave is the mean length of a burst."""
    loss: Probability = 1.0
    """Loss during a burst; `radio.loss` comes on top of it, and counts outside of bursts as well."""


class RadioSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """The radio medium: who is in range, when it may speak, how long that takes, what gets lost."""

    range_m: Positive | None = None
    """What `link` = "disc" needs."""
    access: Literal["ideal", "tdma"] = "ideal"
    tdma: TdmaSettings | None = None
    bit_rate_bps: Positive | None = None
    """None: unlimited bandwidth (Ivanov & Shell 2016, Assumption 3), a message takes no airtime."""
    overhead_bits: Annotated[int, Meta(ge=0)] = 0
    """Preamble, addresses and checksum added to every payload."""
    queue: Count = 64
    """Messages a sender holds that have not left it yet; further ones are dropped, `queue_full`."""
    latency_s: Positive = 0.001
    """From the end of a transmission to its reception; greater than zero always."""
    jitter_s: NonNegative = 0.0
    """Uniform extra latency per receiver, in [0, jitter_s)."""
    loss: Probability = 0.0
    """Bernoulli loss per transmission and receiver."""
    bursts: BurstSettings | None = None
    collisions: bool = False
    """Transmissions that overlap in time destroy each other at whoever is in range of both, and a robot that
    transmits hears nobody."""
    max_payload_bytes: Annotated[int, Meta(ge=1, le=MAX_PAYLOAD_BYTES)] | None = None
    """None: what the units of a slot hold, where slots have units; else 1024."""
    link: Literal["disc", "graph"] = "disc"
    """Who is in range: all within `range_m`, or those whose places in the world's graph hear each other. A
    robot's place is the vertex that it stood at last: who is on its way communicates as from there."""
    line_of_sight: bool = False
    """A disc with shadows: nobody is heard through an obstacle, however high robots are."""


def payload_limit(radio: RadioSettings) -> int:
    """Largest payload a robot may broadcast [bytes]."""
    if radio.max_payload_bytes is not None:
        return radio.max_payload_bytes
    tdma = radio.tdma
    if radio.access != "tdma" or tdma is None or tdma.units is None or tdma.unit_bits is None:
        return USUAL_PAYLOAD_BYTES
    return min(tdma.units * tdma.unit_bits // 8, MAX_PAYLOAD_BYTES)


class LampSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """The light every robot carries."""

    latency_s: Positive = 0.001
    """From the command to the change that a camera can see."""
    colours: Annotated[int, Meta(ge=1, le=255)] = 1
    """How many different colours the lamp can show besides off (0)."""


class CameraSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """The camera every robot carries. Angles are relative to the robot's heading."""

    range_m: Positive
    field_of_view_deg: Annotated[float, Meta(gt=0, le=360)] = 360.0
    frame_rate_hz: Positive = 2.0
    phase_s: NonNegative | None = None
    """Instant of the first frame; None: half a frame period."""
    latency_s: Positive = 0.01
    """From exposure to the frame being available to the robot."""
    miss: Probability = 0.0
    """A robot in view is absent from one frame."""
    lamp_miss: Probability = 0.0
    """A lit lamp looks dark in one frame."""
    lamp_false: Probability = 0.0
    """A dark lamp looks lit (colour 1) in one frame."""
    range_noise_m: NonNegative = 0.0
    """Standard deviation of the measured range."""
    bearing_noise_deg: NonNegative = 0.0
    """Standard deviation of the measured bearing."""


class ClockSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """Imperfection of the robots' own clocks; each robot draws its own within these bounds."""

    drift_ppm: Annotated[float, Meta(ge=0, le=100_000)] = 0.0
    """A robot's clock runs fast or slow by up to this many parts per million, uniformly."""
    offset_s: NonNegative = 0.0
    """A robot's clock is ahead at the start by up to this much, uniformly in [0, offset_s)."""
