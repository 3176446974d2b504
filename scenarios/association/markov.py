"""The i-state transition graph and the absorbing Markov chain of channel association.

Ivanov & Shell 2014, "I-State Transition Graph" and Eq. 1; 2016, sec. 3.2 and 4.3.1. Too expensive for all but
the smallest neighbourhoods, as the papers say: here it is a check of `theory`, built from observations alone.

Two chains: one state per i-state matrix, as in the papers, and one per multiset of blocks, which is all that
matters for the completion time. A block is a connected part of the i-state: u invisible and v visible ids.

How many i-states there are: the papers say Bell's number B_w, the number of partitions of w ids. That holds
for v >= w - 1 only. With two or more invisible ids, partitions that differ only in blocks without visible ids
have the same matrix; then there are sum_k S(v, k) (k+1)^(w-v) (S: Stirling numbers of the second kind; each
invisible id joins one of k blocks or none), e.g. 2^(w-1) for v = 1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import product
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from scenarios.association.theory import check_neighbourhood

Number = Fraction | float
"""Probabilities: fractions give exact results."""
IState = tuple[int, ...]
"""For each visual id the wireless ids it is joined to, as bits; visual id s belongs to wireless id s."""
Blocks = tuple[tuple[int, int], ...]
"""Blocks (u, v) that hold ambiguity, in order: with a visible id, and more than one id."""
State = TypeVar("State", IState, Blocks)

MOST_WIRELESS_UNLUMPED = 8
MOST_WIRELESS_LUMPED = 12


@dataclass(frozen=True)
class AbsorbingChain(Generic[State]):
    """An absorbing Markov chain whose states only lead to themselves and to later ones; the last is final."""

    states: Sequence[State]
    rows: Sequence[Mapping[int, Number]]
    """For each state, the probabilities of the states it leads to."""

    def matrix(self) -> NDArray[np.float64]:
        """Transition probabilities, shape (states, states), upper triangular, as in 2014, Fig. 3."""
        matrix = np.zeros((len(self.rows), len(self.rows)))
        for state, row in enumerate(self.rows):
            for target, probability in row.items():
                matrix[state, target] = float(probability)
        return matrix

    def expected_steps(self) -> list[Number]:
        """Mean steps to the final state from every state: t = (I - Q)^-1 1 (2014, Eq. 1).

        Q is triangular, so substitution from the last row on solves it, and exactly for fractions.
        """
        last = len(self.rows) - 1
        steps: list[Number] = [Fraction(0)] * (last + 1)
        for state in range(last - 1, -1, -1):
            row = self.rows[state]
            later = sum((p * steps[target] for target, p in row.items() if target != state), Fraction(0))
            steps[state] = (1 + later) / (1 - row.get(state, Fraction(0)))
        return steps

    def absorption_cdf(self, steps: int) -> list[Number]:
        """Probability that the final state is reached from the first one after 0 ... steps steps."""
        last = len(self.rows) - 1
        now: dict[int, Number] = {0: Fraction(1)}
        cdf: list[Number] = [now.get(last, Fraction(0))]
        for _ in range(steps):
            following: dict[int, Number] = {}
            for state, probability in now.items():
                for target, p in self.rows[state].items():
                    following[target] = following.get(target, Fraction(0)) + probability * p
            now = following
            cdf.append(now.get(last, Fraction(0)))
        return cdf


@dataclass(frozen=True)
class TransitionGraph:
    """All i-states reached from the complete one, and the observations that lead from one to another.

    States are in order of level (number of parts of the graph), and within a level in order of
    discovery, with observations counted upwards, robot 0 the lowest bit. This is the order of 2014, Fig. 3.
    """

    wireless: int
    visual: int
    states: tuple[IState, ...]
    counts: tuple[Mapping[int, Sequence[int]], ...]
    """For each state and target, how many observations with 0, 1, ... w active robots lead there."""

    def istate_matrix(self, state: int) -> NDArray[np.int_]:
        """The w x v matrix of a state."""
        rows = self.states[state]
        return np.array(
            [[row >> h & 1 for row in rows] for h in range(self.wireless)], dtype=np.int_
        ).reshape(self.wireless, self.visual)

    def observations(self) -> NDArray[np.int_]:
        """How many observations lead from each state to each: the numbers at the edges of Fig. 3."""
        matrix = np.zeros((len(self.states), len(self.states)), dtype=np.int_)
        for state, row in enumerate(self.counts):
            for target, by_active in row.items():
                matrix[state, target] = sum(by_active)
        return matrix

    def levels(self) -> list[int]:
        """For each state its number of connected parts, single wireless ids included."""
        return [_level(state, self.wireless) for state in self.states]

    def chain(self, p: Number = Fraction(1, 2)) -> AbsorbingChain[IState]:
        """The Markov chain, when every robot transmits with probability p."""
        w = self.wireless
        weights = [p**active * (1 - p) ** (w - active) for active in range(w + 1)]
        rows = [
            {
                target: sum((n * x for n, x in zip(by_active, weights, strict=True)), Fraction(0))
                for target, by_active in row.items()
            }
            for row in self.counts
        ]
        return AbsorbingChain(self.states, rows)


def transition_graph(wireless: int, visual: int) -> TransitionGraph:
    """Apply all 2^w observations to all i-states (2014, "Probabilistic Algorithm"); w up to 8."""
    _check_size(wireless, visual, MOST_WIRELESS_UNLUMPED)
    start: IState = (2**wireless - 1,) * visual
    leads_to: dict[IState, dict[IState, list[int]]] = {start: {}}
    queue = [start]
    for state in queue:  # grows while it is walked through
        for observation in range(2**wireless):
            after = _observed(state, observation)
            by_active = leads_to[state].setdefault(after, [0] * (wireless + 1))
            by_active[observation.bit_count()] += 1
            if after not in leads_to:
                leads_to[after] = {}
                queue.append(after)
    ordered = sorted(queue, key=lambda state: _level(state, wireless))
    number = {state: index for index, state in enumerate(ordered)}
    counts = tuple({number[after]: c for after, c in leads_to[state].items()} for state in ordered)
    return TransitionGraph(wireless, visual, tuple(ordered), counts)


def lumped_chain(
    wireless: int, visual: int, p: Number = Fraction(1, 2), colours: int = 1
) -> AbsorbingChain[Blocks]:
    """The chain of multisets of blocks; w up to 12.

    Every block splits by itself: of its ids, each emits symbol s with probability r_s, r = (1-p, p/C, ...).
    """
    _check_size(wireless, visual, MOST_WIRELESS_LUMPED)
    check_neighbourhood(wireless, visual, float(p), colours)
    start = _ambiguous([(wireless - visual, visual)])
    rows: dict[Blocks, dict[Blocks, Number]] = {}
    queue = [start]
    for state in queue:
        if state in rows:
            continue
        after: dict[Blocks, Number] = {(): Fraction(1)}
        for block in state:
            after = _together(after, _splits(block, p, colours))
        rows[state] = after
        queue.extend(after)
    ordered = sorted(rows, key=lambda blocks: (-sum(_pairs(block) for block in blocks), blocks))
    number = {state: index for index, state in enumerate(ordered)}
    return AbsorbingChain(
        ordered, [{number[after]: chance for after, chance in rows[state].items()} for state in ordered]
    )


def number_of_istates(wireless: int, visual: int) -> int:
    """How many different i-state matrices there are; Bell's number for v >= w - 1 only."""
    check_neighbourhood(wireless, visual, 0.5, 1)
    return sum(_stirling(visual, k) * (k + 1) ** (wireless - visual) for k in range(visual + 1))


def bell_number(ids: int) -> int:
    """Partitions of a set of so many ids."""
    return sum(_stirling(ids, k) for k in range(ids + 1))


@cache
def _stirling(ids: int, blocks: int) -> int:
    if ids == blocks:
        return 1
    if blocks == 0 or blocks > ids:
        return 0
    return blocks * _stirling(ids - 1, blocks) + _stirling(ids - 1, blocks - 1)


def _check_size(wireless: int, visual: int, most: int) -> None:
    check_neighbourhood(wireless, visual, 0.5, 1)
    if wireless > most:
        raise ValueError(
            f"wireless: {wireless} ids have too many i-states for this chain; give at most {most}"
        )


def _observed(state: IState, observation: int) -> IState:
    """The i-state after one step; bit h of the observation says whether robot h was active (2016, Alg. 1)."""
    return tuple(
        row & observation if observation >> visual & 1 else row & ~observation
        for visual, row in enumerate(state)
    )


def _level(state: IState, wireless: int) -> int:
    """Visual ids of one part have equal rows; wireless ids in no row are parts of their own."""
    joined = 0
    for row in state:
        joined |= row
    return len(set(state)) + wireless - joined.bit_count()


def _pairs(block: tuple[int, int]) -> int:
    invisible, visible = block
    return visible * (visible - 1) // 2 + visible * invisible


def _ambiguous(blocks: Sequence[tuple[int, int]]) -> Blocks:
    return tuple(sorted(block for block in blocks if _pairs(block)))


def _together(one: Mapping[Blocks, Number], other: Mapping[Blocks, Number]) -> dict[Blocks, Number]:
    """Distribution of the union of two independent multisets."""
    union: dict[Blocks, Number] = {}
    for (blocks, chance), (more, its_chance) in product(one.items(), other.items()):
        key = tuple(sorted(blocks + more))
        union[key] = union.get(key, Fraction(0)) + chance * its_chance
    return union


def _splits(block: tuple[int, int], p: Number, colours: int) -> dict[Blocks, Number]:
    """Into what one block falls in a step: symbol after symbol takes a binomial share of the ids left."""
    open_: dict[tuple[Blocks, int, int], Number] = {((), *block): Fraction(1)}
    for symbols_left in range(colours, -1, -1):
        # of ids that emitted no symbol yet; all that remain at the end are silent
        share = p / colours / (1 - p + p * Fraction(symbols_left, colours)) if symbols_left else Fraction(1)
        following: dict[tuple[Blocks, int, int], Number] = {}
        for ((done, u, v), chance), a, b in product(open_.items(), range(block[0] + 1), range(block[1] + 1)):
            ways = math.comb(u, a) * math.comb(v, b)
            if ways and (symbols_left or (a, b) == (u, v)):
                taken = ways * share ** (a + b) * (1 - share) ** (u + v - a - b)
                key = tuple(sorted(done + _ambiguous([(a, b)]))), u - a, v - b
                following[key] = following.get(key, Fraction(0)) + chance * taken
        open_ = following
    return {done: chance for (done, _, _), chance in open_.items()}
