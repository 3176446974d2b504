"""The information state of channel association: which voice may belong to which light.

Pure bookkeeping: observations go in, edges come out. No radio, no camera, no time.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping


class StationaryIState:
    """Bipartite graph of possible associations (Ivanov & Shell 2016, Def. 6), never growing.

    One row per visual id holds its candidate wireless ids as the bits of an integer, so that
    multiplying by an observation matrix (Alg. 1, lines 15-16) is one AND per row. It starts
    complete: every wireless id may belong to every visual id.
    """

    def __init__(self, wireless: Iterable[str], visual: Iterable[int]) -> None:
        self.wireless: list[str] = sorted(set(wireless))
        """Wireless ids in range (the rows of the paper's matrix), in order."""
        self.steps = 0
        """Observations taken in so far."""
        self._bit = {name: 1 << index for index, name in enumerate(self.wireless)}
        self._all = (1 << len(self.wireless)) - 1
        self._candidates = dict.fromkeys(sorted(set(visual)), self._all)
        self._names: dict[int, list[str]] = {}

    @property
    def visual(self) -> list[int]:
        """Visual ids in range (the columns of the paper's matrix), in order."""
        return list(self._candidates)

    def update(
        self,
        heard: Mapping[str, int] | Iterable[str],
        lit: Mapping[int, int] | Collection[int],
    ) -> bool:
        """Take in one time step (Def. 4). Ids it does not know are ignored. Returns whether an edge went.

        `heard`: who spoke; `lit`: who was lit. As mappings they give the colour, 1 or more, that each
        named and showed (0: dark); plain collections mean colour 1.

        An edge stays exactly if both its ends were active in the same colour or both were not (2016
        sec. 4.1; colours: 2014, "Relaxing Assumptions").
        """
        self.steps += 1
        speaking = self._rows_by_colour(heard)
        colours = lit if isinstance(lit, Mapping) else dict.fromkeys(lit, 1)
        changed = False
        for visual_id, candidates in self._candidates.items():
            left = candidates & speaking.get(colours.get(visual_id, 0), 0)
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
        """Whether the matrix holds exactly v ones (sec. 4.1): everything visible is associated.

        The stop rule where every robot in sight is heard (channel inclusion, 2016 Property 2).
        """
        return all(row.bit_count() == 1 for row in self._candidates.values())

    def is_settled(self, survival: float, false_match_bound: float) -> bool:
        """The stop rule where a robot may be in sight and not be heard (2014, "Relaxing Assumptions").

        No visual id has two candidates, and the lone ones are no accidents: a wrong edge survives a step
        with probability c, so that after t steps one of at most w v wrong edges is left with probability
        at most w v c^t. This must be at most `false_match_bound`, unless no candidate is left at all: then
        nothing is claimed. The bound holds for all claims of one robot together, whenever it stops.

        `survival`: c, see `survival`. Both numbers lie in [0, 1].
        """
        rows = self._candidates.values()
        if any(row.bit_count() > 1 for row in rows):
            return False
        false_edges = len(self.wireless) * len(rows) * survival**self.steps
        return false_edges <= false_match_bound or not any(rows)

    def _rows_by_colour(self, heard: Mapping[str, int] | Iterable[str]) -> dict[int, int]:
        """Wireless ids by the colour they named, as rows; silent ones under 0."""
        rows = {0: self._all}
        for name, colour in (heard if isinstance(heard, Mapping) else dict.fromkeys(heard, 1)).items():
            bit = self._bit.get(name, 0)
            rows[0] &= ~bit
            rows[colour] = rows.get(colour, 0) | bit
        return rows

    def _listed(self, row: int) -> list[str]:
        """The names of a row's bits; rows repeat from step to step, so they are listed once."""
        names = self._names.get(row)
        if names is None:
            names = [name for name, bit in self._bit.items() if row & bit]
            self._names[row] = names
        return names


def survival(transmission_probability: float, colours: int = 1) -> float:
    """Probability that two robots look alike in one step: both silent, or both active in one colour.

    q^2 + p^2 / C with q = 1 - p: what a wrong edge survives a step with.
    """
    active = transmission_probability
    return (1.0 - active) ** 2 + active**2 / colours
