"""Run a robot of no consequence, so that whatever is forked afterwards starts warm.

CPython specialises bytecode and fills caches while code runs, in the memory pages that forked
robots share. What is settled before the fork is settled once, and its pages stay shared.
"""

from __future__ import annotations

import struct
from collections.abc import Callable

from agent.host import RobotHost
from agent.robot import Robot
from channels.messages import Grant, Hello, Message, RadioPlan, WireFrame, encode, encode_payload

GRANTS = 40
PERIOD_NS = 500_000_000
_more: list[Callable[[], object]] = []


def before_forks(function: Callable[[], object]) -> None:
    """Have a function called before robots are forked: what it loads or compiles, none of them needs to.

    For modules of behaviours, as they are imported. Nothing may depend on it: not all robots are forked.
    """
    _more.append(function)


def warm_up() -> None:
    """A few virtual seconds of a robot that talks, listens, looks and logs; and `before_forks`."""
    plan = RadioPlan(max_payload_bytes=100, overhead_bits=0, bit_rate_bps=None, queue=10)
    host = RobotHost(Hello("warm-up", "", {}, 0, 0, (0.0, 0.0, 0.0), plan, 1), _bit_of_everything)
    message = Message(0, "nobody", encode_payload({"id": "nobody"}))
    frame = WireFrame(0, struct.pack("<2i", 1, 2), bytes(8), bytes(8), b"\0\1")
    for number in range(GRANTS):
        host.exchange(encode(Grant(number, number * PERIOD_NS, [message], [frame], (0.0, 0.0, 0.0))))
    host.close()
    for function in _more:
        function()


async def _bit_of_everything(robot: Robot) -> None:
    async for step in robot.steps(PERIOD_NS / 1e9):
        if robot.rng.random() < 0.5:
            robot.radio.broadcast({"id": robot.id})
            robot.lamp.flash(step)
        observed = await step.observe()
        payloads = [message.payload for message in observed.heard]
        robot.log("warm-up", {"heard": len(payloads), "lit": sorted(observed.lit())})
