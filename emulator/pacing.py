"""Virtual time against the wall clock: as fast as it can, or at a rate that people can watch."""

from __future__ import annotations

import time
from collections.abc import Callable

from channels.units import NS_PER_S
from emulator.interrupts import waiting

TOLERANCE_S = 0.05
"""An instant later than this behind its time is an overrun."""


class Pacer:
    """Holds every instant back until its time has come; counts those that are late."""

    def __init__(
        self,
        rate: float | None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """`rate`: virtual seconds per wall-clock second, or None for as fast as it can."""
        self._rate = rate
        self._clock = clock
        self._sleep = sleep
        self._start: float | None = None
        self.overruns = 0
        self.worst_overrun_s = 0.0

    def wait_for(self, now_ns: int) -> None:
        """Sleep until the wall clock has reached a virtual instant."""
        if self._rate is None:
            return
        if self._start is None:
            self._start = self._clock()
        ahead = self._start + now_ns / NS_PER_S / self._rate - self._clock()
        if ahead > 0:
            with waiting():
                self._sleep(ahead)
        elif ahead < -TOLERANCE_S:
            self.overruns += 1
            self.worst_overrun_s = max(self.worst_overrun_s, -ahead)
