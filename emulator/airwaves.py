"""From a robot's broadcast to what the medium makes of it: queues, batches, totals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from msgspec import Raw
from numpy.typing import NDArray

from channels.medium import Fates, Medium, Reason
from channels.messages import Message, encode

Schedule = Callable[[int, int], None]
"""Called with (instant, ticket): have `begin` called for that ticket then."""


@dataclass
class Starting:
    """Transmissions that start at one instant, as parallel columns."""

    robots: Sequence[str]
    senders: list[int] = field(default_factory=list)
    seqs: list[int] = field(default_factory=list)
    payloads: list[bytes] = field(default_factory=list)
    bits: list[int] = field(default_factory=list)
    slots: list[int | None] = field(default_factory=list)
    airtimes_ns: list[int] = field(default_factory=list)
    refused: list[bool] = field(default_factory=list)

    def for_record(self) -> tuple[Any, ...]:
        """The columns in the order the recorder takes them."""
        return self.senders, self.seqs, self.payloads, self.bits, self.slots, self.airtimes_ns

    def message(self, row: int, received_ns: int) -> Raw:
        """One transmission as its receivers get it, encoded."""
        return Raw(encode(Message(received_ns, self.robots[self.senders[row]], self.payloads[row])))


@dataclass(slots=True)
class _Waiting:
    """A transmission that starts later: in its slot, or when the sender's radio is free."""

    sender: int
    seq: int
    payload: bytes
    admitted: bool


class Airwaves:
    """The radio side of one run."""

    def __init__(self, medium: Medium, robots: Sequence[str], overhead_bits: int) -> None:
        self._medium = medium
        self._robots = robots
        self._overhead_bits = overhead_bits
        self._sequence = [0] * len(robots)
        self._listening: NDArray[np.bool_] = np.ones(len(robots), dtype=bool)
        self._waiting: dict[int, _Waiting] = {}
        self._tickets = 0
        self._starting = Starting(robots)
        self._counts = np.zeros(256, dtype=np.int64)

    def submit(
        self, sender: int, start_ns: int, payload: bytes, refused: bool, now_ns: int, schedule: Schedule
    ) -> None:
        """A robot hands over a message whose transmission is to start at `start_ns` or later."""
        seq = self._sequence[sender]
        self._sequence[sender] += 1
        if refused:
            self._add(sender, seq, payload, refused=True)
        elif start_ns > now_ns:
            self._wait(start_ns, _Waiting(sender, seq, payload, admitted=False), schedule)
        else:
            self._admit(now_ns, _Waiting(sender, seq, payload, admitted=False), schedule)

    def begin(self, now_ns: int, ticket: int, schedule: Schedule) -> bool:
        """The instant of a waiting transmission has come. True where something starts now."""
        waiting = self._waiting.pop(ticket)
        if waiting.admitted:
            self._add(waiting.sender, waiting.seq, waiting.payload)
            return True
        return self._admit(now_ns, waiting, schedule)

    def take_batch(self) -> Starting | None:
        """What starts now, in the order it was handed over; None if nothing does."""
        if not self._starting.senders:
            return None
        batch, self._starting = self._starting, Starting(self._robots)
        return batch

    def decide(self, now_ns: int, batch: Starting, positions: NDArray[np.float64]) -> Fates:
        """Ask the medium, and keep count."""
        fates = self._medium.transmit(
            now_ns,
            np.array(batch.senders),
            np.array(batch.seqs),
            np.array(batch.airtimes_ns, dtype=np.int64),
            np.array(batch.refused),
            positions,
            self._listening,
        )
        self._counts += np.bincount(fates.reason.ravel(), minlength=256)
        return fates

    def switch_off(self, robot: int) -> None:
        """Nothing reaches this robot from now on."""
        listening = self._listening.copy()
        listening[robot] = False
        self._listening = listening

    @property
    def waiting(self) -> int:
        """Messages that have been handed over and have not started yet."""
        return len(self._waiting)

    def totals(self) -> tuple[int, int, dict[str, int]]:
        """Transmissions sent, deliveries, and drops by reason (over all receivers but the sender)."""
        dropped = {
            reason.name: int(self._counts[reason])
            for reason in Reason
            if reason not in (Reason.delivered, Reason.not_a_candidate) and self._counts[reason]
        }
        return int(self._counts[Reason.not_a_candidate]), int(self._counts[Reason.delivered]), dropped

    def _admit(self, now_ns: int, waiting: _Waiting, schedule: Schedule) -> bool:
        airtime = self._medium.airtime_ns(len(waiting.payload))
        start = self._medium.admit(waiting.sender, now_ns, airtime)
        if start is not None and start > now_ns:
            waiting.admitted = True
            self._wait(start, waiting, schedule)
            return False
        self._add(waiting.sender, waiting.seq, waiting.payload, refused=start is None)
        return True

    def _wait(self, at_ns: int, waiting: _Waiting, schedule: Schedule) -> None:
        self._tickets += 1
        self._waiting[self._tickets] = waiting
        schedule(at_ns, self._tickets)

    def _add(self, sender: int, seq: int, payload: bytes, refused: bool = False) -> None:
        starting = self._starting
        starting.senders.append(sender)
        starting.seqs.append(seq)
        starting.payloads.append(payload)
        starting.bits.append(8 * len(payload) + self._overhead_bits)
        starting.slots.append(self._medium.slots[sender] if self._medium.schedule is not None else None)
        starting.airtimes_ns.append(self._medium.airtime_ns(len(payload)))
        starting.refused.append(refused)
