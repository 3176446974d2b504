"""The best plans by trying all, in plain Python: beliefs move by dense matrices, every plan is played to its end.

Nothing here is shared with the planner: neither how plans are enumerated, nor how they are valued, nor how a
team's connectivity is found out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import NamedTuple

import networkx as nx
import numpy as np

from agent.behaviours.reconnection.model import Model, Ways
from channels.graphs import Bools, Floats, Graph

Member = tuple[int, int, int]
"""Place, where to (-1: none), steps to the arrival (0: at a vertex)."""
Decision = tuple[int, ...]
Places = tuple[int, ...]


def random_graph(generator: np.random.Generator, vertices: int, extra: int) -> Graph:
    """A random tree, and some edges more; lengths from 0.4 to 2.1."""
    pairs = {(int(generator.integers(b)), b) for b in range(1, vertices)}
    while len(pairs) < vertices - 1 + extra:
        a, b = sorted(generator.choice(vertices, 2, replace=False).tolist())
        pairs.add((a, b))
    return Graph(
        tuple((float(x), float(y)) for x, y in generator.random((vertices, 2))),
        tuple((a, b, float(generator.uniform(0.4, 2.1))) for a, b in sorted(pairs)),
    )


def dense(model: Model) -> Floats:
    """F as a matrix: entry (to, from)."""
    matrix = np.zeros((model.states, model.states))
    for a in range(len(model.place)):
        for s in range(model.first[a], model.first[a + 1]):
            if s + 1 < model.first[a + 1]:
                matrix[s + 1, s] = 1 - model.hazard[s]
            for i in range(model.next_start[a], model.next_start[a + 1]):
                matrix[model.first[model.next_at[i]], s] += model.next_mu[i] * model.hazard[s]
    return matrix


def places_of(model: Model) -> list[int]:
    """Of every state."""
    return [int(model.place[a]) for a in range(len(model.place)) for _ in range(*model.first[a : a + 2])]


class Target(NamedTuple):
    """One target: F, the place of every state, and the belief now."""

    matrix: Floats
    places: list[int]
    belief: Floats


def targets_of(models: Sequence[Model], beliefs: Sequence[Floats]) -> list[Target]:
    return [Target(dense(m), places_of(m), belief) for m, belief in zip(models, beliefs, strict=True)]


def worth(targets: Sequence[Target], hearing: Bools, plan: Sequence[Places], miss: float) -> float:
    """Probability of contact with any target when searchers are at these places in steps 1, 2, ..."""
    never = 1.0
    for matrix, places, belief in targets:
        q, met = belief, 0.0
        for searchers in plan:
            q = matrix @ q
            heard = hearing[list(searchers)].any(axis=0)[places]
            met += (1 - miss) * q[heard].sum()
            q = np.where(heard, miss * q, q)
        never *= 1 - met
    return float(1 - never)


def ways_out(ways: Ways, vertex: int) -> list[tuple[int, int]]:
    """Neighbours, and how many steps one is on the way."""
    return [(int(w), int(k)) for v, w, k in zip(ways.tail, ways.head, ways.steps, strict=True) if v == vertex]


def paths(ways: Ways, vertex: int, horizon: int) -> Iterator[tuple[list[int], list[Places]]]:
    """Every path of one searcher: the vertices it goes to, and where it is heard from in steps 1 .. horizon."""
    if horizon == 0:
        yield [], []
        return
    for other, steps in ways_out(ways, vertex):
        if steps + 1 > horizon:
            yield [other], [(vertex,)] * horizon
            continue
        for rest, plan in paths(ways, other, horizon - steps - 1):
            yield [other, *rest], [(vertex,)] * steps + [(other,)] + plan


def best_alone(
    ways: Ways,
    targets: Sequence[Target],
    hearing: Bools,
    vertex: int,
    horizon: int,
    miss: float,
) -> dict[int, float]:
    """The value of the best path by its first move."""
    found: dict[int, float] = {}
    for moves, plan in paths(ways, vertex, horizon):
        found[moves[0]] = max(found.get(moves[0], 0.0), worth(targets, hearing, plan, miss))
    return found


def one_step(team: Sequence[Member]) -> tuple[list[Member], bool]:
    """The team a step later, and whether anybody has arrived."""
    after: list[Member] = []
    for place, towards, left in team:
        after.append((towards, -1, 0) if left == 1 else (place, towards, max(0, left - 1)))
    return after, any(left == 1 for _, _, left in team)


def in_one_piece(hearing: Bools, places: Sequence[int]) -> bool:
    graph = nx.Graph()
    graph.add_nodes_from(range(len(places)))
    graph.add_edges_from(
        (i, j) for i in range(len(places)) for j in range(i) if hearing[places[i], places[j]]
    )
    return bool(nx.is_connected(graph))


def stays_together(hearing: Bools, team: Sequence[Member]) -> bool:
    """Step by step, until all have arrived."""
    now = list(team)
    while True:
        if not in_one_piece(hearing, [place for place, _, _ in now]):
            return False
        if not any(left for _, _, left in now):
            return True
        now, _ = one_step(now)


def decisions(ways: Ways, hearing: Bools, team: Sequence[Member]) -> list[tuple[Decision, list[Member]]]:
    """All that the team can decide, in lexicographic order, and how it then stands."""
    found = []
    options = [[(-1, 0), *ways_out(ways, place)] if left == 0 else [(-1, 0)] for place, _, left in team]
    for chosen in product(*options):
        after = [
            member if to < 0 else (member[0], to, steps + 1)
            for member, (to, steps) in zip(team, chosen, strict=True)
        ]
        if any(left for _, _, left in after) and stays_together(hearing, after):
            found.append((tuple(to for to, _ in chosen), after))
    return found


def joint_plans(
    ways: Ways, hearing: Bools, team: Sequence[Member], horizon: int
) -> Iterator[tuple[Decision, list[Places]]]:
    """Every joint plan: its first decision, and where the team is heard from in steps 1 .. horizon."""
    stay = (-1,) * len(team), list(team)
    for decision, decided in decisions(ways, hearing, team) or [stay]:
        now, plan, arrived = decided, [], False
        while len(plan) < horizon and not arrived:
            now, arrived = one_step(now)
            plan.append(tuple(place for place, _, _ in now))
        if len(plan) == horizon:
            yield decision, plan
        else:
            for _, rest in joint_plans(ways, hearing, now, horizon - len(plan)):
                yield decision, plan + rest


def best_joint(
    ways: Ways,
    targets: Sequence[Target],
    hearing: Bools,
    team: Sequence[Member],
    horizon: int,
    miss: float,
) -> dict[Decision, float]:
    """The value of the best joint plan by its first decision."""
    found: dict[Decision, float] = {}
    known: dict[tuple[frozenset[int], ...], float] = {}
    for decision, plan in joint_plans(ways, hearing, team, horizon):
        key = tuple(frozenset(places) for places in plan)
        if key not in known:
            known[key] = worth(targets, hearing, plan, miss)
        found[decision] = max(found.get(decision, 0.0), known[key])
    return found
