"""Who knew what of whom, and when: rebuilt from a log.

What robots hear makes their tables of estimates, so the tables can be told from the radio alone: the
estimates of every packet, at every robot it was delivered to; of each robot the strictly newer time stamp
wins (Julian et al. 2009, sec. 2.1). A stamp is a reading of the clock of the robot it is about, taken when
its slot begins; its true time is the start of the first transmission in which that robot itself said it.

Where robots are is taken from /truth: their starts, how they move, and what they were told to do since. That
is exact at every instant, for robots on the air and for silent ones.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from msgspec import Struct, structs
from numpy.typing import NDArray

from agent.behaviours.dissemination.geodesy import TangentPlane
from agent.behaviours.dissemination.wire import Wire
from logs.reader import LogReader
from scenarios.runs import Record, Run, read_run

Ints = NDArray[np.int64]

REFUSED = ("out_of_slot", "too_long", "queue_full")
"""Why a transmission never was on the air, as far as slots are concerned."""
_STAMPS = 2**32


class Transmission(NamedTuple):
    """One record of /radio; robots by their number in the team."""

    sender: int
    start_ns: int
    airtime_ns: int
    slot: int | None
    bits: int
    refused: bool
    estimates: list[tuple[int, int]]
    """(number, time stamp [ms]) of each estimate in it, in order; none where it is no packet."""
    receivers: list[int]
    received_ns: list[int]
    """When each of `receivers` had it."""


class Knowledge(Struct, frozen=True):
    """Every estimate that was strictly newer to its receiver; parallel, by receiver, origin and time."""

    receiver: Ints
    origin: Ints
    """Whom it is about."""
    received_ns: Ints
    sent_ns: Ints
    """When the transmission that carried it began."""
    made_ns: Ints
    """The true time of its stamp."""
    stamp_ms: Ints
    unexplained: int = 0
    """How many more there were whose stamp the origin itself never sent; nobody can tell how old they are."""


class History(Run, frozen=True, kw_only=True):
    """What scoring takes from a log."""

    transmissions: list[Transmission]


def read(log: LogReader) -> History:
    """Everything scoring needs, read once. Raises ValueError for a log that does not say what was run."""
    run = read_run(log)
    sent = transmissions(log.records("/radio"), run.robots, _joined(log))
    return History(**structs.asdict(run), transmissions=sent)


def transmissions(
    radio: Iterable[Record], robots: Sequence[str], joined_ns: Mapping[str, int] = MappingProxyType({})
) -> list[Transmission]:
    """All records of /radio, whose log time is the end of the transmission.

    A packet that robots refuse (`wire.PacketError`) carries no estimates. `joined_ns`: when robots that came
    late began; what they had received before, they threw away.
    """
    number = {name: place for place, name in enumerate(robots)}
    wire = Wire(TangentPlane((0.0, 0.0)), len(robots))
    return [
        Transmission(
            sender=number[record["from"]],
            start_ns=time_ns - record["airtime_ns"],
            airtime_ns=record["airtime_ns"],
            slot=record["slot"],
            bits=record["bits"],
            refused=any(reason in record["dropped"] for reason in REFUSED),
            estimates=_estimates(record["payload"], wire),
            receivers=[number[name] for name, _ in heard],
            received_ns=[received_ns for _, received_ns in heard],
        )
        for time_ns, record in radio
        for heard in [_heard_by(time_ns, record, joined_ns)]
    ]


def _heard_by(time_ns: int, record: Mapping[str, Any], joined_ns: Mapping[str, int]) -> list[tuple[str, int]]:
    """Who has heard a transmission, and when; who had not joined yet has thrown it away."""
    heard = zip(record["delivered"], record["delay_ns"], strict=True)
    return [
        (name, time_ns + delay_ns) for name, delay_ns in heard if time_ns + delay_ns > joined_ns.get(name, -1)
    ]


def knowledge(sent: Sequence[Transmission], robots: int) -> Knowledge:
    """What each of so many robots got to know, from the transmissions in the order of the log."""
    receiver, origin, received_ns, sent_ns, stamp_ms = _heard(sent)
    pair = receiver * robots + origin
    order = np.lexsort((received_ns, pair))
    order = order[receiver[order] != origin[order]]  # about itself a robot knows better
    pair, stamp_ms = pair[order], stamp_ms[order]
    # Pairs ascend, so the largest value so far is the newest stamp of the same pair.
    newest = np.maximum.accumulate(pair * _STAMPS + stamp_ms + 1)
    newer = newest > np.concatenate([np.array([-1]), newest])[:-1]
    order, stamp_ms = order[newer], stamp_ms[newer]
    made_ns = _made(sent, origin[order], stamp_ms)
    told = made_ns >= 0
    order = order[told]
    return Knowledge(
        receiver[order], origin[order], received_ns[order], sent_ns[order], made_ns[told], stamp_ms[told],
        int(np.count_nonzero(~told)),
    )  # fmt: skip


def _estimates(payload: object, wire: Wire) -> list[tuple[int, int]]:
    if not (isinstance(payload, dict) and payload.keys() == {"base64"}):
        return []
    try:
        packet = base64.b64decode(payload["base64"], validate=True)
        return [(estimate.number, estimate.time_ms) for estimate in wire.unpack(packet)]
    except (TypeError, ValueError):  # PacketError is one
        return []


def _heard(sent: Sequence[Transmission]) -> tuple[Ints, Ints, Ints, Ints, Ints]:
    """Receiver, origin, reception and start of the transmission [ns], stamp [ms] of all estimates heard."""
    estimates = _ints(len(one.estimates) for one in sent)
    receivers = _ints(len(one.receivers) for one in sent)
    rows = estimates * receivers
    begins = np.repeat(np.cumsum(rows) - rows, rows)
    within = np.arange(int(rows.sum())) - begins
    per_receiver = np.repeat(estimates, rows)
    estimate = np.repeat(np.cumsum(estimates) - estimates, rows) + within % np.maximum(per_receiver, 1)
    reception = np.repeat(np.cumsum(receivers) - receivers, rows) + within // np.maximum(per_receiver, 1)
    listed = _ints(value for one in sent for pair in one.estimates for value in pair).reshape(-1, 2)
    receiver = _ints(number for one in sent for number in one.receivers)
    received_ns = _ints(time_ns for one in sent for time_ns in one.received_ns)
    sent_ns = np.repeat(_ints(one.start_ns for one in sent), rows)
    return receiver[reception], listed[estimate, 0], received_ns[reception], sent_ns, listed[estimate, 1]


def _made(sent: Sequence[Transmission], origin: Ints, stamp_ms: Ints) -> Ints:
    """True time of these stamps [ns]; -1 where the origin never sent it."""
    first: dict[int, int] = {}
    for one in sent:
        for number, stamp in one.estimates:
            if number == one.sender:
                first.setdefault(number * _STAMPS + stamp, one.start_ns)
    keys = (origin * _STAMPS + stamp_ms).tolist()
    return _ints(first.get(key, -1) for key in keys)


def _joined(log: LogReader) -> dict[str, int]:
    return {
        record["robot"]: time_ns for time_ns, record in log.records("/robot") if record["entry"] == "joined"
    }


def _ints(values: Iterable[int]) -> Ints:
    return np.fromiter(values, dtype=np.int64)
