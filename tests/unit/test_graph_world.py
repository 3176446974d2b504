"""Worlds with a graph: how they are loaded, where robots are in them, who hears whom, what robots are told."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from PIL import Image

from agent.behaviours.reconnection.environments import KINDS
from channels.graphs import Graph, hearing, starts
from channels.medium import Medium
from channels.messages import Hello, MotionCommand, RadioPlan, decode_hello, encode
from channels.randomness import Draws, stable_key
from channels.settings import RadioSettings, TdmaSettings
from channels.units import NS_PER_S
from emulator.assemble import make_hellos, make_medium, rng_seeds
from emulator.cli import main
from emulator.errors import UserError
from emulator.run import Options, run
from emulator.scenario import (
    CommandedMotion,
    RobotSpec,
    Scenario,
    area_m,
    numbered_ids,
    obstacles,
    resolved_json,
    team,
    world_graph,
)
from emulator.scenario_file import from_resolved, load
from emulator.slots import connectivity
from emulator.world import World
from logs.reader import LogReader
from logs.recorder import Recorder
from tests.traffic import BYTE_A_NANOSECOND, Send, medium_of, play

S = NS_PER_S
# A path 0 - 1 - 2 along y = 1 and a spur from 0 to 3.
ELL = Graph(
    vertices=((1.0, 1.0), (3.0, 1.0), (5.0, 1.0), (1.0, 3.0)), edges=((0, 1, 2.0), (1, 2, 2.0), (0, 3, 2.0))
)
FILE = {"vertices": [[1, 1], [3, 1], [5, 1], [1, 3]], "edges": [[0, 1, 2], [1, 2, 2], [0, 3, 2]]}
GENERATORS = '''
from channels.graphs import Graph


def ring(vertices, seed, reach=1.0, *, broken=False):
    """A zigzag, closed to a ring."""
    print("generating")
    if vertices < 3:
        raise ValueError(f"vertices: a ring has 3 at least, not {vertices}")
    if broken:
        raise ValueError("nothing fits")
    return Graph(
        vertices=tuple((1.0 + i, 1.0 + (i % 2) + seed) for i in range(vertices)),
        edges=tuple((i, i + 1, reach) for i in range(vertices - 1)),
    )


def numbers(seed):
    import numpy as np
    return Graph(vertices=np.array([[1, 1], [2, 1]]), edges=[[np.int64(0), 1, np.float32(1)]])


def nothing(seed): ...
def dies(seed): raise KeyError("where")
def shapeless(seed): return Graph(vertices=(1, 2), edges=())
def seedless(): ...


async def still(robot): robot.log("graph", {"vertices": robot.graph.vertices, "links": robot.graph.links})
'''
BASE = """
behaviour = "gen.py:still"
robots = 2
seed = 3
[run]
duration_s = 5
[world]
placement = "graph"
motion = { kind = "commanded", max_speed_mps = 5.0 }
[world.graph]
generator = "gen.py:ring"
args = { vertices = 6 }
scale_m = 2.0
[radio]
link = "graph"
"""
OF_FILE = BASE.replace('generator = "gen.py:ring"\nargs = { vertices = 6 }', 'file = "ell.json"')
INLINE = OF_FILE.replace('file = "ell.json"', f"vertices = {FILE['vertices']}\nedges = {FILE['edges']}")


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("gen.py").write_text(GENERATORS)
    Path("ell.json").write_text(json.dumps(FILE))


def loaded(text: str = BASE, *overrides: str, **changes: int) -> Scenario:
    Path("x.toml").write_text(text)
    return load("x.toml", overrides=overrides, **changes)


def complaint(text: str, *overrides: str, **changes: int) -> str:
    with pytest.raises(UserError) as caught:
        loaded(text, *overrides, **changes)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def graph(text: str = BASE, *overrides: str, **changes: int) -> Graph:
    found = world_graph(loaded(text, *overrides, **changes))
    assert found is not None
    return found


# --- loading -----------------------------------------------------------------------------------------


def test_a_generator_is_given_its_arguments_and_the_seed_and_its_graph_is_scaled(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert graph() == Graph(
        vertices=tuple((2.0 + 2.0 * i, 8.0 + 2.0 * (i % 2)) for i in range(6)),
        edges=tuple((i, i + 1, 2.0) for i in range(5)),
    )
    assert capsys.readouterr().out == ""
    assert graph(BASE, seed=5).vertices[0] == (2.0, 12.0)
    assert graph(BASE, "world.graph.args.seed=0").vertices[0] == (2.0, 2.0)
    assert len(graph(BASE, "world.graph.args.vertices=4").vertices) == 4
    assert graph(BASE, "world.graph.args.reach=1.5").edges[0] == (0, 1, 3.0)


def test_a_generator_may_work_with_numpy() -> None:
    found = graph(BASE.replace("ring", "numbers").replace("vertices = 6", ""))
    assert found == Graph(vertices=((2.0, 2.0), (4.0, 2.0)), edges=((0, 1, 2.0),))
    assert {type(number) for edge in found.edges for number in edge} == {int, float}
    assert msgspec.convert(msgspec.json.decode(msgspec.json.encode(found)), Graph) == found


def test_a_generator_that_has_changed_is_asked_anew() -> None:
    assert graph().edges[0][2] == 2.0
    Path("gen.py").write_text(GENERATORS.replace("reach=1.0", "reach=7.25"))
    assert graph().edges[0][2] == 14.5


def test_a_file_an_inline_graph_and_what_a_log_carries_are_one_and_the_same() -> None:
    of_file, inline = loaded(OF_FILE), loaded(INLINE)
    doubled = Graph(
        vertices=((2.0, 2.0), (6.0, 2.0), (10.0, 2.0), (2.0, 6.0)),
        edges=((0, 1, 4.0), (1, 2, 4.0), (0, 3, 4.0)),
    )
    assert world_graph(of_file) == world_graph(inline) == doubled
    carried = resolved_json(of_file)
    assert carried == resolved_json(inline)
    for name in ("ell.json", "x.toml"):
        Path(name).unlink()
    again = from_resolved(carried, Path.cwd())
    assert world_graph(again) == doubled
    assert resolved_json(again) == carried


def test_a_file_may_be_anywhere(tmp_path: Path) -> None:
    (tmp_path / "deeper").mkdir()
    (tmp_path / "ell.json").rename(tmp_path / "deeper" / "ell.json")
    for name in ("deeper/ell.json", str(tmp_path / "deeper" / "ell.json")):
        assert len(graph(OF_FILE, f"world.graph.file={name}").vertices) == 4


def test_what_a_file_may_hold_besides() -> None:
    more = {"links": [[0, 2]], "starts": [2, 0], "obstacles": [[1, 1.5, 2, 2.5]]}
    Path("ell.json").write_text(json.dumps(FILE | more))
    scenario = loaded(OF_FILE)
    found = world_graph(scenario)
    assert found is not None
    assert (found.links, found.starts) == (((0, 2),), (2, 0))
    assert found.obstacles == ((2.0, 3.0, 4.0, 5.0),)
    assert obstacles(loaded(OF_FILE, "world.obstacles=[[0, 0, 1, 1]]")) == [(0, 0, 1, 1), (2, 3, 4, 5)]
    assert [spec.position_m for spec in team(scenario)] == [(10.0, 2.0), (2.0, 2.0)]
    assert [spec.position_m for spec in team(loaded(OF_FILE, "world.graph.starts=[1, 3]"))] == [
        (6, 2),
        (2, 6),
    ]


def test_links_by_distance_and_sight() -> None:
    # In metres the vertices of the file are 4 apart along the path and the spur, 2 and 3 are 8.9.
    def links(*overrides: str) -> set[tuple[int, int]]:
        return set(graph(OF_FILE, *overrides).links or ())

    near = {(0, 1), (1, 2), (0, 3)}
    assert links("world.graph.heard_m=3.99") == set()
    assert links("world.graph.heard_m=4") == near
    assert links("world.graph.heard_m=6") == near | {(1, 3)}
    assert links("world.graph.heard_m=100") == {(a, b) for b in range(4) for a in range(b)}
    wall = "world.obstacles=[[4, 1, 4.5, 3]]"
    assert links("world.graph.heard_m=4", wall) == near - {(0, 1)}
    Path("ell.json").write_text(json.dumps(FILE | {"obstacles": [[2, 0.5, 2.25, 1.5]], "links": [[2, 3]]}))
    assert links("world.graph.heard_m=4") == near - {(0, 1)}
    assert links() == {(2, 3)}


def test_the_area_has_as_much_room_behind_the_graph_as_before_it() -> None:
    assert area_m(loaded(OF_FILE)) == (12.0, 8.0)
    assert area_m(loaded(OF_FILE, "world.area_m=[10, 60]")) == (10.0, 60.0)
    Path("ell.json").write_text('{"vertices": [[0, 0], [4, 0]], "edges": [[0, 1, 4]]}')
    assert area_m(loaded(OF_FILE)) == (8.0, 0.001)


def test_robots_start_where_the_graph_says() -> None:
    scenario = loaded(BASE, robots=4)
    found = world_graph(scenario)
    assert found is not None
    assert [spec.position_m for spec in team(scenario)] == [found.vertices[v] for v in starts(found, 4)]
    group = '[[group]]\nname = "some"\nrobots = 1\nplacement = "graph"'
    mixed = loaded(BASE.replace('"graph"', '"uniform"', 1).replace('link = "graph"', "range_m = 9") + group)
    at = [spec.position_m in found.vertices for spec in team(mixed)]
    assert sorted(at) == [False, True]


def test_one_source_takes_the_others_place() -> None:
    assert graph(BASE, "world.graph.file=ell.json") == graph(OF_FILE)
    assert graph(INLINE, "world.graph.file=ell.json") == graph(OF_FILE)
    assert graph(OF_FILE, "world.graph.generator=gen.py:ring", "world.graph.args.vertices=6") == graph()
    assert graph(BASE, "world.graph.vertices=[[1, 1], [2, 2]]", "world.graph.edges=[[0, 1, 1]]").vertices == (
        (2.0, 2.0),
        (4.0, 4.0),
    )


def test_check_tells_of_the_graph(capsys: pytest.CaptureFixture[str]) -> None:
    Path("x.toml").write_text(OF_FILE)
    assert main(["check", "x.toml", "--set", "world.graph.scale_m=1"]) == 0
    of_graph = "a graph of 4 vertices and 3 edges"
    assert capsys.readouterr().out == f"x: fine; 2 robots on 6.0 m x 4.0 m, {of_graph}, at most 5 s\n"


SOURCE = 'generator = "gen.py:ring"\nargs = { vertices = 6 }'


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (SOURCE, "", "missing key world.graph.file: name a JSON file, or a world.graph.generator, or give world.graph.vertices and world.graph.edges"),
        (SOURCE, f'{SOURCE}\nfile = "ell.json"', "world.graph.generator: world.graph.file says what the graph is; keep one of them"),
        (SOURCE, 'file = "ell.json"\nargs = { a = 1 }', "world.graph.args: only a generator takes them; leave them out, or set world.graph.generator"),
        (SOURCE, f"{SOURCE}\nedges = [[0, 1, 1]]", "world.graph.edges: belong to world.graph.vertices; leave them out"),
        (SOURCE, "vertices = [[1, 1], [2, 1]]\nedges = [[0, 1]]", "world.graph.edges[0]: must be a list of a whole number, a whole number and a number, is [0,1]"),
        (SOURCE, "vertices = 3", "world.graph.vertices: must be a list of lists of 2 numbers, is 3"),
        (SOURCE, "vertices = [[1, 1]]", "world.graph.vertices: there are 1; a graph has 2 to 10000"),
        (SOURCE, "vertices = [[1, 1], [2, 1]]", "world.graph.edges: no way leads from vertex 0 to vertex 1, nor to 0 others"),
        (SOURCE, "vertices = [[1, 1], [2, 1]]\nedges = [[0, 1, 0]]", "world.graph.edges[0]: its length must be a number greater than 0, is 0.0"),
        (SOURCE, "vertices = [[-1, 1], [2, 1]]\nedges = [[0, 1, 1]]", "world.graph.vertices: has a vertex at -2 m, and the area begins at 0; move the graph up or to the right"),
        (SOURCE, "vertices = [[1, 1], [1, 1]]\nedges = [[0, 1, 1]]", "world.graph.vertices: has vertices 0 and 1 at one place; move one, or raise world.graph.scale_m"),
        ("scale_m = 2.0", "scale_m = 1e7", "world.graph.scale_m: needs an area with sides of 9e+07 m, possible are 1e+07 m; lower it"),
        ("scale_m = 2.0", "scale_m = 1e308", "world.graph.scale_m: is 1e+308, with which vertices[0]: [1e+308, inf] are not both finite numbers"),
        ("scale_m = 2.0", "scale_m = 0", "world.graph.scale_m: must be a number of metres greater than 0, is 0"),
        ("vertices = 6", "", "missing key world.graph.args.vertices: gen.py:ring needs it"),
        ("vertices = 6", "vertices = 2", "world.graph.args.vertices: a ring has 3 at least, not 2"),
        ("vertices = 6", "vertices = 2500", "world.graph.generator: has 2500 vertices, possible are 2000; make the graph smaller"),
        ("vertices = 6", "vertices = 6, broken = true", "world.graph.generator: gen.py:ring fails: nothing fits"),
        ("vertices = 6", "vertices = 6, rich = 2", "unknown key world.graph.args.rich, did you mean reach?"),
        ("vertices = 6", "vertices = 6, x = 2", "unknown key world.graph.args.x, possible are broken, reach, seed, vertices"),
        ("vertices = 6", "vertices = 6, reach = -1", "world.graph.generator: gen.py:ring: edges[0]: its length must be a number greater than 0, is -1.0"),
        (SOURCE, 'generator = "gen.py:rong"', "world.graph.generator: gen.py has no function 'rong'; mend it, or name another function"),
        (SOURCE, 'generator = "gan.py:ring"', "world.graph.generator: there is no file gan.py beside the scenario; mend it, or name another function"),
        (SOURCE, 'generator = "ring"', "world.graph.generator: 'ring' names no function; write module:function or file.py:function; mend it, or name another function"),
        (SOURCE, 'generator = "gen.py:nothing"', "world.graph.generator: gen.py:nothing returns a NoneType instead of a Graph; name another function"),
        (SOURCE, 'generator = "gen.py:dies"', "world.graph.generator: gen.py:dies fails with KeyError: 'where'; mend it"),
        (SOURCE, 'generator = "gen.py:shapeless"', "world.graph.generator: gen.py:shapeless returns no proper Graph (cannot unpack non-iterable int object); mend it"),
        (SOURCE, 'generator = "gen.py:seedless"', "world.graph.generator: gen.py:seedless takes no seed; give it that argument"),
        (SOURCE, 'file = "el.json"', "world.graph.file: there is no file el.json in {folder}, did you mean ell.json?"),
        (SOURCE, 'file = "x"', "world.graph.file: there is no file x in {folder}, give its path relative to the scenario file"),
        (SOURCE, 'file = "."', "world.graph.file: . cannot be read (Is a directory); name a JSON file"),
        (SOURCE, 'file = "gen.py"', "world.graph.file: gen.py is not valid JSON (JSON is malformed: invalid character (byte 6)); mend it"),
        (SOURCE, f"{SOURCE}\nfils = 1", "unknown key world.graph.fils, did you mean file?"),
        ('placement = "graph"', 'placement = "graph"\nneighbours = 3', "world.neighbours: world.graph sets the size of the area as well; keep one of them"),
        ('placement = "graph"', 'placement = "graph"\narea_m = [9, 99]', "world.area_m: [9, 99] does not hold world.graph, which reaches to [12, 10]; leave it out, or enlarge it"),
        ('placement = "graph"', 'placement = "graph"\nobstacles = [[1, 1, 2, 2], [2, 1, 1, 3]]', "world.obstacles[1]: must be [x0, y0, x1, y1] with x0 < x1 and y0 < y1, is [2, 1, 1, 3]"),
        ('placement = "graph"', 'placement = "graph"\nobstacles = [1]', "world.obstacles[0]: must be a list of 4 numbers, is 1"),
        ("robots = 2", "robots = 7", "world.placement: 7 robots cannot start at 6 different vertices; take fewer, or a larger graph"),
        ("scale_m = 2.0", "starts = [0]", "world.graph.starts: names 1 vertices for 2 robots; name more"),
        ("scale_m = 2.0", "starts = [0, 9]", "world.graph.starts[1]: there is no vertex 9; they are 0 to 5"),
        ('link = "graph"', "", "missing key radio.range_m: must be a number of metres greater than 0"),
        ('link = "graph"', 'link = "graph"\nline_of_sight = true', 'radio.line_of_sight: goes with radio.link = "disc"; leave it out: with world.graph.heard_m, too, nobody is heard through an obstacle'),
        ("commanded\", max_", "bounce\", ", 'radio.link: is "graph", but robots that bounce stand at no vertex; set world.motion.kind to "commanded"'),
        ("robots = 2", 'robots = 2\nrobot = [{ id = "r01", position_m = [4, 4] }]', 'robot.r01.position_m: radio.link = "graph" needs robots that start at vertices; r01 does so at [4, 4], where none is; move it to one'),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_in_a_sentence(old: str, new: str, expected: str) -> None:
    assert BASE.count(old) == 1
    assert complaint(BASE.replace(old, new)) == f"x.toml: {expected.replace('{folder}', str(Path.cwd()))}"


@pytest.mark.parametrize(
    ("held", "expected"),
    [
        ('{"vertices": [[1, 1], [2, "a"]], "edges": []}', 'vertices[1][1]: must be a number, is "a"; write the bare number'),
        ('{"vertices": [[1, 1], [2]], "edges": []}', "vertices[1]: must be a list of 2 numbers, is [2]"),
        ('{"vertices": 1, "edges": []}', "vertices: must be a list of lists of 2 numbers, is 1"),
        ('{"vertices": [], "edges": [[0.5, 1, 1]]}', "edges[0][0]: must be a whole number, is 0.5"),
        ('{"edges": []}', "missing key vertices: must be a list of lists of 2 numbers"),
        ('{"vertics": [], "edges": []}', "unknown key vertics, did you mean vertices?"),
        ('{"vertices": [[1, 1], [2, 1]], "edges": [[0, 1, 1]], "starts": [5]}', "starts[0]: there is no vertex 5; they are 0 to 1"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_file_is_told_with_its_place(held: str, expected: str) -> None:
    Path("ell.json").write_text(held)
    assert complaint(OF_FILE) == f"x.toml: world.graph.file: ell.json: {expected}"


def test_a_file_that_is_no_object() -> None:
    Path("ell.json").write_text("[1]")
    expected = 'ell.json must be an object, {"vertices": [...], "edges": [...]}'
    assert complaint(OF_FILE) == f"x.toml: world.graph.file: {expected}"


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("world.graph.args.vertices=2", "--set world.graph.args.vertices=2: a ring has 3 at least, not 2"),
        ("world.graph.args.vertices=two", '--set: world.graph.args.vertices: must be a whole number like the 6 in the file, is "two"'),
        ("world.graph.args.vertices.x=2", "--set: world.graph.args: holds no keys that could be set singly; set it as a whole"),
        ("world.graph.arg.vertices=2", "--set: unknown key world.graph.arg, did you mean args?"),
        ("world.graph.file=no.json", "--set world.graph.file=no.json: there is no file no.json in {folder}, did you mean ell.json?"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_an_override(override: str, expected: str) -> None:
    assert complaint(BASE, override) == expected.replace("{folder}", str(Path.cwd()))


# In metres the vertices of the file are at (2, 2), (6, 2), (10, 2) and (2, 6).
SIGHT = ("radio.link=disc", "radio.range_m=9", "radio.line_of_sight=true")
LEAVE = "from where nobody elsewhere is heard; move it, or leave these vertices out"


@pytest.mark.parametrize("seen", [SIGHT, ("world.graph.heard_m=9",), (*SIGHT, "world.graph.heard_m=9")])
@pytest.mark.parametrize(
    ("held", "expected"),
    [
        ("[1, 1, 3, 3]", f"[1]: holds vertex 0 of world.graph, {LEAVE.replace('these vertices', 'this vertex')}"),
        ("[1, 1, 7, 3]", f"[1]: holds vertices 0 and 1 of world.graph, {LEAVE}"),
        ("[1, 1, 11, 3]", f"[1]: holds vertices 0, 1 and 2 of world.graph, {LEAVE}"),
        ("[1, 1, 11, 7]", f"[1]: holds vertices 0, 1 and 2 more of world.graph, {LEAVE}"),
    ],
)  # fmt: skip
def test_no_obstacle_makes_vertices_deaf(seen: tuple[str, ...], held: str, expected: str) -> None:
    override = f"world.obstacles=[[0, 0, 1, 1], {held}]"
    assert complaint(OF_FILE, *seen, override) == f"--set {override}: world.obstacles{expected}"
    loaded(OF_FILE, override)  # where sight does not matter
    loaded(OF_FILE, "radio.link=disc", "radio.range_m=9", override)


@pytest.mark.parametrize("seen", [SIGHT, ("world.graph.heard_m=9",)])
def test_obstacles_beside_vertices_are_fine(seen: tuple[str, ...]) -> None:
    loaded(OF_FILE, *seen, "world.obstacles=[[2, 1, 6, 3], [2, 5, 3, 6], [0, 0, 1.999, 8]]")


@pytest.mark.parametrize("seen", [SIGHT, ("world.graph.heard_m=9",)])
def test_nor_does_one_of_the_graphs_own(seen: tuple[str, ...]) -> None:
    Path("ell.json").write_text(json.dumps(FILE | {"obstacles": [[4, 0.5, 6, 1.5]]}))
    loaded(OF_FILE)
    why = LEAVE.replace("these vertices", "this vertex")
    assert complaint(OF_FILE, *seen).endswith(
        f": world.graph.obstacles[0]: holds vertex 2 of world.graph, {why}"
    )


@pytest.mark.parametrize("kind", KINDS)
def test_environments_may_have_walls(kind: str) -> None:
    text = BASE.replace("gen.py:ring", "agent.behaviours.reconnection.environments:environment")
    walls = 0
    for seed, vertices in ((1, 150), (2, 60), (3, 7)):
        size = f"world.graph.args={{kind='{kind}', vertices={vertices}}}"
        for seen in (SIGHT, ("world.graph.heard_m=3",)):
            walls += len(obstacles(loaded(text, size, *seen, seed=seed)))
    assert (walls > 0) == (kind in ("gridholes", "maze"))


def test_images_may_have_walls() -> None:
    pixels = np.full((60, 80), 255, dtype=np.uint8)
    pixels[np.random.default_rng(5).random(pixels.shape) < 0.15] = 0
    pixels[:, 33] = pixels[20] = 0
    pixels[5:9, 33] = pixels[20, 50:55] = 255
    Image.fromarray(pixels).save("map.png")
    text = BASE.replace("gen.py:ring", "agent.behaviours.reconnection.occupancy:occupancy")
    for cell in (2, 5, 9):
        for seen in (SIGHT, ("world.graph.heard_m=5",)):
            scenario = loaded(text, f"world.graph.args={{image='map.png', cell={cell}}}", *seen)
            assert len(obstacles(scenario)) > 100


@pytest.mark.parametrize("key", ["link", "placement"])
def test_what_needs_a_graph_says_so(key: str) -> None:
    text = BASE[: BASE.index("[world.graph]")].replace("[world]", "[world]\narea_m = [9, 9]")
    if key == "link":
        text = text.replace('placement = "graph"', "") + '[radio]\nlink = "graph"'
        expected = "radio.link"
    else:
        text += "[radio]\nrange_m = 9"
        expected = "world.placement"
    assert complaint(text) == f'x.toml: {expected}: is "graph", but the world has none; add [world.graph]'


# --- what robots are told ----------------------------------------------------------------------------


def test_robots_are_told_the_graph() -> None:
    scenario = loaded(OF_FILE)
    specs = team(scenario)
    for hello in make_hellos(scenario, specs, make_medium(scenario, specs), None):
        assert hello.graph == world_graph(scenario)
        assert decode_hello(encode(hello)) == hello
    assert (
        decode_hello(encode(Hello("a", "", {}, 1, 0, (0.0, 0.0, 0.0), RadioPlan(9, 0, None, 1), 1))).graph
        is None
    )


def test_seeds_of_generators_are_of_the_seed_and_the_id() -> None:
    scenario = loaded(OF_FILE)
    specs = team(scenario)
    hellos = make_hellos(scenario, specs, make_medium(scenario, specs), None)
    assert [spec.id for spec in specs] == numbered_ids(2)
    assert [hello.rng_seed for hello in hellos] == rng_seeds(3, numbered_ids(2))
    assert rng_seeds(3, ["r01"]) == [int(Draws(3, "robot generator").bits(stable_key("r01")))]
    assert len({*rng_seeds(3, numbered_ids(50)), *rng_seeds(4, numbered_ids(50))}) == 100


# --- places ------------------------------------------------------------------------------------------


def at(x: float, y: float, name: str = "a") -> RobotSpec:
    return RobotSpec(name, (x, y), 0.0, (0.0, 0.0), "m:f", {})


def world(*specs: RobotSpec) -> World:
    return World((9.0, 9.0), specs or (at(1, 1),), CommandedMotion(10.0), ELL)


def to(x: float, y: float, speed: float = 1.0) -> MotionCommand:
    return MotionCommand(towards_m=(x, y), speed_mps=speed)


def places(of: World, *times_s: float) -> list[int]:
    found = []
    for t_s in times_s:
        here = of.places(round(t_s * S))
        assert here is not None
        found.append(int(here[0]))
    return found


NS = 1e-9


def test_a_robot_is_where_it_left_until_it_arrives() -> None:
    some = world()
    some.command(0, 0, to(3, 1))
    assert places(some, 0, 1, 2 - NS, 2, 2 + NS, 100) == [0, 0, 0, 1, 1, 1]


def test_passing_through_is_not_being_there() -> None:
    some = world()
    some.command(0, 0, to(5, 1))
    assert places(some, 1, 2, 3, 4 - NS, 4) == [0, 0, 0, 0, 2]


def test_who_turns_round_has_not_been_away() -> None:
    some = world()
    some.command(0, 0, to(3, 1))
    assert places(some, 1.5) == [0]
    some.command(0, round(1.5 * S), to(1, 1))
    assert places(some, 1.5, 2, 3, 9) == [0, 0, 0, 0]
    some.command(0, 9 * S, to(5, 1))
    some.command(0, 12 * S, to(3, 1))  # past vertex 1 already, and back to it
    assert places(some, 12, 13 - NS, 13) == [0, 0, 1]


def test_who_stops_or_sets_out_at_a_vertex_has_been_there() -> None:
    some = world()
    some.command(0, 0, MotionCommand((1.0, 0.0)))
    assert places(some, 2 - NS) == [0]
    some.command(0, 2 * S, MotionCommand())
    assert places(some, 2, 3) == [1, 1]
    some.command(0, 3 * S, to(5, 1))
    some.command(0, 5 * S - 1, to(3, 1))  # a nanosecond early, by a clock that rounds
    assert places(some, 5 - NS, 6) == [2, 2]


def test_who_stops_in_between_stays_where_it_was() -> None:
    some = world()
    some.command(0, 0, to(3, 1))
    some.command(0, 1 * S, MotionCommand())
    assert places(some, 1, 50) == [0, 0]
    some.command(0, 50 * S, to(3, 1, 2.0))
    assert places(some, 50.5 - NS, 50.5) == [0, 1]


def test_who_has_been_at_no_vertex_has_no_place() -> None:
    some = world(at(2, 2))
    assert places(some, 0) == [-1]
    some.command(0, 0, to(1, 2))
    some.command(0, 10 * S, to(1, 3))
    assert places(some, 10, 11 - NS, 11) == [-1, -1, 3]


def test_places_are_one_array_while_they_last() -> None:
    some = world(at(1, 1), at(5, 1, "b"))
    first = some.places(0)
    assert first is not None
    assert first.tolist() == [0, 2]
    some.command(0, 0, to(3, 1))
    assert some.places(S) is first
    later = some.places(2 * S)
    assert later is not first
    assert some.places(3 * S) is later
    assert first.tolist() == [0, 2]
    with pytest.raises(ValueError, match="read-only"):
        first[0] = 3
    with pytest.raises(ValueError, match="before the latest command"):
        some.places(-1)
    assert World((9.0, 9.0), [at(1, 1)], CommandedMotion(1.0)).places(0) is None


# --- who hears whom ----------------------------------------------------------------------------------

CHANCES = np.random.default_rng(1)


def transmitted(medium: Medium, senders: list[int], places: list[int]) -> list[list[bool]]:
    robots = len(places)
    fates = medium.transmit(
        0, np.array(senders), np.zeros(len(senders), int), np.zeros(len(senders), int),
        np.zeros(len(senders), bool), CHANCES.random((robots, 2)) * 1e6, np.ones(robots, bool), None, np.array(places),
    )  # fmt: skip
    return (fates.reason == 0).tolist()  # type: ignore[no-any-return]


@pytest.mark.parametrize("links", [None, ((0, 2), (1, 3)), ()])
def test_robots_hear_each_other_by_their_places_alone(links: Any) -> None:
    chosen = msgspec.structs.replace(ELL, links=links)
    pairs = {(a, b) for a, b, _ in ELL.edges} if links is None else set(links)
    medium = Medium(RadioSettings(link="graph"), [f"r{i}" for i in range(6)], 1, graph=chosen)
    for _ in range(20):
        where = CHANCES.integers(-1, 4, 6).tolist()
        expected = [
            [
                a != b and -1 not in (where[a], where[b])
                and (where[a] == where[b] or bool({(where[a], where[b]), (where[b], where[a])} & pairs))
                for b in range(6)
            ]
            for a in range(6)
        ]  # fmt: skip
        assert transmitted(medium, [0, 1, 2, 3, 4, 5], where) == expected


def test_a_link_model_without_what_it_needs() -> None:
    with pytest.raises(ValueError, match="link is graph, but the world has none"):
        Medium(RadioSettings(link="graph"), ["a"], 1)
    with pytest.raises(ValueError, match="link is disc, but there is no range_m"):
        Medium(RadioSettings(), ["a"], 1)
    medium = medium_of(2, link="graph", graph=ELL)
    with pytest.raises(ValueError, match="needs the robots' places in it"):
        play(medium, [Send(0, 0, 5)], lambda _now: np.zeros((2, 2)))


def test_collisions_are_by_the_same_links() -> None:
    # At 3, 0, 1 and 2: a path; 3 and 1 are hidden from each other, and collide at 0.
    medium = medium_of(4, link="graph", graph=ELL, range_m=None)
    where = np.array([3, 0, 1, 2])
    together = np.zeros((4, 2))  # where they are does not matter
    heard = play(medium, [Send(0, 0, 10), Send(5, 2, 10)], lambda _now: together, lambda _now: where)
    assert heard[0, 0].reasons == ["not_a_candidate", "collision", "out_of_range", "out_of_range"]
    assert heard[2, 0].reasons == ["out_of_range", "collision", "not_a_candidate", "delivered"]


def test_slots_are_shared_by_the_same_links() -> None:
    specs = [at(*ELL.vertices[vertex], f"r{vertex}") for vertex in (3, 0, 1, 2, 2)]
    tdma = TdmaSettings(slot_s=10e-9, reuse="distance_two")
    radio = RadioSettings(None, "tdma", tdma, BYTE_A_NANOSECOND, link="graph")
    joined = connectivity(radio, specs, ELL)
    assert {tuple(sorted(edge)) for edge in joined.edges} == {(0, 1), (1, 2), (2, 3), (2, 4), (3, 4)}


# --- a run -------------------------------------------------------------------------------------------

WALK = '''
import asyncio
import numpy as np
from channels.graphs import neighbours, vertices_at


async def walk(robot):
    """At random along edges, with a word at every odd moment."""
    graph, ways = robot.graph, neighbours(robot.graph)
    (here,) = vertices_at(graph.vertices, np.array([robot.body.pose[:2]])).tolist()
    while True:
        there, length = ways[here][int(robot.rng.integers(len(ways[here])))]
        robot.body.go_to(*graph.vertices[there], length / 0.7)
        for _ in range(4):
            robot.radio.broadcast({"left": here})
            await asyncio.sleep(0.17)
        await asyncio.sleep(0.02)
        here = there
        robot.radio.broadcast({"left": here})
        await asyncio.sleep(float(robot.rng.random()))
'''


def test_a_run_delivers_by_places_that_follow_from_the_log_alone() -> None:
    Path("walk.py").write_text(WALK)
    text = OF_FILE.replace("gen.py:still", "walk.py:walk").replace("robots = 2", "robots = 4")
    scenario = loaded(text, "run.duration_s=20", "world.motion.max_speed_mps=9")
    out = Path("log.mcap")
    outcome = run(scenario, Options(out=out, fleet="in_process", echo=None))
    assert {"out_of_range"} == set(outcome.progress.dropped)
    found = world_graph(scenario)
    assert found is not None
    hears = hearing(found)
    names = numbered_ids(4)
    replayed = World(area_m(scenario), team(scenario), scenario.world.motion, found)
    with LogReader(out) as log:
        motions = [(t, r) for t, r in log.records("/truth") if r["kind"] == "motion"]
        radio = list(log.records("/radio"))
        scenes = [SceneUpdate.FromString(data) for _, _, _, data in log.raw({"/viz/world"})]
    checked = 0
    for t_ns, record in radio:
        while motions and motions[0][0] <= t_ns:
            when, move = motions.pop(0)
            command = MotionCommand(towards_m=tuple(move["towards_m"]), speed_mps=move["speed_mps"])
            replayed.command(names.index(move["robot"]), when, command)
        where = replayed.places(t_ns)
        assert where is not None
        sender = names.index(record["from"])
        assert where[sender] == record["payload"]["left"]
        expected = [
            names[other] for other in range(4) if other != sender and hears[where[sender], where[other]]
        ]
        assert record["delivered"] == expected
        checked += len(expected)
    assert checked == outcome.progress.delivered > 100
    assert [len(scene.entities[0].lines[0].points) for scene in scenes] == [4] * len(scenes)


# --- viewers -----------------------------------------------------------------------------------------


def test_viewers_are_shown_the_graph_and_obstacles_over_and_over() -> None:
    poses, lamps = np.zeros((1, 3)), np.zeros(1, np.uint8)
    with Recorder(Path("a.mcap"), ["a"], graph=ELL, obstacles=[(1.0, 2.0, 3.0, 6.0)]) as recorder:
        for second in range(12):
            recorder.scene(second * S, poses, lamps)
    with LogReader(Path("a.mcap")) as log:
        scenes = [(t, SceneUpdate.FromString(data)) for _, _, t, data in log.raw({"/viz/world"})]
    assert [t for t, _ in scenes] == [0, 10 * S]
    for t, scene in scenes:
        (entity,) = scene.entities
        assert (entity.id, entity.frame_id, entity.timestamp.seconds) == ("world", "world", t // S)
        (lines,) = entity.lines
        assert lines.type == LinePrimitive.LINE_LIST
        assert [(p.x, p.y) for p in lines.points] == list(ELL.vertices)
        assert list(lines.indices) == [0, 1, 1, 2, 0, 3]
        (cube,) = entity.cubes
        assert (cube.pose.position.x, cube.pose.position.y, cube.size.x, cube.size.y) == (2, 4, 2, 4)


def test_a_world_without_either_is_not_drawn() -> None:
    with Recorder(Path("a.mcap"), ["a"]) as recorder:
        recorder.scene(0, np.zeros((1, 3)), np.zeros(1, np.uint8))
    with LogReader(Path("a.mcap")) as log:
        assert log.topics["/viz/world"].messages == 0
