"""Line of sight: what obstacles hide is neither heard nor disturbed."""

from __future__ import annotations

from collections.abc import Sequence

from channels.fates import Batch, Bools, Floats, Ints, Reason
from channels.gates.range import Kept, Reach
from channels.graphs import Rectangle, in_sight


class Shadows:
    """Who is hidden from whom, where the robots are."""

    def __init__(self, obstacles: Sequence[Rectangle]) -> None:
        """`obstacles`: x0, y0, x1, y1 [m], of any height."""
        self._obstacles = tuple(obstacles)
        self._kept = Kept(self._hidden)

    def beyond(self, positions: Floats, places: Ints | None, senders: Ints) -> Bools:
        """(len(senders), N)."""
        return self._kept.of(positions, senders)

    def _hidden(self, positions: Floats, senders: Ints) -> Bools:
        hidden: Bools = ~in_sight(positions[senders][:, None], positions[None], self._obstacles)
        return hidden


class Shadowed:
    """A link model with shadows."""

    def __init__(self, reach: Reach, shadows: Shadows) -> None:
        self._reach = reach
        self._shadows = shadows

    def beyond(self, positions: Floats, places: Ints | None, senders: Ints) -> Bools:
        """(len(senders), N)."""
        out_of_range = self._reach.beyond(positions, places, senders)
        return out_of_range | self._shadows.beyond(positions, places, senders)


class SightGate:
    """Refuses receivers that an obstacle hides where the robots are when the transmission ends."""

    reason = Reason.no_line_of_sight

    def __init__(self, shadows: Shadows) -> None:
        self._shadows = shadows

    def refuses(self, batch: Batch) -> Bools:
        """(T, N)."""
        return self._shadows.beyond(batch.positions, batch.places, batch.senders)
