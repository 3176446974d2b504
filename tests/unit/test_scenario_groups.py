"""Groups: who is in one, what that changes, and that a log knows nothing of them and needs nothing."""

from __future__ import annotations

import math
from collections import Counter
from fractions import Fraction
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import orjson
import pytest
from hypothesis import given
from hypothesis import strategies as st

from channels.randomness import Draws, stable_key
from emulator.errors import InvalidError, UserError
from emulator.groups import GroupSettings, group_of_each, size
from emulator.scenario import RobotSpec, Scenario, Settings, groups, resolved_json, team
from emulator.scenario_checks import check
from emulator.scenario_file import from_resolved, load
from emulator.verify import verify
from emulator.world import World
from logs.reader import LogReader
from tests.support import run_scenario

STANDING = {"kind": "bounce", "speed_mps": 0}
MOBILE = {"name": "mobile", "share": 0.05, "placement": "uniform", "speed_mps": 2.8}


def settings(world: dict[str, Any] | None = None, **keys: Any) -> Settings:
    raw: dict[str, Any] = {
        "behaviour": "module:function",
        "robots": 10,
        "run": {"duration_s": 1},
        "world": {"area_m": [64, 64]} | (world or {}),
        "radio": {"range_m": 16},
    }
    made = msgspec.convert(raw | keys, Settings)
    check(made)
    return made


def names(of: Settings) -> dict[str, list[str]]:
    """Members of every group, in robot order."""
    found: dict[str, list[str]] = {}
    for robot, group in groups(of).items():
        found.setdefault(group.name, []).append(robot)
    return found


def mixed(seed: int = 1) -> Settings:
    world = {"placement": "jittered_grid", "motion": STANDING}
    return settings(world, robots=256, group=[MOBILE], seed=seed)


# Who is in a group


@pytest.mark.parametrize("share", [0.0, 0.05, 0.125, 0.285, 0.35, 1 / 3, 0.5, 0.615, 1.0])
@pytest.mark.parametrize("robots", [1, 2, 3, 10, 100, 256, 1000])
def test_shares_are_rounded_halves_up(share: float, robots: int) -> None:
    exact = Fraction(repr(share)) * robots
    found = size(GroupSettings("a", share=share), robots)
    assert abs(found - exact) <= Fraction(1, 2)
    if abs(found - exact) == Fraction(1, 2):
        assert found > exact


def test_a_share_is_the_number_that_is_written() -> None:
    assert 0.285 * 100 < 28.5
    assert size(GroupSettings("a", share=0.285), 100) == 29
    assert size(GroupSettings("a", share=0.05), 256) == 13
    assert size(GroupSettings("a", robots=7), 3) == 7


def test_members_are_those_with_the_smallest_draws() -> None:
    ids = [f"r{number:02d}" for number in range(40)]
    draws = {name: int(Draws(5, "groups").bits(stable_key(name))) for name in ids}
    parts = [GroupSettings("a", robots=3), GroupSettings("b", robots=0), GroupSettings("c", share=0.25)]
    found = group_of_each(parts, 5, ids)
    assert list(found) == ids
    for name, group in found.items():
        smaller = sum(draws[name] > other for other in draws.values())
        assert group.name == ("a" if smaller < 3 else "c" if smaller < 13 else "")


teams = st.lists(st.from_regex(r"[a-z0-9]{1,6}", fullmatch=True), min_size=1, max_size=30, unique=True)


@given(teams, st.lists(st.integers(0, 10), max_size=4), st.integers(0, 2**63 - 1), st.randoms())
def test_groups_have_their_sizes_whatever_the_order_of_the_team(
    ids: list[str], counts: list[int], seed: int, random: Any
) -> None:
    counts = [count for place, count in enumerate(counts) if sum(counts[: place + 1]) <= len(ids)]
    while sum(counts) > len(ids):
        counts.pop()
    parts = [GroupSettings(f"g{place}", robots=count) for place, count in enumerate(counts)]
    found = group_of_each(parts, seed, ids)
    sizes = Counter(group.name for group in found.values())
    assert [sizes[part.name] for part in parts] == counts
    shuffled = random.sample(ids, len(ids))
    assert group_of_each(parts, seed, shuffled) == found


@given(teams, st.integers(0, 2**63 - 1), st.data())
def test_a_larger_group_keeps_its_members(ids: list[str], seed: int, data: st.DataObject) -> None:
    larger = data.draw(st.integers(0, len(ids)))
    smaller = data.draw(st.integers(0, larger))
    few, many = (
        {name for name, group in group_of_each([GroupSettings("a", robots=count)], seed, ids).items() if group.name}
        for count in (smaller, larger)
    )  # fmt: skip
    assert few <= many


def test_another_robot_takes_at_most_one_place() -> None:
    ten, eleven = (
        set(names(settings(robots=robots, group=[{"name": "a", "robots": 4}]))["a"]) for robots in (10, 11)
    )
    assert len(ten - eleven) <= 1
    assert eleven - ten <= {"r10"}


def test_every_robot_is_as_likely_a_member() -> None:
    counts: Counter[str] = Counter()
    for seed in range(400):
        counts.update(names(settings(robots=20, seed=seed, group=[{"name": "a", "robots": 5}]))["a"])
    # 100 expected of each, standard deviation 8.7
    assert len(counts) == 20
    assert min(counts.values()) > 60
    assert max(counts.values()) < 140


# What it changes


def test_mobile_robots_replace_robots_of_a_jittered_grid() -> None:
    of = mixed()
    specs = {spec.id: spec for spec in team(of)}
    mobile = names(of)["mobile"]
    assert len(mobile) == 13
    alone = {spec.id: spec for spec in team(settings(robots=256))}
    for index, (name, spec) in enumerate(specs.items()):
        x, y = spec.position_m
        if name in mobile:
            assert spec.position_m == alone[name].position_m  # uniform: as if there were no grid
            assert math.hypot(*spec.velocity_mps) == pytest.approx(2.8, abs=1e-8)
        else:
            assert (int(x // 4), int(y // 4)) == (index % 16, index // 16)
            assert spec.velocity_mps == (0, 0)
        assert spec.heading_rad == pytest.approx(alone[name].heading_rad, abs=2e-9)


def test_mobile_robots_are_spread_over_the_team() -> None:
    # Quarters of the grid by rows: 13 draws without replacement, so about 3 to a quarter.
    quarters = np.zeros(4)
    for seed in range(50):
        members = set(names(mixed(seed))["mobile"])
        quarters += np.histogram([k for k, spec in enumerate(team(mixed(seed))) if spec.id in members],
                                 bins=4, range=(0, 256))[0]  # fmt: skip
    assert quarters.sum() == 50 * 13
    assert abs(quarters - 162.5).max() < 50  # standard deviation 11


def test_only_the_mobile_move() -> None:
    of = mixed()
    specs = team(of)
    world = World((64.0, 64.0), specs, of.world.motion)
    start, later = world.poses(0), world.poses(7_300_000_000)
    mobile = [spec.id in names(of)["mobile"] for spec in specs]
    assert (np.linalg.norm(later - start, axis=1) > 0).tolist() == mobile
    assert start[:, 2].tolist() == [spec.heading_rad for spec in specs]


def test_groups_on_grids_keep_the_cells_of_the_whole_team() -> None:
    whole = {spec.id: spec.position_m for spec in team(settings({"placement": "grid"}))}
    of = settings(group=[{"name": "a", "robots": 4, "placement": "grid"}])
    uniform = {spec.id: spec.position_m for spec in team(settings())}
    for spec in team(of):
        expected = whole if spec.id in names(of)["a"] else uniform
        assert spec.position_m == expected[spec.id]


def test_what_a_group_leaves_out_is_as_for_all() -> None:
    world = {"motion": {"kind": "bounce", "speed_mps": 1.5}, "placement": "jittered_grid"}
    assert team(settings(world, group=[{"name": "a", "share": 0.5}])) == team(settings(world))


def test_standing_groups_where_others_move() -> None:
    of = settings(
        {"motion": {"kind": "bounce", "speed_mps": 1.5}}, group=[{"name": "a", "robots": 4, "speed_mps": 0}]
    )
    speeds = Counter(round(math.hypot(*spec.velocity_mps), 6) for spec in team(of))
    assert speeds == {0.0: 4, 1.5: 6}
    assert not np.signbit([spec.velocity_mps for spec in team(of) if spec.velocity_mps == (0, 0)]).any()


def observers(**group: Any) -> dict[str, Any]:
    return {"name": "observers", "robots": 10, "behaviour": "a:observe", "params": {"b": 2, "c": 2}} | group


def test_params_of_robot_over_group_over_scenario() -> None:
    own = {"id": "r03", "params": {"c": 3, "d": 3}, "behaviour": "b:own"}
    of = settings(params={"a": 1, "b": 1}, group=[observers()], robot=[own])
    specs = {spec.id: spec for spec in team(of)}
    assert (specs["r03"].behaviour, specs["r03"].params) == ("b:own", {"a": 1, "b": 2, "c": 3, "d": 3})
    assert (specs["r04"].behaviour, specs["r04"].params) == ("a:observe", {"a": 1, "b": 2, "c": 2})


def test_a_robots_own_table_overrides_its_group() -> None:
    own = {"id": "r03", "position_m": [1, 2], "velocity_mps": [0, 1]}
    moving = observers(placement="grid", speed_mps=2)
    of = settings({"motion": STANDING}, group=[moving], robot=[own, {"id": "r04", "heading_rad": 0.0}])
    specs = {spec.id: spec for spec in team(of)}
    assert (specs["r03"].position_m, specs["r03"].velocity_mps) == ((1, 2), (0, 1))
    assert specs["r04"].velocity_mps == (2, 0)


def test_groups_may_be_all_that_runs() -> None:
    everyone = [observers(robots=3), {"name": "rest", "robots": 7, "behaviour": "a:rest"}]
    assert Counter(spec.behaviour for spec in team(settings(behaviour=None, group=everyone))) == {
        "a:observe": 3,
        "a:rest": 7,
    }
    with pytest.raises(InvalidError, match=r"^missing key behaviour: r\d\d has nothing to run"):
        settings(behaviour=None, group=everyone[:1])
    with pytest.raises(InvalidError, match=r"^missing key behaviour"):
        settings(behaviour=None, group=[observers(behaviour=None)])


# Files, overrides, mistakes

BASE = """
behaviour = "my_robot.py:main"
robots = 12
[run]
duration_s = 3
[world]
area_m = [12, 12]
placement = "jittered_grid"
motion = { kind = "bounce", speed_mps = 0 }
[radio]
range_m = 16.0
[camera]
range_m = 6.0
[params]
tries = 3
mood = "calm"
[[group]]
name = "mobile"
share = 0.25
placement = "uniform"
speed_mps = 2.8
behaviour = "observer.py:main"
params = { drop_time = 20 }
"""
ROBOT = """
async def main(robot):
    async for step in robot.steps(period=0.5):
        robot.radio.broadcast({"tries": robot.params["tries"]})
        observed = await step.observe()
        robot.log("params", {**robot.params, "seen": len(observed.lit())})
"""


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path_factory.mktemp("scenario"))
    for name in ("my_robot.py", "observer.py"):
        Path(name).write_text(ROBOT)


def loaded(text: str = BASE, *overrides: str, **options: Any) -> Scenario:
    Path("x.toml").write_text(text)
    return load("x.toml", overrides=overrides, **options)


def complaint(text: str, *overrides: str) -> str:
    with pytest.raises(UserError) as caught:
        loaded(text, *overrides)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("share = 0.25", "shar = 0.25", "unknown key group.mobile.shar, did you mean share?"),
        ("share = 0.25", "colour = 1", "unknown key group.mobile.colour, possible are altitude_m, behaviour, name, params, placement, robots, share, speed_mps"),
        ("share = 0.25", "", "missing key group.mobile.robots: say how many robots it has, or group.mobile.share instead"),
        ("share = 0.25", "share = 0.25\nrobots = 3", "group.mobile.share: group.mobile.robots sets its size as well; keep one of them"),
        ("share = 0.25", "share = 25", "group.mobile.share: must be a number from 0 to 1, is 25"),
        ("share = 0.25", 'share = "25 %"', 'group.mobile.share: must be a number from 0 to 1, is "25 %"; write the bare number'),
        ("share = 0.25", "robots = -1", "group.mobile.robots: must be a whole number of at least 0, is -1"),
        ("share = 0.25", "robots = 0.5", "group.mobile.robots: must be a whole number of at least 0, is 0.5"),
        ("share = 0.25", "robots = 13", "group: needs 13 robots (mobile 13), the team has 12; make a group smaller"),
        ("[params]", '[[group]]\nname = "a"\nrobots = 10\n[params]', "group: needs 13 robots (a 10, mobile 3), the team has 12; make a group smaller"),
        ("[params]", '[[group]]\nname = "mobile"\nrobots = 1\n[params]', "group.name: 2 groups are called mobile; give each a name of its own"),
        ('name = "mobile"', "", "missing key group[0].name: must be a text in quotes"),
        ('name = "mobile"', 'name = "a.b"', 'group.name: "a.b" cannot be a group\'s name; use up to 32 letters, digits, - and _, of which the first is a letter or digit'),
        ('"bounce", speed_mps = 0', '"static"', 'group.mobile.speed_mps: only robots that bounce have one; set world.motion.kind to "bounce", or leave it out'),
        ("speed_mps = 2.8", "speed_mps = -1", "group.mobile.speed_mps: must be a number of metres per second from 0 to 10000, is -1"),
        ('"uniform"', '"unifrom"', 'group.mobile.placement: must be "graph" or "grid" or "jittered_grid" or "uniform", is "unifrom"; did you mean uniform?'),
        ("observer.py:main", "observer", 'group.mobile.behaviour: must look like "module:function" or "file.py:function", is "observer"'),
        ("robots = 12", "robots = 12\ngroup = 3", "group: must be [[group]] tables, is 3"),
    ],
)  # fmt: skip
def test_one_mistake_one_sentence(old: str, new: str, expected: str) -> None:
    assert BASE.count(old) == 1
    text = BASE.replace(old, new)
    if new.endswith("group = 3"):
        text = text[: text.index("[[group]]")]
    assert complaint(text) == f"x.toml: {expected}"


def test_a_behaviour_that_is_not_there() -> None:
    text = BASE.replace("observer.py", "observe.py")
    expected = f"there is no file observe.py in {Path.cwd()}; give its path relative to the scenario file"
    assert complaint(text) == f"x.toml: group.mobile.behaviour: {expected}"


def test_overrides() -> None:
    assert len(names(loaded())["mobile"]) == 3
    assert len(names(loaded(BASE, "group.mobile.share=0.5"))["mobile"]) == 6
    assert "mobile" not in names(loaded(BASE, "group.mobile.share=0"))
    assert len(names(loaded(BASE, robots=40))["mobile"]) == 10
    (group,) = loaded(BASE, "group.mobile.params.drop_time=30", "group.mobile.speed_mps=1").group
    assert (group.params, group.speed_mps) == ({"drop_time": 30}, 1.0)


def test_a_number_and_a_share_take_each_others_place() -> None:
    (group,) = loaded(BASE, "group.mobile.robots=4").group
    assert (group.robots, group.share) == (4, None)
    (group,) = loaded(BASE, "group.mobile.robots=4", "group.mobile.share=0.5").group
    assert (group.robots, group.share) == (None, 0.5)


def test_a_group_may_be_given_a_param_that_all_have() -> None:
    scenario = loaded(BASE, "group.mobile.params.tries=9")
    assert (scenario.params["tries"], scenario.group[0].params) == (3, {"drop_time": 20, "tries": 9})


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("group.mobil.share=0.1", "--set: unknown key group.mobil, did you mean mobile?"),
        ("group.mobile.shar=0.1", "--set: unknown key group.mobile.shar, did you mean share?"),
        ("group.mobile.share=2", "--set group.mobile.share=2: must be a number from 0 to 1, is 2"),
        ("group.mobile.share=5 %", '--set group.mobile.share=5 %: must be a number from 0 to 1, is "5 %"; write the bare number'),
        ("group.mobile.robots=13", "x.toml with --set group.mobile.robots=13: group: needs 13 robots (mobile 13), the team has 12; make a group smaller"),
        ("group.mobile.params.drop=1", "--set: unknown key group.mobile.params.drop, did you mean drop_time?"),
        ("group.mobile.params.colour=1", "--set: group.mobile.params.colour: x.toml has no such key under group.mobile.params or [params]; write it there, then --set can change it (there are drop_time, mood, tries)"),
        ("group.mobile.params.drop_time=a", '--set: group.mobile.params.drop_time: must be a whole number like the 20 in the file, is "a"'),
        ("group.mobile=1", "--set: group.mobile: is a table; set its keys singly, possible are altitude_m, behaviour, name, params, placement, robots, share, speed_mps"),
        ("group=1", "--set group=1: must be [[group]] tables, is 1"),
        ("world.motion.kind=static", 'x.toml with --set world.motion.kind=static: group.mobile.speed_mps: only robots that bounce have one; set world.motion.kind to "bounce", or leave it out'),
    ],
)  # fmt: skip
def test_one_mistaken_override_one_sentence(override: str, expected: str) -> None:
    assert complaint(BASE, override) == expected


def test_overrides_of_groups_that_are_not_there() -> None:
    without = BASE[: BASE.index("[[group]]")]
    expected = "--set: unknown key group.mobile, there are no [[group]] tables in the file"
    assert complaint(without, "group.mobile.share=0.1") == expected


# Logs

OWN = '[[robot]]\nid = "r05"\nparams = { tries = 7 }\nvelocity_mps = [0, 0]\n'


def test_resolved_and_back() -> None:
    scenario = loaded(BASE + OWN)
    written = resolved_json(scenario)
    assert "group" not in orjson.loads(written)
    again = from_resolved(written, scenario.folder, text=scenario.text)
    assert team(again) == team(scenario)
    assert resolved_json(again) == written


def test_resolved_holds_no_behaviour_that_nobody_runs() -> None:
    everyone = loaded(BASE, "group.mobile.share=1", "behaviour=my_robot.py:unused")
    assert orjson.loads(resolved_json(everyone))["behaviour"] is None
    assert orjson.loads(resolved_json(loaded()))["behaviour"] == "my_robot.py:main"


@pytest.mark.parametrize("overrides", [(), ("group.mobile.share=1",)])
def test_a_log_of_groups_comes_out_the_same(overrides: tuple[str, ...], tmp_path: Path) -> None:
    scenario = loaded(BASE + OWN, *overrides)
    out = tmp_path / "log.mcap"
    outcome = run_scenario("x.toml", out, "in_process", overrides=overrides)
    assert outcome.progress.delivered > 0
    with LogReader(out) as log:
        document = orjson.loads(log.run["resolved"])
        logged = {entry["robot"]: entry["data"] for _, entry in log.records("/robot")}
        start = next(record for _, record in log.records("/truth") if record["kind"] == "start")
    assert "group" not in document
    by_id = {spec.id: spec for spec in team(scenario)}
    assert {name: without_seen(data) for name, data in logged.items()} == {
        name: spec.params for name, spec in by_id.items()
    }
    for table, record in zip(document["robot"], start["robots"], strict=True):
        assert_complete(table, by_id[table["id"]], record)
    for name in ("my_robot.py", "observer.py", "x.toml"):
        Path(name).unlink()
    assert verify(out, "in_process", None) is None


def without_seen(data: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in data.items() if name != "seen"}


def assert_complete(table: dict[str, Any], spec: RobotSpec, record: dict[str, Any]) -> None:
    assert tuple(table["position_m"]) == tuple(record["position_m"]) == spec.position_m
    assert tuple(table["velocity_mps"]) == tuple(record["velocity_mps"]) == spec.velocity_mps
    assert table["heading_rad"] == record["heading_rad"] == spec.heading_rad
    assert table["behaviour"] == spec.behaviour
    assert spec.params == {"tries": 3, "mood": "calm"} | table["params"]
