"""Where robots go that search without beliefs, wander or work: against rules written down once more."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from itertools import pairwise, product

import networkx as nx
import numpy as np
import pytest
from scipy.stats import chisquare

from agent.behaviours.reconnection.baselines import Visits, persistent_moves, random_moves, wander
from agent.behaviours.reconnection.member import GROUP, OWN, Member, Task, drawn_tasks, next_on_the_way
from agent.behaviours.reconnection.model import Ways, ways_of
from agent.behaviours.reconnection.planner import joint_moves
from agent.behaviours.reconnection.team import (
    Motion,
    arrays,
    departed,
    turned_back,
)
from channels.graphs import Graph, hearing
from channels.randomness import Draws

LINE = Graph(
    vertices=((0, 0), (1, 0), (2, 0), (3, 0)),
    edges=((0, 1, 1.0), (1, 2, 2.0), (2, 3, 0.2)),
)
WAYS = ways_of(LINE, 2)
HEARING = hearing(LINE)


def _random_graph(seed: int, vertices: int, extra: int) -> Graph:
    generator = np.random.default_rng(seed)
    pairs = {(int(generator.integers(b)), b) for b in range(1, vertices)}
    every = [(a, b) for b in range(vertices) for a in range(b)]
    pairs |= {every[i] for i in generator.choice(len(every), extra, replace=False)}
    return Graph(
        tuple((float(v), 0.0) for v in range(vertices)),
        tuple((a, b, float(generator.uniform(0.4, 2.1))) for a, b in sorted(pairs)),
    )


def _neighbours(graph: Graph, vertex: int) -> list[int]:
    return sorted({a + b - vertex for a, b, _ in graph.edges if vertex in (a, b)})


@pytest.mark.parametrize("memory", [1, 2, 5, 10])
def test_persistent_is_the_rule_as_it_is_worded(memory: int) -> None:
    graph = _random_graph(4, 14, 8)
    ways, heard = ways_of(graph, 1), hearing(graph)
    draws = Draws(memory, "persistent")
    visits, history, fell_back = Visits(14, 0), [0], 0
    for move in range(200):
        vertex = history[-1]
        near = _neighbours(graph, vertex)
        fresh = [v for v in near if v not in history[-memory:]]
        if not fresh:  # the least recent
            fell_back += 1
            fresh = [min(near, key=lambda v: max(n for n, past in enumerate(history) if past == v))]
        u = float(draws.uniform(move))
        (chosen,) = persistent_moves(
            ways, heard, [Motion(vertex)], [visits.ages(ways, vertex, memory)], memory, u
        )
        assert chosen == fresh[int(u * len(fresh))]
        history.append(int(chosen))
        visits.note(int(chosen))
    assert len(set(history)) > 7
    assert fell_back > 0 or memory == 1  # that only avoids the vertex it is at


def test_ages_count_moves_and_not_steps() -> None:
    visits = Visits(4, 1)
    assert visits.ages(WAYS, 1, 10) == (10, 10)
    visits.note(2)
    assert visits.ages(WAYS, 2, 10) == (1, 10)
    visits.note(3)
    visits.note(2)
    assert visits.ages(WAYS, 2, 10) == (3, 1)
    assert visits.ages(WAYS, 2, 2) == (2, 1)


def test_a_persistent_team_goes_where_it_has_not_been_for_longest_in_all() -> None:
    graph = _random_graph(9, 7, 4)
    ways, heard = ways_of(graph, 2), hearing(graph)
    generator = np.random.default_rng(1)
    memory, several = 4, 0
    for _ in range(40):
        place = int(generator.integers(7))
        other = int(generator.choice(_neighbours(graph, place)))
        third = departed(ways, Motion(place), other)  # two that decide, and one on the way
        motions = [Motion(place), third._replace(elapsed=1, left=third.left - 1), Motion(other)]
        ages = [tuple(generator.integers(0, 8, len(_neighbours(graph, m.place))).tolist()) for m in motions]
        ages[1] = ()
        worth = {}
        for move in map(tuple, joint_moves(ways, heard, *arrays(motions)).tolist()):
            worth[move] = sum(
                min(memory, ages[i][_neighbours(graph, motions[i].place).index(to)])
                for i, to in enumerate(move)
                if to >= 0
            )
        best = [move for move, value in worth.items() if value == max(worth.values())]
        several += len(best) > 1
        grid = (np.arange(len(best)) + 0.5) / len(best)
        found = [tuple(persistent_moves(ways, heard, motions, ages, memory, u).tolist()) for u in grid]
        assert found == best
    assert several > 0


def _even(pick: Callable[[float], object], kinds: int) -> None:
    """All kinds equally often, exactly on a grid and by chance for draws by step."""
    grid = Counter(pick(float(u)) for u in (np.arange(30 * kinds) + 0.5) / (30 * kinds))
    assert list(grid.values()) == [30] * kinds
    drawn = Counter(pick(float(u)) for u in Draws(5, "robot").uniform(np.arange(300 * kinds), GROUP))
    assert len(drawn) == kinds
    assert kinds == 1 or chisquare(list(drawn.values())).pvalue > 0.01


def test_all_neighbours_are_equally_likely() -> None:
    graph = _random_graph(3, 8, 6)
    ways = ways_of(graph, 2)
    for vertex in range(8):
        near = _neighbours(graph, vertex)
        assert {wander(ways, vertex, u) for u in (0.0, 0.3, 0.6, 1 - 2**-53)} <= set(near)
        _even(lambda u, vertex=vertex: wander(ways, vertex, u), len(near))  # type: ignore[misc]


def test_all_safe_joint_decisions_are_equally_likely() -> None:
    motions = [Motion(1), Motion(2)]
    found = joint_moves(WAYS, HEARING, *arrays(motions))
    assert 2 < len(found) < 9
    _even(lambda u: tuple(random_moves(WAYS, HEARING, motions, u).tolist()), len(found))


def test_draws_for_different_purposes_do_not_follow_from_each_other() -> None:
    draws = Draws(5, "robot")
    steps = np.arange(4000)
    own, group = draws.uniform(steps, OWN), draws.uniform(steps, GROUP)
    assert abs(np.corrcoef(own, group)[0, 1]) < 4 / np.sqrt(len(steps))


# Tasks


@pytest.mark.parametrize("seed", range(4))
def test_the_next_vertex_is_on_a_shortest_way(seed: int) -> None:
    graph = _random_graph(seed, 15, 12)
    ways = ways_of(graph, 2)
    known = nx.Graph()
    known.add_weighted_edges_from((a, b, max(1, round(2 * length)) + 1) for a, b, length in graph.edges)
    far = dict(nx.all_pairs_dijkstra_path_length(known))
    several = 0
    for start, goal in product(range(15), repeat=2):
        if start == goal:
            continue
        best = [
            v for v in sorted(known[start]) if known[start][v]["weight"] + far[v][goal] == far[start][goal]
        ]
        several += len(best) > 1
        assert next_on_the_way(ways, start, goal) == best[0]
    assert several > 0


def _lived(ways: Ways, member: Member, steps: int) -> list[tuple[int, bool, bool, int]]:
    """Where it is in each step, whether it is at a vertex and searches, and how many tasks it has."""
    seen = []
    for step in range(steps):
        searching, tasks = member.searching(step), len(member._tasks)
        seen.append((member.motion.place, member.motion.free, searching, tasks))
        member.mind_own_business(step)
        # Robots tell whether they search before they do anything: it must not change within a step.
        assert (member.searching(step), len(member._tasks)) == (searching, tasks)
        member.advance()
    return seen


def test_tasks_are_done_one_by_one_where_they_are() -> None:
    # From 0 to 1 takes 3 steps, on to 2 takes 5.
    member = Member(WAYS, 0, Draws(1, "r"), 0, [Task(2, 3), Task(2, 1), Task(1, 2)])
    seen = _lived(WAYS, member, 22)
    expected = [(0, k == 0, False, 3) for k in range(3)]
    expected += [(1, k == 0, False, 3) for k in range(5)]
    expected += [(2, True, False, 3)] * 3 + [(2, True, False, 2)]
    expected += [(2, k == 0, False, 1) for k in range(5)]
    expected += [(1, True, False, 1)] * 2 + [(1, True, True, 0)] * 3
    assert seen == expected


def test_a_task_at_the_start_begins_after_the_random_phase() -> None:
    pair = ways_of(Graph(((0, 0), (1, 0)), ((0, 1, 0.5),)), 2)
    member = Member(pair, 0, Draws(1, "r"), 4, [Task(0, 2)])
    seen = _lived(pair, member, 9)
    # There and back takes 2 steps each.
    assert [(place, free) for place, free, _, _ in seen[4:]] == [(0, True)] * 5
    assert [tasks for *_, tasks in seen] == [1] * 6 + [0] * 3
    assert [searching for _, _, searching, _ in seen] == [False] * 6 + [True] * 3


def test_who_wanders_never_stands_and_then_arrives_first() -> None:
    graph = _random_graph(2, 9, 5)
    ways = ways_of(graph, 2)
    member = Member(ways, 0, Draws(8, "r"), 40)
    seen = _lived(ways, member, 60)
    steps = {(a, b): max(1, round(2 * length)) for u, v, length in graph.edges for a, b in ((u, v), (v, u))}
    arrivals = [step for step, (_, free, searching, _) in enumerate(seen) if free and not searching]
    for here, there in pairwise(arrivals):
        assert there - here == steps[seen[here][0], seen[there][0]] + 1
    assert [searching for _, _, searching, _ in seen] == [step >= 40 for step in range(60)]


def test_turning_back_is_no_visit() -> None:
    member = Member(WAYS, 0, Draws(8, "r"), 0)
    member.motion = departed(WAYS, member.motion, 1)
    for _ in range(3):
        member.advance()
    assert member.ages(9) == (1, 9)
    member.motion = departed(WAYS, member.motion, 2)
    for _ in range(2):
        member.advance()
    assert member.ages(9) == ()
    member.motion = turned_back(member.motion)
    for _ in range(2):
        member.advance()
    assert member.ages(9) == (1, 9)


def test_drawn_tasks_are_anywhere_and_of_any_length() -> None:
    tasks = drawn_tasks(Draws(3, "r"), 7, 2100, 5)
    for values, kinds in (([t.vertex for t in tasks], range(7)), ([t.steps for t in tasks], range(1, 6))):
        counts = Counter(values)
        assert sorted(counts) == list(kinds)
        assert chisquare([counts[kind] for kind in kinds]).pvalue > 0.01
    assert drawn_tasks(Draws(3, "r"), 7, 3, 5) == tasks[:3]


def test_who_may_not_wait_may_have_nothing_to_do_but_to_change_places() -> None:
    """Why members of a team that moves at random may wait."""
    for places in ([1, 2], [2, 1]):
        moves = joint_moves(WAYS, HEARING, *arrays(map(Motion, places)))
        assert [move for move in moves.tolist() if min(move) >= 0] == [places[::-1]]
