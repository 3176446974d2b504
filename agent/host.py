"""One robot under granted time: a behaviour on its own loop, grants in, reports out.

Both fleets drive robots through this class and nothing else, so that where a robot runs cannot
change what it does.
"""

from __future__ import annotations

import asyncio
import sys
import traceback

from agent.loading import Behaviour
from agent.outbox import Outbox
from agent.robot import Robot
from agent.virtual_time import GrantedTimeLoop
from channels.messages import (
    AWAITS_CAMERA,
    AWAITS_RADIO,
    END_OF_RUN,
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

        None, and the robot is closed, where the grant says that the run is over.
        """
        grant = decode_grant(raw)
        if grant.number == END_OF_RUN:
            self.close()
            return None
        self._accept(grant)
        self._loop.run_until_idle()
        return encode(self._report(grant.number))

    def close(self) -> None:
        """Cancel what still runs, let it clean up at the present instant, close the loop."""
        loop = self._loop
        if loop.is_closed():
            return
        for task in asyncio.all_tasks(loop):
            task.cancel()
        loop.run_until_idle()
        if self._task.done() and not self._task.cancelled():
            self._task.exception()
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
        traceback.print_exception(error, file=sys.stderr)
        return " ".join(f"{type(error).__name__}: {error}".split())
