"""What a robot believes of where another is (Vandermeulen et al., secs. III.B to III.D).

A belief is a probability for each of the S states of a `model.Model`, float64. Nothing here changes a
belief that it is given. One step in the life of a belief: `advanced`, then `observed` (or both at once:
`step`), and, when groups meet, `merged`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from enum import Enum

import numpy as np

from agent.behaviours.reconnection import kernels
from agent.behaviours.reconnection.model import Model
from channels.graphs import Bools, Floats


class Outcome(Enum):
    """What became of a belief: all but the first tell that it was wrong."""

    usual = 0
    nothing_left = 1
    """An observation contradicts all that was believed: every state at a place not heard is now equally
    likely."""
    everything_heard = 2
    """The same, and no place is left where the robot could be: every state is now equally likely."""
    disjoint = 3
    """What was merged have no state in common: their arithmetic mean was taken."""


_OUTCOMES = tuple(Outcome)


def at_vertex(model: Model, vertex: int, steps: int = 1) -> Floats:
    """Certainty that the robot is at this vertex, and has been for so many steps, from 1.

    Longer than the model thinks possible counts as the longest that it does.
    """
    return _certain(model, vertex, steps)


def on_way(model: Model, way: int, elapsed: int) -> Floats:
    """Certainty that the robot is on this way (`model.Ways`), and has been for so many steps, from 1.

    Longer than the model thinks possible counts as the longest that it does.
    """
    return _certain(model, model.vertices + way, elapsed)


def _certain(model: Model, at: int, steps: int) -> Floats:
    if steps < 1:
        raise ValueError(f"steps: a robot that is somewhere has been there for 1 or more, not {steps}")
    belief = np.zeros(model.states)
    belief[min(model.first[at] + steps, model.first[at + 1]) - 1] = 1.0
    return belief


def advanced(model: Model, belief: Floats) -> Floats:
    """One step later: F q (Eq. 6)."""
    after = np.empty_like(belief)
    kernels.advance(model.first, model.hazard, model.next_start, model.next_at, model.next_mu, belief, after)
    return after


def advanced_mixture(cooperative: Model, neutral: Model, c: float, belief: Floats) -> Floats:
    """One step later, where the robot cooperates with probability c: (c F_c + (1 - c) F_n) q (sec. III.B).

    The two models must have the same states: `mixture.aligned`.
    """
    return np.asarray(c * advanced(cooperative, belief) + (1 - c) * advanced(neutral, belief))


def heard_from(hearing: Bools, places: Iterable[int]) -> Bools:
    """Which places robots at these hear, by `channels.graphs.hearing`: (V,)."""
    return np.asarray(hearing[list(places)].any(axis=0))


def observed(model: Model, heard: Bools, belief: Floats, miss: float = 0.0) -> tuple[Floats, Outcome]:
    """What is believed after the robot was not heard at any of the places `heard`, (V,) (Eq. 7).

    `miss`: the probability that a robot is not heard at such a place. See `Outcome` for what happens where
    nothing is left.
    """
    after = belief.copy()
    return after, _OUTCOMES[kernels.listen(model.first, model.place, heard, miss, after)]


def step(model: Model, heard: Bools, belief: Floats, miss: float = 0.0) -> tuple[Floats, Outcome]:
    """`advanced`, then `observed`: R F q, normalised (Eq. 7)."""
    after = np.empty_like(belief)
    outcome = kernels.tick(
        model.first,
        model.place,
        model.hazard,
        model.next_start,
        model.next_at,
        model.next_mu,
        heard,
        miss,
        belief,
        after,
    )
    return after, _OUTCOMES[outcome]


def merged(beliefs: Sequence[Floats]) -> tuple[Floats, Outcome]:
    """The normalised geometric mean, state by state, of one belief or more (sec. III.D).

    It is 0 exactly where one of them is 0, and the same to the last bit in whatever order they come. Where
    that leaves no state, it is their arithmetic mean (`Outcome.disjoint`).
    """
    count = len(beliefs)
    each = np.stack(beliefs)
    if count > 2:
        each.sort(axis=0)  # products, and sums, of more than two depend on the order
    factors, powers = np.frexp(each)  # powers of 2 apart: products underflow
    product, power = factors[0], powers[0]
    for factor, exponent in zip(factors[1:], powers[1:], strict=True):
        product, shift = np.frexp(product * factor)
        power += exponent + shift
    whole, rest = np.divmod(power, count)
    product = np.ldexp(product, rest)
    mean = np.ldexp(np.sqrt(product) if count == 2 else product ** (1.0 / count), whole)
    total = mean.sum()
    if total > 0:
        return mean / total, Outcome.usual
    mean = each.sum(axis=0)
    return mean / mean.sum(), Outcome.disjoint


def by_place(model: Model, belief: Floats) -> Floats:
    """How likely the robot communicates from each vertex of the environment: (V,)."""
    mass = np.empty(model.vertices)
    kernels.mass_of_places(model.first, model.place, belief, mass)
    return mass


def mass_at(model: Model, belief: Floats, place: int) -> float:
    """How likely the belief holds it that the robot is where it is."""
    return float(by_place(model, belief)[place])
