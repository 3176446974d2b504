"""Ctrl-C and SIGTERM take effect between two instants of a run, or while it waits.

Python raises them between any two steps of the main thread: in the middle of a record, half of which
would then stand in a log closed as whole, or in a place where exceptions are swallowed. During a run
a signal is therefore only noted. `check` raises it. A second one, for a behaviour that does not give
control back, is raised at once unless something is `held`.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)
Handler = Callable[[int, FrameType | None], object] | int | signal.Handlers | None


class _State:
    """Of the process, as signal handlers are. Touched by the main thread alone."""

    def __init__(self) -> None:
        self.previous: dict[int, Handler] = {}
        self.arrived: list[int] = []
        self.held = 0
        self.waiting = False


_state = _State()


def _in_main_thread() -> bool:
    # Elsewhere no signal is ever raised, and no handler can be set.
    return threading.current_thread() is threading.main_thread()


@contextmanager
def noted() -> Iterator[None]:
    """Only note signals within this. One that `check` has not raised takes effect at the end."""
    if _state.previous or not _in_main_thread():
        yield
        return
    _state.previous = {number: signal.getsignal(number) for number in SIGNALS}
    for number in SIGNALS:
        signal.signal(number, _on_signal)
    arrived: list[int] = []
    try:
        yield
    finally:
        for known, handler in _state.previous.items():
            signal.signal(known, signal.SIG_DFL if handler is None else handler)
        _state.previous = {}
        arrived, _state.arrived = _state.arrived, arrived
    if arrived:  # once those that answer are back, so that none is lost that arrives meanwhile
        signal.raise_signal(arrived[-1])


def check() -> None:
    """Raise what was noted."""
    if _state.arrived and _in_main_thread():
        _deliver(_state.arrived.pop())


@contextmanager
def waiting() -> Iterator[None]:
    """Within this, where the main thread only waits, signals are raised at once."""
    if not _in_main_thread():
        yield
        return
    _state.waiting = True
    try:
        check()
        yield
    finally:
        _state.waiting = False


@contextmanager
def held() -> Iterator[None]:
    """Within this no signal is raised, however often it comes."""
    if not _in_main_thread():
        yield
        return
    with noted():
        _state.held += 1
        try:
            yield
        finally:
            _state.held -= 1


def _on_signal(number: int, _frame: FrameType | None) -> None:
    if not _state.held and (_state.waiting or _state.arrived):
        _deliver(number)
    else:
        _state.arrived.append(number)


def _deliver(number: int) -> None:
    handler = _state.previous.get(number)
    if callable(handler):
        handler(number, None)
    elif handler != signal.SIG_IGN:
        signal.signal(number, signal.SIG_DFL)
        signal.raise_signal(number)
