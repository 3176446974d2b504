"""What a behaviour sees of its robot. This is the whole surface; on hardware it is the same.

async def roll_call(robot: Robot) -> None:
    async for step in robot.steps(period=0.5):
        robot.radio.broadcast({"id": robot.id})
        observed = await step.observe()
        robot.log("heard", {"count": len(observed.heard)})
"""

from __future__ import annotations

from collections.abc import KeysView, Mapping
from functools import cached_property
from itertools import chain, compress
from typing import Any

from numpy.random import Generator, default_rng  # here, so that it is loaded before robots are forked

from agent.clock import Clock
from agent.drivers.body import Body
from agent.drivers.camera import Camera, Frame
from agent.drivers.lamp import Lamp
from agent.outbox import Outbox
from agent.radio import Radio
from agent.waiting import sleep_until
from channels.graphs import Graph
from channels.messages import MAX_NAME, Hello, LogEntry, Message, encode_entry
from channels.units import to_ns, to_s


class Robot:
    """Radio, lamp, camera, body, randomness, parameters and log of one robot."""

    def __init__(self, hello: Hello, outbox: Outbox, clock: Clock) -> None:
        self.id: str = hello.robot
        """Own name, which is also its network address (wireless id)."""
        self.number: int = hello.number
        """Own place in the team, from 0: an address that takes few bits."""
        self.team_size: int = hello.team
        """How many robots the team has."""
        self.params: Mapping[str, Any] = hello.params
        """The scenario's [params] for this robot."""
        self.graph: Graph | None = hello.graph
        """Where robots can go, in metres; None where the world has no graph."""
        self.radio = Radio(hello.radio, outbox, clock)
        self.lamp = Lamp(hello.colours, outbox, clock)
        self.camera = Camera()
        self.body = Body(hello.pose, outbox, hello.altitude_m)
        self._seed = hello.rng_seed
        self._outbox = outbox
        self._clock = clock

    @property
    def now_ns(self) -> int:
        """Reading of the robot's own clock [ns]."""
        return self._clock.now_ns

    @property
    def now_s(self) -> float:
        """Reading of the robot's own clock [s]; the time base of the event loop."""
        return to_s(self._clock.now_ns)

    @cached_property
    def rng(self) -> Generator:
        """The robot's own random generator, a function of (scenario seed, robot id) alone."""
        return default_rng(self._seed)

    def steps(self, period: float) -> Steps:
        """Common time steps of `period` seconds, counted from 0 on the own clock.

        `async for step in robot.steps(0.5)`: a step that the behaviour has slept through is skipped.
        Raises ValueError for a period under a nanosecond.
        """
        period_ns = to_ns(period)
        if period_ns < 1:
            raise ValueError(f"a step lasts at least a nanosecond, not {period} s")
        return Steps(self, period_ns)

    def log(self, name: str, data: Mapping[str, Any]) -> None:
        """Record an entry: what scoring reads. Sets are written in order, dicts as they are.

        `name`: 1 to 100 characters. Raises TypeError for what JSON has no form for, ValueError for
        NaN, infinity and other names, TooMuchAtOnce past 10 000 entries at one instant.
        """
        if not 1 <= len(name) <= MAX_NAME:
            raise ValueError(f"the name of an entry has 1 to {MAX_NAME} characters, not {len(name)}")
        if not name.isascii():
            name.encode()  # raises a ValueError where it holds half a character
        self._outbox.log(LogEntry(name, encode_entry(data)))


class Observation:
    """What was heard and seen in one step."""

    __slots__ = ("frames", "heard")

    def __init__(self, heard: list[Message], frames: list[Frame]) -> None:
        self.heard = heard
        """Radio messages, in order of arrival."""
        self.frames = frames
        """Camera frames, in order of exposure."""

    def heard_from(self) -> KeysView[str]:
        """Network addresses of the robots heard in this step, each once, in order of arrival.

        Usable as a set (`in`, `len`, `|`, `&`, `-`), but with an order: going through a `set` of
        text takes another one in every process, unless PYTHONHASHSEED is fixed as it is for robot
        processes.
        """
        return dict.fromkeys(message.sender for message in self.heard).keys()

    def lit(self) -> KeysView[int]:
        """Visual ids of the robots whose lamp was on in any frame of this step, in order of sight.

        Usable as a set, as `heard_from` is.
        """
        lit = (compress(frame.visual_ids, frame.lamps) for frame in self.frames)
        return dict.fromkeys(chain.from_iterable(lit)).keys()

    def lamps(self) -> dict[int, int]:
        """Visual id -> brightest lamp colour over the frames of this step (0: seen, never lit)."""
        lamps: dict[int, int] = {}
        for frame in self.frames:
            for visual_id, colour in zip(frame.visual_ids, frame.lamps, strict=True):
                if colour > lamps.get(visual_id, -1):
                    lamps[visual_id] = colour
        return lamps


class Step:
    """One time step: from `start_ns` to `end_ns` on the robot's own clock."""

    __slots__ = ("_robot", "end_ns", "index", "start_ns")

    def __init__(self, robot: Robot, index: int, period_ns: int) -> None:
        self._robot = robot
        self.index = index
        """Counts the steps of this period from time 0."""
        self.start_ns = index * period_ns
        self.end_ns = self.start_ns + period_ns

    async def observe(self) -> Observation:
        """Wait for the end of the step; then what has been heard and seen and not taken before."""
        if self.end_ns > self._robot.now_ns:
            await sleep_until(self.end_ns)
        return Observation(self._robot.radio.received(), self._robot.camera.frames())


class Steps:
    """Asynchronous iterator over time steps; each waits until its start."""

    __slots__ = ("_next", "_period_ns", "_robot")

    def __init__(self, robot: Robot, period_ns: int) -> None:
        self._robot = robot
        self._period_ns = period_ns
        self._next = -(-robot.now_ns // period_ns)

    def __aiter__(self) -> Steps:
        return self

    async def __anext__(self) -> Step:
        period = self._period_ns
        now_ns = self._robot.now_ns
        index = max(self._next, now_ns // period)
        self._next = index + 1
        if index * period > now_ns:
            await sleep_until(index * period)
        return Step(self._robot, index, period)
