"""Environments of any kind, size, seed and options; Gabriel graphs and pieces against brute force."""

from __future__ import annotations

import itertools
import math

import networkx as nx
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from agent.behaviours.reconnection.environment_cells import _in_one_piece, _still_in_one_piece
from agent.behaviours.reconnection.environment_parts import thinned
from agent.behaviours.reconnection.environment_points import random_points, triangulated
from agent.behaviours.reconnection.environments import KINDS, MARGIN, OPTIONS, environment
from channels.graphs import Graph, check, in_sight
from channels.randomness import Draws

sizes = st.integers(2, 120)
seeds = st.integers(-(2**63), 2**63)


@st.composite
def environments(draw: st.DrawFn, kinds: tuple[str, ...] = KINDS) -> Graph:
    kind = draw(st.sampled_from(kinds))
    options = {}
    for name, option in OPTIONS[kind].items():
        most = min(option.most, option.default * 4)
        whole = isinstance(option.default, int)
        values = st.integers(int(option.least), int(most)) if whole else st.floats(option.least, most)
        if draw(st.booleans()):
            options[name] = draw(values)
    return environment(kind, draw(sizes), draw(seeds), **options)


@given(kind=st.sampled_from(KINDS), vertices=sizes, seed=seeds)
def test_of_one_seed_there_is_one(kind: str, vertices: int, seed: int) -> None:
    graph = environment(kind, vertices, seed)
    assert len(graph.vertices) == vertices
    assert environment(kind, vertices, seed) == graph
    if vertices > 60:  # of small grids there are few
        assert environment(kind, vertices, seed + 1) != graph


@given(graph=environments())
def test_what_all_have_in_common(graph: Graph) -> None:
    check(graph)  # in one piece, among other things
    points = np.array(graph.vertices)
    assert points.min(axis=0).tolist() == [MARGIN, MARGIN]
    assert list(graph.vertices) == sorted(graph.vertices, key=lambda point: point[::-1])
    assert list(graph.edges) == sorted(graph.edges)
    assert all(a < b for a, b, _ in graph.edges)
    assert math.isclose(math.fsum(length for _, _, length in graph.edges) / len(graph.edges), 1.0)
    for a, b, length in graph.edges:
        assert math.isclose(length, math.dist(graph.vertices[a], graph.vertices[b]), rel_tol=1e-9)
    width, height = points.max(axis=0) + MARGIN
    assert all(x0 >= 0 and y0 >= 0 and x1 <= width and y1 <= height for x0, y0, x1, y1 in graph.obstacles)


@given(graph=environments())
def test_no_two_ways_cross(graph: Graph) -> None:
    points = np.array(graph.vertices)
    pairs = np.array([edge[:2] for edge in graph.edges])
    first, second = points[pairs[:, 0]], points[pairs[:, 1]]

    def side(start: np.ndarray, end: np.ndarray, of: np.ndarray) -> np.ndarray:
        (x, y), (across, up) = (end - start).T, np.moveaxis(of - start, -1, 0)
        return x * up - y * across

    # A crosses B where A's ends are on different sides of B, and B's of A.
    on = [side(first, second, end[:, None]) for end in (first, second)]
    apart = on[0] * on[1] < -1e-12
    crossing = apart & apart.T
    shared = (pairs[:, None, :, None] == pairs[None, :, None, :]).any(axis=(2, 3))
    assert not (crossing & ~shared).any()


@given(graph=environments())
def test_nothing_stands_in_the_way(graph: Graph) -> None:
    points = np.array(graph.vertices)
    pairs = np.array([edge[:2] for edge in graph.edges])
    assert in_sight(points[pairs[:, 0]], points[pairs[:, 1]], graph.obstacles).all()


@settings(max_examples=40)
@given(vertices=st.integers(3, 40), seed=seeds, gap=st.floats(0, 0.6))
def test_gabriel_graphs_by_brute_force(vertices: int, seed: int, gap: float) -> None:
    points = random_points(vertices, seed, gap)
    pairs, near = triangulated(points)
    expected = []
    for a, b in itertools.combinations(range(vertices), 2):
        others = np.delete(points, [a, b], axis=0)
        if (
            np.linalg.norm(others - (points[a] + points[b]) / 2, axis=1) * 2
            >= math.dist(points[a], points[b])
        ).all():
            expected.append([a, b])
    assert pairs[near].tolist() == expected
    edges = environment("gabriel", vertices, seed, gap=gap).edges
    assert [[a, b] for a, b, _ in edges] == expected


@settings(max_examples=40)
@given(vertices=st.integers(3, 30), seed=seeds)
def test_triangulations_have_empty_circles(vertices: int, seed: int) -> None:
    """An edge is Delaunay's where some circle through its ends is empty."""
    points = random_points(vertices, seed, 0.0)
    pairs, _ = triangulated(points)
    expected = []
    for a, b in itertools.combinations(range(vertices), 2):
        half = (points[b] - points[a]) / 2
        offsets = np.delete(points, [a, b], axis=0) - (points[a] + points[b]) / 2
        # The circle around middle + t * normal leaves a point out where t is beyond a bound on its side.
        along, excess = offsets @ np.array([-half[1], half[0]]), (offsets**2).sum(axis=1) - half @ half
        least = (excess[along < 0] / (2 * along[along < 0])).max(initial=-np.inf)
        most = (excess[along > 0] / (2 * along[along > 0])).min(initial=np.inf)
        if least < most:
            expected.append([a, b])
    assert pairs.tolist() == expected


@given(nodes=st.integers(2, 25), density=st.floats(0, 1), seed=st.integers(0, 999), share=st.floats(0, 1))
def test_thinning_one_by_one(nodes: int, density: float, seed: int, share: float) -> None:
    """As the words say: an edge goes in its turn unless that cuts the graph."""
    graph = nx.gnp_random_graph(nodes, density, seed=seed)
    graph.add_edges_from((i, i + 1) for i in range(nodes - 1))
    pairs = np.array(sorted(tuple(sorted(edge)) for edge in graph.edges))
    kept, draws = round(share * len(pairs)), Draws(seed, "test")
    for edge in np.argsort(draws.bits(np.arange(len(pairs)))):
        if graph.number_of_edges() > kept:
            graph.remove_edge(*pairs[edge])
            if not nx.is_connected(graph):
                graph.add_edge(*pairs[edge])
    assert thinned(nodes, pairs, kept, draws).tolist() == sorted(sorted(edge) for edge in graph.edges)


@given(rows=st.integers(1, 6), columns=st.integers(1, 6), data=st.data())
def test_pieces_of_grids(rows: int, columns: int, data: st.DataObject) -> None:
    flags = data.draw(st.lists(st.booleans(), min_size=rows * columns, max_size=rows * columns))
    free = np.array(flags).reshape(rows, columns)
    if not free.any():
        return
    grid = nx.grid_2d_graph(rows, columns).subgraph([tuple(cell) for cell in np.argwhere(free).tolist()])
    assert _in_one_piece(free) == nx.is_connected(grid)
    y, x = data.draw(st.sampled_from(np.argwhere(free).tolist()))
    rest = grid.subgraph([cell for cell in grid if cell != (y, x)])
    if nx.is_connected(grid) and len(rest):
        free[y, x] = False
        assert _still_in_one_piece(free, x, y, 1, 1) == nx.is_connected(rest)


@settings(max_examples=20)
@given(vertices=st.integers(20, 80), seed=seeds, degree=st.floats(2, 5))
def test_graphs_within_graphs(vertices: int, seed: int, degree: float) -> None:
    def pairs(kind: str, **options: float) -> set[tuple[int, int]]:
        return {edge[:2] for edge in environment(kind, vertices, seed, **options).edges}

    whole, left = pairs("delaunay"), pairs("delaunay-thinned", degree=degree)
    assert pairs("gabriel") <= whole
    assert left <= whole
    assert len(left) == min(len(whole), max(vertices - 1, round(degree * vertices / 2)))
    tree, some = pairs("maze", loops=0.0), pairs("maze", loops=0.3)
    assert len(tree) == vertices - 1
    assert tree <= some <= pairs("maze", loops=1.0)
