"""How teams move, and who searches for whom: against rules written down once more."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import networkx as nx
import pytest

from agent.behaviours.reconnection.model import ways_of
from agent.behaviours.reconnection.team import (
    TARGETS,
    Motion,
    departed,
    everybody,
    moved,
    networks,
    sinks,
    targets_of,
    turn_backs,
    turned_back,
    upwards,
    way_between,
)
from channels.graphs import Graph, hearing

LINE = Graph(
    vertices=((0, 0), (1, 0), (2, 0), (3, 0)),
    edges=((0, 1, 1.0), (1, 2, 2.0), (2, 3, 0.2)),
)
WAYS = ways_of(LINE, 2)
HEARING = hearing(LINE)


# Motions


@pytest.mark.parametrize(("tail", "head", "tau"), [(0, 1, 2), (2, 1, 4), (3, 2, 1)])
def test_a_move_takes_the_way_and_a_step(tail: int, head: int, tau: int) -> None:
    course = [departed(WAYS, Motion(tail), head)]
    for _ in range(tau + 1):
        course.append(moved(course[-1]))
    # Decided at step 0: on the way, heard as from its tail, at 1 .. tau; there at tau + 1.
    assert [(m.place, m.towards, m.elapsed) for m in course[1 : tau + 1]] == [
        (tail, head, k) for k in range(1, tau + 1)
    ]
    assert not any(m.free for m in course[:-1])
    assert course[-1] == Motion(head)
    assert course[-1].free


def test_who_waits_counts_its_steps() -> None:
    motion = Motion(2)
    for k in range(1, 4):
        motion = moved(motion)
        assert motion == Motion(2, elapsed=k)
        assert motion.free


@pytest.mark.parametrize("elapsed", [1, 2, 3, 4])
def test_to_turn_back_takes_as_long_as_the_way_so_far(elapsed: int) -> None:
    motion = departed(WAYS, Motion(1), 2)
    for _ in range(elapsed):
        motion = moved(motion)
    motion = turned_back(motion)
    assert turned_back(motion) == motion
    for _ in range(elapsed):
        assert not motion.free
        assert motion.place == 1
        motion = moved(motion)
        assert turned_back(motion) == motion  # on the way back, and then at home
    assert motion == Motion(1)


def test_to_turn_back_at_once_is_not_to_go() -> None:
    assert turned_back(departed(WAYS, Motion(1), 2)) == Motion(1)
    waiting = Motion(1, elapsed=5)
    assert turned_back(waiting) == waiting


def test_only_neighbours_can_be_gone_to() -> None:
    for tail, head in product(range(4), repeat=2):
        if abs(tail - head) == 1:
            way = way_between(WAYS, tail, head)
            assert (WAYS.tail[way], WAYS.head[way]) == (tail, head)
        else:
            with pytest.raises(ValueError, match=f"no way leads from vertex {tail} to vertex {head}"):
                way_between(WAYS, tail, head)


def test_networks_are_those_who_hear_each_other_by_others() -> None:
    assert networks({7: 0, 3: 2, 5: 1, 4: 0}, HEARING) == [(3, 4, 5, 7)]
    assert networks({7: 0, 3: 2, 5: 3, 4: 0}, HEARING) == [(3, 5), (4, 7)]
    assert networks({}, HEARING) == []


def test_of_equally_many_the_lowest_turn_back() -> None:
    # Either may go on from 1, but not one to 0 and the other to 2, which do not hear each other.
    apart = [moved(departed(WAYS, Motion(1), 0)), moved(departed(WAYS, Motion(1), 2))]
    assert turn_backs(apart, HEARING) == (0,)
    assert turn_backs(apart[::-1], HEARING) == (0,)
    assert turn_backs([apart[0], Motion(1)], HEARING) == ()
    assert turn_backs([turned_back(apart[0]), apart[1]], HEARING) == ()
    # From 1 to 0 and from 2 to 3: wherever one stays, the other is lost.
    lost = [apart[0], moved(departed(WAYS, Motion(2), 3))]
    assert turn_backs(lost, HEARING) == (0, 1)


def test_who_comes_too_late_turns_others_back() -> None:
    # From 0 to 1 takes 3 steps, from 1 to 2 takes 5, from 2 to 3 takes 2: apart at 0 and 2, or 1 and 3, in between.
    first = departed(WAYS, Motion(1), 2)
    follows = departed(WAYS, Motion(0), 1)
    assert turn_backs([moved(first), moved(follows)], HEARING) == ()
    soon = first._replace(elapsed=4, left=1)
    assert turn_backs([soon, moved(follows)], HEARING) == (0,)


# Targets


@pytest.mark.parametrize("robots", range(2, 9))
@pytest.mark.parametrize("name", sorted(set(TARGETS) - {"all"}))  # where all search for all, chance must help
def test_named_target_graphs_rule_out_livelock(name: str, robots: int) -> None:
    """Weakly connected, without a directed cycle, and with exactly one sink (sec. II.C)."""
    graph = nx.DiGraph((i, j) for i, found in enumerate(TARGETS[name](robots)) for j in found)
    assert sorted(graph) == list(range(robots))
    assert nx.is_weakly_connected(graph)
    assert nx.is_directed_acyclic_graph(graph)
    assert [i for i in graph if graph.out_degree(i) == 0] == sorted(sinks(TARGETS[name](robots)))
    assert len(sinks(TARGETS[name](robots))) == 1


def test_a_group_searches_for_what_its_members_do_but_not_for_who_is_there() -> None:
    assert targets_of((0, 2), (0, 2, 3), everybody(5)) == (1, 4)
    assert targets_of((1,), (1,), everybody(3)) == (0, 2)
    assert targets_of((0, 1, 2), (0, 1, 2), everybody(3)) == ()
    two_sinks = ((1, 3), (), (3,), ())
    assert targets_of((0, 1, 2), (0, 1, 2), two_sinks) == (3,)
    circle = ((1,), (2,), (0,), (0,))
    assert targets_of((1, 3), (1, 3), circle) == (0, 2)


def _partitions(members: Sequence[int]) -> list[list[list[int]]]:
    if not members:
        return [[]]
    found = []
    for rest in _partitions(members[1:]):
        found.append([[members[0]], *rest])
        for i, group in enumerate(rest):
            found.append([*rest[:i], [members[0], *group], *rest[i + 1 :]])
    return found


def _acyclic_targets(robots: int) -> list[list[list[int]]]:
    """All target graphs that rule out livelock."""
    pairs = [(i, j) for i in range(robots) for j in range(robots) if i != j]
    found = []
    for chosen in product((False, True), repeat=len(pairs)):
        edges = [pair for pair, there in zip(pairs, chosen, strict=True) if there]
        if nx.is_directed_acyclic_graph(nx.DiGraph(edges)) and len({i for i, _ in edges}) == robots - 1:
            found.append([[j for i, j in edges if i == robot] for robot in range(robots)])
    return found


def test_groups_never_search_in_circles_and_all_but_one_search() -> None:
    # 0 > 2 and 1 > 3: the groups of 0 and 3, and of 1 and 2, are equally far from the sink.
    crossed = [[2], [3], [4], [4], []]
    for targets in [*_acyclic_targets(3), *_acyclic_targets(4)[::5], crossed, upwards(5)]:
        robots = len(targets)
        for partition in _partitions(range(robots)):
            of = {robot: g for g, group in enumerate(partition) for robot in group}
            graph = nx.DiGraph()
            graph.add_nodes_from(range(len(partition)))
            for g, group in enumerate(partition):
                found = targets_of(group, group, targets)
                assert set(found) <= {j for i in group for j in targets[i]} - set(group)
                graph.add_edges_from((g, of[j]) for j in found)
            assert nx.is_directed_acyclic_graph(graph), (targets, partition)
            # Only the group of the robot that stands still does, too.
            still = [g for g in graph if graph.out_degree(g) == 0]
            assert still == [of[next(i for i in range(robots) if not targets[i])]], (targets, partition)


def test_alone_all_search_for_whom_they_are_told_to() -> None:
    for targets in [*_acyclic_targets(4)[::7], upwards(5), everybody(4)]:
        for robot, found in enumerate(targets):
            assert targets_of((robot,), (robot,), targets) == tuple(found)
