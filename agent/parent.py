"""Not to outlive one's parent process. Linux only."""

from __future__ import annotations

import ctypes
import os
import signal

_PR_SET_PDEATHSIG = 1


def signal_at_death_of(parent: int, number: signal.Signals) -> None:
    """Have the kernel signal this process when its parent ends, however it ends."""
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, number)
    if os.getppid() != parent:  # it ended before the request took effect
        os.kill(os.getpid(), number)
