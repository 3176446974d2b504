"""All robots in this process, each on its own granted loop: no sockets, one thread.

For Monte Carlo, for a debugger, and as the oracle that the sockets change nothing. What is emulated
is the same; what is not is isolation: robots share modules, so a behaviour that keeps state in
globals shares it too (until the run ends: the next one loads the user's files anew). And the order
of sets of text is that of this process, unless it was started with PYTHONHASHSEED=0.
"""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from types import FrameType

from agent.endings import exit_code
from agent.host import RobotHost
from agent.loading import BehaviourError, forget_user_modules, is_file, load_behaviour
from channels.messages import Hello, MessageError, Report, decode_hello, decode_report, encode
from emulator.fleet import RobotFailure


class _TookTooLong(KeyboardInterrupt):
    """Raised inside a behaviour that never gives control back; asyncio lets only this kind through."""


class InProcessFleet:
    """See emulator.fleet.Fleet."""

    def __init__(self, folder: Path | None, answer_timeout_s: float) -> None:
        self._folder = folder
        self._hosts: list[RobotHost] = []
        self._robots: list[str] = []
        self._watchdog = _Watchdog(answer_timeout_s)
        self._timeout_s = answer_timeout_s
        self._owns_modules = False
        self.refused: list[tuple[int, str]] = []

    def start(self, hellos: Sequence[Hello]) -> None:
        """Load every behaviour afresh and give it a robot."""
        self._owns_modules = any(is_file(hello.behaviour) for hello in hellos)
        self._forget_modules()
        for hello in hellos:
            try:
                with contextlib.redirect_stdout(sys.stderr):
                    behaviour = load_behaviour(hello.behaviour, self._folder)
            except BehaviourError as error:
                raise RobotFailure(hello.robot, f"cannot start: {error}") from None
            # Through the wire's codec: no two robots get the same objects.
            self._hosts.append(RobotHost(decode_hello(encode(hello)), behaviour))
            self._robots.append(hello.robot)
        self._watchdog.start()

    def exchange(
        self, grants: Iterable[tuple[int, bytes]], meanwhile: Callable[[], None]
    ) -> Iterator[Report]:
        """One robot after the other, each when its report is asked for."""
        granted = list(grants)
        meanwhile()
        for robot, grant in granted:
            yield self._ask(robot, grant)

    def _ask(self, robot: int, grant: bytes) -> Report:
        self._watchdog.since = time.monotonic()
        try:
            with contextlib.redirect_stdout(sys.stderr):  # standard output is for results
                raw = self._hosts[robot].exchange(grant)
        except _TookTooLong:
            cause = f"did not answer within {self._timeout_s:g} s; does it loop without awaiting?"
            raise RobotFailure(self._robots[robot], cause) from None
        except SystemExit as error:
            raise RobotFailure(self._robots[robot], f"exited with code {exit_code(error)}") from None
        finally:
            self._watchdog.since = None
        if raw is None:
            raise ValueError("the end of a run is not something to exchange")
        try:
            return decode_report(raw)
        except MessageError as error:
            raise RobotFailure(self._robots[robot], f"sent a malformed report: {error}") from None

    def last_output(self, robot: str) -> list[str]:
        """Nothing: what robots write here goes straight to the terminal."""
        return []

    def close(self) -> None:
        """Cancel every behaviour and close its loop; one that does not let itself be closed is left."""
        with contextlib.ExitStack() as closing:  # each is called, whatever another one raises
            closing.callback(self._forget_modules)
            closing.callback(self._watchdog.stop)
            while self._hosts:
                closing.callback(self._close_host, self._hosts.pop())

    def _close_host(self, host: RobotHost) -> None:
        self._watchdog.since = time.monotonic()
        try:
            with contextlib.suppress(_TookTooLong), contextlib.redirect_stdout(sys.stderr):
                host.close()
        finally:
            self._watchdog.since = None

    def _forget_modules(self) -> None:
        if self._owns_modules:
            forget_user_modules(self._folder)


class _Watchdog:
    """Interrupts the main thread when one answer takes too long. Idle outside the main thread."""

    def __init__(self, timeout_s: float) -> None:
        self.since: float | None = None
        self._timeout_s = timeout_s
        self._stopped = threading.Event()
        self._previous: signal.Handlers | Callable[[int, FrameType | None], object] | int | None = None
        self._armed = False

    def start(self) -> None:
        if threading.current_thread() is not threading.main_thread():
            return
        self._previous = signal.signal(signal.SIGALRM, self._interrupt)
        self._armed = True
        threading.Thread(target=self._watch, name="watchdog", daemon=True).start()

    def stop(self) -> None:
        self._stopped.set()
        if self._armed:
            # None: a handler that Python knows nothing of, and cannot put back
            signal.signal(signal.SIGALRM, signal.SIG_DFL if self._previous is None else self._previous)
            self._armed = False

    def _interrupt(self, _signum: int, _frame: FrameType | None) -> None:
        if self._is_overdue():  # the alarm may come late, when the next robot has only begun
            raise _TookTooLong

    def _is_overdue(self) -> bool:
        since = self.since
        return since is not None and time.monotonic() - since > self._timeout_s

    def _watch(self) -> None:
        while not self._stopped.wait(min(1.0, self._timeout_s / 4)):
            if self._is_overdue():
                signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGALRM)
