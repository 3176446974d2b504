"""What the kernel tells of a process: whether it computes, and how much it has."""

from __future__ import annotations

import os
from pathlib import Path

_TICKS_PER_S = os.sysconf("SC_CLK_TCK")


def is_runnable(pid: int) -> bool:
    """Whether any thread of the process computes, or would if it had a processor."""
    return any(state == "R" for state, _ in _threads(pid))


def processor_time_s(pid: int) -> float:
    """Processor time of all threads so far [s]."""
    return sum(ticks for _, ticks in _threads(pid)) / _TICKS_PER_S


def _threads(pid: int) -> list[tuple[str, int]]:
    """State and processor time [clock ticks] of each thread; none where the process is gone."""
    found = []
    try:
        for thread in Path(f"/proc/{pid}/task").iterdir():
            fields = (thread / "stat").read_text().rpartition(")")[2].split()
            found.append((fields[0], int(fields[11]) + int(fields[12])))
    except OSError:
        pass  # ended while we looked
    return found
