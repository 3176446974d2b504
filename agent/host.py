"""One robot under granted time: a behaviour on its own loop, grants in, reports out.

Both fleets drive robots through this class and nothing else, so that where a robot runs cannot
change what it does.
"""

from __future__ import annotations

import asyncio
import contextlib
import sys
import traceback

from agent.endings import sentence
from agent.loading import Behaviour
from agent.outbox import Outbox, TooMuchAtOnce
from agent.robot import Robot
from agent.virtual_time import GrantedTimeLoop
from channels.messages import (
    AWAITS_CAMERA,
    AWAITS_RADIO,
    END_OF_RUN,
    MAX_REPORT_BYTES,
    Grant,
    Hello,
    Report,
    decode_grant,
    encode,
)


class RobotHost:
    """Runs a behaviour for as long as it is granted time."""

    def __init__(self, hello: Hello, behaviour: Behaviour) -> None:
        self._loop = GrantedTimeLoop(hello.clock_ns)
        self._outbox = Outbox()
        self._robot = Robot(hello, self._outbox, self._loop)
        self._task = self._loop.create_task(behaviour(self._robot), name=hello.robot)

    def exchange(self, raw: bytes) -> bytes | None:
        """Take a grant, run the robot until it is idle, return its report (both as msgpack).

        None, and the robot is closed, where the grant says that the run is over. Whatever goes wrong
        with the behaviour is told in the report; only SystemExit and KeyboardInterrupt get out.
        """
        grant = decode_grant(raw)
        if grant.number == END_OF_RUN:
            self.close()
            return None
        try:
            self._accept(grant)
            self._loop.run_until_idle()
            report = encode(self._report(grant.number))
            if len(report) > MAX_REPORT_BYTES:
                raise TooMuchAtOnce(
                    f"what it did at one instant takes {len(report)} bytes to report, the limit is "
                    f"{MAX_REPORT_BYTES}; log and send less, or await in between"
                )
        except Exception as error:
            self._outbox.clear()
            report = encode(Report(grant.number, None, ended=_told(error)))
        return report

    def close(self) -> None:
        """Cancel what still runs, let it clean up at the present instant, close the loop.

        Whatever goes wrong in that no longer matters to anybody; only KeyboardInterrupt gets out.
        """
        loop = self._loop
        if loop.is_closed():
            return
        for task in asyncio.all_tasks(loop):
            task.cancel()
        try:
            with contextlib.suppress(Exception, SystemExit):
                loop.run_until_idle()
            if self._task.done() and not self._task.cancelled():
                self._task.exception()
        finally:
            loop.close()

    def _accept(self, grant: Grant) -> None:
        self._loop.advance_to(grant.now_ns)
        if grant.pose is not None:
            self._robot.body.deliver(grant.pose)
        if grant.messages:
            self._robot.radio.deliver(grant.messages)
        if grant.frames:
            self._robot.camera.deliver(grant.frames)

    def _report(self, number: int) -> Report:
        outbox = self._outbox
        robot = self._robot
        awaits = AWAITS_RADIO * robot.radio.awaited + AWAITS_CAMERA * robot.camera.awaited
        ended = self._ending() if self._task.done() else None
        report = Report(
            number,
            self._loop.next_deadline() if ended is None else None,
            awaits,
            outbox.transmissions,
            outbox.lamp,
            outbox.motion,
            outbox.entries,
            ended,
        )
        outbox.clear()
        return report

    def _ending(self) -> str:
        """Why the behaviour is over: empty where it simply returned."""
        if self._task.cancelled():
            return "CancelledError: the behaviour cancelled itself"
        error = self._task.exception()
        if error is None:
            return ""
        return _told(error)


def _told(error: BaseException) -> str:
    with contextlib.suppress(Exception):  # an error may be unprintable, or standard error closed
        traceback.print_exception(error, file=sys.stderr)
    return sentence(error)
