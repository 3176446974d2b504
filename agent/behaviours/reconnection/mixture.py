"""A robot of which nobody knows whether it searches, too (Vandermeulen et al., sec. III.B).

Cooperative and neutral robots move by different models, F_c and F_n; what is believed of one that can be
either is advanced by c[t] F_c + (1 - c[t]) F_n: `belief.advanced_mixture`.
"""

from __future__ import annotations

import math

import numpy as np

from agent.behaviours.reconnection.model import Model
from channels.graphs import Floats, Ints


def aligned(*models: Model) -> tuple[Model, ...]:
    """The same models with the same states, so that a belief can be advanced by any of them.

    Each augmented vertex gets as many states as the model that needs most; none of them are ever reached in
    the others. Raises ValueError for models of different graphs.
    """
    one = models[0]
    for other in models[1:]:
        same = np.array_equal(one.next_start, other.next_start) and np.array_equal(one.next_at, other.next_at)
        if not same:
            raise ValueError("models: they are of different graphs")
    lengths = np.max([np.diff(model.first) for model in models], axis=0)
    first = np.concatenate(([0], np.cumsum(lengths)))
    return tuple(_stretched(model, first) for model in models)


def _stretched(model: Model, first: Ints) -> Model:
    hazard = np.ones(first[-1])  # nobody can have been there for so long: leaves at once
    for begin, old, end in zip(first, model.first, model.first[1:], strict=False):
        hazard[begin : begin + end - old] = model.hazard[old:end]
    return Model(model.vertices, first, model.place, hazard, model.next_start, model.next_at, model.next_mu)


def willingness(steps: float, half_steps: float) -> float:
    """c[t], how likely a robot cooperates so many steps after the last contact: 1 - 2^(-steps / half_steps).

    It "increases with time since the two robots were most recently connected" (sec. III.B); how, the paper
    leaves open. Here it is 0 at the contact, 1/2 after `half_steps` (more than 0), and goes to 1.
    """
    return -math.expm1(-math.log(2.0) * steps / half_steps)


def blended(cooperative: Model, neutral: Model, c: float) -> Model:
    """One model in place of c F_c + (1 - c) F_n (sec. III.B), of `aligned` models: for planning.

    The same operator wherever the two agree on the hazards of a vertex, or on what comes next. Where they
    differ in both, who leaves after k steps goes elsewhere than who leaves after others, which no single mu
    tells: each is then weighed by how often it leaves, c or 1 - c over its mean holding time.
    """
    rates = c / _mean_holding(cooperative), (1 - c) / _mean_holding(neutral)
    same = np.array(
        [
            np.array_equal(cooperative.hazard[begin:end], neutral.hazard[begin:end])
            for begin, end in zip(cooperative.first, cooperative.first[1:], strict=False)
        ]
    )
    share = np.where(same, c, rates[0] / (rates[0] + rates[1]))
    shares = np.repeat(share, np.diff(cooperative.next_start))
    return Model(
        cooperative.vertices,
        cooperative.first,
        cooperative.place,
        c * cooperative.hazard + (1 - c) * neutral.hazard,
        cooperative.next_start,
        cooperative.next_at,
        shares * cooperative.next_mu + (1 - shares) * neutral.next_mu,
    )


def _mean_holding(model: Model) -> Floats:
    """Mean number of steps at each augmented vertex: (n_a,)."""
    means = np.empty(len(model.place))
    for a, (begin, end) in enumerate(zip(model.first, model.first[1:], strict=False)):
        still = np.cumprod(np.concatenate(([1.0], 1.0 - model.hazard[begin : end - 1])))
        means[a] = still.sum()
    return means
