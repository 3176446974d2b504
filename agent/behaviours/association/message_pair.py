"""Message pairs: a broadcast and a flash at once, with which a robot shows whose voice is whose light.

With coloured lights (2014, "Relaxing Assumptions": the visual channel carries several bits) every pair has a
colour, drawn uniformly by the sender, shown by its lamp and named in its broadcast.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from agent.parameters import ParameterError, probability, whole_number
from agent.robot import Observation, Robot, Step
from channels.messages import Message, MessageError


class MessagePairs:
    """Sends one robot's message pairs, and reads those of others.

    Params: `transmission_probability`, p, of a pair in a step; `colours` (1), of which each pair has one.
    Raises ValueError where they do not fit, or the lamp has fewer colours.
    """

    def __init__(self, robot: Robot) -> None:
        self.transmission_probability = probability(robot.params, "transmission_probability")
        self.colours = whole_number(robot.params, "colours", 1)
        if self.colours > robot.lamp.colours:
            raise ParameterError(
                f"params.colours: is {self.colours}, but lamps show {robot.lamp.colours}; "
                f"set lamp.colours to {self.colours} as well"
            )
        self._robot = robot

    def send(self, step: Step) -> None:
        """Transmit in both channels at once: the own id by radio, and a flash as long as the step."""
        robot = self._robot
        if self.colours == 1:
            robot.radio.broadcast({"id": robot.id})
            robot.lamp.flash(step)
        else:
            colour = int(robot.rng.integers(1, self.colours, endpoint=True))
            robot.radio.broadcast({"id": robot.id, "colour": colour})
            robot.lamp.flash(step, colour)

    def send_at_random(self, step: Step) -> bool:
        """Send a pair with probability p; returns whether it was sent."""
        if not self._robot.rng.random() < self.transmission_probability:
            return False
        self.send(step)
        return True

    def activity(
        self, observed: Observation
    ) -> tuple[Mapping[str, int] | Collection[str], Mapping[int, int] | Collection[int]]:
        """Who spoke and who was lit, as `StationaryIState.update` takes it; with colours if there are any."""
        if self.colours == 1:
            return observed.heard_from(), observed.lit()
        return {message.sender: _colour(message) for message in observed.heard}, observed.lamps()


def _colour(message: Message) -> int:
    """The colour that a broadcast names; 1 where it names none."""
    try:
        payload: Any = message.payload
    except MessageError:
        return 1
    colour = payload.get("colour") if isinstance(payload, dict) else None
    return colour if type(colour) is int and colour > 0 else 1
