"""The information state of channel association among moving robots: ids come and go.

Pure bookkeeping: observations go in, edges come out. No radio, no camera, no time.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable


class MobileIState:
    """Bipartite graph of possible associations in a changing neighbourhood (Ivanov & Shell 2016, Alg. 2).

    Starts empty. As in `StationaryIState` one row of bits per visual id holds its candidate wireless
    ids; a wireless id has its bit for as long as it is in the list. Lights are on or off: colours are
    not supported.

    `drop_time`: steps in a row, 1 or more, after which a wireless id that was not heard is dropped;
    `wireless_exceeds_visual`: whether the radio reaches farther than the camera, so that a robot can be
    heard before it is seen (sec. 5.2, 6.1). Raises ValueError for a drop time below 1.
    """

    def __init__(self, drop_time: int = 20, wireless_exceeds_visual: bool = False) -> None:
        if drop_time < 1:
            raise ValueError(f"drop_time is 1 step or more, not {drop_time}")
        self._drop_time = drop_time
        self._wireless_exceeds_visual = wireless_exceeds_visual
        self._step = 0
        self._bit: dict[str, int] = {}
        self._last_heard: dict[str, int] = {}
        self._candidates: dict[int, int] = {}

    @property
    def wireless(self) -> list[str]:
        """Wireless ids in the list (the rows of the paper's matrix), in order."""
        return sorted(self._bit)

    @property
    def visual(self) -> list[int]:
        """Visual ids in the list (the columns of the paper's matrix), in order."""
        return sorted(self._candidates)

    def update(self, heard: Iterable[str], in_view: Collection[int], lit: Collection[int]) -> None:
        """Take in one time step.

        `heard`: wireless ids that spoke; `in_view`: visual ids in the camera's view, lit or dark; `lit`:
        those of them that were lit (others are ignored).

        In this order: visual ids that left view go; edges go whose ends were not alike active; wireless
        ids that have been silent for `drop_time` steps, this one included, go; ids enter. A wireless id
        enters when it is heard, a visual id when it is first lit, and every newcomer of the one kind gets
        an edge to every newcomer of the other: all of them are active, so this observation removes
        none of these edges. Where the radio reaches farther, new visual ids also get edges to those old
        wireless ids that are active now and are no visual id's only candidate.
        """
        self._step += 1
        voices = sorted(set(heard))
        self._lose_sight(in_view)
        self._strike_out(voices, lit)
        self._drop_silent(voices)
        new_visual = sorted(s for s in set(lit) if s in in_view and s not in self._candidates)
        candidates = self._eligible(voices) if self._wireless_exceeds_visual else 0
        candidates |= self._enter([name for name in voices if name not in self._bit])
        self._candidates.update(dict.fromkeys(new_visual, candidates))

    def edges(self) -> dict[int, list[str]]:
        """Visual id -> wireless ids that may still be its own; both in order."""
        names = sorted(self._bit.items())
        return {
            visual_id: [name for name, bit in names if row & bit]
            for visual_id, row in sorted(self._candidates.items())
        }

    def matches(self) -> dict[int, str]:
        """Visual id -> the one wireless id left for it; only where exactly one is left."""
        name_of = {bit: name for name, bit in self._bit.items()}
        return {
            visual_id: name_of[row]
            for visual_id, row in sorted(self._candidates.items())
            if row.bit_count() == 1
        }

    def _lose_sight(self, in_view: Collection[int]) -> None:
        for visual_id in [s for s in self._candidates if s not in in_view]:
            del self._candidates[visual_id]

    def _strike_out(self, voices: Iterable[str], lit: Collection[int]) -> None:
        active = self._row(voices)
        for visual_id, row in self._candidates.items():
            self._candidates[visual_id] = row & (active if visual_id in lit else ~active)

    def _drop_silent(self, voices: Iterable[str]) -> None:
        self._last_heard.update(dict.fromkeys(voices, self._step))
        silent = [name for name, last in self._last_heard.items() if self._step - last >= self._drop_time]
        if not silent:
            return
        left = ~self._row(silent)
        for visual_id, row in self._candidates.items():
            self._candidates[visual_id] = row & left
        for name in silent:
            del self._bit[name], self._last_heard[name]

    def _eligible(self, voices: Iterable[str]) -> int:
        """Old wireless ids that were heard now and are not associated yet."""
        associated = 0
        for row in self._candidates.values():
            if row.bit_count() == 1:
                associated |= row
        return self._row(voices) & ~associated

    def _enter(self, names: Iterable[str]) -> int:
        """Give each of these wireless ids a bit that nobody has; returns the row of them all."""
        taken = self._row(self._bit)
        entered = 0
        for name in names:
            bit = ~taken & (taken + 1)  # the lowest one that is free
            taken |= bit
            entered |= bit
            self._bit[name] = bit
        return entered

    def _row(self, names: Iterable[str]) -> int:
        row = 0
        for name in names:
            row |= self._bit.get(name, 0)
        return row
