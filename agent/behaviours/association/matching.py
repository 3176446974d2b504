"""Matching rows to columns one to one, every pair with a weight: the best way, and the chance of every pair.

A matching gives each row a column of its own or leaves it alone; columns may stay free. Its weight is the
product of the weights of its pairs and of the rows left alone, and its chance is proportional to that. Here
rows are visual ids and columns wireless ids; the weight of a pair is its likelihood ratio. All weights
are given as logarithms (nats); -inf: this pair, or leaving this row alone, is impossible.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agent.behaviours.association.marginals import EXACT_SIDE, pair_posteriors

try:
    from scipy.optimize import linear_sum_assignment
except ModuleNotFoundError:
    sentence = "association under noise needs SciPy; install heliograph[matching]"
    raise ModuleNotFoundError(sentence, name="scipy") from None

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.intp]

ALONE = -1
"""The column of a row that is left alone."""
TIE_NOISE = 1e-9
"""By how much weights are perturbed at most: far above rounding (1e-12), far below what evidence weighs."""
CUTS = (25.0, 18.0, 12.0)
"""Slacks (nats) beyond which pairs are cut off; the first that leaves a part small enough is taken."""

_LAST_RESORT = 50.0


def best_matching(weights: Floats, alone: Floats, generator: np.random.Generator | None = None) -> Indices:
    """Column of every row, or ALONE, in the matching of greatest weight; (R,).

    `weights` (R, C), `alone` (R,). With a generator, ties fall at random: every weight is perturbed by
    less than TIE_NOISE, so that no order of rows or columns decides. Without one, they fall anyhow.
    An impossible pair is never chosen. Where it is impossible to leave rows alone but there is no other
    way, as few as possible are.
    """
    return _best(weights, _finite(weights, alone), generator)


def posteriors(weights: Floats, alone: Floats) -> Floats:
    """P(row belongs to column) for every pair; (R, C). What is missing to 1 in a row: it is alone.

    `weights` (R, C), `alone` (R,). Pairs without which the best matching with them is hopeless (`slacks`
    beyond the first of CUTS: 1e-11) are cut off, and each part that remains is summed by itself: exactly,
    if need be after cutting some more (6e-6), or nearly where it stays too large (`marginals`). What
    was cut off still counts, by the weight of its best matching.
    """
    result = np.zeros(weights.shape)
    if not result.size:
        return result
    alone = _finite(weights, alone)
    chosen = _best(weights, alone, None)
    slack, potentials = slacks(weights, alone, chosen)
    pairs, lone, idle = _scaled(weights, alone, chosen, potentials)
    likely = np.exp(-slack)
    for rows, kept in _parts(slack):
        used = np.flatnonzero(kept.any(axis=0))
        block = np.ix_(rows, used)
        inside = pair_posteriors(np.where(kept[:, used], pairs[block], 0.0), lone[rows], idle[used])
        found = np.where(kept, 0.0, likely[rows])
        cut_off = found.sum(axis=1, keepdims=True)
        found[:, used] += inside
        result[rows] = found / (1.0 + cut_off)
    return result


def slacks(weights: Floats, alone: Floats, chosen: Indices) -> tuple[Floats, Floats]:
    """By how much the best matching with each pair falls short of the best of all, which is `chosen` (R,).

    `weights` (R, C); `alone` (R,), finite. Returns the slacks (R, C) and potentials (R + 1,) of what rows
    are matched to and, last, of all that is free (0): the dual prices of the assignment problem.

    Another matching differs from the best one by alternating paths: a row takes another's column, which
    takes the next one's, until one takes a free column. Shortest paths between rows, with all that is
    free as one more node, come from Floyd's algorithm; there is no negative cycle, since
    `chosen` is best (Ahuja, Magnanti & Orlin 1993, ch. 5 and 12).
    """
    rows, columns = weights.shape
    own = _own(weights, alone, chosen)
    matched = np.flatnonzero(chosen != ALONE)
    steps = np.full((rows + 1, rows + 1), np.inf)
    steps[:rows, matched] = own[:, None] - weights[:, chosen[matched]]
    free = np.setdiff1d(np.arange(columns), chosen)
    steps[:rows, rows] = own - np.maximum(weights[:, free].max(axis=1, initial=-np.inf), alone)
    steps[rows, :] = 0.0
    np.fill_diagonal(steps, 0.0)
    for middle in range(rows + 1):
        np.minimum(steps, steps[:, middle, None] + steps[middle], out=steps)
    slack = own[:, None] - weights + steps[_owners(columns, chosen), :rows].T
    slack[matched, chosen[matched]] = 0.0
    return np.maximum(slack, 0.0), steps[rows]


def _parts(slack: Floats) -> list[tuple[Indices, Bools]]:
    """Rows that compete for columns, directly or by others: places (K,), and pairs that are kept (K, C)."""
    parts = []
    todo = [(np.arange(len(slack)), 0)]
    while todo:
        members, level = todo.pop()
        kept = slack[members] <= CUTS[level]
        for part in _components(kept):
            smaller = min(part.size, int(kept[part].any(axis=0).sum()))
            if smaller > EXACT_SIDE and level + 1 < len(CUTS):
                todo.append((members[part], level + 1))
            else:
                parts.append((members[part], kept[part]))
    return parts


def _components(kept: Bools) -> list[Indices]:
    """Connected components of the graph of rows and columns, by their rows."""
    parts = []
    left = np.ones(len(kept), dtype=np.bool_)
    while left.any():
        reached = np.zeros(len(kept), dtype=np.bool_)
        wider = reached.copy()
        wider[left.argmax()] = True
        while not np.array_equal(reached, wider):
            reached = wider
            wider = reached | kept[:, kept[reached].any(axis=0)].any(axis=1)
        parts.append(np.flatnonzero(reached))
        left &= ~reached
    return parts


def _finite(weights: Floats, alone: Floats) -> Floats:
    """`alone`, with a last resort where it is impossible to leave a row alone.

    That weighs less than any difference the rest of a matching can make: between matchings with k and k + 1
    such rows, the other rows can differ by at most R times the span of all finite weights. A margin of
    another 50 nats (1e-22) keeps its share of the posteriors below rounding.
    """
    possible = np.concatenate([weights[np.isfinite(weights)], alone[np.isfinite(alone)]])
    low, high = possible.min(initial=0.0), possible.max(initial=0.0)
    return np.where(np.isfinite(alone), alone, low - len(weights) * (high - low) - _LAST_RESORT)


def _best(weights: Floats, alone: Floats, generator: np.random.Generator | None) -> Indices:
    rows, columns = weights.shape
    costs = np.full((rows, columns + rows), np.inf)
    costs[:, :columns] = -weights
    costs[np.arange(rows), columns + np.arange(rows)] = -alone
    if generator is not None:
        costs += TIE_NOISE * generator.random(costs.shape)
    _, found = linear_sum_assignment(costs)
    return np.where(found < columns, found, ALONE)


def _own(weights: Floats, alone: Floats, chosen: Indices) -> Floats:
    """(R,) what each row contributes to the best matching."""
    return np.where(chosen == ALONE, alone, weights[np.arange(len(chosen)), chosen])


def _owners(columns: int, chosen: Indices) -> Indices:
    """(C,) row each column belongs to; R: it is free."""
    owners = np.full(columns, len(chosen))
    matched = np.flatnonzero(chosen != ALONE)
    owners[chosen[matched]] = matched
    return owners


def _scaled(
    weights: Floats, alone: Floats, chosen: Indices, potentials: Floats
) -> tuple[Floats, Floats, Floats]:
    """Weights of pairs (R, C), of rows left alone (R,) and of columns left idle (C,), no logarithms any more.

    None is above 1, and those of the best matching are 1, so that nothing overflows and only what is
    negligible vanishes. The weights of all matchings have changed by the same factor.
    """
    own = _own(weights, alone, chosen) + potentials[:-1]
    prices = potentials[_owners(weights.shape[1], chosen)]
    pairs = np.minimum(weights - own[:, None] + prices, 0.0)
    return np.exp(pairs), np.exp(np.minimum(alone - own, 0.0)), np.exp(prices)
