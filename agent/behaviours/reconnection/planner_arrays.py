"""What planning reads of an environment and of how targets move, as one bundle of arrays for compiled code.

Several targets are one vector of states, one target's behind another's: nothing then depends on whether
they move alike, and one step of all is one call of `kernels.advance`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agent.behaviours.reconnection.model import Model, Ways
from channels.graphs import Bools, Floats, Ints

CHUNK = 256
"""How many joint choices are looked at together."""


class Ground(NamedTuple):
    """Ways, hearing and the joined models of T targets; made by `ground_of`, kept by who plans often.

    V vertices, D ways, A augmented vertices of all targets together, S states of all together, M
    successors, N pairs of places.
    """

    start: Ints
    """(V + 1,): as `Ways.start`."""
    tail: Ints
    head: Ints
    steps: Ints
    """(D,): as in `Ways`."""
    hearing: Bools
    """(V, V): from which vertices robots hear each other, themselves included."""
    near_start: Ints
    near_at: Ints
    """The same as lists: v is heard from `near_at[near_start[v]:near_start[v + 1]]`."""
    ends: Ints
    """(T + 1,): target j's states are `ends[j]` .. `ends[j + 1] - 1`."""
    first: Ints
    place: Ints
    hazard: Floats
    next_start: Ints
    next_at: Ints
    next_mu: Floats
    """As in `Model`, the targets' one behind the other."""
    target: Ints
    """(A,): whose augmented vertex it is."""
    here_start: Ints
    here_at: Ints
    """The augmented vertices of each place: `here_at[here_start[p]:here_start[p + 1]]`."""
    pair: Ints
    """(M,): from which place to which each successor leads, as the number of a pair. Pairs 0 .. V - 1 are
    (p, p)."""
    pair_tail: Ints
    """(N,): the first place of each pair."""
    into_start: Ints
    into_at: Ints
    """The pairs that lead to each place: `into_at[into_start[p]:into_start[p + 1]]`."""


class Beam(NamedTuple):
    """The nodes of a group's search: of each step before the horizon, H, at most W. m members."""

    size: Ints
    """(H,): how many slots of each step are taken."""
    heap: Ints
    """(H, W): the slots, the one to be dropped first on top."""
    number: Ints
    """(H, W): nodes in the order they came."""
    counted: Ints
    """(1,): how many have come."""
    key: Ints
    """(H, W): the same for nodes from which all goes on alike, practically never for others."""
    history: Ints
    """(H, W): the same where the same has been observed."""
    first: Ints
    """(H, W): the first decision of the plan, by number."""
    before: Ints
    of: Ints
    """(H, W): step and slot of the node it follows."""
    guide: Floats
    """(H, W): those with the highest are kept."""
    upper: Floats
    """(H, W): no plan that goes on from there is better."""
    places: Ints
    to: Ints
    left: Ints
    """(H, W, m): place of each member, where it is on the way to, and its remaining steps."""
    c: Floats
    """(H, W, T): what has been detected."""
    q: Floats
    """(H, W, S): what has not; written when the search gets there."""


class Room(NamedTuple):
    """Where a group's search works."""

    q: Floats
    """(2, S): belief, by turns."""
    c: Floats
    """(H + 1, T): detected after so many steps at the same places."""
    mass: Floats
    """(H + 1, T, V): belief at each place, before it is observed."""
    marks: Ints
    """(V + 1,): which places have been counted; the last is the number of the count."""
    waste: Floats
    child: Floats
    """(T,)."""
    more: Floats
    """(rows,)."""
    ahead: Floats
    """(rows, m, most ways + 1)."""
    chosen: Ints
    to: Ints
    left: Ints
    """(CHUNK, m): joint choices."""
    choice: Ints
    places: Ints
    at: Ints
    part: Ints
    """(m,)."""
    known: Ints
    """(1,): up to which step `c` and `mass` are of this node."""
    found: Ints
    """(1,): how many joint choices it has so far."""
    best: Floats
    """(1,): value of the best plan so far."""
    lean: Floats
    """(1,): which share of what members can add by themselves counts in the guide."""


def beam_of(ground: Ground, belief: Floats, team: tuple[Ints, Ints, Ints], horizon: int, width: int) -> Beam:
    """Room for nodes, with the root in slot 0 of step 0. `team`: places, towards, remaining."""
    members, targets = len(team[0]), len(ground.ends) - 1
    shape = (horizon, width)
    heap, number, key, history, first, before, of = np.zeros((7, *shape), dtype=np.int64)
    guide, upper = np.zeros((2, *shape))
    places, to, left = np.zeros((3, *shape, members), dtype=np.int64)
    q = np.empty((*shape, len(belief)))
    q[0, 0] = belief
    places[0, 0], to[0, 0], left[0, 0] = team
    size = np.zeros(horizon, dtype=np.int64)
    size[0] = 1
    counted, c = np.zeros(1, dtype=np.int64), np.zeros((*shape, targets))
    return Beam(
        size, heap, number, counted, key, history, first, before, of, guide, upper, places, to, left, c, q
    )


def room_of(ground: Ground, members: int, horizon: int, rows: int, lean: float) -> Room:
    """Room to work in."""
    targets, vertices = len(ground.ends) - 1, len(ground.start) - 1
    waste, child = np.zeros((2, targets))
    chosen, to, left = np.zeros((3, CHUNK, members), dtype=np.int64)
    choice, places, at, part = np.zeros((4, members), dtype=np.int64)
    return Room(
        q=np.empty((2, int(ground.ends[-1]))),
        c=np.zeros((horizon + 1, targets)),
        mass=np.zeros((horizon + 1, targets, vertices)),
        marks=np.zeros(vertices + 1, dtype=np.int64),
        waste=waste,
        child=child,
        more=np.zeros(rows),
        ahead=np.zeros((rows, members, int(np.diff(ground.start).max()) + 1)),
        chosen=chosen,
        to=to,
        left=left,
        choice=choice,
        places=places,
        at=at,
        part=part,
        known=np.zeros(1, dtype=np.int64),
        found=np.zeros(1, dtype=np.int64),
        best=np.full(1, -1.0),
        lean=np.full(1, lean),
    )


def ground_of(ways: Ways, hearing: Bools, models: Sequence[Model]) -> Ground:
    """The bundle for one model per target (the same object may be named more than once).

    `hearing`: (V, V) as of `channels.graphs.hearing`. Raises ValueError without a target, or where shapes
    do not fit each other.
    """
    vertices = len(ways.start) - 1
    if not models:
        raise ValueError("models: names no target; there must be one model for each")
    if hearing.shape != (vertices, vertices) or any(model.vertices != vertices for model in models):
        raise ValueError(f"ways, hearing and models must all be of one environment, of {vertices} vertices")
    listener, speaker = np.nonzero(hearing)
    near_start, near_at = _lists(speaker, listener, vertices)
    place = np.concatenate([model.place for model in models])
    sizes = [len(model.place) for model in models]
    next_at = _joined([model.next_at for model in models], sizes)
    successors = [model.next_start[1:] for model in models]
    next_start = _ends(_joined(successors, [len(model.next_at) for model in models]))
    source = np.repeat(np.arange(len(place)), np.diff(next_start))
    pair, pair_tail, pair_head = _pairs(place[source], place[next_at], vertices)
    here_start, here_at = _lists(np.arange(len(place)), place, vertices)
    into_start, into_at = _lists(np.arange(len(pair_tail)), pair_head, vertices)
    states = [model.states for model in models]
    return Ground(
        _whole(ways.start),
        _whole(ways.tail),
        _whole(ways.head),
        _whole(ways.steps),
        np.array(hearing, dtype=np.bool_, order="C"),
        near_start,
        near_at,
        np.cumsum([0, *states]),
        _ends(_joined([model.first[1:] for model in models], states)),
        place,
        np.concatenate([model.hazard for model in models]),
        next_start,
        next_at,
        np.concatenate([model.next_mu for model in models]),
        np.repeat(np.arange(len(models)), sizes),
        here_start,
        here_at,
        pair,
        pair_tail,
        into_start,
        into_at,
    )


def _joined(parts: Sequence[Ints], sizes: Sequence[int]) -> Ints:
    """Numbers of things of which every part has so many, counted through."""
    before = np.cumsum([0, *sizes[:-1]])
    return np.concatenate([part + add for part, add in zip(parts, before, strict=True)]).astype(np.int64)


def _ends(array: Ints) -> Ints:
    return np.concatenate([np.zeros(1, dtype=np.int64), array])


def _whole(array: Ints) -> Ints:
    return np.array(array, dtype=np.int64, order="C")


def _lists(items: Ints, owners: Ints, count: int) -> tuple[Ints, Ints]:
    """Where the items of each owner begin, and the items, in their order."""
    order = np.argsort(owners, kind="stable")
    return _ends(np.cumsum(np.bincount(owners, minlength=count))), _whole(items[order])


def _pairs(tails: Ints, heads: Ints, count: int) -> tuple[Ints, Ints, Ints]:
    """Number of each pair, and of every number the two places."""
    codes, number = np.unique(tails * count + heads, return_inverse=True)
    apart = codes // count != codes % count
    numbers = np.where(apart, count + np.cumsum(apart) - 1, codes % count)
    every = np.arange(count)
    tail_of = np.concatenate([every, codes[apart] // count])
    return _whole(numbers[number.reshape(-1)]), tail_of, np.concatenate([every, codes[apart] % count])
