"""What becomes of a transmission at each receiver, and the form of a gate that decides it."""

from __future__ import annotations

from enum import IntEnum
from typing import Any, Protocol, TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

Bools: TypeAlias = NDArray[np.bool_]
Ints: TypeAlias = NDArray[np.integer[Any]]
Floats: TypeAlias = NDArray[np.float64]


class Reason(IntEnum):
    """What became of a transmission at one receiver. Codes fit a uint8; names go into the log."""

    delivered = 0
    out_of_range = 1
    queue_full = 2
    out_of_slot = 3
    too_long = 4
    loss = 5
    receiver_down = 6
    half_duplex = 7
    collision = 8
    burst = 9
    no_line_of_sight = 10
    not_a_candidate = 255
    """The sender itself."""


# A plain number: looking a member up in its enumeration costs as much as a small array operation.
_DELIVERED = np.uint8(Reason.delivered)


class OnAir(Struct, frozen=True, gc=False):
    """A transmissions whose times overlap that of one of a batch, its own ones among them."""

    senders: Ints
    """(A,) robot indices."""
    starts_ns: NDArray[np.int64]
    """(A,)"""
    ends_ns: NDArray[np.int64]
    """(A,)"""


class Batch(Struct, frozen=True, gc=False):
    """Transmissions that end at one instant: T of them, in a team of N robots.

    Their fates are decided when they end: only then is known what else was on the air meanwhile.
    """

    now_ns: int
    """The instant at which they end."""
    senders: Ints
    """(T,) robot indices."""
    seqs: Ints
    """(T,) sequence numbers, each counted by its sender."""
    airtimes_ns: NDArray[np.int64]
    """(T,)"""
    refused: Bools
    """(T,) the sender's transmit queue was full: this one never left it."""
    positions: Floats
    """(N, 2) x, y in metres. An array is never written to once handed over: gates cache by its identity."""
    listening: Bools
    """(N,) the robot's radio is on."""
    on_air: OnAir | None = None
    """None where nothing overlaps, or overlapping does no harm."""
    places: Ints | None = None
    """(N,) vertices of the world's graph that robots communicate from, -1: none; as `positions` never written
    to. None where the link model is none of a graph."""

    @property
    def starts_ns(self) -> NDArray[np.int64]:
        """(T,) when each began."""
        return self.now_ns - self.airtimes_ns


class Fates(Struct, frozen=True, gc=False):
    """One row per transmission, one column per robot."""

    reason: NDArray[np.uint8]
    """(T, N) codes of `Reason`."""
    delay_ns: NDArray[np.int64]
    """(T, N) from the end of the transmission to its reception; meaningful where delivered."""

    def deliveries(self) -> list[tuple[list[int], list[int]]]:
        """For each transmission the receivers it reaches, ascending, and the delay to each [ns]."""
        if len(self.reason) == 1:  # slotted radios speak one at a time: no matrix is needed for a row
            receivers = np.flatnonzero(self.reason[0] == _DELIVERED)
            return [(receivers.tolist(), self.delay_ns[0, receivers].tolist())]
        rows, receivers = np.nonzero(self.reason == _DELIVERED)
        reached, delays = receivers.tolist(), self.delay_ns[rows, receivers].tolist()
        ends = np.bincount(rows, minlength=len(self.reason)).cumsum().tolist()
        starts = [0, *ends[:-1]]
        return [(reached[start:end], delays[start:end]) for start, end in zip(starts, ends, strict=True)]


class Gate(Protocol):
    """One rule of the medium.

    A gate owns no clock and no socket, and its answer depends on nothing but the batch: whether another
    gate has refused a receiver already does not change it.
    """

    @property
    def reason(self) -> Reason:
        """The name of its refusals."""

    def refuses(self, batch: Batch) -> Bools | None:
        """Which receivers it refuses: an array that broadcasts to (T, N), or None for nobody."""
