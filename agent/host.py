"""One robot under granted time: a behaviour on its own loop, grants in, reports out.

Both fleets drive robots through this class and nothing else, so that where a robot runs cannot
change what it does.
"""

from __future__ import annotations

import asyncio
import contextlib
import sys
import traceback

from agent.endings import one_line, sentence, unwrapped
from agent.loading import Behaviour
from agent.outbox import Outbox, TooMuchAtOnce
from agent.parameters import ParameterError
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
        error = self._ending() if self._task.done() else None
        ended = None if not self._task.done() else "" if error is None else _told(error)
        report = Report(
            number,
            self._loop.next_deadline() if ended is None else None,
            awaits,
            outbox.transmissions,
            outbox.lamp,
            outbox.motion,
            outbox.entries,
            ended,
            isinstance(error, ParameterError),
        )
        outbox.clear()
        return report

    def _ending(self) -> BaseException | None:
        """Why the behaviour is over; None where it simply returned."""
        if self._task.cancelled():
            return asyncio.CancelledError("the behaviour cancelled itself")
        error = self._task.exception()
        return None if error is None else unwrapped(error)


def _told(error: BaseException) -> str:
    if isinstance(error, ParameterError):
        return one_line(str(error))  # the scenario's fault; a traceback would lead nobody to it
    if isinstance(error, asyncio.CancelledError):
        return sentence(error)
    with contextlib.suppress(Exception):  # an error may be unprintable, or standard error closed
        traceback.print_exception(error, file=sys.stderr)
    return sentence(error)
