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
    not_a_candidate = 255
    """The sender itself."""


class Batch(Struct, frozen=True, gc=False):
    """Transmissions that start at one instant: T of them, in a team of N robots."""

    now_ns: int
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


class Fates(Struct, frozen=True, gc=False):
    """One row per transmission, one column per robot."""

    reason: NDArray[np.uint8]
    """(T, N) codes of `Reason`."""
    delay_ns: NDArray[np.int64]
    """(T, N) from the start of the transmission to its reception; meaningful where delivered."""


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
