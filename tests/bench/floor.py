"""The floor: the same messages between as many processes, with as little as possible in between.

One forked process per robot, blocking reads on a Unix socket pair, epoll in the broker. No Zenoh,
no event loop, no recording, no behaviour: only encoding, decoding and the kernel.
"""

from __future__ import annotations

import gc
import os
import select
import socket
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from msgspec import Raw

from channels.messages import (
    END_OF_RUN,
    LogEntry,
    Message,
    RawGrant,
    Report,
    decode_grant,
    decode_report,
    encode,
)
from tests.bench.measure import Figures, Meter

WARM_UP = 20
"""Exchanges with everybody before the meters run."""
STEP_NS = 500_000_000
SPARE_BYTES = 1024


@dataclass(frozen=True)
class Sizes:
    """Mean lengths of a run's messages."""

    grant_bytes: int
    report_bytes: int


def measure_floor(robots: int, dense: Sizes, turns: Sizes, activations: int) -> Figures:
    """Cost per activation with all robots due at every instant, and (`turns_`) with one."""
    everyone = range(robots)
    steps = max(1, activations // robots)
    return {
        **_lock_step(robots, dense, [everyone] * steps, ""),
        **_lock_step(robots, turns, [[turn % robots] for turn in range(activations)], "turns_"),
    }


def _lock_step(robots: int, sizes: Sizes, instants: Sequence[Sequence[int]], prefix: str) -> Figures:
    team = _Team(robots, sizes)
    try:
        for _ in range(WARM_UP):
            team.exchange(range(robots))
        meter = Meter(team.pids)
        meter.begin()
        for due in instants:
            team.exchange(due)
        meter.end()
    finally:
        team.close()
    return meter.per_activation(sum(map(len, instants)), prefix)


class _Team:
    """Forked robots at the other ends of socket pairs."""

    def __init__(self, robots: int, sizes: Sizes) -> None:
        self.pids: list[int] = []
        self._read_bytes = sizes.report_bytes + SPARE_BYTES
        self._sockets: list[socket.socket] = []
        self._messages = [Raw(encode(Message(0, "r00", bytes(_filling(sizes.grant_bytes, _grant)))))]
        self._numbers = [0] * robots
        self._epoll = select.epoll()
        gc.freeze()  # the collector then leaves shared pages alone
        for _ in range(robots):
            # One datagram is one message; a stream would need a length before each and two reads.
            ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            self.pids.append(self._fork(theirs, sizes))
            theirs.close()
            self._sockets.append(ours)
            self._epoll.register(ours, select.EPOLLIN)
        self._robot_of = {end.fileno(): robot for robot, end in enumerate(self._sockets)}

    def exchange(self, due: Iterable[int]) -> list[Report]:
        """Grants out, reports in, in robot order."""
        sockets, numbers, robot_of = self._sockets, self._numbers, self._robot_of
        awaited = set(due)
        for robot in sorted(awaited):
            numbers[robot] += 1
            sockets[robot].send(encode(RawGrant(numbers[robot], numbers[robot] * STEP_NS, self._messages)))
        reports: dict[int, Report] = {}
        while awaited:
            for descriptor, _ in self._epoll.poll():
                robot = robot_of[descriptor]
                reports[robot] = report = decode_report(sockets[robot].recv(self._read_bytes))
                if report.number != numbers[robot]:
                    raise ValueError(f"robot {robot} answers grant {report.number}, not {numbers[robot]}")
                awaited.discard(robot)
        return [reports[robot] for robot in sorted(reports)]

    def close(self) -> None:
        for end, pid in zip(self._sockets, self.pids, strict=True):
            end.send(encode(RawGrant(END_OF_RUN, 0)))
            os.waitpid(pid, 0)
            end.close()
        self._epoll.close()

    def _fork(self, theirs: socket.socket, sizes: Sizes) -> int:
        pid = os.fork()
        if pid == 0:
            try:
                _be_robot(theirs, sizes)
            finally:
                os._exit(0)
        return pid


def _be_robot(end: socket.socket, sizes: Sizes) -> None:
    entries = [LogEntry("floor", bytes(_filling(sizes.report_bytes, _report)))]
    read_bytes = sizes.grant_bytes + SPARE_BYTES
    while (raw := end.recv(read_bytes)) and (grant := decode_grant(raw)).number != END_OF_RUN:
        end.send(encode(Report(grant.number, grant.now_ns + STEP_NS, entries=entries)))


def _grant(filling: bytes) -> object:
    return RawGrant(1000, STEP_NS, [Raw(encode(Message(0, "r00", filling)))])


def _report(filling: bytes) -> object:
    return Report(1000, STEP_NS, entries=[LogEntry("floor", filling)])


def _filling(wanted_bytes: int, message: Callable[[bytes], object]) -> int:
    """Length of the filling that makes a message so long; 0 where it is longer without any."""
    envelope = len(encode(message(bytes(wanted_bytes)))) - wanted_bytes
    return max(0, wanted_bytes - envelope)
