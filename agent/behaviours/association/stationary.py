"""Stationary probabilistic association (Ivanov & Shell 2016, Algorithm 1; 2014, Algorithm 3).

In the first step everybody sends a message pair (a broadcast and a flash), so that every robot
knows its neighbourhood (sec. 4: the additional assumption). From then on each robot sends a pair
with probability p in every step and strikes out the edges its observation contradicts. It goes on
after it is done: its neighbours still need to hear and see it.

Params: `step_s`, length of a time step [s]; `transmission_probability`, p.

Logs `association` after every step: `step` (0 is the initial one, which does not count), `edges`
and `matches` (visual id -> wireless ids, visual id -> wireless id) and `complete`.
"""

from __future__ import annotations

from typing import Any

from agent.behaviours.association.istate import StationaryIState
from agent.robot import Robot, Step


async def associate(robot: Robot) -> None:
    """Associate the voices and the lights in range, for as long as the run lasts."""
    probability = float(robot.params["transmission_probability"])
    steps = robot.steps(float(robot.params["step_s"]))

    first = await anext(steps)
    send_message_pair(robot, first)
    observed = await first.observe()
    # Everybody has just sent a pair: whoever was heard and whoever was lit is in range.
    istate = StationaryIState(observed.heard_from(), observed.lit())
    knowledge = described(istate)
    robot.log("association", {"step": 0, **knowledge})

    async for step in steps:
        if robot.rng.random() < probability:
            send_message_pair(robot, step)
        observed = await step.observe()
        if istate.update(observed.heard_from(), observed.lit()):
            knowledge = described(istate)
        robot.log("association", {"step": step.index - first.index, **knowledge})


def send_message_pair(robot: Robot, step: Step) -> None:
    """Transmit in both channels at once: the own id by radio, and a flash as long as the step."""
    robot.radio.broadcast({"id": robot.id})
    robot.lamp.flash(step)


def described(istate: StationaryIState) -> dict[str, Any]:
    """What is still possible and what is claimed, for the log."""
    return {"edges": istate.edges(), "matches": istate.matches(), "complete": istate.is_final()}
