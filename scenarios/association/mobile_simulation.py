"""Mobile association of all observers of a world at once (Ivanov & Shell 2016, Alg. 2).

Does to flat arrays what `MobileIState` does to one robot's i-state, in the same order.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Stamps = NDArray[np.int16 | np.int32]

LIT = 1
LISTED = 2
STEP = 4
"""Parts of what is known of a robot in view: step * STEP + LISTED (its visual id is in the list) + LIT."""


class Counts(Struct, frozen=True):
    """How every observer stands after a step; shape (observers,) each."""

    visual: Ints
    """Visual ids in the list."""
    edges: Ints
    true_edges: Ints
    matched: Ints
    """Visual ids with exactly one candidate."""
    right: Ints
    """Those of them whose candidate is the right one."""


class MobileAssociation:
    """The i-states of `observers` robots, which are the first ones of `robots`.

    Robot r as observer o sees or hears it is the key o * robots + r. A robot has at most one visual id at a
    time, and the key stands for the present one. All arrays of keys are sorted: so what belongs to one
    observer, and all edges of one visual id, lie beside each other.

    `drop_time`: steps in a row without a message after which a wireless id is dropped.
    `wireless_exceeds_visual`: whether robots are heard farther than they are seen (sec. 5.2, 6.1).
    `steps`: how many steps there will be at most (it decides how much memory a pair of robots takes).
    """

    def __init__(
        self,
        observers: int,
        robots: int,
        *,
        drop_time: int = 20,
        wireless_exceeds_visual: bool = False,
        steps: int = 2**20,
    ) -> None:
        if drop_time < 1:
            raise ValueError(f"drop_time is 1 step or more, not {drop_time}")
        self._drop_time = drop_time
        self._wireless_exceeds_visual = wireless_exceeds_visual
        self._step = 0
        self._rows = np.arange(observers + 1) * robots
        # Dense, so that every question is one look-up; stamped with the step, so that they need no clearing.
        size, stamp = observers * robots, stamp_type(steps, drop_time)
        self._seen: Stamps = np.zeros(size, dtype=stamp)
        self._heard: Stamps = np.full(size, -drop_time - 1, dtype=stamp)
        self._associated: Stamps = np.zeros(size if wireless_exceeds_visual else 0, dtype=stamp)
        self.visual: Ints = np.zeros(0, dtype=np.int64)
        """Keys of the visual ids in the lists."""
        self.edges: tuple[Ints, Ints] = (self.visual, self.visual)
        """Keys of the visual and of the wireless end of every edge, sorted by the visual."""

    def observe(self, in_view: Ints, in_earshot: Ints, active: Bools) -> None:
        """Take in one time step.

        `in_view`, `in_earshot`: keys of the robots in visual and in wireless range, sorted, each once;
        `active`, shape (robots,): who transmits, in both channels.
        """
        self._step += 1
        lit = self._active(in_view, active)
        heard = in_view[lit] if in_earshot is in_view else in_earshot[self._active(in_earshot, active)]
        newly_heard = heard[self._heard[heard] < self._step - self._drop_time]
        self._heard[heard] = self._step
        newly_seen = self._look(in_view, lit)
        self._strike_out_and_drop()
        self._enter(newly_seen, self._eligible(heard) if self._wireless_exceeds_visual else newly_heard)

    def counts(self) -> Counts:
        """The metrics' ingredients, for every observer."""
        visual, wireless = self.edges
        true = visual == wireless
        alone = self._alone()
        return Counts(
            self._per_observer(self.visual),
            self._per_observer(visual),
            self._per_observer(visual[true]),
            self._per_observer(visual[alone]),
            self._per_observer(visual[alone & true]),
        )

    def _per_observer(self, keys: Ints) -> Ints:
        counts: Ints = np.diff(np.searchsorted(keys, self._rows))
        return counts

    def _active(self, keys: Ints, active: Bools) -> Bools:
        return active[keys - np.repeat(self._rows[:-1], self._per_observer(keys))]

    def _look(self, in_view: Ints, lit: Bools) -> Ints:
        """Renew what is known of the robots in view; returns the keys of new visual ids."""
        before = self._seen[in_view]
        # Who was out of view at the last step has lost its visual id.
        listed = (before >= (self._step - 1) * STEP) & (before & LISTED != 0)
        newly_seen: Ints = in_view[lit & ~listed]
        listed |= lit
        self._seen[in_view] = self._step * STEP + listed * LISTED + lit * LIT
        self.visual = in_view[listed]
        return newly_seen

    def _strike_out_and_drop(self) -> None:
        """Remove the edges of ids that are gone, and of those whose ends were not alike active."""
        visual, wireless = self.edges
        seen = self._seen[visual]
        last = self._heard[wireless]
        stays = seen >= self._step * STEP
        stays &= (seen & LIT != 0) == (last == self._step)
        stays &= last > self._step - self._drop_time
        self.edges = visual[stays], wireless[stays]

    def _eligible(self, heard: Ints) -> Ints:
        """Wireless ids heard now, new or old, but not those that are some visual id's only candidate."""
        self._associated[self.edges[1][self._alone()]] = self._step
        eligible: Ints = heard[self._associated[heard] != self._step]
        return eligible

    def _alone(self) -> Bools:
        """Which edges are the only ones of their visual ids."""
        visual = self.edges[0]
        changes = np.ones(len(visual) + 1, dtype=np.bool_)
        np.not_equal(visual[1:], visual[:-1], out=changes[1:-1])
        return changes[1:] & changes[:-1]

    def _enter(self, visual: Ints, wireless: Ints) -> None:
        """Edges from every new visual id to all these wireless ids of the same observer."""
        candidates = self._per_observer(wireless)
        newcomers = self._per_observer(visual)
        many = np.repeat(candidates, newcomers)
        first = np.repeat(np.cumsum(candidates) - candidates, newcomers)
        within = np.arange(many.sum()) - np.repeat(np.cumsum(many) - many, many)
        places = np.searchsorted(self.edges[0], np.repeat(visual, many))
        self.edges = (
            np.insert(self.edges[0], places, np.repeat(visual, many)),
            np.insert(self.edges[1], places, wireless[np.repeat(first, many) + within]),
        )


def stamp_type(steps: int, drop_time: int) -> type[np.int16 | np.int32]:
    """The smallest type that holds what is known of a pair of robots in so many steps."""
    return np.int16 if max((steps + 1) * STEP, drop_time + 1) < 2**15 else np.int32
