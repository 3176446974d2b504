"""Trackers of the cameras: under which name each observer knows each robot in its view.

Visual ids are an observer's own and tell nothing of robots, radio names or other observers' ids: each is
a draw that depends on observer, target and how often that target has come into that observer's view.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from channels.fates import Bools
from channels.randomness import Draws, UInts

Indices: TypeAlias = NDArray[np.intp]
Change: TypeAlias = tuple[int, int, int]
"""Observer index, visual id, target index."""

VISUAL_ID_BITS = 31
"""Visual ids are positive and fit an int32."""


class Trackers:
    """Which visual id each observer has given to each robot in its view.

    `keys` (N,): `stable_keys` of the team, in robot order.
    """

    def __init__(self, keys: UInts, draws: Draws, id_bits: int = VISUAL_ID_BITS) -> None:
        self._keys = keys
        self._draws = draws
        self._shift = 64 - id_bits
        self.ids = np.zeros((len(keys), len(keys)), dtype=np.int32)
        """(N, N) by observer and target; 0: not in view."""
        self._entries = np.zeros_like(self.ids)

    def update(self, observers: Indices, in_view: Bools) -> tuple[list[Change], list[Change]]:
        """Begin and end the tracks of these observers; returns those that began and those that ended.

        `observers` (M,) robot indices; `in_view` (M, N). Both lists are in order of (observer's place in
        `observers`, visual id).
        """
        tracked = self.ids.take(observers, axis=0) != 0
        new_rows, new_targets = pairs(in_view & ~tracked)
        gone_rows, gone_targets = pairs(tracked & ~in_view)
        if len(new_rows):
            # Before the old ones end: an id that is free only now would be taken for its last owner.
            self._name(observers, observers[new_rows], new_targets)
        entered = self._changes(observers, new_rows, new_targets)
        left = self._changes(observers, gone_rows, gone_targets)
        self.ids[observers[gone_rows], gone_targets] = 0
        return entered, left

    def _changes(self, observers: Indices, rows: Indices, targets: Indices) -> list[Change]:
        visual = self.ids[observers[rows], targets]
        order = np.argsort(sort_keys(rows, visual))
        columns = observers[rows[order]], visual[order], targets[order]
        return list(zip(*(column.tolist() for column in columns), strict=True))

    def _name(self, observers: Indices, who: Indices, whom: Indices) -> None:
        self._entries[who, whom] += 1
        self.ids[who, whom] = self._drawn(who, whom, 0)
        if self._clash(observers, who, whom):
            self.ids[who, whom] = 0
            for observer, target in zip(who.tolist(), whom.tolist(), strict=True):
                self._name_one(observer, target)

    def _drawn(self, who: Indices | int, whom: Indices | int, attempt: int) -> NDArray[np.int32]:
        entries = self._entries[who, whom] - 1
        bits = self._draws.bits(self._keys[who], self._keys[whom], entries, attempt)
        return np.asarray(bits >> np.uint64(self._shift)).astype(np.int32)

    def _clash(self, observers: Indices, who: Indices, whom: Indices) -> bool:
        if not self.ids[who, whom].all():
            return True
        rows, targets = pairs(self.ids.take(observers, axis=0) != 0)
        keys = np.sort(sort_keys(rows, self.ids[observers[rows], targets]))
        return bool((keys[1:] == keys[:-1]).any())

    def _name_one(self, observer: int, target: int) -> None:
        # 0 is no id, and stands in every row: nobody tracks itself.
        taken = set(self.ids[observer].tolist())
        attempt = 0
        while (visual := int(self._drawn(observer, target, attempt))) in taken:
            attempt += 1
        self.ids[observer, target] = visual


def pairs(matrix: Bools) -> tuple[Indices, Indices]:
    """Rows and columns of what is true, row by row; `numpy.nonzero` is several times slower in 2-D."""
    flat = np.flatnonzero(matrix)
    rows = flat // matrix.shape[1]
    return rows, flat - rows * matrix.shape[1]


def sort_keys(rows: Indices, visual: NDArray[np.int32]) -> NDArray[np.int64]:
    """One number per sighting, by which they sort by row first and visual id second."""
    return rows.astype(np.int64) << VISUAL_ID_BITS | visual
