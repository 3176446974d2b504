"""Time-division multiple access: when each slot begins, and what fits into it.

Frame f holds places 0 .. slots-1, one after the other; place k of frame f begins at f*frame + k*slot. A
slot is at the place of its own number, or, where the order is drawn anew for every frame, at one that
everybody works out from a common key. The guard is silence: half of it before the message, half after.
Robots keep to it by their own clocks; by true time the medium asks only that a message does not leave its
slot. So a clock may be off by half the guard, in either direction, and nothing is lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from channels.randomness import Draws, stable_keys
from channels.settings import RadioSettings, TdmaSettings
from channels.units import airtime_ns, to_ns

Ints: TypeAlias = "int | NDArray[np.integer[Any]]"


@dataclass(frozen=True, slots=True)
class Schedule:
    """A frame of `slots` equal slots. Raises ValueError when no message could ever fit."""

    slot_ns: int
    guard_ns: int
    slots: int
    order_key: int | None = None
    """Of the draws that give every frame an order of its own; None: slots are in order of their numbers."""

    def __post_init__(self) -> None:
        if not 0 <= self.guard_ns < self.slot_ns:
            raise ValueError(f"a guard of {self.guard_ns} ns leaves nothing of a slot of {self.slot_ns} ns")
        if self.slots < 1:
            raise ValueError(f"{self.slots} slots, at least 1 is needed")

    @property
    def frame_ns(self) -> int:
        """Time from the beginning of a frame to that of the next."""
        return self.slots * self.slot_ns

    @property
    def lead_ns(self) -> int:
        """Silence before the message."""
        return self.guard_ns // 2

    def place(self, slot: int, frame: int) -> int:
        """Where in a frame a slot is: 0 .. slots-1."""
        if self.order_key is None:
            return slot
        return _order(self.order_key, frame, self.slots)[slot]

    def next_start(self, slot: int, after_ns: int) -> int:
        """First instant at or after another at which a message may begin in `slot`, its lead being over."""
        frame = after_ns // self.frame_ns
        start_ns = self._start(slot, frame)
        return start_ns if start_ns >= after_ns else self._start(slot, frame + 1)

    def _start(self, slot: int, frame: int) -> int:
        return frame * self.frame_ns + self.place(slot, frame) * self.slot_ns + self.lead_ns

    def fits(self, airtime_ns: Ints) -> Any:
        """Whether such a message fits into a slot beside its guard; bool, or a bool array for an array."""
        return airtime_ns + self.guard_ns <= self.slot_ns

    def inside(self, slot: int, start_ns: int, airtime_ns: int) -> bool:
        """Whether a transmission lies wholly in one occurrence of `slot`, guard included."""
        into_ns = self._into(slot, start_ns)
        # A message of no airtime at the very end of the slot belongs to the next slot.
        return 0 <= into_ns < self.slot_ns and into_ns + airtime_ns <= self.slot_ns

    def keeps_guard(self, slot: int, start_ns: int, airtime_ns: int) -> bool:
        """Whether a transmission lies in one occurrence of `slot` and leaves its guard silent."""
        into_ns, tail_ns = self._into(slot, start_ns), self.guard_ns - self.lead_ns
        # A clock that runs fast can skip the very nanosecond at which the message was to begin.
        silent_from_ns = self.slot_ns - max(tail_ns - 1, 0)
        return self.lead_ns <= into_ns < self.slot_ns and into_ns + airtime_ns <= silent_from_ns

    def _into(self, slot: int, instant_ns: int) -> int:
        """Time since `slot` began in the frame of an instant; negative where it is still to come."""
        frame = instant_ns // self.frame_ns
        return instant_ns - frame * self.frame_ns - self.place(slot, frame) * self.slot_ns


@lru_cache(maxsize=256)
def _order(key: int, frame: int, slots: int) -> tuple[int, ...]:
    """The place of every slot in one frame."""
    draws = Draws.of_key(key).bits(frame, np.arange(slots))
    places = np.empty(slots, dtype=np.int64)
    places[np.argsort(draws, kind="stable")] = np.arange(slots)
    return tuple(places.tolist())


def slot_order(settings: TdmaSettings, robots: Sequence[str], seed: int) -> list[int]:
    """The slot of each robot where all have one of their own, in robot order: a permutation of 0 .. N-1.

    "drawn" ranks the robots by a draw of their own, so one more robot takes a place in the order and
    leaves the order of the others as it was. "drawn_each_frame" is up to the schedule.
    """
    if settings.order != "drawn":
        return list(range(len(robots)))
    draws = Draws(seed, "slot_order").bits(stable_keys(robots)).tolist()
    slots = [0] * len(robots)
    for slot, robot in enumerate(sorted(range(len(robots)), key=lambda robot: (draws[robot], robots[robot]))):
        slots[robot] = slot
    return slots


def schedule_of(radio: RadioSettings, slots: int, seed: int) -> Schedule:
    """The schedule of a frame of so many slots. Raises ValueError as `Schedule` does, or without settings."""
    tdma = radio.tdma
    if tdma is None:
        raise ValueError("access is tdma, but there are no tdma settings")
    key = Draws(seed, "slot_order_of_frame").key if tdma.order == "drawn_each_frame" else None
    return Schedule(slot_length_ns(radio, tdma), to_ns(tdma.guard_s), slots, key)


def slot_length_ns(radio: RadioSettings, tdma: TdmaSettings) -> int:
    """Length of a slot, guard included, from its units or as it is given.

    Raises ValueError where neither says, or units have no size.
    """
    if tdma.units is None:
        if tdma.slot_s is None:
            raise ValueError("slots have neither a length nor units")
        return to_ns(tdma.slot_s)
    if tdma.unit_bits is None:
        raise ValueError("the units of a slot have no size")
    bits = tdma.units * tdma.unit_bits + radio.overhead_bits
    return airtime_ns(bits, radio.bit_rate_bps) + to_ns(tdma.guard_s)
