"""From a robot's broadcast to what the medium makes of it: queues, batches, totals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from msgspec import Raw
from numpy.typing import NDArray

from channels.fates import OnAir
from channels.medium import Fates, Medium, Reason
from channels.messages import Message, encode

Schedule = Callable[[int, int], None]
"""Called with (instant, ticket): have `begin` called for that ticket then."""


@dataclass
class Ending:
    """Transmissions that end at one instant, as parallel columns."""

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
class _Sent:
    """A transmission that waits for its slot, or for the sender's radio, or is on the air."""

    sender: int
    seq: int
    payload: bytes
    airtime_ns: int
    admitted: bool = False
    start_ns: int | None = None
    """When it went on the air; None: not yet."""


class Airwaves:
    """The radio side of one run. Fates are decided when a transmission ends; without airtime, at once."""

    def __init__(self, medium: Medium, robots: Sequence[str], overhead_bits: int) -> None:
        self._medium = medium
        self._robots = robots
        self._overhead_bits = overhead_bits
        self._sequence = [0] * len(robots)
        self._listening: NDArray[np.bool_] = np.ones(len(robots), dtype=bool)
        self._pending: dict[int, _Sent] = {}
        self._tickets = 0
        self._ending = Ending(robots)
        self._on_air: dict[int, _Sent] = {}
        self._past: list[tuple[int, int, int]] = []
        self._counts = np.zeros(256, dtype=np.int64)

    def submit(
        self, sender: int, start_ns: int, payload: bytes, refused: bool, now_ns: int, schedule: Schedule
    ) -> None:
        """A robot hands over a message whose transmission is to start at `start_ns` or later."""
        seq = self._sequence[sender]
        self._sequence[sender] += 1
        sent = _Sent(sender, seq, payload, self._medium.airtime_ns(len(payload)))
        if refused:
            self._end(now_ns, sent, refused=True)
        elif start_ns > now_ns:
            self._wait(start_ns, sent, schedule)
        else:
            self._admit(now_ns, sent, schedule)

    def proceed(self, now_ns: int, ticket: int, schedule: Schedule) -> None:
        """The instant has come for which `schedule` was called with this ticket."""
        sent = self._pending.pop(ticket)
        if sent.start_ns is not None:
            self._on_air.pop(ticket, None)
            self._end(now_ns, sent)
        elif sent.admitted:
            self._start(now_ns, sent, schedule)
        else:
            self._admit(now_ns, sent, schedule)

    def take_batch(self) -> Ending | None:
        """What ends now, in the order in which it was to; None if nothing does."""
        if not self._ending.senders:
            return None
        batch, self._ending = self._ending, Ending(self._robots)
        return batch

    def decide(
        self,
        now_ns: int,
        batch: Ending,
        positions: NDArray[np.float64],
        places: NDArray[np.int64] | None = None,
    ) -> Fates:
        """Ask the medium, and keep count."""
        fates = self._medium.transmit(
            now_ns,
            np.array(batch.senders),
            np.array(batch.seqs),
            np.array(batch.airtimes_ns, dtype=np.int64),
            np.array(batch.refused),
            positions,
            self._listening,
            self._overlapping(now_ns, batch) if self._medium.collides else None,
            places,
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
        """Messages that have been handed over and are not yet sent, or not yet to the end."""
        return len(self._pending)

    def totals(self) -> tuple[int, int, dict[str, int]]:
        """Transmissions sent, deliveries, and drops by reason (over all receivers but the sender)."""
        dropped = {
            reason.name: int(self._counts[reason])
            for reason in Reason
            if reason not in (Reason.delivered, Reason.not_a_candidate) and self._counts[reason]
        }
        return int(self._counts[Reason.not_a_candidate]), int(self._counts[Reason.delivered]), dropped

    def _admit(self, now_ns: int, sent: _Sent, schedule: Schedule) -> None:
        start_ns = self._medium.admit(sent.sender, now_ns, sent.airtime_ns)
        if start_ns is None:
            self._end(now_ns, sent, refused=True)
            return
        sent.admitted = True
        if start_ns > now_ns:
            self._wait(start_ns, sent, schedule)
        else:
            self._start(now_ns, sent, schedule)

    def _start(self, now_ns: int, sent: _Sent, schedule: Schedule) -> None:
        sent.start_ns = now_ns
        if sent.airtime_ns == 0:
            self._end(now_ns, sent)
            return
        ticket = self._wait(now_ns + sent.airtime_ns, sent, schedule)
        if self._medium.collides:
            self._on_air[ticket] = sent

    def _wait(self, at_ns: int, sent: _Sent, schedule: Schedule) -> int:
        self._tickets += 1
        self._pending[self._tickets] = sent
        schedule(at_ns, self._tickets)
        return self._tickets

    def _end(self, now_ns: int, sent: _Sent, refused: bool = False) -> None:
        start_ns = now_ns if refused or sent.start_ns is None else sent.start_ns
        ending = self._ending
        ending.senders.append(sent.sender)
        ending.seqs.append(sent.seq)
        ending.payloads.append(sent.payload)
        ending.bits.append(8 * len(sent.payload) + self._overhead_bits)
        ending.slots.append(self._medium.place_of(sent.sender, start_ns))
        ending.airtimes_ns.append(0 if refused else sent.airtime_ns)
        ending.refused.append(refused)

    def _overlapping(self, now_ns: int, batch: Ending) -> OnAir | None:
        """Everything that was on the air with anything that ends now; None where nothing can have been."""
        now = [
            (sender, now_ns - airtime_ns, now_ns)
            for sender, airtime_ns, refused in zip(
                batch.senders, batch.airtimes_ns, batch.refused, strict=True
            )
            if not refused
        ]
        lasting = [(sent.sender, sent.start_ns or 0, now_ns + 1) for sent in self._on_air.values()]
        air = [*self._past, *now, *lasting]
        # What has ended matters to nobody who began later.
        earliest_ns = min((start_ns for _, start_ns, _ in lasting), default=now_ns)
        self._past = [entry for entry in (*self._past, *now) if entry[2] > earliest_ns]
        if len(air) < 2:
            return None
        return OnAir(*np.array(air, dtype=np.int64).T)
