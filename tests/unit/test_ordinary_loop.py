"""The same behaviour object on asyncio's own loop: nothing in it knows of granted time."""

from __future__ import annotations

import asyncio
import time

import pytest

from agent.behaviours.association.stationary import associate
from agent.outbox import Outbox
from agent.robot import Robot
from channels.messages import Hello, Message, RadioPlan, WireFrame
from tests.properties.test_virtual_time_order import jumping_loop

NAMES = [f"r{number}" for number in range(6)]


class LoopClock:
    """The clock of whatever loop a robot runs on."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop

    @property
    def now_ns(self) -> int:
        return round(self._loop.time() * 1e9)


class Room:
    """Robots in one room: everybody hears and sees everybody, at once, on whatever loop is running."""

    def __init__(self, step_s: float) -> None:
        loop = asyncio.get_running_loop()
        clock = LoopClock(loop)
        plan = RadioPlan(100, 0, None, 10)
        params = {"step_s": step_s, "transmission_probability": 0.5}
        hellos = [
            Hello(name, "", params, seed, 0, (0.0, 0.0, 0.0), plan, 1) for seed, name in enumerate(NAMES)
        ]
        self.outboxes = [Outbox() for _ in NAMES]
        self.robots = [
            Robot(hello, outbox, clock) for hello, outbox in zip(hellos, self.outboxes, strict=True)
        ]
        self.entries: list[list[bytes]] = [[] for _ in NAMES]

    def carry(self) -> None:
        """Deliver what was sent, and a frame of all lamps, to everybody else."""
        lit = [any(command.colour for command in outbox.lamp) for outbox in self.outboxes]
        for index, outbox in enumerate(self.outboxes):
            for transmission in outbox.transmissions:
                for robot in self.robots:
                    if robot.id != NAMES[index]:
                        robot.radio.deliver([Message(0, NAMES[index], transmission.payload)])
            self.entries[index] += [entry.text for entry in outbox.entries]
            outbox.clear()
        for observer, robot in enumerate(self.robots):
            others = [index for index in range(len(NAMES)) if index != observer]
            # visual ids: any numbers, here counted backwards
            visual = b"".join((100 - index).to_bytes(4, "little") for index in reversed(others))
            zeros = bytes(4 * len(others))
            lamps = bytes(lit[index] for index in reversed(others))
            robot.camera.deliver([WireFrame(0, visual, zeros, zeros, lamps)])


async def run_room(step_s: float, steps: int) -> list[bytes]:
    """Let everybody associate for some steps; the last entry of each."""
    room = Room(step_s)
    tasks = [asyncio.create_task(associate(robot)) for robot in room.robots]
    loop = asyncio.get_running_loop()
    first = -(-round(loop.time() * 1e9) // round(step_s * 1e9)) * step_s
    for step in range(steps):
        await asyncio.sleep(first + (step + 0.5) * step_s - loop.time())
        room.carry()
    await asyncio.sleep(0.25 * step_s)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    room.carry()
    return [entries[-1] for entries in room.entries]


def expected() -> list[str]:
    """What each must know at the end: light 100 - n belongs to voice n."""
    return [
        ",".join(
            f'"{100 - index}":"{name}"' for index, name in reversed(list(enumerate(NAMES))) if name != own
        )
        for own in NAMES
    ]


def assert_all_matched(entries: list[bytes]) -> None:
    for entry, matches in zip(entries, expected(), strict=True):
        assert f'"matches":{{{matches}}}' in entry.decode()
        assert '"complete":true' in entry.decode()


def test_on_asyncios_own_loop_with_a_clock_that_jumps() -> None:
    loop = jumping_loop()
    try:
        assert_all_matched(loop.run_until_complete(run_room(0.5, 25)))
    finally:
        loop.close()


async def test_in_real_time() -> None:
    """Steps of 40 ms by the wall clock; a machine that stalls longer than that may not tell lights apart."""
    for _ in range(5):
        begun = time.monotonic()
        entries = await run_room(0.04, 25)
        if time.monotonic() - begun < 1.1:  # it kept pace
            assert_all_matched(entries)
            return
    pytest.skip("this machine did not keep pace with real time in five tries")
