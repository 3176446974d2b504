"""Loading scenarios: what is wrong with one is said in a sentence that names file, key and remedy."""

from __future__ import annotations

from pathlib import Path

import pytest

from channels.settings import BurstSettings, TdmaSettings, payload_limit
from emulator.cli import main
from emulator.errors import RunFailed, UserError
from emulator.scenario import BounceMotion, Scenario, StaticMotion, resolved_json, team
from emulator.scenario_file import from_resolved, load, shipped

BASE = """
title = "A test"
behaviour = "my_robot.py:roll_call"
robots = 3
[run]
duration_s = 60
[world]
area_m = [20, 10]
[radio]
range_m = 16.0
[params]
step_s = 0.5
tries = 3
mood = "calm"
list = [1]
table = { a = 1 }
"""
WRITE = "write it there, then --set can change it"
SLOTTED = 'range_m = 16.0\naccess = "tdma"'
RATED = f"{SLOTTED}\nbit_rate_bps = 3000"


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("my_robot.py").write_text("async def roll_call(robot): ...\n")


def loaded(text: str = BASE, *overrides: str, robots: int | None = None, seed: int | None = None) -> Scenario:
    Path("x.toml").write_text(text)
    return load("x.toml", robots=robots, seed=seed, overrides=overrides)


def complaint(text: str, *overrides: str, robots: int | None = None, seed: int | None = None) -> str:
    with pytest.raises(UserError) as caught:
        loaded(text, *overrides, robots=robots, seed=seed)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def edited(old: str, new: str) -> str:
    assert BASE.count(old) == 1
    return BASE.replace(old, new)


def test_what_a_scenario_holds(tmp_path: Path) -> None:
    scenario = loaded()
    assert (scenario.name, scenario.title, scenario.seed) == ("x", "A test", 1)
    assert scenario.text == BASE.encode()
    assert scenario.folder == tmp_path
    assert scenario.run.duration_s == 60.0
    assert scenario.camera is None
    assert scenario.lamp.colours == 1
    assert scenario.limits.answer_timeout_s == 30.0
    assert scenario.record.scene_rate_hz == 1.0
    assert scenario.params["table"] == {"a": 1}


def test_exit_codes() -> None:
    assert UserError.exit_code == 2
    assert RunFailed.exit_code == 1


def test_run_failed_says_who_and_why() -> None:
    failed = RunFailed("robot r03 died", robot="r03", cause="died", output=("last", "words"))
    assert (str(failed), failed.robot, failed.cause) == ("robot r03 died", "r03", "died")
    assert failed.output == ["last", "words"]
    assert RunFailed("out of memory").cause == "out of memory"


METRES = "must be a number of metres greater than 0"
ROBOTS = "must be a whole number from 1 to 1000 or a list of texts (1 to 1000 of them)"
KINDS = 'must be "static" or "bounce" or "commanded"'
TOO_SHORT = (
    "radio.tdma.slot_s: a slot of 0.001 s is too short for one message of 1024 bytes (needs at least "
    "2.730667 s at 3000 bit/s); lengthen the slot, raise bit_rate_bps or lower max_payload_bytes"
)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("range_m = 16.0", "rang_m = 16", "unknown key radio.rang_m, did you mean range_m (metres)?"),
        ("range_m = 16.0", "range_km = 16", "unknown key radio.range_km, did you mean range_m (metres)?"),
        ("range_m = 16.0", "range_m = -5", f"radio.range_m: {METRES}, is -5"),
        ("range_m = 16.0", 'range_m = "16 m"', f'radio.range_m: {METRES}, is "16 m"; write the bare number'),
        ("range_m = 16.0", "", f"missing key radio.range_m: {METRES}"),
        ("range_m = 16.0", "range_m = inf", "radio.range_m: must be a finite number, is inf"),
        (
            "range_m = 16.0",
            "range_m = 1\nqueue = true",
            "radio.queue: must be a whole number of at least 1, is true",
        ),
        ("range_m = 16.0", "range_m = 1\nloss = 1.5", "radio.loss: must be a number from 0 to 1, is 1.5"),
        ("robots = 3", "robots = 0", f"robots: {ROBOTS}, is 0"),
        ("robots = 3", "robots = 2001", f"robots: {ROBOTS}, is 2001"),
        ("robots = 3", "robots = []", f"robots: {ROBOTS}, is []"),
        ("robots = 3", "robots = [1]", "robots[0]: must be a text in quotes, is 1"),
        (
            "robots = 3",
            'robots = ["al", "al"]',
            "robots: 2 robots are called al; give each robot an id of its own",
        ),
        (
            "robots = 3",
            'robots = ["al b"]',
            'robots: "al b" cannot be a robot\'s id; use up to 32 letters, digits, - and _, of which the '
            "first is a letter or digit",
        ),
        (
            "robots = 3",
            "",
            'missing key robots: say how many there are (robots = 20), or name them (robots = ["alice"])',
        ),
        ("robots = 3", "robots = 3\nseeed = 1", "unknown key seeed, did you mean seed?"),
        ("robots = 3", "robots = 3\nrobot = 3", "robot: must be [[robot]] tables, is 3"),
        ("robots = 3", "robots = 3\nseed = -1", "seed: must be a whole number of at least 0, is -1"),
        (
            "area_m = [20, 10]",
            "",
            "missing key world.area_m: give the area as [width, height], or world.neighbours instead",
        ),
        (
            "area_m = [20, 10]",
            "area_m = [1, 1]\nneighbours = 3",
            "world.neighbours: world.area_m sets the size of the area as well; keep one of them",
        ),
        (
            "area_m = [20, 10]",
            "area_m = [20]",
            "world.area_m: must be a list of 2 numbers of metres from 0.001 to 10000000, is [20]",
        ),
        (
            "area_m = [20, 10]",
            "area_m = [20, -1]",
            "world.area_m[1]: must be a number of metres from 0.001 to 10000000, is -1",
        ),
        (
            "area_m = [20, 10]",
            "neighbours = 1e-30",
            "world.neighbours: needs an area with sides of 4.01061e+16 m, possible are 0.001 to 1e+07 m; "
            "change it or radio.range_m",
        ),
        (
            "area_m = [20, 10]",
            'area_m = [1, 1]\nmotion = { kind = "bonce" }',
            f'world.motion.kind: {KINDS}, is "bonce"; did you mean bounce?',
        ),
        ("area_m = [20, 10]", "area_m = [1, 1]\nmotion = {}", f"missing key world.motion.kind: {KINDS}"),
        ("area_m = [20, 10]", "area_m = [1, 1]\nmotion = 1", "world.motion: must be a table, is 1"),
        (
            "area_m = [20, 10]",
            'area_m = [1, 1]\nmotion = { kind = "bounce" }',
            "missing key world.motion.speed_mps: must be a number of metres per second from 0 to 10000",
        ),
        (
            "area_m = [20, 10]",
            'area_m = [1, 1]\nmotion = { kind = "bounce", speed_mps = -0.1 }',
            "world.motion.speed_mps: must be a number of metres per second from 0 to 10000, is -0.1",
        ),
        (
            "area_m = [20, 10]",
            'area_m = [1, 1]\nmotion = { kind = "commanded", max_speed_mps = 0 }',
            "world.motion.max_speed_mps: must be a number of metres per second greater than 0 and at most "
            "10000, is 0",
        ),
        (
            "area_m = [20, 10]",
            'area_m = [1, 1]\nplacement = "jitterd_grid"',
            'world.placement: must be "graph" or "grid" or "jittered_grid" or "uniform", is "jitterd_grid"; did you mean '
            "jittered_grid?",
        ),
        (
            "area_m = [20, 10]",
            'area_m = [1, 1]\nmotion = { kind = "static", speed_mps = 1.0 }',
            "unknown key world.motion.speed_mps, possible are kind",
        ),
        (
            "duration_s = 60",
            "duration_s = 1000001.0",
            "run.duration_s: must be at most 1000000 s, is 1000001 s",
        ),
        (
            "duration_s = 60",
            "duration_s = 1e-10",
            "run.duration_s: must be at least 1e-09 s, in which time is counted, is 1e-10 s",
        ),
        ("duration_s = 60", "", "missing key run.duration_s: must be a number of seconds greater than 0"),
        ("[run]\nduration_s = 60", "", "missing key run: must be a table"),
        (
            "[params]",
            "[camera]\nrange_m = 1\nframe_rate_hz = 4e9\n[params]",
            "camera.frame_rate_hz: must be from 1e-06 to 1e+06 Hz, is 4000000000 Hz",
        ),
        (
            "my_robot.py:roll_call",
            "my_robot",
            'behaviour: must look like "module:function" or "file.py:function", is "my_robot"',
        ),
        (
            "my_robot.py:roll_call",
            "/my_robot.py:f",
            'behaviour: "/my_robot.py" is an absolute path; give it relative to the scenario file',
        ),
        (
            'behaviour = "my_robot.py:roll_call"',
            "",
            'missing key behaviour: r00 has nothing to run; write behaviour = "file.py:function"',
        ),
        (
            "range_m = 16.0",
            SLOTTED,
            'radio.tdma: access = "tdma" needs slots; add [radio.tdma] with slot_s, or with units and '
            "unit_bits",
        ),
        (
            "range_m = 16.0",
            SLOTTED + "\ntdma = { slot_s = 1 }",
            'radio.bit_rate_bps: access = "tdma" needs a bit rate, or messages would take no time; add one',
        ),
        ("range_m = 16.0", f"{RATED}\ntdma = {{ slot_s = 0.001 }}", TOO_SHORT),
        (
            "range_m = 16.0",
            f"{RATED}\nmax_payload_bytes = 3\ntdma = {{ slot_s = 0.1, guard_s = 0.2 }}",
            "radio.tdma.slot_s: a slot of 0.1 s is too short for one message of 3 bytes with a guard of 0.2 s "
            "(needs at least 0.208 s at 3000 bit/s); lengthen the slot, raise bit_rate_bps or lower "
            "max_payload_bytes",
        ),
        (
            "range_m = 16.0",
            f"{RATED}\ntdma = {{}}",
            "missing key radio.tdma.slot_s: give the length of a slot, or what it carries as radio.tdma.units "
            "and radio.tdma.unit_bits",
        ),
        (
            "range_m = 16.0",
            f"{RATED}\ntdma = {{ unit_bits = 192 }}",
            "missing key radio.tdma.slot_s: give the length of a slot, or what it carries as radio.tdma.units "
            "and radio.tdma.unit_bits",
        ),
        (
            "range_m = 16.0",
            f"{RATED}\ntdma = {{ units = 3, slot_s = 3 }}",
            "radio.tdma.units: radio.tdma.slot_s sets the length of a slot as well; keep one of them",
        ),
        (
            "range_m = 16.0",
            f"{RATED}\ntdma = {{ units = 3 }}",
            "missing key radio.tdma.unit_bits: say how many bits a unit has",
        ),
        (
            "range_m = 16.0",
            f"{RATED}\ntdma = {{ units = 3, unit_bits = 192 }}\nmax_payload_bytes = 73",
            "radio.max_payload_bytes: is 73, and 3 units of 192 bits hold no more than 72 bytes; leave it out, "
            "or set more units",
        ),
        (
            "range_m = 16.0",
            f"{RATED}\ntdma = {{ units = 1, unit_bits = 7 }}",
            "radio.tdma.units: 1 units of 7 bits hold no whole byte; set more or larger ones",
        ),
        (
            "range_m = 16.0",
            f"{RATED}\ntdma = {{ units = 1000000000000, unit_bits = 192 }}",
            "radio.tdma.units: make a slot that lasts longer than any run; set fewer",
        ),
        (
            "range_m = 16.0",
            f"{RATED}\ntdma = {{ units = 0, unit_bits = 192 }}",
            "radio.tdma.units: must be a whole number of at least 1, is 0",
        ),
        (
            "range_m = 16.0",
            f'{RATED}\ntdma = {{ slot_s = 3, reuse = "distance_too" }}',
            'radio.tdma.reuse: must be "distance_one" or "distance_two" or "none", is "distance_too"; did you '
            "mean distance_two?",
        ),
        (
            "range_m = 16.0",
            f'{RATED}\ntdma = {{ slot_s = 3, order = "drawn_every_frame" }}',
            'radio.tdma.order: must be "drawn" or "drawn_each_frame" or "fixed", is "drawn_every_frame"; did '
            "you mean drawn_each_frame?",
        ),
        (
            "range_m = 16.0",
            "range_m = 16.0\nbursts = { enter = 0.6, leave = 0.5 }",
            "radio.bursts.enter: is 0.6 and radio.bursts.leave 0.5, together more than 1, which no burst can "
            "be like; lower one of them",
        ),
        (
            "range_m = 16.0",
            "range_m = 16.0\nbursts = { enter = 0, leave = 0.5 }",
            "radio.bursts.enter: must be a number greater than 0 and at most 1, is 0",
        ),
        (
            "range_m = 16.0",
            "range_m = 16.0\ncollisions = true",
            "radio.collisions: needs a bit rate: messages that take no time cannot overlap; set radio.bit_rate_bps",
        ),
        (
            "range_m = 16.0",
            "range_m = 16.0\nbursts = { enter = 0.1 }",
            "missing key radio.bursts.leave: must be a number greater than 0 and at most 1",
        ),
        (
            "range_m = 16.0",
            "range_m = 16.0\ncollisions = 1",
            "radio.collisions: must be true or false, is 1",
        ),
        (
            "range_m = 16.0",
            "range_m = 16.0\nbit_rate_bps = 1e-9",
            "radio.bit_rate_bps: is so low that one message takes longer than any run; raise it",
        ),
        (
            "tries = 3",
            "tries = 2020-01-01",
            "params.tries: 2020-01-01 is a date or time; write it as a text in quotes",
        ),
        (
            "tries = 3",
            "tries = 99999999999999999999",
            "params.tries: is a whole number of more than 64 bits; write a smaller one",
        ),
        ("tries = 3", "tries =", "line 13, column 8: is not valid TOML (invalid value); mend that line"),
        (
            "table = { a = 1 }",
            "table = '",
            'line 16, at the end: is not valid TOML (expected "\'"); mend that line',
        ),
    ],
)
def test_one_mistake_one_sentence(old: str, new: str, expected: str) -> None:
    assert complaint(edited(old, new)).removeprefix("x.toml: ") == expected


def test_the_slot_that_is_asked_for_is_long_enough() -> None:
    text = edited("range_m = 16.0", SLOTTED + "\nbit_rate_bps = 3000\ntdma = { slot_s = 2.730667 }")
    assert loaded(text).radio.tdma is not None
    with_guard = text.replace("2.730667 }", "2.730667, guard_s = 0.001 }")
    assert "with a guard of 0.001 s (needs at least 2.731667 s" in complaint(with_guard)


@pytest.mark.parametrize("more", ["", ", guard_s = 0.01", ', order = "drawn_each_frame"'])
def test_slots_of_units_need_no_limit_of_payloads(more: str) -> None:
    text = edited(
        "range_m = 16.0", f"{RATED}\noverhead_bits = 40\ntdma = {{ units = 3, unit_bits = 192{more} }}"
    )
    radio = loaded(text).radio
    assert (radio.max_payload_bytes, payload_limit(radio)) == (None, 72)
    lower = loaded(text, "radio.max_payload_bytes=72").radio
    assert payload_limit(lower) == 72
    again = from_resolved(resolved_json(loaded(text)), Path.cwd())
    assert again.radio == radio


@pytest.mark.parametrize(("enter", "leave"), [(0.3, 0.7), (0.1, 0.9), (1e-9, 1 - 1e-9), (0.43, 0.57)])
def test_bursts_that_just_can_be(enter: float, leave: float) -> None:
    text = edited("range_m = 16.0", f"range_m = 16.0\nbursts = {{ enter = {enter}, leave = {leave} }}")
    assert loaded(text).radio.bursts == BurstSettings(enter, leave)


def test_altitudes_of_robots_and_of_groups() -> None:
    group = '[[group]]\nname = "flying"\nrobots = 3\naltitude_m = 30\n'
    own = '[[robot]]\nid = "r01"\naltitude_m = 0\n[[robot]]\nid = "r02"\naltitude_m = -2.5\n'
    scenario = loaded(BASE + group + own)
    assert [spec.altitude_m for spec in team(scenario)] == [30.0, 0.0, -2.5]
    again = from_resolved(resolved_json(scenario), scenario.folder)
    assert team(again) == team(scenario)
    assert resolved_json(again) == resolved_json(scenario)
    assert [spec.altitude_m for spec in team(loaded(BASE))] == [0.0] * 3
    assert complaint(BASE + own, "robot.r01.altitude_m=up") == (
        '--set robot.r01.altitude_m=up: must be a number of metres from -10000000 to 10000000, is "up"; write '
        "the bare number"
    )


def test_slots_are_not_checked_without_tdma() -> None:
    assert (
        loaded(edited("range_m = 16.0", "range_m = 16.0\ntdma = { slot_s = 1e-9 }")).radio.access == "ideal"
    )


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        (
            'id = "r01"\nposition_m = [20.5, 1]',
            "robot.r01.position_m: [20.5, 1] lies outside the area, which reaches from [0, 0] to [20, 10]; "
            "move the robot or enlarge the area",
        ),
        (
            'id = "r01"\nvelocity_mps = [1, 1]',
            'robot.r01.velocity_mps: only robots that bounce have one; set world.motion.kind to "bounce", or '
            "leave it out",
        ),
        ('id = "r11"', "robot.r11: is not in the team (r00 to r02), did you mean r01?"),
        ('id = "zed"', "robot.zed: is not in the team (r00 to r02), take its table out, or add it to robots"),
        (
            'id = "r01"\nposition = [1, 1]',
            "unknown key robot.r01.position, did you mean position_m (metres)?",
        ),
        (
            'id = "r01"\nposition_m = [1, "a"]',
            'robot.r01.position_m[1]: must be a number of metres, is "a"; write the bare number',
        ),
        ("position_m = [1, 1]", "missing key robot[0].id: must be a text in quotes"),
        (
            'id = "r01"\n[[robot]]\nid = "r01"',
            "robot.id: 2 robots are called r01; give each robot an id of its own",
        ),
        (
            'id = "r01"\nbehaviour = "f"',
            'robot.r01.behaviour: must look like "module:function" or "file.py:function", is "f"',
        ),
    ],
)
def test_mistakes_in_a_robots_table(table: str, expected: str) -> None:
    assert complaint(f"{BASE}[[robot]]\n{table}\n") == f"x.toml: {expected}"


def test_a_bouncing_robot_cannot_look_elsewhere() -> None:
    text = edited("[20, 10]", '[20, 10]\nmotion = { kind = "bounce", speed_mps = 1 }')
    table = '[[robot]]\nid = "r01"\nvelocity_mps = [0, 1]\nheading_rad = 0.5'
    assert complaint(text + table) == (
        "x.toml: robot.r01.heading_rad: a bouncing robot faces where velocity_mps points; leave it out"
    )


def test_a_behaviour_that_is_not_there(tmp_path: Path) -> None:
    expected = f"there is no file nix.py in {tmp_path}; give its path relative to the scenario file"
    assert complaint(edited("my_robot.py", "nix.py")) == f"x.toml: behaviour: {expected}"


def test_a_behaviour_lies_beside_the_file_and_not_where_one_is(monkeypatch: pytest.MonkeyPatch) -> None:
    Path("elsewhere").mkdir()
    Path("x.toml").write_text(BASE)
    monkeypatch.chdir("elsewhere")
    assert load("../x.toml").folder == Path("..").resolve()


def test_text_that_is_not_utf8() -> None:
    Path("x.toml").write_bytes(b'title = "a"\n# \xff\n')
    with pytest.raises(UserError, match=r"^x.toml: line 2: is not UTF-8 text; save the file as UTF-8$"):
        load("x.toml")


def test_text_with_a_byte_order_mark() -> None:
    Path("x.toml").write_text(BASE, encoding="utf-8-sig")
    assert load("x.toml").title == "A test"


def test_nesting_without_end() -> None:
    assert complaint(f"a = {'[' * 100_000}").startswith("x.toml: is nested too deeply")


def test_files_that_cannot_be_read() -> None:
    Path("tricky.toml").write_text(BASE)
    with pytest.raises(UserError, match=r"^tricki.toml: there is no such file, did you mean tricky.toml\?$"):
        load("tricki.toml")
    with pytest.raises(UserError, match=r"^nowhere/x.toml: there is no such file, check its path$"):
        load("nowhere/x.toml")
    Path("folder.toml").mkdir()
    with pytest.raises(
        UserError, match=r"^folder.toml: cannot be read \(Is a directory\); name a TOML file$"
    ):
        load("folder.toml")


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("radio.rang_m=5", "--set: unknown key radio.rang_m, did you mean range_m (metres)?"),
        ("radio.range_m=-5", f"--set radio.range_m=-5: {METRES}, is -5"),
        ("radio.range_m=16 m", f'--set radio.range_m=16 m: {METRES}, is "16 m"; write the bare number'),
        (
            "radio.range_m",
            '--set: "radio.range_m" sets nothing; write key=value, for example radio.range_m=16',
        ),
        ("radio..x=1", '--set: "radio..x=1" sets nothing; write key=value, for example radio.range_m=16'),
        ("radio=5", "--set radio=5: must be a table, is 5"),
        (
            "radio.range_m.x=5",
            "--set: radio.range_m: holds no keys that could be set singly; set it as a whole",
        ),
        ("robot.r01.id=5", "--set: unknown key robot.r01, there are no [[robot]] tables in the file"),
        ("robot=5", "--set robot=5: must be [[robot]] tables, is 5"),
        (
            "seed=1\nrobots=5",
            '--set seed=1 robots=5: must be a whole number of at least 0, is "1\\nrobots=5"; write the bare '
            "number",
        ),
        ("clock.drift_ppm=nan", "--set clock.drift_ppm=nan: must be a finite number, is nan"),
        ("camera.miss=0.5", f"x.toml with --set camera.miss=0.5: missing key camera.range_m: {METRES}"),
        (
            "radio.access=tdma",
            'x.toml with --set radio.access=tdma: radio.tdma: access = "tdma" needs slots; add [radio.tdma] '
            "with slot_s, or with units and unit_bits",
        ),
        ("params.trys=3", "--set: unknown key params.trys, did you mean tries?"),
        (
            "params.colour=3",
            f"--set: params.colour: x.toml has no such key under [params]; {WRITE} (there are list, mood, step_s, table, tries)",
        ),
        (
            "params.colour.x=3",
            f"--set: params.colour: x.toml has no such key under [params]; {WRITE} (there are list, mood, step_s, table, tries)",
        ),
        (
            "params.table.b=3",
            f"--set: params.table.b: x.toml has no such key under [params.table]; {WRITE} (there are a)",
        ),
        ("params.list.b=3", "--set: unknown key params.list.b, nothing can be set there"),
        ("params.tries=1.5", "--set: params.tries: must be a whole number like the 3 in the file, is 1.5"),
        ("params.tries=true", "--set: params.tries: must be a whole number like the 3 in the file, is true"),
        ("params.step_s=fast", '--set: params.step_s: must be a number like the 0.5 in the file, is "fast"'),
        ("params.list=1", "--set: params.list: must be a list like the [1] in the file, is 1"),
    ],
)
def test_one_mistaken_override_one_sentence(override: str, expected: str) -> None:
    assert complaint(BASE, override) == expected


ONE_ROBOT = """
[[robot]]
id = "r01"
params = { tries = 9, mine = "a" }
"""


def test_overrides_of_a_robots_table() -> None:
    overrides = ("robot.r01.heading_rad=2", "robot.r01.params.tries=4", "robot.r01.params.table.a=5")
    scenario = loaded(BASE + ONE_ROBOT, *overrides)
    (own,) = scenario.robot
    assert own.heading_rad == 2.0
    assert own.params == {"tries": 4, "mine": "a", "table": {"a": 5}}
    assert scenario.params["table"] == {"a": 1}
    first, second, _ = team(scenario)
    assert (first.params["tries"], second.params["tries"], second.params["table"]) == (3, 4, {"a": 5})


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("robot.r02.heading_rad=1", "--set: unknown key robot.r02, did you mean r01?"),
        ("robot.r01.headin_rad=1", "--set: unknown key robot.r01.headin_rad, did you mean heading_rad (radians)?"),
        ("robot.r01.heading_rad=up", '--set robot.r01.heading_rad=up: must be a number of radians, is "up"; write the bare number'),
        ("robot.r01.position_m=[9, 99]", "--set robot.r01.position_m=[9, 99]: [9, 99] lies outside the area, which reaches from [0, 0] to [20, 10]; move the robot or enlarge the area"),
        ("robot.r01.params.mint=b", "--set: unknown key robot.r01.params.mint, did you mean mine?"),
        ("robot.r01.params.colour=b", f"--set: robot.r01.params.colour: x.toml has no such key under robot.r01.params or [params]; {WRITE} (there are list, mine, mood, step_s, table, tries)"),
        ("robot.r01.params.table.b=b", f"--set: robot.r01.params.table.b: x.toml has no such key under robot.r01.params.table or [params.table]; {WRITE} (there are a)"),
        ("robot.r01.params.tries=b", '--set: robot.r01.params.tries: must be a whole number like the 9 in the file, is "b"'),
        ("robot.r01.params.tries.x=1", "--set: unknown key robot.r01.params.tries.x, nothing can be set there"),
        ("robot.r01.heading_rad.x=1", "--set: robot.r01.heading_rad: holds no keys that could be set singly; set it as a whole"),
        ("robot.r01=1", "--set: robot.r01: is a table; set its keys singly, possible are altitude_m, behaviour, heading_rad, id, params, position_m, velocity_mps"),
    ],
)  # fmt: skip
def test_mistaken_overrides_of_a_robots_table(override: str, expected: str) -> None:
    assert complaint(BASE + ONE_ROBOT, override) == expected


def test_overrides_below_what_is_no_table() -> None:
    text = edited("robots = 3", "robots = 3\nrobot = 3")
    assert complaint(text, "robot.r01.id=a") == "--set: robot: must be [[robot]] tables, is 3"
    text = BASE + ONE_ROBOT.replace('{ tries = 9, mine = "a" }', "7")
    assert complaint(text, "robot.r01.params.tries=1") == "--set: robot.r01.params: must be a table, is 7"


def test_params_that_the_file_does_not_have() -> None:
    without = BASE[: BASE.index("[params]")]
    expected = f"--set: params.a: x.toml has no such key under [params]; {WRITE}"
    assert complaint(without, "params.a=1") == expected
    assert complaint(f"{without}[params]", "params.a=1") == expected


def test_a_table_of_a_robots_own_hides_the_shared_one() -> None:
    text = BASE + ONE_ROBOT.replace('mine = "a"', "table = { b = 2 }")
    found = complaint(text, "robot.r01.params.table.zeal=1")
    assert "x.toml has no such key under robot.r01.params.table; write it there" in found
    assert found.endswith("(there are b)")


def test_check_says_what_it_does_not_check(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["check", "--help"])
    told = " ".join(capsys.readouterr().out.split())
    assert "A behaviour's own [params] are not checked here: the behaviour does that when it starts." in told


def test_params_that_a_shipped_file_does_not_have() -> None:
    with pytest.raises(UserError) as caught:
        load("association", overrides=["params.zeal=1"])
    before, _, after = str(caught.value).partition("; copy ")
    assert before == "--set: params.zeal: association has no such key under [params]"
    path, _, rest = after.partition(" and ")
    assert Path(path).name == "association.toml"
    assert rest.startswith("write it there, then --set can change it (there are ")
    # It helps, as it says.
    Path("mine.toml").write_text(f"{Path(path).read_text()}\n".replace("[params]", "[params]\nzeal = 2"))
    assert load("mine.toml", overrides=["params.zeal=1"]).params["zeal"] == 1


def test_mistaken_options() -> None:
    assert complaint(BASE, robots=0) == f"--robots 0: {ROBOTS}, is 0"
    assert complaint(BASE, seed=-1) == "--seed -1: must be a whole number of at least 0, is -1"


def test_overrides_take_the_type_of_the_schema() -> None:
    scenario = loaded(
        BASE,
        "radio.range_m=5",
        "title=5",
        "radio.loss = 0.25",
        'world.placement="grid"',
        "run.stop.entry=done",
        "run.stop.field=all",
        "camera.range_m=3",
        "world.area_m=[1, 2]",
    )
    assert (scenario.radio.range_m, scenario.title, scenario.radio.loss) == (5.0, "5", 0.25)
    assert scenario.world.placement == "grid"
    assert scenario.run.stop is not None
    assert (scenario.run.stop.entry, scenario.run.stop.field) == ("done", "all")
    assert scenario.camera is not None
    assert scenario.camera.range_m == 3.0
    assert scenario.world.area_m == (1.0, 2.0)


def test_overrides_of_params_keep_their_types() -> None:
    params = loaded(
        BASE, "params.step_s=2", "params.mood=7", "params.list=[2, 3]", "params.table.a=9", "params.tries=4"
    ).params
    assert params == {"step_s": 2.0, "tries": 4, "mood": "7", "list": [2, 3], "table": {"a": 9}}
    assert type(params["step_s"]) is float


def test_the_last_override_of_a_key_counts() -> None:
    assert loaded(BASE, "seed=5", "seed=6").seed == 6
    assert loaded(BASE, seed=7).seed == 7
    assert loaded(BASE, "seed=6", seed=7).seed == 6


def test_another_kind_of_motion_drops_what_belonged_to_the_first() -> None:
    text = edited("[20, 10]", '[20, 10]\nmotion = { kind = "bounce", speed_mps = 1 }')
    assert loaded(text, "world.motion.speed_mps=2").world.motion == BounceMotion(2.0)
    assert loaded(text, "world.motion.kind=static").world.motion == StaticMotion()
    assert loaded(BASE, "world.motion.speed_mps=2", "world.motion.kind=bounce").world.motion == BounceMotion(
        2.0
    )


def test_area_and_neighbours_take_each_others_place() -> None:
    assert loaded(BASE, "world.neighbours=2").world.area_m is None
    assert (
        loaded(edited("area_m = [20, 10]", "neighbours = 2"), "world.area_m=[1, 1]").world.neighbours is None
    )


def test_units_and_lengths_of_slots_take_each_others_place() -> None:
    lasting = edited("range_m = 16.0", f"{RATED}\ntdma = {{ slot_s = 3 }}")
    holding = edited("range_m = 16.0", f"{RATED}\ntdma = {{ units = 3, unit_bits = 192 }}")
    one = loaded(lasting, "radio.tdma.units=2", "radio.tdma.unit_bits=80").radio.tdma
    assert one == TdmaSettings(units=2, unit_bits=80)
    other = loaded(holding, "radio.tdma.slot_s=4").radio.tdma
    assert other == TdmaSettings(slot_s=4.0, unit_bits=192)


def test_overrides_leave_the_text_alone() -> None:
    assert loaded(BASE, "seed=5").text == BASE.encode()


def test_resolved_and_back() -> None:
    text = edited("area_m = [20, 10]", 'neighbours = 1\nmotion = { kind = "bounce", speed_mps = 1.4 }')
    table = '[[robot]]\nid = "r01"\nparams = { tries = 9 }\nposition_m = [1, 2]\n'
    scenario = loaded(text + table, "params.mood=wild", "run.stop.entry=a", "run.stop.field=b", seed=8)
    written = resolved_json(scenario)
    again = from_resolved(written, scenario.folder, text=scenario.text)
    assert team(again) == team(scenario)
    assert resolved_json(again) == written
    assert (again.name, again.seed, again.text) == ("x", 8, scenario.text)
    assert (again.run, again.radio, again.params) == (scenario.run, scenario.radio, scenario.params)
    assert list(again.params) == list(scenario.params)


def test_resolved_holds_no_limits_of_wall_clock_time() -> None:
    scenario = loaded(BASE, "limits.answer_timeout_s=5")
    assert scenario.limits.answer_timeout_s == 5.0
    assert resolved_json(scenario) == resolved_json(loaded(BASE))
    assert from_resolved(resolved_json(scenario), scenario.folder).limits.answer_timeout_s == 30.0


def test_resolved_holds_no_absolute_path(tmp_path: Path) -> None:
    assert str(tmp_path) not in resolved_json(loaded())


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{", "is not the JSON that a log carries"),
        ("[]", "is not the JSON that a log carries"),
        ("{}", "missing key name"),
        ('{"name": "x"}', "missing key run: must be a table"),
        ('{"name": "x", "colour": 1}', "unknown key colour"),
    ],
)
def test_what_is_no_resolved_scenario(text: str, expected: str) -> None:
    with pytest.raises(UserError) as caught:
        from_resolved(text, None)
    assert str(caught.value).startswith(f"resolved scenario: {expected}")


def test_resolved_with_a_file_needs_its_folder(tmp_path: Path) -> None:
    written = resolved_json(loaded())
    with pytest.raises(UserError, match=r"behaviour: my_robot.py is a file of its own; say in which folder"):
        from_resolved(written, None)
    with pytest.raises(UserError, match=r"there is no file my_robot.py in "):
        from_resolved(written, tmp_path / "elsewhere")


@pytest.fixture
def _shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    family = tmp_path / "made_up_scenarios" / "family"
    family.mkdir(parents=True)
    text = BASE.replace("my_robot.py:roll_call", "package.module:function")
    (family / "beacon.toml").write_text(text)
    (family / "tide.toml").write_text(text.replace("A test", "Another"))
    (family / "notes.txt").write_text("no scenario")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("emulator.scenario_file.SHIPPED_PACKAGE", "made_up_scenarios")


@pytest.mark.usefixtures("_shipped")
def test_shipped_scenarios() -> None:
    assert shipped() == [("beacon", "A test"), ("tide", "Another")]
    scenario = load("beacon", robots=2)
    assert (scenario.name, scenario.folder, len(team(scenario))) == ("beacon", None, 2)


@pytest.mark.usefixtures("_shipped")
def test_unknown_shipped_scenario() -> None:
    with pytest.raises(UserError) as caught:
        load("becon")
    assert str(caught.value) == (
        "becon: there is no such scenario, did you mean beacon? `heliograph scenarios` lists them"
    )
    with pytest.raises(UserError, match="name one of them or a TOML file; `heliograph scenarios` lists them"):
        load("zzz")


@pytest.mark.usefixtures("_shipped")
def test_shipped_scenario_with_ones_own_behaviour(tmp_path: Path) -> None:
    scenario = load("beacon", overrides=["behaviour=my_robot.py:roll_call"])
    assert scenario.folder == tmp_path


def test_every_shipped_scenario_loads_and_resolves() -> None:
    names = [name for name, _ in shipped()]
    if not names:
        pytest.skip("no scenario is shipped yet")
    for name, title in shipped():
        scenario = load(name)
        assert title == scenario.title != ""
        assert from_resolved(resolved_json(scenario), scenario.folder).name == name


def test_a_word_among_params_may_become_a_table_and_nothing_else() -> None:
    density = "{floor=1.0, hills=[{x_m=20.0, y_m=70.0, sigma_m=10.0, weight=5.0}]}"
    changed = load("coverage", overrides=[f"params.density={density}"]).params["density"]
    assert changed == {"floor": 1.0, "hills": [{"x_m": 20.0, "y_m": 70.0, "sigma_m": 10.0, "weight": 5.0}]}
    assert load("coverage", overrides=["params.density=3"]).params["density"] == "3"
    with pytest.raises(UserError, match=r"params\.gain: must be a number like the 0\.5 in the file"):
        load("coverage", overrides=["params.gain={floor=1.0}"])
