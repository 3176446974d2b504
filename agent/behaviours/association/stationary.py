"""Stationary probabilistic association (Ivanov & Shell 2016, Algorithm 1; 2014, Algorithm 3).

In the first step everybody sends a message pair (a broadcast and a flash), so that every robot
knows its neighbourhood (sec. 4: the additional assumption). From then on each robot sends a pair
with probability p in every step and strikes out the edges its observation contradicts. It goes on
after it is done: its neighbours still need to hear and see it.

Params: `step_s`, length of a time step [s]; `transmission_probability`, p; `colours` (1), of lights;
`channel_inclusion` (true): whether every robot in sight is sure to be heard; and where it is not,
`false_match_bound` (0.01): the probability, at most, that a robot is done and has a match that is wrong.

Logs `association` after every step: `step` (0 is the initial one, which does not count), `edges`
and `matches` (visual id -> wireless ids, visual id -> wireless id), `complete`, and `sent`: whether
it sent a pair itself.
"""

from __future__ import annotations

from typing import Any

from agent.behaviours.association.istate import StationaryIState, survival
from agent.behaviours.association.message_pair import MessagePairs
from agent.parameters import flag, positive, probability
from agent.robot import Robot


async def associate(robot: Robot) -> None:
    """Associate the voices and the lights in range, for as long as the run lasts."""
    pairs = MessagePairs(robot)
    stop = StopRule(robot, pairs)
    steps = robot.steps(positive(robot.params, "step_s"))

    first = await anext(steps)
    pairs.send(first)
    observed = await first.observe()
    # Everybody has just sent a pair: whoever was heard and whoever was lit is in range.
    istate = StationaryIState(observed.heard_from(), observed.lit())
    knowledge = described(istate)
    robot.log("association", {"step": 0, **knowledge, "complete": stop.is_met(istate), "sent": True})

    async for step in steps:
        sent = pairs.send_at_random(step)
        observed = await step.observe()
        # A step without a frame shows nobody dark: it would contradict whoever spoke.
        if observed.frames and istate.update(*pairs.activity(observed)):
            knowledge = described(istate)
        entry = {"step": step.index - first.index, **knowledge, "complete": stop.is_met(istate), "sent": sent}
        robot.log("association", entry)


async def beacon(robot: Robot) -> None:
    """Send message pairs as `associate` does, and neither associate nor log anything.

    Params: `step_s`, `transmission_probability` and `colours` as above; `roll_call` (true): whether to send
    one in the first step in any case, for robots that associate as stationary ones do.
    """
    pairs = MessagePairs(robot)
    roll_call = flag(robot.params, "roll_call", True)
    async for step in robot.steps(positive(robot.params, "step_s")):
        if roll_call:
            pairs.send(step)
            roll_call = False
        else:
            pairs.send_at_random(step)


class StopRule:
    """When a robot is done, by the params `channel_inclusion` and `false_match_bound`."""

    def __init__(self, robot: Robot, pairs: MessagePairs) -> None:
        self._inclusion = flag(robot.params, "channel_inclusion", True)
        self._bound = probability(robot.params, "false_match_bound", 0.01)
        self._survival = survival(pairs.transmission_probability, pairs.colours)

    def is_met(self, istate: StationaryIState) -> bool:
        """Whether everything that can be associated is."""
        return istate.is_final() if self._inclusion else istate.is_settled(self._survival, self._bound)


def described(istate: StationaryIState) -> dict[str, Any]:
    """What is still possible and what is claimed, for the log."""
    return {"edges": istate.edges(), "matches": istate.matches()}
