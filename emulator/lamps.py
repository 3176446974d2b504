"""The lamps of the team: commands take effect later, and cameras see what is in effect."""

from __future__ import annotations

from bisect import insort
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

_effective = itemgetter(0)


class Lamps:
    """Colour of every lamp as of an instant that only moves forward."""

    def __init__(self, robots: int, latency_ns: int) -> None:
        self._latency_ns = latency_ns
        self._colours = np.zeros(robots, dtype=np.uint8)
        self._pending: dict[int, list[tuple[int, int]]] = {}

    def command(self, robot: int, now_ns: int, at_ns: int, colour: int) -> None:
        """Show `colour` from `at_ns` on, or from now if that is past; seen after the lamp's latency."""
        effective = max(now_ns, at_ns) + self._latency_ns
        # insort is stable: of two commands for one instant, the one given later wins
        insort(self._pending.setdefault(robot, []), (effective, colour), key=_effective)

    def colours(self, now_ns: int) -> NDArray[np.uint8]:
        """(N,) colours now, 0 for dark. The array is reused: copy what is to be kept."""
        for robot in list(self._pending):
            commands = self._pending[robot]
            done = 0
            for effective, colour in commands:
                if effective > now_ns:
                    break
                self._colours[robot] = colour
                done += 1
            if done == len(commands):
                del self._pending[robot]
            elif done:
                del commands[:done]
        return self._colours
