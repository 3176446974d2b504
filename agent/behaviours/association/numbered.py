"""What the deterministic algorithms share (Ivanov & Shell 2014): numbered robots that flash by a timetable.

In the initial step, the roll call, everybody broadcasts its number and flashes: that gives every robot
the numbers of its voices, and the lights in sight. Then only lights are used: the number alone says in
which of the following steps a robot flashes.

Params: `step_s`, length of a time step [s]; `ids`, n: numbers are 0 to n - 1; `number`, for single robots:
by default a robot's number is the digits its id ends in (r07: 7).

Logs `association` as `stationary` does; `sent` is whether it flashed. A robot returns once it is done.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping
from typing import Any

from agent.behaviours.association.istate import StationaryIState
from agent.parameters import ParameterError, positive, whole_number
from agent.robot import Observation, Robot
from channels.messages import MessageError


class Timetable(ABC):
    """Lights seen so far against the steps in which each number is to flash.

    An edge stays while its light was lit in exactly the steps in which its voice's number flashes: the
    i-state of 2014, "Deterministic Algorithms and the I-State Graph", with what was heard replaced by
    what is known in advance.

    `numbers`: wireless id -> number, each from 0 to `ids` - 1 and different from all others; `visual`:
    visual ids in sight. A light whose number nobody has announced ends up without a candidate.
    """

    def __init__(self, numbers: Mapping[str, int], visual: Iterable[int], ids: int) -> None:
        self._numbers = dict(numbers)
        self._ids = ids
        self._istate = StationaryIState(numbers, visual)

    @staticmethod
    @abstractmethod
    def steps(ids: int) -> int:
        """After how many steps everything in sight has shown its number."""

    @staticmethod
    @abstractmethod
    def flashes(number: int, step: int) -> bool:
        """Whether the robot with this number flashes in step 1, 2, ..."""

    def update(self, step: int, lit: Collection[int]) -> bool:
        """Take in who was lit in step 1, 2, ...; returns whether an edge went. Steps may be left out."""
        on = [name for name, number in self._numbers.items() if self.flashes(number, step)]
        return self._istate.update(on, lit)

    def edges(self) -> dict[int, list[str]]:
        """Visual id -> wireless ids whose number fits what it has shown so far, in order."""
        return self._istate.edges()

    def matches(self) -> dict[int, str]:
        """Visual id -> the one wireless id left for it; only where exactly one is left."""
        return self._istate.matches()

    def is_final(self, step: int) -> bool:
        """Whether everything is over after this step."""
        return step >= self.steps(self._ids)


async def run(robot: Robot, timetable: type[Timetable]) -> None:
    """Roll call, then as many steps as the algorithm takes."""
    ids = whole_number(robot.params, "ids")
    number = own_number(robot.id, robot.params, ids)
    steps = robot.steps(positive(robot.params, "step_s"))

    first = await anext(steps)
    robot.radio.broadcast({"id": robot.id, "number": number})
    robot.lamp.flash(first)
    observed = await first.observe()
    table = timetable(announced(observed, robot.id, number, ids), observed.lit(), ids)
    knowledge = _described(table)
    robot.log("association", {"step": 0, **knowledge, "complete": table.is_final(0), "sent": True})

    count = 0
    while not table.is_final(count):
        step = await anext(steps)
        count = step.index - first.index
        flashes = table.flashes(number, count)
        if flashes:
            robot.lamp.flash(step)
        observed = await step.observe()
        # A step without a frame shows nobody dark: it would contradict whoever flashed.
        if observed.frames and table.update(count, observed.lit()):
            knowledge = _described(table)
        entry = {"step": count, **knowledge, "complete": table.is_final(count), "sent": flashes}
        robot.log("association", entry)


def own_number(robot_id: str, params: Mapping[str, Any], ids: int) -> int:
    """A robot's number: the param `number`, or else the digits its id ends in.

    Raises ValueError where there is none, or it is not below `ids`.
    """
    remedy = f'give the robot one: [[robot]] with id = "{robot_id}" and params = {{ number = ... }}'
    if "number" in params:
        number = whole_number(params, "number", least=0)
    else:
        digits = re.search(r"[0-9]+$", robot_id)
        if digits is None:
            raise ParameterError(
                f"params.number: is missing, and the id {robot_id} ends in no digits; {remedy}"
            )
        number = int(digits[0])
    if number >= ids:
        raise ParameterError(
            f"params.number: {robot_id} has number {number}, but params.ids = {ids} allows 0 to {ids - 1}; "
            f"raise ids, or {remedy}"
        )
    return number


def announced(observed: Observation, robot_id: str, number: int, ids: int) -> dict[str, int]:
    """Wireless id -> number of everyone heard in the roll call, in order of arrival.

    Raises ValueError where a robot named no number from 0 to `ids` - 1, or two robots the same.
    """
    owner = {number: robot_id}
    numbers: dict[str, int] = {}
    for message in observed.heard:
        try:
            payload: Any = message.payload
        except MessageError:
            payload = None
        named = payload.get("number") if isinstance(payload, dict) else None
        if type(named) is not int or not 0 <= named < ids:
            raise ParameterError(
                f"params.ids: is {ids}, but {message.sender} announced no number from 0 to {ids - 1}; "
                "let all robots run the same behaviour with the same ids"
            )
        if owner.setdefault(named, message.sender) != message.sender:
            raise ParameterError(
                f"params.number: {owner[named]} and {message.sender} both have number {named}; "
                "give each robot a number of its own"
            )
        numbers[message.sender] = named
    return numbers


def _described(table: Timetable) -> dict[str, Any]:
    return {"edges": table.edges(), "matches": table.matches()}
