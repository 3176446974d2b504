"""Semi-Markov models of how a robot moves over the augmented graph (Vandermeulen et al., secs. III.A, III.B).

The augmented graph has a vertex for every vertex v of the environment, and one for every direction of every
edge: (v > w), on the way from v to w. A robot's state is the pair of an augmented vertex and of the number of
steps, from 1, since it came to it. States are numbered through: those of augmented vertex a are
`first[a]` .. `first[a + 1] - 1`, one for each time that it can have been there. The paper's (2, 2)-tensor F
then is a sparse matrix, which `kernels.advance` applies without ever writing it down.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from statistics import NormalDist
from typing import TypeAlias

import numpy as np
from msgspec import Struct

from channels.graphs import Floats, Graph, Ints, neighbours

Distribution: TypeAlias = Sequence[float] | Floats
"""Of a number of steps: entry k - 1 is the probability of k."""

HOLDINGS = ("uniform", "normal")

MOST_WAY_STEPS = 100_000
MOST_STEPS_OF_ALL_WAYS = 5_000_000

_NORMAL_REACH = 3.0


class Ways(Struct, frozen=True):
    """The environment's edges as arrays: way d, of 2 E, leads from `tail[d]` to `head[d]`."""

    start: Ints
    """(V + 1,): the ways out of vertex v are `start[v]` .. `start[v + 1] - 1`, by increasing head."""
    tail: Ints
    head: Ints
    steps: Ints
    """How many steps a robot is on the way, at its usual speed; those at the ends do not count."""


class Model(Struct, frozen=True):
    """How one robot is believed to move: n_a augmented vertices, S states."""

    vertices: int
    """How many of the augmented vertices are vertices of the environment: 0 .. vertices - 1. Way d is
    augmented vertex `vertices` + d."""
    first: Ints
    """(n_a + 1,): number of the first state of each augmented vertex; `first[n_a]` is S."""
    place: Ints
    """(n_a,): the vertex from which a robot that is there communicates; on a way, that at its tail."""
    hazard: Floats
    """(S,): d_k(a), the probability to leave in the next step after k steps there; 1 in the last state."""
    next_start: Ints
    """(n_a + 1,): where the successors of each augmented vertex begin in `next_at`."""
    next_at: Ints
    """Augmented vertices that can be next."""
    next_mu: Floats
    """mu(b | a), the probability of each to be next once a is left."""

    @property
    def states(self) -> int:
        """S."""
        return int(self.first[-1])


def ways_of(graph: Graph, travel_steps: float) -> Ways:
    """Each way takes max(1, round(length * travel_steps)) steps, halves rounded to even.

    Raises ValueError where a way, or all together, take too many: a belief has a number for each.
    """
    out = neighbours(graph)
    ends = [(tail, head, length) for tail, ways in enumerate(out) for head, length in ways]
    tail, head, longest = max(ends, key=lambda way: way[2], default=(0, 0, 0.0))
    if longest * travel_steps > MOST_WAY_STEPS:
        raise ValueError(
            f"travel_steps: the way from vertex {tail} to {head}, {longest:g} long, takes more than "
            f"{MOST_WAY_STEPS:,} steps; set less than {MOST_WAY_STEPS / longest:.3g}"
        )
    total = travel_steps * sum(length for _, _, length in ends)
    if total > MOST_STEPS_OF_ALL_WAYS:
        raise ValueError(
            f"travel_steps: all ways together take {total:,.0f} steps, more than {MOST_STEPS_OF_ALL_WAYS:,}; "
            f"set less than {travel_steps * MOST_STEPS_OF_ALL_WAYS / total:.3g}"
        )
    return Ways(
        start=np.cumsum([0, *map(len, out)]),
        tail=np.array([tail for tail, _, _ in ends], dtype=np.int64),
        head=np.array([head for _, head, _ in ends], dtype=np.int64),
        steps=np.array([max(1, round(length * travel_steps)) for _, _, length in ends], dtype=np.int64),
    )


def hazards(holding: Distribution) -> Floats:
    """d_k = gamma(k) / sum over k' >= k of gamma(k'), and 1 where nothing is left (Eq. 2)."""
    gamma = np.asarray(holding, dtype=np.float64)
    rest = np.cumsum(gamma[::-1])[::-1]
    with np.errstate(invalid="ignore", divide="ignore"):
        found = np.where(rest > 0, gamma / rest, 1.0)
    found[-1] = 1.0  # whatever rounding has left
    return np.minimum(found, 1.0)


def walk_model(
    graph: Graph,
    ways: Ways,
    *,
    holding: str | Sequence[Distribution] = "uniform",
    spread: float = 0.5,
    mu: Sequence[float] | Floats | None = None,
    dwell: Mapping[int, Distribution] | None = None,
) -> Model:
    """A robot that walks from vertex to neighbouring vertex (secs. III.B, V).

    `holding`: how many steps it is on a way, "uniform" or "normal" about the way's own `steps` as `spread`
    says (see those functions), or a distribution for every way. `mu`: (2 E,), the probability of each way
    once its tail is left; None: all neighbours are equally likely, "the simplest model". `dwell`: how many
    steps it stays at a vertex, for tasks; one step where nothing is given. Raises ValueError, "key: what is
    wrong".
    """
    vertices = len(ways.start) - 1
    if len(graph.vertices) != vertices or 2 * len(graph.edges) != len(ways.tail):
        raise ValueError("ways: they are those of another graph")
    at = [np.ones(1)] * vertices
    for vertex, distribution in (dwell or {}).items():
        if not 0 <= vertex < vertices:
            raise ValueError(f"dwell: there is no vertex {vertex}; they are 0 to {vertices - 1}")
        at[vertex] = _distribution(f"dwell[{vertex}]", distribution)
    return _semi_markov(ways, [*at, *_on_ways(ways, holding, spread)], _next_way(ways, mu))


def check_model(model: Model, ways: Ways) -> None:
    """Raises ValueError where a model is not one of a robot that goes these ways."""
    if model.place.tolist() != [*range(len(ways.start) - 1), *ways.tail.tolist()]:
        raise ValueError("expected: its model has other ways than the graph; make it of robot.graph")


def standing(model: Model) -> Model:
    """A robot that stays at the vertex that it is at, or on the way to; with the states of another model."""
    degrees = np.diff(model.next_start[: model.vertices + 1])
    after = model.next_at.copy()
    after[: model.next_start[model.vertices]] = np.repeat(np.arange(model.vertices), degrees)
    return Model(
        model.vertices, model.first, model.place, model.hazard, model.next_start, after, model.next_mu
    )


def uniform(steps: int, spread: float = 0.5) -> Floats:
    """Every whole number of steps from (1 - spread) to (1 + spread) times the usual is equally likely.

    For 0.5, "between 50 % and 150 %" (sec. V), this is ceil(0.5 tau) .. floor(1.5 tau).
    """
    slack = 1e-9  # 0.9 * 10 is no whole number
    least = max(1, math.ceil((1 - spread) * steps - slack))
    most = max(least, math.floor((1 + spread) * steps + slack))
    gamma = np.zeros(most)
    gamma[least - 1 :] = 1.0 / (most - least + 1)
    return gamma


def normal(steps: int, spread: float = 0.5) -> Floats:
    """Normal about the usual number of steps, the standard deviation being `spread` times that.

    Whole steps get what lies within half a step of them. It is cut off at three standard deviations or at
    one step, whichever is nearer, on both sides alike: so the mean stays what it is.
    """
    deviation = spread * steps
    reach = min(math.ceil(_NORMAL_REACH * deviation), steps - 1)
    if reach == 0:
        return uniform(steps, 0.0)
    law = NormalDist(steps, deviation)
    gamma = np.zeros(steps + reach)
    for k in range(steps - reach, steps + reach + 1):
        gamma[k - 1] = law.cdf(k + 0.5) - law.cdf(k - 0.5)
    return np.asarray(gamma / gamma.sum())


def _on_ways(ways: Ways, holding: str | Sequence[Distribution], spread: float) -> list[Floats]:
    if not isinstance(holding, str):
        if len(holding) != len(ways.tail):
            raise ValueError(f"holding: {len(holding)} distributions for {len(ways.tail)} ways")
        return [_distribution(f"holding[{way}]", each) for way, each in enumerate(holding)]
    if holding not in HOLDINGS:
        raise ValueError(f"holding: must be one of {', '.join(HOLDINGS)}, is {holding!r}")
    if not (math.isfinite(spread) and spread >= 0):
        raise ValueError(f"spread: must be a number of 0 or more, is {spread}")
    law = uniform if holding == "uniform" else normal
    known = {steps: law(steps, spread) for steps in np.unique(ways.steps).tolist()}
    return [known[steps] for steps in ways.steps.tolist()]


def _distribution(key: str, numbers: Distribution) -> Floats:
    gamma = np.asarray(numbers, dtype=np.float64)
    if gamma.ndim != 1 or not np.all(np.isfinite(gamma)) or np.any(gamma < 0) or abs(gamma.sum() - 1) > 1e-9:
        raise ValueError(f"{key}: must be probabilities of 1, 2, ... steps that sum to 1")
    return np.trim_zeros(gamma, "b")


def _next_way(ways: Ways, mu: Sequence[float] | Floats | None) -> Floats:
    degrees = np.diff(ways.start)
    if mu is None:
        return np.repeat(1.0 / degrees, degrees)
    given = np.asarray(mu, dtype=np.float64)
    if given.shape != ways.tail.shape or not np.all(np.isfinite(given)) or np.any(given < 0):
        raise ValueError(f"mu: must be {len(ways.tail)} probabilities, one for each way")
    wrong = np.flatnonzero(np.abs(np.add.reduceat(given, ways.start[:-1]) - 1) > 1e-9)
    if len(wrong):
        raise ValueError(f"mu: those of the ways out of vertex {wrong[0]} do not sum to 1")
    return given


def _semi_markov(ways: Ways, holdings: Sequence[Floats], mu: Floats) -> Model:
    vertices, count = len(ways.start) - 1, len(ways.tail)
    return Model(
        vertices=vertices,
        first=np.cumsum([0, *map(len, holdings)]),
        place=np.concatenate((np.arange(vertices), ways.tail)),
        hazard=np.concatenate([hazards(each) for each in holdings]),
        next_start=np.concatenate((ways.start, ways.start[-1] + np.arange(1, count + 1))),
        next_at=np.concatenate((vertices + np.arange(count), ways.head)),
        next_mu=np.concatenate((mu, np.ones(count))),
    )
