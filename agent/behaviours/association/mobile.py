"""Probabilistic association among moving robots (Ivanov & Shell 2016, Algorithm 2).

There is no roll call: ids come and go as robots do. In every step each robot sends a message pair with
probability p, and updates its i-state by who spoke, who is in view, and who is lit. It is never complete.

Params: `step_s`, length of a time step [s]; `transmission_probability`, p; `drop_time` (20), steps of silence
after which a wireless id is dropped; `wireless_exceeds_visual` (false): the radio reaches farther than the
camera. Lights are on or off: `colours` must be 1.

Logs `association` after every step as `stationary` does; steps count from 1.
"""

from __future__ import annotations

from agent.behaviours.association.message_pair import MessagePairs
from agent.behaviours.association.mobile_istate import MobileIState
from agent.parameters import ParameterError, flag, positive, whole_number
from agent.robot import Robot


async def associate(robot: Robot) -> None:
    """Associate the voices and the lights in range, for as long as the run lasts."""
    pairs = MessagePairs(robot)
    if pairs.colours != 1:
        raise ParameterError(
            f"params.colours: is {pairs.colours}, but among moving robots lights are on or off; set it to 1"
        )
    istate = MobileIState(
        drop_time=whole_number(robot.params, "drop_time", 20),
        wireless_exceeds_visual=flag(robot.params, "wireless_exceeds_visual", False),
    )
    count = 0
    async for step in robot.steps(positive(robot.params, "step_s")):
        count += 1
        sent = pairs.send_at_random(step)
        observed = await step.observe()
        # A step without a frame shows nobody in view, which is not to say that all have left.
        if observed.frames:
            lamps = observed.lamps()
            istate.update(observed.heard_from(), lamps, observed.lit())
        knowledge = {"edges": istate.edges(), "matches": istate.matches()}
        robot.log("association", {"step": count, **knowledge, "complete": False, "sent": sent})
