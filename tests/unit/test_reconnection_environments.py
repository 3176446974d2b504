"""Environments: what their options do, what is refused, and what graph files hold."""

from __future__ import annotations

import math
import random
import sys
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from agent.behaviours.reconnection.environment_cells import WALL
from agent.behaviours.reconnection.environments import KINDS, MARGIN, OPTIONS, environment
from agent.behaviours.reconnection.graph_file import read_graph, write_graph
from channels.graphs import Graph, check, in_sight, spread


def degree(graph: Graph) -> float:
    return 2 * len(graph.edges) / len(graph.vertices)


def cells_covered(graph: Graph) -> float:
    return sum((x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in graph.obstacles)


def sides(graph: Graph) -> tuple[float, float]:
    width, height = np.array(graph.vertices).max(axis=0) + MARGIN
    return float(width), float(height)


# --- gridholes ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(5))
def test_holes_and_vertices_fill_the_smallest_square_that_is_large_enough(seed: int) -> None:
    for share in (0.0, 0.1, 0.3, 0.5):
        graph = environment("gridholes", 150, seed, holes=share)
        width, height = sides(graph)
        assert cells_covered(graph) == width * height - 150
        assert width == height
        assert (1 - share) * width * height + 1e-9 >= 150
        assert (1 - share) * (width - 1) * (height - 1) < 150
        assert not any(
            x0 < x < x1 and y0 < y < y1 for x0, y0, x1, y1 in graph.obstacles for x, y in graph.vertices
        )


@pytest.mark.parametrize("seed", range(5))
def test_all_neighbours_in_the_grid_are_joined(seed: int) -> None:
    graph = environment("gridholes", 100, seed)
    joined = {(a, b) for a, b, _ in graph.edges}
    apart = [
        (a, b)
        for b, at in enumerate(graph.vertices)
        for a, other in enumerate(graph.vertices[:b])
        if math.dist(at, other) == 1
    ]
    assert joined == set(apart)
    assert all(length == 1 for _, _, length in graph.edges)


@pytest.mark.parametrize("seed", range(10))
def test_corners_are_left_and_holes_keep_off_the_rim(seed: int) -> None:
    graph = environment("gridholes", 150, seed, rim=2)
    width, height = sides(graph)
    corners = {(x, y) for x in (0.5, width - 0.5) for y in (0.5, height - 0.5)}
    assert {graph.vertices[vertex] for vertex in spread(graph, 4)} == corners
    for x0, y0, x1, y1 in graph.obstacles:
        assert min(x0, y0, width - x1, height - y1) >= 2 or (x1 - x0, y1 - y0) == (1, 1)


def test_sides_of_holes() -> None:
    for side in (1, 2, 6):
        graphs = [environment("gridholes", 200, seed, side=side, rim=0) for seed in range(8)]
        longest = [max(x1 - x0, y1 - y0) for graph in graphs for x0, y0, x1, y1 in graph.obstacles]
        assert max(longest) == side


def test_small_grids_have_holes_where_there_is_room() -> None:
    """Of 2 x 2 cells, corners have to go."""
    for vertices in range(2, 12):
        for seed in range(5):
            graph = environment("gridholes", vertices, seed, holes=0.5)
            check(graph)
            assert len(graph.vertices) == vertices
            assert np.array(graph.vertices).min() == MARGIN
            assert all(min(rectangle) >= 0 for rectangle in graph.obstacles)


# --- of points ---------------------------------------------------------------------------------------


def test_gap_keeps_points_apart() -> None:
    # In a square of 300 points, each has a 300th of it.
    for gap in (0.0, 0.3, 0.6):
        points = np.array(environment("gabriel", 300, 3, gap=gap).vertices)
        spacing = np.ptp(points, axis=0).max() / math.sqrt(300)
        apart = np.linalg.norm(points[:, None] - points, axis=2)[np.triu_indices(300, 1)].min()
        assert apart >= 0.98 * gap * spacing
        assert gap > 0 or apart < 0.2 * spacing


def test_kinds_of_one_seed_share_their_points() -> None:
    shapes = []
    for kind in ("gabriel", "delaunay", "delaunay-thinned"):
        points = np.array(environment(kind, 80, 5).vertices) - MARGIN
        shapes.append(points / points.max())
    assert np.allclose(shapes[0], shapes[1], atol=1e-12)
    assert np.allclose(shapes[0], shapes[2], atol=1e-12)


def test_long_edges_go_but_those_of_the_gabriel_graph() -> None:
    for seed in range(5):
        near = {edge[:2] for edge in environment("gabriel", 120, seed).edges}
        whole = environment("delaunay", 120, seed, longest=math.inf)
        median = float(np.median([length for _, _, length in whole.edges]))
        for longest in (1.0, 1.5, 3.0):
            kept = {edge[:2] for edge in environment("delaunay", 120, seed, longest=longest).edges}
            short = {(a, b) for a, b, length in whole.edges if length <= longest * median}
            assert kept == near | short


@pytest.mark.parametrize("wanted", [2.0, 2.4, 3.0, 4.0])
def test_thinned_to_a_degree(wanted: float) -> None:
    graph = environment("delaunay-thinned", 150, 2, degree=wanted)
    assert degree(graph) == wanted
    assert {e[:2] for e in graph.edges} <= {e[:2] for e in environment("delaunay", 150, 2).edges}


def test_thinning_is_random() -> None:
    """Edges go whatever their length: those that are left are about as long as those there were."""
    ratios = []
    for seed in range(20):
        points = np.array(environment("delaunay", 150, seed).vertices)
        before = np.array([edge[:2] for edge in environment("delaunay", 150, seed).edges])
        after = np.array([edge[:2] for edge in environment("delaunay-thinned", 150, seed).edges])
        mean_after, mean_before = (
            np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1).mean()
            for pairs in (after, before)
        )
        ratios.append(mean_after / mean_before)
    assert abs(np.mean(ratios) - 1) < 0.03


# --- mazes -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("loops", "cycles"), [(0.0, 0), (1.0, 1000)])
def test_loops(loops: float, cycles: int) -> None:
    graph, whole = (environment("maze", 150, 4, loops=share) for share in (loops, 1.0))
    others = len(whole.edges) - 149
    assert len(graph.edges) - 149 == min(cycles, others)
    assert len(environment("maze", 150, 4, loops=0.25).edges) - 149 == round(0.25 * others)


def test_walls_stand_where_no_way_leads() -> None:
    graph = environment("maze", 90, 1, loops=0.2)
    points = np.array(graph.vertices)
    seen = in_sight(points[:, None], points[None], graph.obstacles)
    joined = np.eye(90, dtype=bool)
    for a, b, _ in graph.edges:
        joined[a, b] = joined[b, a] = True
    near = np.abs(points[:, None] - points).sum(axis=2) <= 1
    assert (seen[near] == joined[near]).all()
    assert not seen[near].all()
    assert all(math.isclose(min(x1 - x0, y1 - y0), WALL) for x0, y0, x1, y1 in graph.obstacles)


# --- what is refused ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"kind": "hexes"}, "kind: must be gridholes, gabriel, delaunay, delaunay-thinned or maze, is hexes"),
        ({"vertices": 1}, "vertices: must be a whole number 2 to 10000, is 1"),
        ({"vertices": 10_001}, "vertices: must be a whole number 2 to 10000, is 10001"),
        ({"vertices": 150.0}, "vertices: must be a whole number 2 to 10000, is 150.0"),
        ({"vertices": "150"}, "vertices: must be a whole number 2 to 10000, is 150"),
        ({"vertices": True}, "vertices: must be a whole number 2 to 10000, is True"),
        ({"seed": 1.5}, "seed: must be a whole number, is 1.5"),
        ({"degree": 3}, "degree: gridholes has no such option; possible are holes, side, rim"),
        ({"side": 2.5}, "side: must be a whole number 1 to 100, is 2.5"),
        ({"holes": 0.6}, "holes: must be 0 to 0.5, is 0.6"),
        ({"holes": math.nan}, "holes: must be 0 to 0.5, is nan"),
        ({"holes": "many"}, "holes: must be a number, is many"),
        ({"kind": "delaunay", "longest": 0.5}, "longest: must be 1 or more, is 0.5"),
        ({"kind": "delaunay-thinned", "degree": 1.9}, "degree: must be 2 to 6, is 1.9"),
    ],
)
def test_refusals(given: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError) as refused:  # noqa: PT011
        environment(**{"kind": "gridholes", "vertices": 20, **given})
    assert str(refused.value) == sentence


def test_no_room_for_points_so_far_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    from agent.behaviours.reconnection import environment_points

    monkeypatch.setattr(environment_points, "_DARTS", 1)
    with pytest.raises(
        ValueError, match=r"gap: no room is left after \d+ of 50 vertices; choose less than 0.7"
    ):
        environment("gabriel", 50, gap=0.7)


def test_without_scipy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "scipy.spatial", None)
    with pytest.raises(ModuleNotFoundError, match=r"need SciPy; install heliograph\[desk\]"):
        environment("gabriel")
    for kind in ("gridholes", "maze"):
        check(environment(kind, 30))


def test_whatever_is_possible_at_the_ends_of_ranges_works() -> None:
    for kind in KINDS:
        for name, option in OPTIONS[kind].items():
            for value in (option.least, option.most):
                graph = environment(kind, 60, 1, **{name: value})
                check(graph)
                assert len(graph.vertices) == 60


# --- files -------------------------------------------------------------------------------------------

TRIANGLE = Graph(((0.0, 0.0), (3.0, 0.0), (3.0, 4.0)), ((0, 1, 2.5), (1, 2, 4.0)))


@pytest.mark.parametrize(
    "graph",
    [
        TRIANGLE,
        Graph(TRIANGLE.vertices, TRIANGLE.edges, ((0, 2),), (2, 0), ((1.0, 1.0, 2.0, 2.0),)),
        Graph(TRIANGLE.vertices, TRIANGLE.edges, (), ()),
        environment("gabriel", 40),
        environment("gridholes", 40),
    ],
)
def test_there_and_back(graph: Graph, tmp_path: Path) -> None:
    write_graph(tmp_path / "env.json", graph)
    assert read_graph(tmp_path / "env.json") == graph


def test_lengths_may_be_left_out(tmp_path: Path) -> None:
    file = tmp_path / "env.json"
    file.write_text('{"vertices": [[0, 0], [3, 0], [3, 4]], "edges": [[0, 1, 2.5], [1, 2], [0, 2, 7]]}')
    assert read_graph(file) == Graph(TRIANGLE.vertices, ((0, 1, 2.5), (1, 2, 4.0), (0, 2, 7.0)))


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    file = tmp_path / "env.json"
    file.write_text("mine")
    with pytest.raises(ValueError, match=r"env\.json: exists already; choose another name, or remove it"):
        write_graph(file, TRIANGLE)
    assert file.read_text() == "mine"
    with pytest.raises(ValueError, match=r"env\.json: cannot be written \(No such file or directory\)"):
        write_graph(tmp_path / "nowhere" / "env.json", TRIANGLE)


def test_what_is_no_graph_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="edges: no way leads from vertex 0 to vertex 2"):
        write_graph(tmp_path / "env.json", Graph(TRIANGLE.vertices, TRIANGLE.edges[:1]))
    assert list(tmp_path.iterdir()) == []


TWO = '"vertices": [[0, 0], [1, 0]]'


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("{", "is not a graph in JSON (Input data was truncated)"),
        ("[]", 'must be a table {"vertices": [[x, y], ...], "edges": [[a, b, length], ...]}'),
        ("{}", "vertices: is missing; it must be a list of [x, y], each a number"),
        ("{TWO}", "edges: is missing; it must be a list of [vertex, vertex, length], the length may be left out"),
        ('{TWO, "edges": [[0, 1]], "walls": []}', "unknown key walls; possible are vertices, edges, links, starts, obstacles"),
        ('{"vertices": [[0, 0], [1]], "edges": []}', "vertices: must be a list of [x, y], each a number; vertices[1] is not"),
        ('{"vertices": 7, "edges": []}', "vertices: must be a list of [x, y], each a number"),
        ('{TWO, "edges": [[0, 1.5, 1]]}', "edges: must be a list of [vertex, vertex, length], the length may be left out; edges[0] is not"),
        ('{TWO, "edges": [[0]]}', "edges: must be a list of [vertex, vertex, length], the length may be left out; edges[0] is not"),
        ('{TWO, "edges": [[0, 1, "far"]]}', "edges: must be a list of [vertex, vertex, length], the length may be left out; edges[0] is not"),
        ('{TWO, "edges": [[0, NINES]]}', "edges: must be a list of [vertex, vertex, length], the length may be left out; edges[0] is not"),
        ('{"vertices": [[0, 0], [NINES, 0]], "edges": [[0, 1]]}', "vertices: must be a list of [x, y], each a number; vertices[1] is not"),
        ('{TWO, "edges": [[0, 2]]}', "edges[0]: there is no vertex 2; they are 0 to 1"),
        ('{TWO, "edges": [[-1, 1]]}', "edges[0]: there is no vertex -1; they are 0 to 1"),
        ('{TWO, "edges": [[0, 1, 0]]}', "edges[0]: its length must be a number greater than 0, is 0.0"),
        ('{"vertices": [[0, 0], [0, 0]], "edges": [[0, 1]]}', "edges[0]: its length must be a number greater than 0, is 0.0"),
        ('{TWO, "edges": [[0, 1]], "starts": ["a"]}', "starts: must be a list of vertices; starts[0] is not"),
        ('{TWO, "edges": [[0, 1]], "links": [[0]]}', "links: must be a list of [vertex, vertex]; links[0] is not"),
        ('{TWO, "edges": [[0, 1]], "obstacles": [[0, 0, 1]]}', "obstacles: must be a list of [x0, y0, x1, y1], each a number; obstacles[0] is not"),
        ('{TWO, "edges": [[0, 1]], "obstacles": [[1, 0, 0, 1]]}', "obstacles[0]: must be x0, y0, x1, y1 with x0 < x1 and y0 < y1"),
    ],
)  # fmt: skip
def test_faults_of_files(text: str, sentence: str, tmp_path: Path) -> None:
    file = tmp_path / "env.json"
    file.write_text(text.replace("TWO", TWO).replace("NINES", "9" * 400))
    with pytest.raises(ValueError) as refused:  # noqa: PT011
        read_graph(file)
    assert str(refused.value) == f"{file}: {sentence}"


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"none\.json: cannot be read \(No such file or directory\)"):
        read_graph(tmp_path / "none.json")
    with pytest.raises(ValueError, match=r"cannot be read \(Is a directory\)"):
        read_graph(tmp_path)


VALUES = [b"", b"7", b",", b"null", b"true", b"-1", b"1e999", b"1e308", b"9" * 400, b"9" * 25, b'"x"', b"[]", b"{}", b"[" * 3000, b"\xff"]  # fmt: skip


def refusal(file: Path) -> str | None:
    """What is said about a file; None where it holds a graph."""
    try:
        check(read_graph(file))
    except ValueError as error:
        return str(error)
    return None


def test_damaged_files_are_refused_in_one_sentence(tmp_path: Path) -> None:
    """Bytes are cut out and exchanged for others: a graph, or one sentence."""
    file, chance = tmp_path / "env.json", random.Random(5)
    graph = Graph(TRIANGLE.vertices, TRIANGLE.edges, ((0, 2),), (2, 0), ((1.0, 1.0, 2.0, 2.0),))
    whole, read = msgspec.json.encode(graph), 0
    for _ in range(600):
        at = chance.randrange(len(whole))
        file.write_bytes(whole[:at] + chance.choice(VALUES) + whole[at + chance.randrange(6) :])
        said = refusal(file)
        if said is None:
            read += 1
        else:
            assert said.startswith(f"{file}: ")
            assert "\n" not in said
            assert len(said) < len(str(file)) + 220
    assert 5 < read < 300
