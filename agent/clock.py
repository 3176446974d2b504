"""The robot's own clock, as the parts of a robot read it."""

from __future__ import annotations

from typing import Protocol


class Clock(Protocol):
    """Anything that tells the time; the granted loop is one."""

    @property
    def now_ns(self) -> int:
        """Reading now [ns]; the event loop's `time()` is the same in seconds."""
