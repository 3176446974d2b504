"""The information state of channel association: which voice may belong to which light.

Pure bookkeeping: observations go in, edges come out. No radio, no camera, no time.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable


class StationaryIState:
    """Bipartite graph of possible associations (Ivanov & Shell 2016, Def. 6), never growing.

    One row per visual id holds its candidate wireless ids as the bits of an integer, so that
    multiplying by an observation matrix (Alg. 1, lines 15-16) is one AND per row. It starts
    complete: every wireless id may belong to every visual id.
    """

    def __init__(self, wireless: Iterable[str], visual: Iterable[int]) -> None:
        self.wireless: list[str] = sorted(set(wireless))
        """Wireless ids in range (the rows of the paper's matrix), in order."""
        self._bit = {name: 1 << index for index, name in enumerate(self.wireless)}
        self._all = (1 << len(self.wireless)) - 1
        self._candidates = dict.fromkeys(sorted(set(visual)), self._all)
        self._names: dict[int, list[str]] = {}

    @property
    def visual(self) -> list[int]:
        """Visual ids in range (the columns of the paper's matrix), in order."""
        return list(self._candidates)

    def update(self, active_wireless: Iterable[str], active_visual: Collection[int]) -> bool:
        """Take in one time step: who spoke, who was lit (Def. 4). Ids it does not know are ignored.

        An edge stays exactly if both its ends were active or both were not (sec. 4.1).
        Returns whether any edge was struck out.
        """
        active = 0
        for name in active_wireless:
            active |= self._bit.get(name, 0)
        changed = False
        for visual_id, candidates in self._candidates.items():
            left = candidates & (active if visual_id in active_visual else ~active)
            if left != candidates:
                self._candidates[visual_id] = left
                changed = True
        return changed

    def edges(self) -> dict[int, list[str]]:
        """Visual id -> wireless ids that may still be its own, in order."""
        return {visual_id: self._listed(row) for visual_id, row in self._candidates.items()}

    def matches(self) -> dict[int, str]:
        """Visual id -> the one wireless id left for it; only where exactly one is left."""
        return {
            visual_id: self.wireless[row.bit_length() - 1]
            for visual_id, row in self._candidates.items()
            if row.bit_count() == 1
        }

    def is_final(self) -> bool:
        """Whether the matrix holds exactly v ones (sec. 4.1): everything visible is associated."""
        return all(row.bit_count() == 1 for row in self._candidates.values())

    def _listed(self, row: int) -> list[str]:
        """The names of a row's bits; rows repeat from step to step, so they are listed once."""
        names = self._names.get(row)
        if names is None:
            names = [name for name, bit in self._bit.items() if row & bit]
            self._names[row] = names
        return names
