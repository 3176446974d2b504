"""Inner loops, compiled. What calls these functions from compiled code belongs into this module: caches of
compiled code notice changes of their own file only.

Arrays as in `model.Model` and `model.Ways`. F[...], I[...] and B[...] are arrays of float64, int64 and
bool, their shape in the brackets.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numba import njit

from agent.behaviours.reconnection.planner_arrays import Beam, Ground, Room
from agent.compiling import announce
from channels.graphs import Bools, Floats, Ints

Function = TypeVar("Function", bound=Callable[..., Any])

announce()


def compiled(function: Function) -> Function:
    """Compiled at the first call, and kept on disk; the types are those of the Python function."""
    # The error model only spares a check for division by 0 that keeps loops from being vectorised.
    kept: Any = njit(cache=True, error_model="numpy")(function)
    return kept  # type: ignore[no-any-return]


def inner(function: Function) -> Function:
    """The same for what only compiled code calls: it takes half as long to compile."""
    options: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    kept: Any = njit(cache=True, error_model="numpy", **options)(function)
    return kept  # type: ignore[no-any-return]


@compiled
def advance(
    first: Ints,
    hazard: Floats,
    next_start: Ints,
    next_at: Ints,
    next_mu: Floats,
    belief: Floats,
    after: Floats,
) -> None:
    """The operator of Eqs. 3-6: `after` becomes what `belief` is one step later. Both are F[S]."""
    # Whoever has been somewhere for as long as can be leaves: its hazard is 1, and the 0 that is written one
    # state further on is what the first state of the next augmented vertex begins with.
    after[0] = 0.0
    for s in range(len(belief) - 1):
        after[s + 1] = belief[s] - hazard[s] * belief[s]
    # Unsigned: numba need not look for indices that count from the end, which takes as long as all the rest.
    for a in range(len(first) - 1):
        leaving = 0.0
        for s in range(np.uint64(first[a]), np.uint64(first[a + 1])):
            leaving += hazard[s] * belief[s]
        for i in range(np.uint64(next_start[a]), np.uint64(next_start[a + 1])):
            after[np.uint64(first[np.uint64(next_at[i])])] += next_mu[i] * leaving


# Beliefs


@compiled
def listen(first: Ints, place: Ints, heard: Bools, miss: float, belief: Floats) -> int:
    """What silence tells (Eq. 7), in place: states at places `heard` keep a share `miss`; normalised.

    Where nothing is left, all states of places not heard become equally likely (returns 1), or all states
    where every place is heard (returns 2); otherwise returns 0.
    """
    total = 0.0
    unheard = 0
    for a in range(len(place)):
        left = 0.0  # by itself: additions that do not wait for each other
        begin, end = np.uint64(first[a]), np.uint64(first[a + 1])
        if heard[np.uint64(place[a])]:
            for s in range(begin, end):
                belief[s] *= miss
                left += belief[s]
        else:
            unheard += first[a + 1] - first[a]
            for s in range(begin, end):
                left += belief[s]
        total += left
    if total > 0.0:
        for s in range(len(belief)):
            belief[s] /= total
        return 0
    for a in range(len(place)):
        for s in range(first[a], first[a + 1]):
            if unheard == 0:
                belief[s] = 1.0 / len(belief)
            else:
                belief[s] = 0.0 if heard[place[a]] else 1.0 / unheard
    return 2 if unheard == 0 else 1


@compiled
def tick(
    first: Ints,
    place: Ints,
    hazard: Floats,
    next_start: Ints,
    next_at: Ints,
    next_mu: Floats,
    heard: Bools,
    miss: float,
    belief: Floats,
    after: Floats,
) -> int:
    """`advance`, then `listen` on `after`, whose outcome is returned."""
    advance(first, hazard, next_start, next_at, next_mu, belief, after)
    return listen(first, place, heard, miss, after)


@compiled
def mass_of_places(first: Ints, place: Ints, belief: Floats, mass: Floats) -> None:
    """`mass`, F[V], becomes the probability of every place."""
    mass[:] = 0.0
    for a in range(len(place)):
        there = 0.0
        for s in range(np.uint64(first[a]), np.uint64(first[a + 1])):
            there += belief[s]
        mass[np.uint64(place[a])] += there


# Planning. `ground`: a planner_arrays.Ground; `c`: F[T], what has been detected of each target's mass.
# Bounds are compared with a margin for rounding, which costs a few nodes and never an answer.


@compiled
def together(places: Ints, towards: Ints, remaining: Ints, time: int, hearing: Bools) -> bool:
    """Whether all members are one network so many steps from now, if nobody decides anything more."""
    members = len(places)
    reached, todo = 1, 1
    while todo:
        i = 0
        while not (todo >> i) & 1:
            i += 1
        todo &= ~(1 << i)
        here = towards[i] if 0 < remaining[i] <= time else places[i]
        for j in range(members):
            if not (reached >> j) & 1:
                there = towards[j] if 0 < remaining[j] <= time else places[j]
                if hearing[here, there]:
                    reached |= 1 << j
                    todo |= 1 << j
    return reached == (1 << members) - 1


@inner
def between(places: Ints, towards: Ints, remaining: Ints, hearing: Bools) -> bool:
    """Whether all are one network after every arrival but the last, if nobody decides anything more."""
    time, last = 0, 0
    for i in range(len(places)):
        last = max(last, remaining[i])
    while True:
        after = last
        for i in range(len(places)):
            if remaining[i] > time:
                after = min(after, remaining[i])
        time = after
        if time == last:
            return True
        if not together(places, towards, remaining, time, hearing):
            return False


@compiled
def safe(places: Ints, towards: Ints, remaining: Ints, hearing: Bools) -> bool:
    """Whether a team stays one network until all on the way have arrived, if nobody decides any more.

    Arrays I[members] (at most 62): `places`; `towards`, where those on the way go (their own place: they
    return; any number for the others); `remaining`, steps to the arrival, 0 for those at a vertex. `hearing`:
    B[V, V]. Whoever is on the way is heard as from its place until it arrives.
    """
    now = together(places, towards, remaining, 0, hearing)
    then = together(places, towards, remaining, 1 << 60, hearing)
    return now and then and between(places, towards, remaining, hearing)


@inner
def distinct(places: Ints, remaining: Ints, choice: Ints) -> bool:
    """Whether a joint choice is the first, in order, of those that differ by who of its equals does what."""
    for i in range(1, len(places)):
        for j in range(i):
            if places[i] == places[j] and choice[j] > choice[i] and not (remaining[i] or remaining[j]):
                return False
    return True


@inner
def label(at: Ints, hearing: Bools, part: Ints) -> None:
    """`part[i]`: the network that member i is in without the last member; `part[-1]`: them all, as bits."""
    last = len(at) - 1
    part[last] = 0
    for i in range(last):
        part[i] = i
        for j in range(i):
            if part[j] != i and hearing[at[i], at[j]]:
                old = part[j]
                for n in range(i):
                    if part[n] == old:
                        part[n] = i
    for i in range(last):
        part[last] |= 1 << part[i]


@compiled
def gather(
    start: Ints,
    head: Ints,
    steps: Ints,
    hearing: Bools,
    places: Ints,
    towards: Ints,
    remaining: Ints,
    once: bool,
    changed: int,
    choice: Ints,
    at: Ints,
    part: Ints,
    chosen: Ints,
    to: Ints,
    left: Ints,
) -> int:
    """The next safe joint choices with somebody on the way: how many, as many as `chosen`, I[room, m], holds.

    A choice is, for each member, -1, to wait (and for those on the way, who have nothing to choose), or
    which of the ways out of its place it takes; they come in lexicographic order. `to`, `left`, I[room, m]:
    where all then go. The group is one network now. Begin with `choice`, I[m], all -1, and `changed` 0; to
    go on, leave all as it is, with `changed` -1. `at`, `part`, I[m]: to work in. `once`: only `distinct`.
    """
    last, n = len(places) - 1, 0
    while n < len(chosen):
        if changed < 0:
            changed = last
            while changed >= 0 and (
                remaining[changed] > 0
                or choice[changed] + 1 == start[places[changed] + 1] - start[places[changed]]
            ):
                choice[changed] = -1
                changed -= 1
            if changed < 0:
                return n
            choice[changed] += 1
        latest, soonest = 0, 1 << 60
        for i in range(last + 1):
            to[n, i], left[n, i] = towards[i], remaining[i]
            if choice[i] >= 0:
                way = start[places[i]] + choice[i]
                to[n, i], left[n, i] = head[way], steps[way] + 1
            at[i] = to[n, i] if left[n, i] > 0 else places[i]
            chosen[n, i] = choice[i]
            latest = max(latest, left[n, i])
            soonest = min(soonest, left[n, i] if left[n, i] > 0 else soonest)
        if changed < last or last == 0:
            label(at, hearing, part)
        joined = 0
        for i in range(last):
            if hearing[at[last], at[i]]:
                joined |= 1 << part[i]
        changed = -1
        if (
            joined == part[last]
            and latest > 0
            and (soonest == latest or between(places, to[n], left[n], hearing))
            and (not once or distinct(places, remaining, choice))
        ):
            n += 1
    return n


@inner
def either(c: Floats) -> float:
    """Probability that at least one target is met, 1 - prod(1 - c_j)."""
    if len(c) == 1:
        return float(min(1.0, c[0]))
    missed = 0.0
    for j in range(len(c)):
        missed += np.log1p(-min(1.0, c[j]))
    return float(-np.expm1(missed))


@inner
def most(c: Floats, rest: Floats) -> float:
    """Upper bound on `either` of c + e for all e >= 0 with e_j <= rest[j], and sum(e) <= rest[T] if T > 1.

    The second holds since 1 - prod(1 - c_j) is concave along increasing directions: what all e_j add
    together is at most the sum of what each adds alone, e_j prod(1 - c_i) over i other than j, and of those
    products the largest leaves out the largest c.
    """
    targets = len(c)
    if targets == 1:
        return float(min(1.0, c[0] + rest[0]))
    missed, alone, top = 0.0, 1.0, 0
    for j in range(targets):
        missed += np.log1p(-min(1.0, c[j] + rest[j]))
        if c[j] > c[top]:
            top = j
    for j in range(targets):
        if j != top:
            alone *= 1.0 - min(1.0, c[j])
    return float(min(-np.expm1(missed), either(c) + alone * rest[targets]))


@inner
def hopeless(bound: float, own: float, best: float, slack: float) -> bool:
    """Whether a plan of at most that value improves neither its own first move's nor is within the slack."""
    high = bound * (1 + 1e-9) + 1e-14
    return bound <= own or high < (1 - slack) * best


@inner
def hear_from(ground: Ground, q: Floats, c: Floats, vertex: int, miss: float) -> None:
    """Observe from a vertex: what is heard of q, F[S], goes to c."""
    for n in range(ground.near_start[vertex], ground.near_start[vertex + 1]):
        hear_place(ground, q, c, ground.near_at[n], miss)


@inner
def hear_place(ground: Ground, q: Floats, c: Floats, place: int, miss: float) -> None:
    """Observe one place, once."""
    for n in range(ground.here_start[place], ground.here_start[place + 1]):
        a = ground.here_at[n]
        mass = 0.0
        for s in range(ground.first[a], ground.first[a + 1]):
            mass += q[s]
            q[s] *= miss
        c[ground.target[a]] += (1 - miss) * mass


@inner
def step_on(ground: Ground, q: Floats, after: Floats) -> None:
    """One step of all targets, unobserved."""
    advance(ground.first, ground.hazard, ground.next_start, ground.next_at, ground.next_mu, q, after)


@inner
def flows(ground: Ground, q: Floats, flow: Floats, inflow: Floats) -> None:
    """What q moves from each pair of places' first to its second, F[T, N], and to each place, F[T, V]."""
    flow[:] = 0.0
    for a in range(len(ground.place)):
        j, here = ground.target[a], ground.place[a]
        leaving = 0.0
        last = ground.first[a + 1] - 1
        for s in range(ground.first[a], last + 1):
            going = q[s] if s == last else ground.hazard[s] * q[s]
            leaving += going
            flow[j, here] += q[s] - going
        if leaving > 0.0:
            for i in range(ground.next_start[a], ground.next_start[a + 1]):
                flow[j, ground.pair[i]] += ground.next_mu[i] * leaving
    for j in range(len(flow)):
        for p in range(inflow.shape[1]):
            inflow[j, p] = 0.0
            for n in range(ground.into_start[p], ground.into_start[p + 1]):
                inflow[j, p] += flow[j, ground.into_at[n]]


@inner
def gain(ground: Ground, flow: Floats, inflow: Floats, before: int, now: int, kept: float) -> float:
    """Mass to be detected in one step at most, of one target, by a robot at `before` and then at `now`."""
    total = 0.0
    for n in range(ground.near_start[now], ground.near_start[now + 1]):
        p = ground.near_at[n]
        if inflow[p] > 0.0:
            for m in range(ground.into_start[p], ground.into_start[p + 1]):
                e = ground.into_at[m]
                total += flow[e] * (kept if ground.hearing[before, ground.pair_tail[e]] else 1.0)
    return total


@compiled
def soonest(ground: Ground, places: Ints, towards: Ints, remaining: Ints, soon: Ints) -> None:
    """After how many steps any member can be at each vertex at the soonest; `soon`, I[V], is high before."""
    for i in range(len(places)):
        soon[places[i]] = 0
    for i in range(len(places)):
        if remaining[i] > 0:
            soon[towards[i]] = min(soon[towards[i]], remaining[i])
    changed = True
    while changed:
        changed = False
        for d in range(len(ground.head)):
            there = soon[ground.tail[d]] + ground.steps[d] + 1
            if there < soon[ground.head[d]]:
                soon[ground.head[d]] = there
                changed = True


@compiled
def prospects(
    ground: Ground,
    q: Floats,
    after: Floats,
    soon: Ints,
    miss: float,
    stayed: Floats,
    came: Floats,
    flow: Floats,
    inflow: Floats,
) -> None:
    """What one robot can detect of each target at most in single steps: `planner`'s docstring has the proof.

    `stayed[j, s, v]`, F[T, H + 1, V]: from being at v in steps 1 .. s, as far as v can be reached (`soon`,
    I[V]); `came[j, s, d]`, F[T, H + 1, D]: from coming along way d in step s. Both are zero before. q, F[S],
    is moved on by H steps; `after`, `flow`, F[T, N], and `inflow`, F[T, V], are room to work in.
    """
    for s in range(1, stayed.shape[1]):
        flows(ground, q, flow, inflow)
        kept = 1.0 if s == 1 else miss
        for j in range(stayed.shape[0]):
            for v in range(stayed.shape[2]):
                stayed[j, s, v] = stayed[j, s - 1, v]
                if soon[v] < s:
                    stayed[j, s, v] += (1 - miss) * gain(ground, flow[j], inflow[j], v, v, kept)
            for d in range(came.shape[2]):
                u, v = ground.tail[d], ground.head[d]
                if soon[u] < s and soon[v] <= s:
                    came[j, s, d] = (1 - miss) * gain(ground, flow[j], inflow[j], u, v, kept)
        step_on(ground, q, after)
        for i in range(len(q)):
            q[i] = after[i]


@compiled
def onwards(ground: Ground, soon: Ints, stayed: Floats, came: Floats, waiting: bool, rest: Floats) -> None:
    """`rest[row, s, v]`: the most that one robot can detect from being free at v in step s, in s + 1 .. H.

    Rows are targets, or sums over targets, of `stayed` and `came` as in `prospects`; `rest`,
    F[rows, H + 1, V], is zero before. `waiting`: whether it may wait. From the last step to the first.
    """
    horizon = stayed.shape[1] - 1
    for j in range(stayed.shape[0]):
        for s in range(horizon - 1, -1, -1):
            for u in range(stayed.shape[2]):
                if soon[u] > s:
                    continue
                best = stayed[j, s + 1, u] - stayed[j, s, u] + rest[j, s + 1, u] if waiting else 0.0
                for d in range(ground.start[u], ground.start[u + 1]):
                    there = s + ground.steps[d] + 1
                    value = stayed[j, min(there - 1, horizon), u] - stayed[j, s, u]
                    if there <= horizon:
                        value += came[j, there, d] + rest[j, there, ground.head[d]]
                    best = max(best, value)
                rest[j, s, u] = best


@inner
def stay(ground: Ground, q: Floats, c: Floats, at: int, known: int, wanted: int, miss: float) -> int:
    """Lone search: q[k], c[k], after k steps at a vertex, for k up to `wanted`; returns how many."""
    for k in range(known + 1, wanted + 1):
        step_on(ground, q[k - 1], q[k])
        for j in range(c.shape[1]):
            c[k, j] = c[k - 1, j]
        hear_from(ground, q[k], c[k], at, miss)
    return max(known, wanted)


@inner
def rank(
    ground: Ground,
    c: Floats,
    at: int,
    step: int,
    known: int,
    stayed: Floats,
    came: Floats,
    rest: Floats,
    more: Floats,
    order: Ints,
    bound: Floats,
) -> None:
    """Lone search: bounds of all ways out of a vertex, after c, F[T], `known` steps there; the best first."""
    horizon = stayed.shape[1] - 1
    for i in range(ground.start[at + 1] - ground.start[at]):
        way = ground.start[at] + i
        there = step + ground.steps[way] + 1
        for row in range(stayed.shape[0]):
            more[row] = stayed[row, min(there - 1, horizon), at] - stayed[row, step + known, at]
            if there <= horizon:
                more[row] += came[row, there, way] + rest[row, there, ground.head[way]]
        bound[i] = most(c, more)
        j = i
        while j > 0 and bound[order[j - 1]] < bound[i]:
            order[j] = order[j - 1]
            j -= 1
        order[j] = i


@compiled
def search_alone(
    ground: Ground,
    miss: float,
    slack: float,
    stayed: Floats,
    came: Floats,
    rest: Floats,
    q: Floats,
    c: Floats,
    order: Ints,
    bound: Floats,
    more: Floats,
    vertex: Ints,
    step: Ints,
    tried: Ints,
    known: Ints,
    path: Ints,
    values: Floats,
    paths: Ints,
) -> int:
    """Branch and bound, depth first, from q[0, 0] at `vertex[0]`: how many nodes it has looked at.

    Arrays of depth L: q[L, legs, S], c[L, legs, T] (zero), `order` and `bound`, [L, most ways], `vertex`,
    `step`, `tried`, `known`, `path`; `more`: F[rows]. `values`, F[ways], and `paths`, I[ways, L], both -1
    before, become the value of the best path that begins with each way out, and this path.
    """
    horizon, best = stayed.shape[1] - 1, -1.0
    level, first, nodes, fresh = 0, 0, 0, True
    while level >= 0:
        at, now = vertex[level], step[level]
        if fresh:
            nodes += 1
            nearest = horizon - now
            for d in range(ground.start[at], ground.start[at + 1]):
                nearest = min(nearest, ground.steps[d])
            tried[level] = known[level] = 0
            known[level] = stay(ground, q[level], c[level], at, known[level], nearest, miss)
            rank(
                ground,
                c[level, nearest],
                at,
                now,
                nearest,
                stayed,
                came,
                rest,
                more,
                order[level],
                bound[level],
            )
            fresh = False
        if tried[level] == ground.start[at + 1] - ground.start[at]:
            level -= 1
            continue
        i = order[level, tried[level]]
        tried[level] += 1
        first = i if level == 0 else first
        if hopeless(bound[level, i], values[first], best, slack):
            continue
        way = ground.start[at] + i
        there = now + ground.steps[way] + 1
        wanted = min(there - 1, horizon) - now
        known[level] = stay(ground, q[level], c[level], at, known[level], wanted, miss)
        path[level] = ground.head[way]
        reached = c[level, wanted]
        if there <= horizon:
            step_on(ground, q[level, wanted], q[level + 1, 0])
            reached = c[level + 1, 0]
            for j in range(len(reached)):
                reached[j] = c[level, wanted, j]
            hear_from(ground, q[level + 1, 0], reached, path[level], miss)
        if there >= horizon:
            value = either(reached)
            if value > values[first]:
                values[first], best = value, max(best, value)
                for n in range(len(path)):
                    paths[first, n] = path[n] if n <= level else -1
            continue
        for row in range(len(more)):
            more[row] = rest[row, there, path[level]]
        if not hopeless(most(reached, more), values[first], best, slack):
            level += 1
            vertex[level], step[level], fresh = path[level - 1], there, True
    return nodes


# Planning of groups. `beam`, `room`: planner_arrays.Beam and .Room; a node is a slot of the step it is for.


@inner
def hear_around(ground: Ground, q: Floats, c: Floats, places: Ints, marks: Ints, miss: float) -> None:
    """Observe from several places, each place that is heard once; `marks` as in Room."""
    marks[-1] += 1
    for i in range(len(places)):
        for n in range(ground.near_start[places[i]], ground.near_start[places[i] + 1]):
            p = ground.near_at[n]
            if marks[p] != marks[-1]:
                marks[p] = marks[-1]
                hear_place(ground, q, c, p, miss)


@inner
def wait_and_hear(ground: Ground, room: Room, places: Ints, wanted: int, miss: float) -> None:
    """A team stays where it is: `room.c[k]`, what it has heard by step k, `room.mass[k]`, what was where.

    For k up to `wanted`, from where it is known; then `room.known` says so.
    """
    for k in range(room.known[0] + 1, wanted + 1):
        q = room.q[k % 2]
        step_on(ground, room.q[(k - 1) % 2], q)
        for j in range(room.mass.shape[1]):
            room.c[k, j] = room.c[k - 1, j]
            for p in range(room.mass.shape[2]):
                room.mass[k, j, p] = 0.0
        for a in range(len(ground.place)):
            for s in range(ground.first[a], ground.first[a + 1]):
                room.mass[k, ground.target[a], ground.place[a]] += q[s]
        hear_around(ground, q, room.c[k], places, room.marks, miss)
        room.known[0] = k


@inner
def arrive(ground: Ground, beam: Beam, room: Room, step: int, slot: int, miss: float) -> None:
    """The belief of a node, from that of the node it follows."""
    before, of = beam.before[step, slot], beam.of[step, slot]
    for i in range(room.q.shape[1]):
        room.q[0, i] = beam.q[before, of, i]
    for k in range(1, step - before):
        step_on(ground, room.q[(k - 1) % 2], room.q[k % 2])
        hear_around(ground, room.q[k % 2], room.waste, beam.places[before, of], room.marks, miss)
    q = beam.q[step, slot]
    step_on(ground, room.q[(step - before - 1) % 2], q)
    hear_around(ground, q, room.waste, beam.places[step, slot], room.marks, miss)


@inner
def look_ahead(
    ground: Ground, stayed: Floats, came: Floats, rest: Floats, beam: Beam, room: Room, step: int, slot: int
) -> None:
    """`room.ahead[row, i, n]`: what member i can detect at most by itself, by its choice n - 1, on any way.

    Counted from step 0, as if it had been at its place before.
    """
    horizon = stayed.shape[1] - 1
    for i in range(beam.places.shape[2]):
        at, to, left = beam.places[step, slot, i], beam.to[step, slot, i], beam.left[step, slot, i]
        for way in range(ground.start[at], ground.start[at + 1]):
            there, n = step + ground.steps[way] + 1, way - ground.start[at] + 1
            if left > 0:
                there, n = step + left, 0
            if left == 0 or to == ground.head[way]:
                for row in range(stayed.shape[0]):
                    room.ahead[row, i, n] = stayed[row, min(there - 1, horizon), at]
                    if there <= horizon:
                        room.ahead[row, i, n] += came[row, there, way] + rest[row, there, ground.head[way]]
        if left > 0 and to == at:
            for row in range(stayed.shape[0]):
                room.ahead[row, i, 0] = stayed[row, min(step + left, horizon), at]
                if step + left <= horizon:
                    room.ahead[row, i, 0] += rest[row, step + left, at]


@inner
def mixed(number: int) -> int:
    """Some bits of a number that look random: numbers that are not equal hardly ever share them."""
    number = (number + 0x1E3779B97F4A7C15) * 0x3F58476D1CE4E5B9
    number ^= (number >> 29) & 0x7FFFFFFFF
    number *= 0x14D049BB133111EB
    return number ^ ((number >> 32) & 0xFFFFFFFF)


@inner
def mixed_places(places: Ints) -> int:
    """The same for a set of places."""
    total = 0
    for i in range(len(places)):
        again = False
        for j in range(i):
            again |= places[j] == places[i]
        if not again:
            total += mixed(places[i])
    return mixed(total)


@inner
def drops_before(beam: Beam, step: int, a: int, b: int) -> bool:
    """Whether slot a is to be dropped before slot b."""
    if beam.guide[step, a] != beam.guide[step, b]:
        return bool(beam.guide[step, a] < beam.guide[step, b])
    return bool(beam.number[step, a] > beam.number[step, b])


@inner
def sift(beam: Beam, step: int, n: int) -> None:
    """Put entry n of a step's heap into its place; the one to be dropped first is on top."""
    heap, size = beam.heap[step], beam.size[step]
    while n > 0 and drops_before(beam, step, heap[n], heap[(n - 1) // 2]):
        heap[n], heap[(n - 1) // 2] = heap[(n - 1) // 2], heap[n]
        n = (n - 1) // 2
    while 2 * n + 1 < size:
        least = 2 * n + 1
        if least + 1 < size and drops_before(beam, step, heap[least + 1], heap[least]):
            least += 1
        if not drops_before(beam, step, heap[least], heap[n]):
            break
        heap[n], heap[least] = heap[least], heap[n]
        n = least


@inner
def offer(beam: Beam, step: int, guide: float, upper: float, key: int, first: int, lost: Floats) -> int:
    """A slot for a new node, which is among the best of its step; -1 where it is there already."""
    size, width = beam.size[step], beam.guide.shape[1]
    for slot in range(size):
        if beam.key[step, slot] == key:
            return -1
    slot, n = size, size
    if size == width:
        slot, n = beam.heap[step, 0], 0
        gone = beam.first[step, slot]
        lost[gone] = max(lost[gone], beam.upper[step, slot])
    else:
        beam.size[step] += 1
        beam.heap[step, n] = slot
    beam.counted[0] += 1
    beam.guide[step, slot], beam.upper[step, slot] = guide, upper
    beam.key[step, slot], beam.first[step, slot] = key, first
    beam.number[step, slot] = beam.counted[0]
    sift(beam, step, n)
    return int(slot)


@inner
def keep(
    beam: Beam,
    room: Room,
    step: int,
    slot: int,
    then: int,
    n: int,
    first: int,
    guide: float,
    upper: float,
    lost: Floats,
) -> None:
    """Find a slot for what follows a node by joint choice n, in step `then`."""
    places = beam.places[step, slot]
    key = beam.history[step, slot]
    for _ in range(then - step - 1):
        key = mixed(key + mixed_places(places))
    key = mixed(key + mixed_places(room.places))
    history, members = key, 0
    for i in range(len(places)):
        left = max(0, room.left[n, i] - (then - step))
        members += mixed(room.places[i] + mixed((room.to[n, i] if left > 0 else -1) + mixed(left)))
    new = offer(beam, then, guide, upper, mixed(key + mixed(members + mixed(first))), first, lost)
    if new >= 0:
        beam.before[then, new], beam.of[then, new], beam.history[then, new] = step, slot, history
        for j in range(len(room.child)):
            beam.c[then, new, j] = room.child[j]
        for i in range(len(places)):
            left = room.left[n, i] - (then - step)
            beam.places[then, new, i] = room.places[i]
            beam.left[then, new, i] = max(0, left)
            beam.to[then, new, i] = room.to[n, i] if left > 0 else -1


@inner
def follow(
    ground: Ground,
    stayed: Floats,
    rest: Floats,
    beam: Beam,
    room: Room,
    step: int,
    slot: int,
    count: int,
    miss: float,
    slack: float,
    values: Floats,
    lost: Floats,
) -> None:
    """Values and bounds of what follows a node by the choices in `room.chosen`; `room.found` counts them.

    The next node is where the first of those on the way arrives.
    """
    horizon, members = stayed.shape[1] - 1, len(room.places)
    for n in range(count):
        first = room.found[0] if step == 0 else beam.first[step, slot]
        room.found[0] += 1
        k = horizon - step + 1
        for i in range(members):
            k = min(k, room.left[n, i] if room.left[n, i] > 0 else k)
        then = min(step + k, horizon)
        wait_and_hear(ground, room, beam.places[step, slot], then - step, miss)
        if step + k > horizon:
            values[first] = max(values[first], either(room.c[horizon - step]))
            room.best[0] = max(room.best[0], values[first])
            continue
        room.marks[-1] += 1
        for j in range(len(room.child)):
            room.child[j] = room.c[k - 1, j]
        for row in range(len(room.more)):
            room.more[row] = 0.0
        for i in range(members):
            at, left = beam.places[step, slot, i], room.left[n, i]
            now = room.to[n, i] if left == k else at
            room.places[i] = now
            for m in range(ground.near_start[now], ground.near_start[now + 1]):
                p = ground.near_at[m]
                if room.marks[p] != room.marks[-1]:
                    room.marks[p] = room.marks[-1]
                    for j in range(len(room.child)):
                        room.child[j] += (1 - miss) * room.mass[k, j, p]
            for row in range(len(room.more)):
                if left > k:
                    room.more[row] += room.ahead[row, i, room.chosen[n, i] + 1] - stayed[row, then, at]
                else:
                    room.more[row] += rest[row, then, now]
        value, upper = either(room.child), most(room.child, room.more)
        values[first] = max(values[first], value)
        room.best[0] = max(room.best[0], value)
        if then == horizon or hopeless(upper, values[first], room.best[0], slack):
            continue
        guide = value + (1 - value) * min(1.0, room.lean[0] * room.more[-1])
        if beam.size[then] == beam.guide.shape[1] and guide <= beam.guide[then, beam.heap[then, 0]]:
            lost[first] = max(lost[first], upper)
        else:
            keep(beam, room, step, slot, then, n, first, guide, upper, lost)


@inner
def expand(
    ground: Ground,
    stayed: Floats,
    came: Floats,
    rest: Floats,
    beam: Beam,
    room: Room,
    step: int,
    slot: int,
    miss: float,
    slack: float,
    values: Floats,
    lost: Floats,
) -> None:
    """All joint decisions at a node. At the root, step 0, each is a first decision of its own."""
    places, to, left = beam.places[step, slot], beam.to[step, slot], beam.left[step, slot]
    for i in range(len(places)):
        room.choice[i] = -1
    for i in range(room.q.shape[1]):
        room.q[0, i] = beam.q[step, slot, i]
    for j in range(len(room.child)):
        room.c[0, j] = beam.c[step, slot, j]
    look_ahead(ground, stayed, came, rest, beam, room, step, slot)
    room.known[0], room.found[0], count = 0, 0, len(room.chosen)
    while count == len(room.chosen):
        count = gather(
            ground.start, ground.head, ground.steps, ground.hearing, places, to, left, True,
            0 if room.found[0] == 0 else -1, room.choice, room.at, room.part, room.chosen, room.to, room.left,
        )  # fmt: skip
        if count == 0 and room.found[0] == 0:  # nothing is safe but to stay
            count = 1
            for i in range(len(places)):
                room.left[0, i] = 0
        follow(ground, stayed, rest, beam, room, step, slot, count, miss, slack, values, lost)


@compiled
def search_team(
    ground: Ground,
    stayed: Floats,
    came: Floats,
    rest: Floats,
    beam: Beam,
    room: Room,
    miss: float,
    slack: float,
    values: Floats,
    lost: Floats,
) -> int:
    """Beam search, step by step, from the node in slot 0 of step 0: how many nodes it has gone on from.

    `values`, F[first decisions]: raised to that of the best plan found that begins with each; `lost`: to
    the greatest bound of the nodes that found no room.
    """
    nodes = 0
    for step in range(stayed.shape[1] - 1):
        for slot in range(beam.size[step]):
            own = values[beam.first[step, slot]]
            if step > 0:
                if hopeless(beam.upper[step, slot], own, room.best[0], slack):
                    continue
                arrive(ground, beam, room, step, slot, miss)
            nodes += 1
            expand(ground, stayed, came, rest, beam, room, step, slot, miss, slack, values, lost)
    return nodes
