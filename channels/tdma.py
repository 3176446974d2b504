"""Time-division multiple access: when each slot begins, and what fits into it.

Frame f holds slots 0 .. slots-1, one after the other; slot k of frame f begins at f*frame + k*slot and
ends with `guard_ns` of silence. Robots keep to it by their own clocks, the medium judges by true time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from channels.randomness import Draws, stable_keys
from channels.settings import TdmaSettings
from channels.units import to_ns

Ints: TypeAlias = "int | NDArray[np.integer[Any]]"


@dataclass(frozen=True, slots=True)
class Schedule:
    """A frame of `slots` equal slots. Raises ValueError when no message could ever fit."""

    slot_ns: int
    guard_ns: int
    slots: int

    def __post_init__(self) -> None:
        if not 0 <= self.guard_ns < self.slot_ns:
            raise ValueError(f"a guard of {self.guard_ns} ns leaves nothing of a slot of {self.slot_ns} ns")
        if self.slots < 1:
            raise ValueError(f"{self.slots} slots, at least 1 is needed")

    @property
    def frame_ns(self) -> int:
        """Time from one slot to the same slot of the next frame."""
        return self.slots * self.slot_ns

    def next_start(self, slot: int, after_ns: int) -> int:
        """First start of `slot` at or after an instant."""
        first_ns = slot * self.slot_ns
        frames = -((first_ns - after_ns) // self.frame_ns)
        return first_ns + frames * self.frame_ns

    def fits(self, airtime_ns: Ints) -> Any:
        """Whether such a message fits into a slot before its guard; bool, or a bool array for an array."""
        return airtime_ns + self.guard_ns <= self.slot_ns

    def inside(self, slot: Ints, start_ns: Ints, airtime_ns: Ints) -> Any:
        """Whether a transmission lies wholly in one occurrence of `slot`, before its guard.

        Arguments are integers or arrays that broadcast; bool, or a bool array.
        """
        into_ns = (start_ns - slot * self.slot_ns) % self.frame_ns
        # A message of no airtime at the very end of the slot belongs to the next slot.
        return (into_ns < self.slot_ns) & (into_ns + airtime_ns + self.guard_ns <= self.slot_ns)


def slot_order(settings: TdmaSettings, robots: Sequence[str], seed: int) -> list[int]:
    """The slot of each robot, in robot order: a permutation of 0 .. N-1.

    "drawn" ranks the robots by a draw of their own, so one more robot takes a place in the order and
    leaves the order of the others as it was.
    """
    if settings.order == "fixed":
        return list(range(len(robots)))
    draws = Draws(seed, "slot_order").bits(stable_keys(robots)).tolist()
    slots = [0] * len(robots)
    for slot, robot in enumerate(sorted(range(len(robots)), key=lambda robot: (draws[robot], robots[robot]))):
        slots[robot] = slot
    return slots


def schedule_of(settings: TdmaSettings, robots: int) -> Schedule:
    """The schedule of a team of so many robots. Raises ValueError as `Schedule` does."""
    return Schedule(to_ns(settings.slot_s), to_ns(settings.guard_s), robots)
