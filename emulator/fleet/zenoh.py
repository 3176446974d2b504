"""One process per robot, over real sockets: the broker hosts the Zenoh router they connect to.

The main thread puts all grants of an instant, then drains reports from one channel. Bad news comes
through the same channel: the supervising thread publishes it on a key no robot may use.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TextIO, TypeVar

import zenoh

from agent.link.session import broker_config, channel, declare_publisher
from channels.keys import from_all_robots, robot_of, to_broker, to_robot
from channels.messages import (
    END_OF_RUN,
    PROTOCOL,
    Grant,
    Hello,
    MessageError,
    Ready,
    Report,
    decode_ready,
    decode_report,
    encode,
)
from emulator.errors import UserError
from emulator.fleet import RobotFailure
from emulator.fleet.access import access_control
from emulator.fleet.process_state import is_runnable, processor_time_s
from emulator.fleet.supervisor import Supervisor
from emulator.interrupts import waiting

Answer = TypeVar("Answer", Ready, Report)

SUPERVISOR = "_supervisor"
"""Stands for a robot on the key of bad news; no robot can be called so."""
GONE = b"gone"
OVERDUE = b"overdue"
MAX_SOCKET_FOLDER = 80
MAX_REFUSED = 100
"""Messages at one instant that are no reports; who sends more is flooding."""
GOODBYE_S = 2.0
"""How long robots get to end by themselves."""


class ZenohFleet:
    """See emulator.fleet.Fleet. Constructing it already starts the zygote, which takes a while."""

    def __init__(
        self,
        behaviours: Sequence[str],
        folder: Path | None,
        answer_timeout_s: float,
        listen: str | None = None,
        echo: TextIO | None = sys.stderr,
    ) -> None:
        """`listen`: a Zenoh endpoint such as tcp/127.0.0.1:7447; None: a Unix socket of our own.

        Raises UserError for an endpoint or a behaviour that cannot be used.
        """
        if listen is not None and listen.endswith(":0"):
            raise UserError(f"--listen {listen}: robots must know the port; name one that is free, as 7447")
        self._socket_folder = _socket_folder()
        self.endpoint = listen or f"unixsock-stream/{self._socket_folder}/broker.sock"
        self.run = secrets.token_hex(4)
        """Part of all keys of this run, so that runs cannot meet."""
        self.passwords: dict[str, str] = {}
        self._timeout_s = answer_timeout_s
        self._session: zenoh.Session | None = None
        self._robots: list[str] = []
        self._index: dict[str, int] = {}
        self._numbers: list[int] = []
        self._gone: set[int] = set()
        self._allowed_s: dict[int, float] = {}
        self._grants: list[zenoh.Publisher] = []
        self.pids: list[int] = []
        self.refused: list[tuple[int, str]] = []
        self._clock = _AnswerClock(answer_timeout_s, self._tell_overdue)
        try:
            self._supervisor = Supervisor(self._socket_folder, echo)
        except BaseException:
            shutil.rmtree(self._socket_folder, ignore_errors=True)
            raise
        try:
            self._supervisor.prepare(behaviours, folder)
        except BaseException:
            self.close()
            raise

    def start(self, hellos: Sequence[Hello]) -> None:
        """Open the router, fork the robots, shake hands with each."""
        self._robots = [hello.robot for hello in hellos]
        self._index = {robot: index for index, robot in enumerate(self._robots)}
        self._numbers = [0] * len(hellos)
        self.passwords = {robot: secrets.token_urlsafe(16) for robot in self._robots}
        run, credentials = self.run, list(self.passwords.items())
        session = self._open(credentials)
        # Declared before any robot knows the endpoint, so nothing a robot says can be lost.
        self._reports = session.declare_subscriber(from_all_robots(run), channel())
        self._bad_news = declare_publisher(session, to_broker(run, SUPERVISOR))
        self._grants = [declare_publisher(session, to_robot(run, robot)) for robot in self._robots]
        self.pids = self._supervisor.spawn(self.endpoint, run, credentials, self._tell_gone)
        everyone = range(len(hellos))
        self._clock.start()
        with self._clock:
            for _ in self._answers(everyone, self._take_ready):
                pass
        for publisher, hello in zip(self._grants, hellos, strict=True):
            publisher.put(encode(hello))
        with self._clock:
            for robot, report in zip(everyone, self._answers(everyone, self._take_report), strict=True):
                if report.ended:
                    raise RobotFailure(self._robots[robot], f"cannot start: {report.ended}")

    def exchange(
        self, grants: Iterable[tuple[int, bytes]], meanwhile: Callable[[], None]
    ) -> Iterator[Report]:
        """Put each grant as soon as it is made, then yield each report as soon as its turn comes."""
        publishers, numbers = self._grants, self._numbers
        granted: list[int] = []
        self._allowed_s.clear()
        for robot, grant in grants:
            numbers[robot] += 1
            publishers[robot].put(grant)
            granted.append(robot)
        meanwhile()
        with self._clock:
            yield from self._answers(granted, self._take_report)

    def last_output(self, robot: str) -> list[str]:
        """The last lines a robot wrote; complete once the fleet is closed."""
        return self._supervisor.last_output(robot)

    def close(self) -> None:
        """Say goodbye, give the robots a moment, end those that stay, remove the socket."""
        with contextlib.ExitStack() as last:  # whatever fails, or is interrupted, the rest is done
            last.callback(shutil.rmtree, self._socket_folder, ignore_errors=True)
            last.callback(self._close_session)
            last.callback(self._supervisor.close)
            last.callback(self._clock.stop)
            if self._session is not None:
                self._say_goodbye()

    def _close_session(self) -> None:
        if self._session is not None:
            self._session.close()  # type: ignore[no-untyped-call]
            self._session = None

    def _say_goodbye(self) -> None:
        farewell = encode(Grant(END_OF_RUN, 0))
        for publisher in self._grants:
            publisher.put(farewell)
        deadline = time.monotonic() + GOODBYE_S
        while time.monotonic() < deadline:
            if all(map(self._supervisor.has_exited, self._robots)):
                return
            time.sleep(0.005)

    def _open(self, credentials: Sequence[tuple[str, str]]) -> zenoh.Session:
        own_password = secrets.token_urlsafe(16)
        # The router wants passwords as a file: give it one that has no name and never meets a disk.
        descriptor = os.memfd_create("passwords")
        try:
            lines = [f"_broker:{own_password}", *(f"{robot}:{word}" for robot, word in credentials)]
            os.write(descriptor, ("\n".join(lines) + "\n").encode())
            rules = access_control(self.run, self._robots)
            path = f"/proc/self/fd/{descriptor}"
            self._session = zenoh.open(broker_config(self.endpoint, own_password, path, rules))
        except zenoh.ZError as error:
            raise UserError(
                f"--listen: cannot listen at {self.endpoint} ({_first_sentence(error)}); "
                "choose another endpoint, or leave it out to use a Unix socket"
            ) from None
        finally:
            os.close(descriptor)
        return self._session

    def _answers(self, robots: Sequence[int], take: Callable[[int, bytes], Answer]) -> Iterator[Answer]:
        """One message of each robot, in the order given, whatever the order they come in.

        Raises RobotFailure in the place of the first robot that will not answer.
        """
        awaited = set(robots)
        answers: dict[int, Answer] = {}
        for robot in robots:
            while robot not in answers:
                self._receive(robot, awaited, answers, take)
            yield answers.pop(robot)

    def _receive(
        self, robot: int, awaited: set[int], answers: dict[int, Answer], take: Callable[[int, bytes], Answer]
    ) -> None:
        """Wait for news, then take all that has come. `robot` is the one whose turn it is."""
        # One that owes an answer fails in its place; one that has no part in this instant fails now.
        lost = robot if robot in self._gone else min(self._gone - awaited, default=None)
        if lost is not None:
            name = self._robots[lost]
            raise RobotFailure(name, self._supervisor.cause_of_end(name))
        with waiting():
            sample: zenoh.Sample | None = self._reports.recv()
        while sample is not None:
            sender = self._index.get(robot_of(str(sample.key_expr)))
            raw = sample.payload.to_bytes()
            if sender is None:
                self._hear_bad_news(raw, robot)
            elif sender in awaited:
                try:
                    answers[sender] = take(sender, raw)
                    awaited.discard(sender)
                    self._clock.restart()  # who comes later has had to share the processors
                except MessageError as error:
                    self._refuse(sender, str(error))
            else:
                self._refuse(sender, "a message nobody had asked for")
            sample = self._reports.try_recv()

    def _refuse(self, robot: int, why: str) -> None:
        """Keep count. Raises RobotFailure for a robot that sends nothing but such messages."""
        self.refused.append((robot, why[:200]))
        if len(self.refused) > MAX_REFUSED:
            raise RobotFailure(
                self._robots[robot],
                f"sent more than {MAX_REFUSED} messages that are no reports, the last: {why}",
            )

    def _take_ready(self, _robot: int, raw: bytes) -> Ready:
        ready = decode_ready(raw)
        if ready.protocol != PROTOCOL:
            raise MessageError(f"speaks protocol {ready.protocol}, this broker {PROTOCOL}")
        return ready

    def _take_report(self, robot: int, raw: bytes) -> Report:
        report = decode_report(raw)
        if report.number != self._numbers[robot]:
            raise MessageError(f"answers grant {report.number} instead of {self._numbers[robot]}")
        return report

    def _hear_bad_news(self, news: bytes, robot: int) -> None:
        """Remember whose process is gone. Raises RobotFailure where `robot` lets us wait too long."""
        if news == OVERDUE and self._clock.overdue() and self._is_stuck(robot):
            raise RobotFailure(self._robots[robot], self._why_overdue(robot))
        self._gone = {index for index, name in enumerate(self._robots) if self._supervisor.has_exited(name)}

    def _is_stuck(self, robot: int) -> bool:
        """Whether a robot that is overdue has had its time.

        One that still computes may only have had to share the processors with many others: it gets as
        much processor time again as the deadline allows.
        """
        if robot >= len(self.pids) or not is_runnable(self.pids[robot]):
            return True
        used_s = processor_time_s(self.pids[robot])
        return used_s >= self._allowed_s.setdefault(robot, used_s + self._timeout_s)

    def _why_overdue(self, robot: int) -> str:
        refused = [why for who, why in self.refused if who == robot]
        cause = f"did not answer within {self._timeout_s:g} s"
        if refused:
            return f"{cause}; {len(refused)} malformed messages were refused, the last: {refused[-1]}"
        return f"{cause}; does it loop without awaiting? (limits.answer_timeout_s sets the deadline)"

    def _tell_gone(self, _robot: str) -> None:
        with contextlib.suppress(zenoh.ZError):
            self._bad_news.put(GONE)

    def _tell_overdue(self) -> None:
        with contextlib.suppress(zenoh.ZError):
            self._bad_news.put(OVERDUE)


class _AnswerClock:
    """Watches, by the wall clock, that answers do not take for ever. `with` it while waiting."""

    def __init__(self, timeout_s: float, tell: Callable[[], None]) -> None:
        self._timeout_s = timeout_s
        self._tell = tell
        self._since: float | None = None
        self._stopped = threading.Event()

    def start(self) -> None:
        threading.Thread(target=self._watch, name="answer clock", daemon=True).start()

    def stop(self) -> None:
        self._stopped.set()

    def overdue(self) -> bool:
        since = self._since
        return since is not None and time.monotonic() - since > self._timeout_s

    def restart(self) -> None:
        self._since = time.monotonic()

    def __enter__(self) -> None:
        self.restart()

    def __exit__(self, *_: object) -> None:
        self._since = None

    def _watch(self) -> None:
        while not self._stopped.wait(min(1.0, self._timeout_s / 4)):
            if self.overdue():
                self._tell()


def _socket_folder() -> Path:
    """A folder of our own for the socket, on a path that is not too long for one (108 bytes)."""
    folder = Path(tempfile.mkdtemp(prefix="heliograph-"))
    if len(str(folder)) <= MAX_SOCKET_FOLDER:
        return folder
    folder.rmdir()
    return Path(tempfile.mkdtemp(prefix="heliograph-", dir="/tmp"))


def _first_sentence(error: Exception) -> str:
    return str(error).split("at ", 1)[0].strip().rstrip(".") or type(error).__name__
