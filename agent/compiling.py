"""Tells whoever watches that inner loops are being compiled: once, since what is compiled is kept on disk.

For modules that numba compiles; it need not be there for others.
"""

from __future__ import annotations

import multiprocessing
import sys
from functools import cache

from numba.core import event

SENTENCE = "heliograph: compiling inner loops; this takes up to a minute, once"


class _Teller(event.Listener):
    """Hears of functions that are compiled; not of those that are loaded."""

    def __init__(self) -> None:
        self._told = False

    def on_start(self, _event: object) -> None:
        if self._told or multiprocessing.parent_process() is not None:  # workers leave it to who started them
            return
        self._told = True
        if sys.stderr is not None and sys.stderr.isatty():
            print(SENTENCE, file=sys.stderr, flush=True)

    def on_end(self, _event: object) -> None:
        pass


@cache
def announce() -> None:
    """From now on in this process, say on a terminal that something is being compiled, the first time."""
    event.register("numba:compile", _Teller())  # type: ignore[no-untyped-call]
