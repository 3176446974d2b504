"""What robots and broker say to each other: wire structures, their msgpack codec, their limits.

Everything is a msgpack array with a fixed layout, decoded into typed structures in one step, so a
malformed or oversized message is refused by the decoder and by nothing else. Times are integer
nanoseconds; on this wire they are readings of the *robot's own* clock, which the broker translates
(`channels.clocks`).

    robot  -> broker   Ready      after its subscription is declared
    broker -> robot    Hello      who it is and what it runs
    robot  -> broker   Report 0   the behaviour is built, or why not
    broker -> robot    Grant n    it is now t; here is what arrived meanwhile
    robot  -> broker   Report n   what it did at t, and when it wants to wake
    broker -> robot    Grant -1   the run is over
"""

from __future__ import annotations

import math
from collections.abc import KeysView, Mapping
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta, Struct

from channels.graphs import Graph
from channels.settings import MAX_PAYLOAD_BYTES
from channels.units import to_s

PROTOCOL = 3
MAX_REPORT_BYTES = 16 * 1024 * 1024
MAX_TRANSMISSIONS = 1000
"""Most messages one robot may hand to its radio at one instant."""
MAX_ENTRIES = 10_000
"""Most log entries one robot may write at one instant."""

MAX_NAME = 100
"""Characters of a log entry's name."""

END_OF_RUN = -1
"""`Grant.number` that tells a robot to finish."""

AWAITS_RADIO = 1
AWAITS_CAMERA = 2

Instant = Annotated[int, Meta(ge=-(2**62), le=2**62)]
Text = Annotated[str, Meta(max_length=100_000)]


class MessageError(ValueError):
    """A message that does not have the agreed form; says what is wrong with it."""


class Ready(Struct, array_like=True, frozen=True):
    """A robot process is connected and listens. `protocol` must equal `PROTOCOL`."""

    protocol: int


class RadioPlan(Struct, array_like=True, frozen=True):
    """What a robot's own medium access control needs to know of the radio."""

    max_payload_bytes: int
    overhead_bits: int
    bit_rate_bps: float | None
    queue: int
    slot_ns: int = 0
    """0: no slots, speak when you like."""
    guard_ns: int = 0
    slot: int = 0
    slots: int = 1
    order_key: int | None = None
    """As in `channels.tdma.Schedule`."""


class Hello(Struct, array_like=True, frozen=True):
    """Everything a robot learns at the start, and nothing it must not know."""

    robot: str
    behaviour: str
    params: dict[str, Any]
    rng_seed: int
    """Seed of the robot's own generator; tells nothing of other robots' draws. Below 2**64."""
    clock_ns: int
    """Reading of its own clock at the start."""
    pose: tuple[float, float, float]
    """x, y [m], heading [rad]."""
    radio: RadioPlan
    colours: int
    number: int = 0
    """Its place in the team, from 0: an address of few bits."""
    team: int = 1
    """How many robots there are."""
    altitude_m: float = 0.0
    graph: Graph | None = None
    """Of the world, in metres."""


class Transmission(Struct, array_like=True, frozen=True, gc=False):
    """One radio message handed to the medium: starts at `start_ns`, or never left the queue."""

    start_ns: Instant
    payload: Annotated[bytes, Meta(max_length=MAX_PAYLOAD_BYTES)]
    refused: bool = False
    """The robot's own transmit queue was full: nobody hears it, the log tells."""


class LampCommand(Struct, array_like=True, frozen=True, gc=False):
    """Show `colour` (0: off) from `at_ns` on."""

    at_ns: Instant
    colour: Annotated[int, Meta(ge=0, le=255)]


class MotionCommand(Struct, array_like=True, frozen=True, gc=False):
    """Drive with a velocity, or to a place at a speed and stop there (`towards` set)."""

    velocity_mps: tuple[float, float] = (0.0, 0.0)
    towards_m: tuple[float, float] | None = None
    speed_mps: Annotated[float, Meta(ge=0)] = 0.0


class LogEntry(Struct, array_like=True, frozen=True, gc=False):
    """One line a behaviour logs: a name and an object, as the JSON text that the log will hold."""

    name: Annotated[str, Meta(min_length=1, max_length=MAX_NAME)]
    text: bytes


class Report(Struct, array_like=True, frozen=True, gc=False):
    """What one robot did in one activation."""

    number: int
    """The grant this answers."""
    wake_ns: Instant | None
    """Earliest own timer, or None: nothing but the radio or the camera can wake it."""
    awaits: int = 0
    """Sum of AWAITS_RADIO and AWAITS_CAMERA."""
    transmissions: Annotated[list[Transmission], Meta(max_length=MAX_TRANSMISSIONS)] = []
    lamp: Annotated[list[LampCommand], Meta(max_length=MAX_ENTRIES)] = []
    motion: Annotated[list[MotionCommand], Meta(max_length=MAX_ENTRIES)] = []
    entries: Annotated[list[LogEntry], Meta(max_length=MAX_ENTRIES)] = []
    ended: Text | None = None
    """None: still running. Empty: the behaviour returned. Else: why it failed, in one line."""
    mistaken: bool = False
    """It failed because of the scenario: `ended` names the key."""


class Message(Struct, array_like=True, frozen=True, gc=False):
    """One radio message as a robot receives it. Times by the receiver's own clock."""

    received_ns: int
    """Instant of reception [ns]."""
    sender: str
    """Network address of the robot that sent it (the wireless id)."""
    raw: bytes
    """The payload as it went over the air."""

    @property
    def received_s(self) -> float:
        """Instant of reception [s]."""
        return to_s(self.received_ns)

    @property
    def payload(self) -> Any:
        """What the sender broadcast. Raises MessageError where it is not msgpack."""
        return decode_payload(self.raw)


class WireFrame(Struct, array_like=True, frozen=True, gc=False):
    """One camera frame: parallel little-endian arrays, ordered by visual id.

    `visual` int32, `range_m` and `bearing_rad` float32, `lamp` uint8; all of one length.
    """

    captured_ns: int
    visual: bytes
    range_m: bytes
    bearing_rad: bytes
    lamp: bytes


class Grant(Struct, array_like=True, frozen=True, gc=False):
    """It is now `now_ns`; this has arrived since the last grant, oldest first."""

    number: int
    now_ns: int
    messages: list[Message] = []
    frames: list[WireFrame] = []
    pose: tuple[float, float, float] | None = None
    """Own pose now, or None where it has not changed since the last one sent."""


class RawGrant(Struct, array_like=True, frozen=True, gc=False):
    """`Grant` as the broker writes it: messages and frames were encoded once for all receivers."""

    number: int
    now_ns: int
    messages: list[msgspec.Raw] = []
    frames: list[msgspec.Raw] = []
    pose: tuple[float, float, float] | None = None


def _plain(value: object) -> object:
    """NumPy scalars and arrays travel as the plain numbers and lists they stand for, views as lists."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, KeysView):
        return list(value)
    raise TypeError(
        f"values of type {type(value).__name__} cannot be sent or logged: use numbers, text, lists, dicts"
    )


encode = msgspec.msgpack.Encoder(enc_hook=_plain).encode
"""Any of the structures above, or plain data, as msgpack bytes. TypeError for other objects."""

_encode_json = msgspec.json.Encoder(enc_hook=_plain).encode

_report = msgspec.msgpack.Decoder(Report).decode
_hello = msgspec.msgpack.Decoder(Hello).decode
_ready = msgspec.msgpack.Decoder(Ready).decode
decode_grant = msgspec.msgpack.Decoder(Grant).decode
"""Grant from bytes of the broker, which is trusted."""


def decode_report(raw: bytes) -> Report:
    """Report from untrusted bytes. Raises MessageError, and no other error, on anything else."""
    if len(raw) > MAX_REPORT_BYTES:
        raise MessageError(f"a report of {len(raw)} bytes, the limit is {MAX_REPORT_BYTES}")
    try:
        return _report(raw)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise MessageError(str(error)) from None


def decode_ready(raw: bytes) -> Ready:
    """Ready from untrusted bytes. Raises MessageError on anything else."""
    try:
        return _ready(raw)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise MessageError(str(error)) from None


def decode_hello(raw: bytes) -> Hello:
    """Hello from bytes of the broker. Raises MessageError when versions do not fit."""
    try:
        return _hello(raw)
    except msgspec.DecodeError as error:
        raise MessageError(str(error)) from None


def encode_entry(data: Mapping[str, Any]) -> bytes:
    """A log entry as JSON text; keys that are numbers become text, bytes become base64.

    Raises TypeError for what JSON has no form for, ValueError for NaN and infinity.
    """
    text = _encode_json(dict(data))
    # The encoder turns NaN and infinity into null without a word.
    if b"null" in text and has_non_finite(data):
        raise ValueError("JSON has no NaN and no infinity; log None, or leave the value out")
    return text


def has_non_finite(value: object) -> bool:
    """Whether plain data holds NaN or infinity anywhere."""
    pending: list[Any] = [value]
    for item in pending:
        if item is None or type(item) in (int, str, bool):  # most there is; instance checks take their time
            continue
        if isinstance(item, float | np.floating):
            if not math.isfinite(item):
                return True
        elif isinstance(item, Mapping):
            pending.extend(item.values())
        elif isinstance(item, list | tuple | set | frozenset):
            pending.extend(item)
        elif isinstance(item, np.ndarray):
            pending.extend(item.ravel().tolist())
    return False


def encode_payload(payload: object) -> bytes:
    """A behaviour's radio payload as msgpack. Raises TypeError for what msgpack cannot carry."""
    return encode(payload)


def decode_payload(raw: bytes) -> Any:
    """A radio payload from bytes; bytes that are not msgpack raise MessageError."""
    try:
        return msgspec.msgpack.decode(raw)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise MessageError(str(error)) from None
