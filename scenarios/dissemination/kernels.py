"""The schemes of selection as compiled code, for Monte Carlo: what `agent/behaviours/dissemination` does.

Bit for bit the same choices as the classes robots run make, on the same input; the tests hold them to it.
No chance in here: what is random is drawn beforehand and handed in.

For one robot (rows of the team's arrays; n robots, F: float64, I: int64):

- `importances(distances, alpha)`: Eq. 1, once for all, or whenever distances change; not compiled;
- `choose(rule I[3], own, distances F[n], importance F[n], stamps I[n], counters F[n], last I[n],
  draws F[>= min(m, n) - 1], weights F[n], chosen I[>= min(m, n)]) -> count`: the numbers to send in this
  slot, in `chosen[:count]`. `rule` is what `rule(scheme, m, new_estimates)` returns. `last`: as made by
  `fresh_team`, shared by all. `draws`: uniform, for "location-probabilistic" only. `weights`: scratch;
- `receive(rule, receiver, number, stamp, stamps I[n, n], counters F[n, n]) -> 0 | 1 | 2`: one estimate of a
  packet, as `News` (nothing, newer, first);
- `deliver(rule, receivers I[a], numbers I[k], sent I[>= k], stamps I[n, n], counters F[n, n],
  news I[>= a, >= k]) -> bool`: a whole packet at all its receivers. A call costs as much as ten estimates:
  prefer this one in loops that count.

For a whole team:

- `propagate(...)`: slot after slot until parts of the team know of each other, for `study_propagation`;
- `talk(...)`: slot after slot, with every update noted, for `study_age`.

Time stamps are whole numbers of 0 or more, in any unit; `UNKNOWN` where there is none. The caller keeps the
own one, `stamps[own, own]`, and freezes the packet: it copies the stamps of what was chosen at the start
of the slot, and hands them to `receive` at its end. Where one robot at a time transmits, nothing changes
meanwhile, and nothing need be copied.

What calls these functions from compiled code belongs into this module, or is to be compiled anew (delete
`__pycache__/*.nb?`) when it changes: numba notices no more than changes of the caller's own file.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from msgspec import Struct
from numba import njit
from numpy.typing import NDArray

from agent.behaviours.dissemination.selection import LEAST_COUNTER, MIN_DISTANCE_M
from agent.compiling import announce

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
F = TypeVar("F", bound=Callable[..., Any])

announce()

UNKNOWN = -1

# Numbers of its own: numba would not notice if others changed.
LOCATION, PROBABILISTIC, FLOODING, OWN, ROUND_ROBIN, FRESHEST_FIRST = range(6)
SCHEME_NUMBERS = {
    "location": LOCATION,
    "location-probabilistic": PROBABILISTIC,
    "flooding": FLOODING,
    "own": OWN,
    "round-robin": ROUND_ROBIN,
    "freshest-first": FRESHEST_FIRST,
}
FIRST, LITERAL, TRUE_DISTANCE = range(3)
NEW_NUMBERS = {"first": FIRST, "literal": LITERAL, "true-distance": TRUE_DISTANCE}


class Team(Struct, frozen=True):
    """What all robots know and remember; arrays that are changed in place."""

    stamps: Ints
    """(n, n): row i is the time stamps robot i has."""
    counters: Floats
    """(n, n): row i is the counters of robot i (Algorithm 1)."""
    last: Ints
    """(n,): for "round-robin", the number each has sent last."""


def rule(scheme: str, m: int, new_estimates: str) -> Ints:
    """Scheme, m, and what becomes of new estimates, as numbers: what `choose` and `receive` take."""
    return np.array([SCHEME_NUMBERS[scheme], m, NEW_NUMBERS[new_estimates]])


def fresh_team(robots: int) -> Team:
    """A cold start: each of n robots will know its own state and no other."""
    stamps = np.full((robots, robots), UNKNOWN)
    np.fill_diagonal(stamps, 0)
    return Team(stamps, np.ones((robots, robots)), np.arange(robots))


def importances(distances: Floats, alpha: float) -> Floats:
    """Eq. 1, f = d^-alpha, for every distance of an array of any shape, d being `MIN_DISTANCE_M` at least."""
    # Python's power, as in the classes: NumPy's may differ in the last bit.
    floored = np.maximum(distances, MIN_DISTANCE_M)
    return np.array([d**-alpha for d in floored.ravel().tolist()]).reshape(distances.shape)


def compiled(function: F) -> F:
    """The function as machine code, kept for the next time; no liberties are taken in arithmetic."""
    # The error model only spares a check for division by 0 that keeps loops from being vectorised.
    result: Any = njit(cache=True, error_model="numpy")(function)
    return result  # type: ignore[no-any-return]


@compiled
def receive(rule: Ints, receiver: int, number: int, stamp: int, stamps: Ints, counters: Floats) -> int:
    """Take in one estimate: strictly newer wins, and the own state is the receiver's own business."""
    known = stamps[receiver, number]
    if number == receiver or stamp <= known:
        return 0
    stamps[receiver, number] = stamp
    if known != UNKNOWN:
        return 1
    if rule[2] == FIRST:
        counters[receiver, number] = 0.0
    return 2


@compiled
def deliver(
    rule: Ints, receivers: Ints, numbers: Ints, sent: Ints, stamps: Ints, counters: Floats, news: Ints
) -> bool:
    """A whole packet, `numbers` with the time stamps `sent`, at all its receivers.

    `news[a, k]` becomes what `receive` says of estimate k at receiver a; returns whether one is a first.
    """
    any_first = False
    for a in range(receivers.size):
        receiver = receivers[a]
        for k in range(numbers.size):
            number = numbers[k]
            known = stamps[receiver, number]
            news[a, k] = 0
            if number != receiver and sent[k] > known:
                stamps[receiver, number] = sent[k]
                news[a, k] = 1
                if known == UNKNOWN:
                    news[a, k] = 2
                    any_first = True
                    if rule[2] == FIRST:
                        counters[receiver, number] = 0.0
    return any_first


@compiled
def choose(
    rule: Ints,
    own: int,
    distances: Floats,
    importance: Floats,
    stamps: Ints,
    counters: Floats,
    last: Ints,
    draws: Floats,
    weights: Floats,
    chosen: Ints,
) -> int:
    """How many estimates robot `own` sends in a slot: `chosen[:count]`, the own one first."""
    chosen[0] = own
    scheme, room = rule[0], min(rule[1], stamps.size)
    if scheme == LOCATION:
        return _lowest_counters(rule, own, distances, importance, stamps, counters, weights, chosen)
    if scheme == PROBABILISTIC:
        return _drawn(room, own, importance, stamps, draws, weights, chosen)
    if scheme == ROUND_ROBIN:
        return _in_turn(room, own, stamps, last, chosen)
    if scheme == FRESHEST_FIRST:
        return _freshest(room, own, stamps, weights, chosen)
    if scheme == FLOODING:
        return _all_known(own, stamps, chosen)
    return 1


@compiled
def _all_known(own: int, stamps: Ints, chosen: Ints) -> int:
    count = 1
    for j in range(stamps.size):
        if j != own and stamps[j] != UNKNOWN:
            chosen[count] = j
            count += 1
    return count


@compiled
def _lowest_counters(
    rule: Ints,
    own: int,
    distances: Floats,
    importance: Floats,
    stamps: Ints,
    counters: Floats,
    weights: Floats,
    chosen: Ints,
) -> int:
    known = _weigh(own, importance, stamps, rule[2] == TRUE_DISTANCE, weights)
    count: int = min(rule[1], known + 1)
    for pick in range(1, count):
        total = 0.0
        for j in range(stamps.size):
            total += weights[j]
        for j in range(stamps.size):
            counter = counters[j]
            # Where the weight is 0, this changes nothing.
            counters[j] = counter * (1.0 - weights[j] / total)
            if counter != 0.0 and counters[j] == 0.0:
                counters[j] = LEAST_COUNTER
        best, lowest = -1, np.inf
        for j in range(stamps.size):
            if counters[j] > lowest or weights[j] == 0.0 or stamps[j] == UNKNOWN:
                continue
            if counters[j] < lowest or (rule[2] == FIRST and distances[j] < distances[best]):
                best, lowest = j, counters[j]
        chosen[pick] = best
        counters[best] = 1.0
        weights[best] = 0.0
    return count


@compiled
def _drawn(
    room: int, own: int, importance: Floats, stamps: Ints, draws: Floats, weights: Floats, chosen: Ints
) -> int:
    count = min(room, _weigh(own, importance, stamps, False, weights) + 1)
    for pick in range(1, count):
        total = 0.0
        for weight in weights:
            total += weight
        aim = draws[pick - 1] * total
        passed = 0.0
        best = -1
        for j in range(stamps.size):
            if weights[j] > 0.0:
                best = j
                passed += weights[j]
                if passed > aim:
                    break
        chosen[pick] = best
        weights[best] = 0.0
    return count


@compiled
def _weigh(own: int, importance: Floats, stamps: Ints, unknown_too: bool, weights: Floats) -> int:
    """The importances of all that count, and 0 for the others; how many of the others are known."""
    known = 0
    for j in range(stamps.size):
        counts = j != own and (unknown_too or stamps[j] != UNKNOWN)
        weights[j] = importance[j] if counts else 0.0
        known += j != own and stamps[j] != UNKNOWN
    return known


@compiled
def _in_turn(room: int, own: int, stamps: Ints, last: Ints, chosen: Ints) -> int:
    count = 1
    before = last[own]
    for step in range(1, stamps.size + 1):
        j = (before + step) % stamps.size
        if count < room and j != own and stamps[j] != UNKNOWN:
            chosen[count] = j
            last[own] = j
            count += 1
    return count


@compiled
def _freshest(room: int, own: int, stamps: Ints, taken: Floats, chosen: Ints) -> int:
    taken[:] = 0.0
    taken[own] = 1.0
    for count in range(1, room):
        best = -1
        for j in range(stamps.size):
            if taken[j] == 0.0 and stamps[j] != UNKNOWN and (best < 0 or stamps[j] > stamps[best]):
                best = j
        if best < 0:
            return count
        chosen[count] = best
        taken[best] = 1.0
    return room


@compiled
def propagate(
    slot: int,
    rule: Ints,
    neighbours: Ints,
    neighbours_from: Ints,
    senders: Ints,
    senders_from: Ints,
    distances: Floats,
    importance: Floats,
    members: NDArray[np.bool_],
    stamps: Ints,
    counters: Floats,
    last: Ints,
    orders: Ints,
    draws: Floats,
    missing: Ints,
    done: Ints,
) -> None:
    """Slots in these orders, one row per frame, until every part of the team knows all of itself.

    `slot`: slots before; the time stamps are slots. `neighbours[neighbours_from[i] : neighbours_from[i + 1]]`
    hear robot i; `senders[senders_from[k] : ...]` transmit in slot k of a frame, and share no neighbour.
    `members` (parts, n); `missing` (parts,): ordered pairs that do not know each other, counted down here;
    `done` (parts,): slots until they did. `draws`: one row per transmission.
    """
    robots = len(distances)
    chosen = np.empty(robots, dtype=np.int64)
    sent = np.empty(robots, dtype=np.int64)
    news = np.empty((robots, robots), dtype=np.int64)
    weights = np.empty(robots)
    transmission = 0
    for place in orders.ravel():
        # Who shares a slot shares no neighbour: one after the other is all at once.
        for sender in senders[senders_from[place] : senders_from[place + 1]]:
            stamps[sender, sender] = slot
            count = choose(
                rule, sender, distances[sender], importance[sender], stamps[sender], counters[sender],
                last, draws[transmission], weights, chosen,
            )  # fmt: skip
            transmission += 1
            for k in range(count):
                sent[k] = stamps[sender, chosen[k]]
            hearing = neighbours[neighbours_from[sender] : neighbours_from[sender + 1]]
            if deliver(rule, hearing, chosen[:count], sent, stamps, counters, news):
                _note(hearing, chosen[:count], news, slot + 1, members, missing, done)
        slot += 1
        if missing.sum() == 0:
            return


@compiled
def _note(
    receivers: Ints,
    numbers: Ints,
    news: Ints,
    now: int,
    members: NDArray[np.bool_],
    missing: Ints,
    done: Ints,
) -> None:
    """Count off the pairs that are complete since this slot."""
    for part in range(len(members)):
        if missing[part] == 0:
            continue
        for a in range(receivers.size):
            for k in range(numbers.size):
                both = members[part, receivers[a]] and members[part, numbers[k]]
                missing[part] -= both and news[a, k] == 2
        if missing[part] == 0:
            done[part] = now


@compiled
def talk(
    rule: Ints,
    links: Bools,
    distances: Floats,
    importance: Floats,
    stamps: Ints,
    counters: Floats,
    last: Ints,
    senders: Ints,
    draws: Floats,
    found: Ints,
) -> int:
    """How many updates there were: rows of `found`, receiver, origin, slots until reception, until the stamp.

    Stamps are whole slots, `senders` those who transmit in each.
    """
    robots = len(distances)
    chosen = np.empty(robots, dtype=np.int64)
    weights = np.empty(robots)
    rows = 0
    for slot in range(senders.size):
        sender = senders[slot]
        stamps[sender, sender] = slot
        count = choose(
            rule, sender, distances[sender], importance[sender], stamps[sender], counters[sender], last,
            draws[slot], weights, chosen,
        )  # fmt: skip
        for receiver in range(robots):
            if not links[sender, receiver]:
                continue
            for number in chosen[:count]:
                stamp = stamps[sender, number]
                if receive(rule, receiver, number, stamp, stamps, counters) != 0:
                    found[rows, 0], found[rows, 1] = receiver, number
                    found[rows, 2], found[rows, 3] = slot + 1, stamp
                    rows += 1
    return rows
