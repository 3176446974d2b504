"""What a schedule of slots allows (Julian et al. 2009, sec. 2.1): `heliograph predict frame-rate`."""

from __future__ import annotations

from typing import Annotated, Any

from msgspec import Meta, Struct

from agent.behaviours.dissemination.wire import ESTIMATE_BITS
from channels.units import NS_PER_S, airtime_ns, to_ns, to_s
from scenarios.prediction import Prediction


class FrameRateParameters(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A team that takes turns. The defaults are the paper's (sec. 4)."""

    robots: Annotated[int, Meta(ge=1, le=1_000_000, description="robots in the team, n")] = 9
    m: Annotated[int, Meta(ge=1, le=1_000_000, description="estimates in a slot")] = 3
    bits: Annotated[int, Meta(ge=1, le=1_000_000, description="size of an estimate, b")] = ESTIMATE_BITS
    bit_rate: Annotated[float, Meta(ge=0.001, le=1e12, description="of the radio [bit/s]")] = 3000.0
    overhead_bits: Annotated[int, Meta(ge=0, le=1_000_000, description="added to every message")] = 0
    guard_s: Annotated[float, Meta(ge=0, le=1000, description="silence in every slot [s]")] = 0.0
    slots: (
        Annotated[int, Meta(ge=1, le=1_000_000, description="in a frame, where robots share some")] | None
    ) = None
    """None: one for each robot."""


def frame_rate(parameters: FrameRateParameters) -> dict[str, Any]:
    """The schedule, as the medium keeps it to the nanosecond; without overhead and guard r_b / (m n b).

    - `unit_s`: air time of one estimate;
    - `slot_s`: of m estimates and the overhead in one message, and the guard;
    - `frame_s`, `frame_rate_hz`: until every slot had its turn, and how often that is.
    """
    bits = parameters.m * parameters.bits + parameters.overhead_bits
    slot_ns = airtime_ns(bits, parameters.bit_rate) + to_ns(parameters.guard_s)
    frame_ns = slot_ns * (parameters.robots if parameters.slots is None else parameters.slots)
    return {
        "unit_s": to_s(airtime_ns(parameters.bits, parameters.bit_rate)),
        "slot_s": to_s(slot_ns),
        "frame_s": to_s(frame_ns),
        "frame_rate_hz": NS_PER_S / frame_ns,
    }


def check(parameters: FrameRateParameters) -> None:
    """Raises ValueError for parameters that do not go together, naming the key."""
    if parameters.slots is not None and parameters.slots > parameters.robots:
        raise ValueError(
            f"slots: {parameters.robots} robots need no {parameters.slots} slots; "
            f"set slots to {parameters.robots} or less"
        )


PREDICTION = Prediction(
    name="frame-rate",
    title="Slots and frames: how often every robot has its turn",
    parameters=FrameRateParameters,
    predict=frame_rate,
    check=check,
)
