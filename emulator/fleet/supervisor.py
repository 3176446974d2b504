"""The broker's hold on its robot processes: start them, hear of their end, end them.

A thread listens to the zygote; what it learns it hands to a callback, so that the main thread can
wait on one queue for reports and bad news alike.
"""

from __future__ import annotations

import contextlib
import os
import resource
import socket
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TextIO

from agent.zygote import (
    MAX_CONTROL_BYTES,
    ROBOTS_PER_SPAWN,
    Exited,
    Finish,
    FromZygote,
    Output,
    Prepare,
    Prepared,
    Spawn,
    Spawned,
    ToZygote,
    decode_from_zygote,
    encode,
)
from emulator.errors import RunFailed, UserError
from emulator.interrupts import waiting

HASH_SEED = "0"
"""Of every process that runs a behaviour: sets of text then have the same order in all of them."""
KEPT_LINES = 20
"""How much of a robot's output is kept for the story of its end."""
CLOSE_TIMEOUT_S = 5.0
ANSWER_TIMEOUT_S = 60.0
"""How long importing behaviours, or forking robots, may take."""

ZYGOTE_ENVIRONMENT = {
    "OPENBLAS_NUM_THREADS": "1",
    "PYTHONHASHSEED": HASH_SEED,  # or a set of text would have another order in every run
}


class Supervisor:
    """Owns the zygote, and through it every robot process of one run."""

    def __init__(self, socket_folder: Path, echo: TextIO | None) -> None:
        """`echo`: where the robots' output goes, line by line with the robot's name; None: nowhere."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._control = ours
        self._echo = echo
        self._lines: dict[str, deque[str]] = {}
        self._partial: dict[str, bytes] = {}
        self._exited: dict[str, int] = {}
        self._answers: deque[Prepared | Spawned | None] = deque()
        self._answered = threading.Semaphore(0)
        self._on_exit: Callable[[str], None] | None = None
        self._closing = False
        self._lost = False
        _raise_file_limit()
        with theirs:
            # A session of its own: Ctrl-C reaches the broker alone, which then ends the run.
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "agent.zygote", str(socket_folder)],
                stdin=theirs.fileno(),
                stdout=sys.stderr.fileno() if _has_descriptor(sys.stderr) else subprocess.DEVNULL,
                start_new_session=True,
                env={**os.environ, **ZYGOTE_ENVIRONMENT, "PYTHONPATH": _import_path()},
            )
        self._thread = threading.Thread(target=self._listen, name="supervisor", daemon=True)
        self._thread.start()

    def prepare(self, behaviours: Sequence[str], folder: Path | None) -> None:
        """Import the behaviours in the zygote. Raises UserError where one cannot be used."""
        self._send(Prepare(list(behaviours), str(folder) if folder is not None else None))
        answer = self._await_answer()
        if isinstance(answer, Prepared) and answer.error is not None:
            raise UserError(f"behaviour: {answer.error}; mend it, or name another one in the scenario")

    def spawn(
        self, endpoint: str, run: str, robots: Sequence[tuple[str, str]], on_exit: Callable[[str], None]
    ) -> list[int]:
        """Fork robot processes given as (name, password); their process ids.

        `on_exit(robot)` is called from the listening thread when one ends, or with "" when the
        zygote itself does.
        """
        self._on_exit = on_exit
        pids: list[int] = []
        for first in range(0, len(robots), ROBOTS_PER_SPAWN):
            self._send(Spawn(endpoint, run, list(robots[first : first + ROBOTS_PER_SPAWN])))
            answer = self._await_answer()
            pids += answer.pids if isinstance(answer, Spawned) else []
        return pids

    def cause_of_end(self, robot: str) -> str:
        """How a robot process ended, in words."""
        code = self._exited.get(robot)
        if code is None:
            return "was lost: the process that starts the robots is gone"
        if code < 0:
            return f"was killed by signal {-code}"
        return f"exited with code {code}"

    def has_exited(self, robot: str) -> bool:
        """Whether this robot's process is known to be gone."""
        return robot in self._exited or self._lost or self._process.poll() is not None

    def last_output(self, robot: str) -> list[str]:
        """The last lines a robot wrote."""
        lines = list(self._lines.get(robot, ()))
        rest = self._partial.get(robot)
        return [*lines, rest.decode(errors="replace")] if rest else lines

    def close(self) -> None:
        """End all robot processes and the zygote. Safe to call again."""
        if self._closing:
            return
        self._closing = True
        with contextlib.suppress(OSError):
            self._control.send(encode(Finish()))
        try:
            self._process.wait(CLOSE_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()  # its robots die with it
            self._process.wait()
        self._thread.join(CLOSE_TIMEOUT_S)
        self._control.close()

    def _send(self, request: ToZygote) -> None:
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            self._control.send(encode(request))

    def _await_answer(self) -> Prepared | Spawned:
        with waiting():
            answered = self._answered.acquire(timeout=ANSWER_TIMEOUT_S)
        if not answered:
            raise RunFailed(
                f"importing the behaviours took more than {ANSWER_TIMEOUT_S:g} s; "
                "a module should define things, and leave work to its behaviour"
            )
        answer = self._answers.popleft()
        if answer is None:
            raise RunFailed("the process that starts the robots ended by itself; its message stands above")
        return answer

    def _listen(self) -> None:
        try:
            while raw := self._hear():
                self._take(decode_from_zygote(raw))
        finally:  # nobody must wait for a zygote that nobody listens to
            self._lost = True
            self._answers.append(None)
            self._answered.release()
            if self._on_exit is not None and not self._closing:
                self._on_exit("")

    def _hear(self) -> bytes:
        try:
            return self._control.recv(MAX_CONTROL_BYTES)
        except OSError:
            return b""

    def _take(self, message: FromZygote) -> None:
        match message:
            case Prepared() | Spawned():
                self._answers.append(message)
                self._answered.release()
            case Output(robot, text):
                self._take_output(robot, text)
            case Exited(robot, code):
                if self._partial.get(robot):  # a last line that was not ended
                    self._take_output(robot, b"\n")
                self._exited[robot] = code
                if self._on_exit is not None and not self._closing:
                    self._on_exit(robot)

    def _take_output(self, robot: str, text: bytes) -> None:
        *whole, rest = (self._partial.get(robot, b"") + text).split(b"\n")
        self._partial[robot] = rest[-4096:]
        kept = self._lines.setdefault(robot, deque(maxlen=KEPT_LINES))
        for raw in whole:
            line = raw.decode(errors="replace")
            kept.append(line)
            self._show(f"{robot} | {line}\n")

    def _show(self, line: str) -> None:
        """Echo a line, unless there is nobody to read it any more (as in `2>&1 | head`)."""
        if self._echo is None:
            return
        try:
            self._echo.write(line)
        except (OSError, ValueError):
            self._echo = None


def _has_descriptor(stream: TextIO) -> bool:
    try:
        stream.fileno()
    except (OSError, ValueError, AttributeError):
        return False
    return True


def _import_path() -> str:
    """The zygote finds what we find, wherever it is started from."""
    return os.pathsep.join(path or os.getcwd() for path in sys.path)


def _raise_file_limit() -> None:
    """A few descriptors per robot: take what the system allows without asking."""
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
