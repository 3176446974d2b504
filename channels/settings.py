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


class TdmaSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """Time-division access: each robot owns one slot a frame."""

    slot_s: Positive
    guard_s: NonNegative = 0.0
    """Silence kept at the end of every slot."""
    order: Literal["fixed", "drawn"] = "fixed"
    """Slots in robot order, or in one order drawn from the seed for the whole run."""


class RadioSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """The radio medium: who is in range, when it may speak, how long that takes, what gets lost."""

    range_m: Positive
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
    max_payload_bytes: Annotated[int, Meta(ge=1, le=MAX_PAYLOAD_BYTES)] = 1024


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
