"""Noise-tolerant stationary association (Ivanov & Shell 2016, sec. 6.3, carried out).

As in Algorithm 1, everybody sends a message pair in the first step, and from then on with probability p in
every step. But nothing is struck out on one observation: each robot keeps likelihood ratios under the
rates at which its channels err, and claims a pair once the posterior of it reaches `confidence`; until
then it says nothing. A robot whose first message was lost turns up when it is next heard.
Needs SciPy (`heliograph[matching]`), and cameras that take one frame a step.

Params: `step_s`, length of a time step [s]; `transmission_probability`, p; `confidence` (0.99);
`wireless_loss`, `visual_miss`, `visual_false` ("estimate") and `wireless_false` (0): each a number, or
"estimate" to learn it on the way; `estimate_rates` (false): learn the first three in any case, beginning with
the numbers that are given; `nobody` (0): prior probability that a robot in sight is out of radio range.

Logs `association` after every step: `step` (0 is the initial one, which does not count), `edges` (visual
id -> wireless ids whose posterior is above 0.001), `matches` (visual id -> wireless id: the claims) and
`posteriors` (visual id -> that of its claim), `strangers` (visual ids that are out of radio range with
probability `confidence`), `rates` in use, `complete` (every visual id is claimed or a stranger), and `sent`:
whether it sent a pair itself.
"""

from __future__ import annotations

from typing import Any

from agent.behaviours.association.message_pair import MessagePairs
from agent.behaviours.association.noisy_istate import NoisyIState
from agent.behaviours.association.rates import RATES, ChannelRates
from agent.parameters import ParameterError, Params, flag, positive, probability
from agent.robot import Robot

EDGE_THRESHOLD = 0.001
"""Posterior above which a pair counts as still possible."""
DECIMALS = 6
"""Of what is logged: the last bits of sums differ between processors."""

_FIRST_GUESS = {"wireless_loss": 0.1, "wireless_false": 0.05, "visual_miss": 0.1, "visual_false": 0.05}
_ESTIMATE = "estimate"
_DEFAULTS = dict.fromkeys(RATES, _ESTIMATE) | {"wireless_false": 0.0}


async def associate(robot: Robot) -> None:
    """Associate the voices and the lights in range, for as long as the run lasts."""
    pairs = MessagePairs(robot)
    if pairs.colours != 1:
        raise ParameterError(
            "params.colours: association under noise tells lit from dark only; set colours to 1"
        )
    confidence = _confidence(robot.params)
    istate = istate_of(robot.params, pairs.transmission_probability)
    steps = robot.steps(positive(robot.params, "step_s"))

    first = await anext(steps)
    pairs.send(first)
    observed = await first.observe()
    istate.roll_call(observed.heard_from(), observed.lamps())
    robot.log("association", {"step": 0, **described(istate, confidence), "sent": True})

    async for step in steps:
        sent = pairs.send_at_random(step)
        observed = await step.observe()
        istate.update(observed.heard_from(), observed.lamps())
        entry = {"step": step.index - first.index, **described(istate, confidence), "sent": sent}
        robot.log("association", entry)


def istate_of(params: Params, transmission_probability: float) -> NoisyIState:
    """The information state that a scenario's parameters ask for. Raises ValueError where they do not fit."""
    known: dict[str, float] = {}
    unknown: list[str] = []
    for name, default in _DEFAULTS.items():
        if params.get(name, default) == _ESTIMATE:
            known[name] = _FIRST_GUESS[name]
            unknown.append(name)
        else:
            known[name] = probability(params, name, 0.0)
    if flag(params, "estimate_rates", False):
        unknown = sorted({*unknown, "wireless_loss", "visual_miss", "visual_false"})
    rates = ChannelRates(transmission_probability=transmission_probability, **known)
    try:
        return NoisyIState(rates, estimate=unknown, nobody=probability(params, "nobody", 0.0))
    except ValueError as error:
        raise ParameterError(f"params.{error}") from None


def described(istate: NoisyIState, confidence: float) -> dict[str, Any]:
    """What is possible, what is claimed, and how sure that is, for the log."""
    claims = istate.claims(confidence)
    strangers = istate.strangers(confidence)
    return {
        "edges": istate.edges(EDGE_THRESHOLD),
        "matches": {visual_id: name for visual_id, (name, _) in claims.items()},
        "posteriors": {visual_id: round(posterior, DECIMALS) for visual_id, (_, posterior) in claims.items()},
        "strangers": strangers,
        "rates": {name: round(getattr(istate.rates, name), DECIMALS) for name in RATES},
        "complete": len(claims) + len(strangers) == len(istate.visual),
    }


def _confidence(params: Params) -> float:
    confidence = probability(params, "confidence", 0.99)
    if confidence <= 0.5:
        raise ParameterError(f"params.confidence: must be above 0.5, is {confidence}; 0.99 is usual")
    return confidence
