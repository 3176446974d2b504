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

from agent.behaviours.association.istate import StationaryIState
from agent.robot import Observation, Robot, Step


async def associate(robot: Robot) -> None:
    """Associate the voices and the lights in range, for as long as the run lasts."""
    probability = float(robot.params["transmission_probability"])
    steps = robot.steps(float(robot.params["step_s"]))

    first = await anext(steps)
    send_message_pair(robot, first)
    istate = initial_istate(await first.observe())
    log_istate(robot, 0, istate)

    async for step in steps:
        if robot.rng.random() < probability:
            send_message_pair(robot, step)
        observation = await step.observe()
        istate.update(observation.heard_from(), lit(observation))
        log_istate(robot, step.index - first.index, istate)


def send_message_pair(robot: Robot, step: Step) -> None:
    """Transmit in both channels at once: the own id by radio, and a flash as long as the step."""
    robot.radio.broadcast({"id": robot.id})
    robot.lamp.flash(step)


def initial_istate(observation: Observation) -> StationaryIState:
    """Everybody has just sent a pair: whoever was heard and whoever was lit is in range."""
    return StationaryIState(observation.heard_from(), lit(observation))


def lit(observation: Observation) -> set[int]:
    """Visual ids whose lamp was on in this step."""
    return {visual_id for visual_id, colour in observation.lamps().items() if colour}


def log_istate(robot: Robot, step: int, istate: StationaryIState) -> None:
    """Record what is still possible and what is claimed. JSON wants text for keys."""
    robot.log(
        "association",
        {
            "step": step,
            "edges": {str(visual_id): names for visual_id, names in istate.edges().items()},
            "matches": {str(visual_id): name for visual_id, name in istate.matches().items()},
            "complete": istate.is_final(),
        },
    )
