"""Where to search: the moves most likely to meet a target within a horizon (Vandermeulen et al., sec. IV).

A plan is worth the probability of contact with at least one target in its H steps (Eqs. 10, 11):
1 - prod(1 - c_j), where c_j adds up, step by step, the mass of target j's belief that the searchers hear;
what they heard has gone from the belief, or, if silence proves little, a share `miss` of it stays.

**The bound.** Let m_s = F^s q be a belief that is moved on from the root and never observed, and n_s the one
that a plan observes; observing only takes away, and F has no negative entry, so n_s <= m_s. A searcher that
is at v' in step s - 1 and at v in step s detects in s mass of two kinds: what it did not hear in s - 1 and
hears now, at most what m moves in that step from places not heard at v' to places heard at v; and what it
heard before already, of which at most a share `miss` was left. So with g_s(v', v) = (1 - miss) (what m moves
to places heard at v from places not heard at v', plus miss times what it moves there from places heard at
v'), the mass detected in step s is at most g_s(v', v). (In step 1 nothing has been observed by the plan, so
all mass counts in full.) As g depends on two successive places only, dynamic programming over steps and
vertices finds the most, `rest`, that any continuation can still add to each c_j, once per plan; and, with g
summed over targets, the most that it can add to all c_j together, which several targets in different
directions cannot all reach. `kernels.most` makes of both one bound on 1 - prod(1 - c_j).

For a team, mass that is detected in s was heard by nobody in s - 1, or a share `miss` of it was left; some
member i hears it now, and in s - 1 it was not heard by i. It is therefore counted in g_s of that member,
and the sum over members of g_s bounds what the team detects in s. Each member goes its own way, so the sum of
what each can add by itself, waiting as it likes, bounds what any joint plan can add.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike

from agent.behaviours.reconnection import kernels
from agent.behaviours.reconnection.model import Ways
from agent.behaviours.reconnection.planner_arrays import CHUNK, Ground, beam_of, room_of
from channels.graphs import Bools, Floats, Ints

SLACK = 0.05
"""First moves this share below the best are as good as the best: to choose among them at random breaks
most of the cycles that the best moves alone can get stuck in."""

ROUNDING = 1e-12
"""Values that differ by less than this share of theirs are equal; which is greater is chance of rounding."""


WIDTH = 8
"""How many nodes a group's search keeps of each step, at first."""

BUDGET = 60
"""How many nodes a group's search goes on from before it stops to double the width."""

LEAN = 0.2
"""Which share of what members can add by themselves counts when a group's search chooses what to keep: they
hear much the same, and with all of it the search prefers plans that put off what others do at once. Found by
trying on 150 vertices; it has no effect on what is proven."""


class AlonePlan(Struct, frozen=True):
    """What one searcher can do first."""

    first: Ints
    """(k,): the neighbours of its vertex, in order."""
    values: Floats
    """(k,): probability of contact by the best path that begins so; exact for all within the slack of the
    best; -1 for others."""
    best_path: tuple[int, ...]
    """The vertices that the best path comes to, in order; the last one maybe after the horizon."""
    nodes: int
    """How many paths have been looked at."""


class TeamPlan(Struct, frozen=True):
    """What a group can do first."""

    moves: Ints
    """(k, m): safe joint decisions, in lexicographic order: the vertex each member goes to, or -1: it waits
    for the next arrival, or is on the way. Of decisions that differ only by who of several members at one
    vertex does what, the first is there for all."""
    values: Floats
    """(k,): probability of contact by the best plan found that begins so; -1 where none within the slack
    was found."""
    proven: bool
    """Whether no plan at all is better than the best of these."""
    bound: float
    """No plan has a higher probability of contact."""
    nodes: int
    """How many joint states the search has gone on from."""
    width: int
    """How many of them it has kept of each step, in the end."""


def plan_alone(
    ground: Ground,
    beliefs: Sequence[Floats] | Floats,
    vertex: int,
    horizon: int,
    *,
    miss: float = 0.0,
    slack: float = SLACK,
) -> AlonePlan:
    """The best paths of one searcher that is at a vertex: exact, by branch and bound.

    `beliefs`: of each target of `ground`, (T, S) or T arrays, just observed; `horizon`: H >= 1 steps;
    `miss` in [0, 1): see the module. Never waits. Raises ValueError where beliefs and ground do not fit.
    """
    belief = _flat(ground, beliefs, horizon, miss, slack)
    here = np.array([vertex])
    tables = _tables(ground, belief, (here, here, np.zeros(1, dtype=np.int64)), horizon, miss, waiting=False)
    first = ground.head[ground.start[vertex] : ground.start[vertex + 1]].copy()
    deep, legs = horizon // 2 + 2, min(int(ground.steps.max()), horizon) + 1
    widest = int(np.diff(ground.start).max())
    q = np.empty((deep, legs, len(belief)))
    q[0, 0] = belief
    at, step, tried, known, path = np.zeros((5, deep), dtype=np.int64)
    at[0] = vertex
    values, paths = np.full(len(first), -1.0), np.full((len(first), deep), -1)
    nodes = kernels.search_alone(
        ground,
        miss,
        slack,
        *tables,
        q,
        np.zeros((deep, legs, len(ground.ends) - 1)),
        np.zeros((deep, widest), dtype=np.int64),
        np.zeros((deep, widest)),
        np.zeros(len(tables[0])),
        at,
        step,
        tried,
        known,
        path,
        values,
        paths,
    )
    values[values < _least(values, slack)] = -1.0
    path = paths[int(np.argmax(values >= _least(values, 0.0)))]
    return AlonePlan(first, values, tuple(path[path >= 0].tolist()), nodes)


def plan_team(
    ground: Ground,
    beliefs: Sequence[Floats] | Floats,
    places: Ints,
    towards: Ints,
    remaining: Ints,
    horizon: int,
    *,
    miss: float = 0.0,
    slack: float = SLACK,
    width: int = WIDTH,
    budget: int = BUDGET,
) -> TeamPlan:
    """Joint plans of a connected group: any-time, by beam search with the bound of branch and bound.

    `places`, `towards`, `remaining`: (m,), of its members, as in `kernels.safe`; what they are committed to
    must be safe. The rest as in `plan_alone`. Members decide when somebody arrives (and now): each that is
    at a vertex leaves it, or waits for the next arrival; a decision must be safe, and not all may wait
    while nobody is on the way. Of all joint states of one step, the search goes on from the most promising
    `width`; then again with twice that, as long as the nodes of all searches stay within `budget`. Raises
    ValueError where beliefs and ground do not fit.
    """
    belief = _flat(ground, beliefs, horizon, miss, slack)
    team = (
        np.array(places, dtype=np.int64),
        np.array(towards, dtype=np.int64),
        np.array(remaining, np.int64),
    )
    tables = _tables(ground, belief, team, horizon, miss, waiting=True)
    moves = joint_moves(ground, ground.hearing, *team, once=True)
    room = room_of(ground, len(places), horizon, len(tables[0]), LEAN)
    values, nodes = np.full(len(moves), -1.0), 0
    while True:
        lost = np.full(len(moves), -1.0)
        beam = beam_of(ground, belief, team, horizon, width)
        last = kernels.search_team(ground, *tables, beam, room, miss, slack, values, lost)
        nodes += last
        bound = max(float(values.max()), float(lost.max()))
        proven = bound <= float(values.max()) * (1 + ROUNDING)
        if proven or nodes + 2 * last > budget:
            break
        width *= 2
    values[values < _least(values, slack)] = -1.0
    return TeamPlan(moves, values, proven, bound, nodes, width)


def joint_moves(
    ways: Ways | Ground, hearing: Bools, places: Ints, towards: Ints, remaining: Ints, *, once: bool = False
) -> Ints:
    """All safe joint decisions of a group: (k, m), in lexicographic order; vertices, or -1.

    `hearing`: (V, V); the members' arrays as in `kernels.safe`. -1 is to wait for the next arrival of
    anybody, and stands for those on the way, who have decided before. Not all may wait while nobody is on
    the way, so one robot alone never does; only where nothing else is safe is the answer one row of -1.
    `once`: of decisions that differ only by who of several members at one vertex does what, only the first.
    """
    at, to, left = (np.array(array, dtype=np.int64) for array in (places, towards, remaining))
    members, changed = len(at), 0
    parts: list[Ints] = []
    choice = np.full(members, -1)
    then_at, part = np.zeros((2, members), dtype=np.int64)
    if kernels.together(at, to, left, 0, hearing):
        while not parts or len(parts[-1]) == CHUNK:
            chosen, then, after = np.empty((3, CHUNK, members), dtype=np.int64)
            count = kernels.gather(
                ways.start,
                ways.head,
                ways.steps,
                hearing,
                at,
                to,
                left,
                once,
                changed,
                choice,
                then_at,
                part,
                chosen,
                then,
                after,
            )
            parts.append(np.where(chosen >= 0, then, -1)[:count])
            changed = -1
    moves = np.concatenate([np.empty((0, members), dtype=np.int64), *parts])
    return moves if len(moves) else np.full((1, members), -1)


def choose(values: ArrayLike, slack: float, u: float) -> int:
    """Which of the plans to follow: each within the slack of the best with the same probability.

    `values`: probabilities of contact; `u`: a uniform draw from [0, 1); 0 chooses the first of them.
    """
    values = np.asarray(values, dtype=np.float64)
    near = np.flatnonzero(values >= _least(values, slack))
    return int(near[min(int(u * len(near)), len(near) - 1)])


def _tables(
    ground: Ground, belief: Floats, team: tuple[Ints, Ints, Ints], horizon: int, miss: float, waiting: bool
) -> tuple[Floats, Floats, Floats]:
    """`stayed`, `came` and `rest` (see `kernels`), a row for each target and, of several, one for the sum."""
    targets, vertices = len(ground.ends) - 1, len(ground.start) - 1
    soon = np.full(vertices, horizon + 1)
    kernels.soonest(ground, *team, soon)
    stayed = np.zeros((targets, horizon + 1, vertices))
    came = np.zeros((targets, horizon + 1, len(ground.head)))
    flow, inflow = np.empty((targets, len(ground.pair_tail))), np.empty((targets, vertices))
    kernels.prospects(ground, belief.copy(), np.empty_like(belief), soon, miss, stayed, came, flow, inflow)
    if targets > 1:
        stayed = np.concatenate((stayed, stayed.sum(axis=0, keepdims=True)))
        came = np.concatenate((came, came.sum(axis=0, keepdims=True)))
    rest = np.zeros_like(stayed)
    kernels.onwards(ground, soon, stayed, came, waiting, rest)
    return stayed, came, rest


def _least(values: Floats, slack: float) -> float:
    """From which value on a plan is within the slack of the best."""
    return float(values.max()) * (1 - slack) * (1 - ROUNDING)


def _flat(
    ground: Ground, beliefs: Sequence[Floats] | Floats, horizon: int, miss: float, slack: float
) -> Floats:
    """The joined beliefs."""
    if [len(belief) for belief in beliefs] != np.diff(ground.ends).tolist():
        raise ValueError("beliefs: there must be one for each target of ground, with a number per state")
    if horizon < 1:
        raise ValueError(f"horizon: must be at least 1 step, not {horizon}")
    if not 0 <= miss < 1:
        raise ValueError(f"miss: must be at least 0 and less than 1, not {miss}")
    if not 0 <= slack < 1:
        raise ValueError(f"slack: must be at least 0 and less than 1, not {slack}")
    return np.concatenate(beliefs).astype(np.float64, copy=False)
