"""The link model of a graph: who hears whom depends on the vertices that they communicate from, only."""

from __future__ import annotations

import numpy as np

from channels.fates import Bools, Floats, Ints
from channels.gates.range import Kept
from channels.graphs import Graph, hearing


class Links:
    """In range is who is at the same vertex, or at one that has a link to it (Vandermeulen et al., II)."""

    def __init__(self, graph: Graph) -> None:
        count = len(graph.vertices)
        # One row and column more, for whoever is at no vertex (-1) and hears nobody.
        self._deaf = np.ones((count + 1, count + 1), dtype=bool)
        self._deaf[:count, :count] = ~hearing(graph)
        self._kept = Kept(self._unheard)

    def beyond(self, positions: Floats, places: Ints | None, senders: Ints) -> Bools:
        """(len(senders), N), whatever the positions. Raises ValueError where there are no places."""
        if places is None:
            raise ValueError("the link model of a graph needs the robots' places in it")
        return self._kept.of(places, senders)

    def _unheard(self, places: Ints, senders: Ints) -> Bools:
        unheard: Bools = self._deaf[places[senders][:, None], places]
        return unheard
