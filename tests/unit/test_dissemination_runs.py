"""Robots on the emulator against robots made of the pure classes: the same slots, the same words, in the same order."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import pytest

import scenarios
from agent.behaviours.dissemination.disseminate import disseminate
from agent.behaviours.dissemination.distances import euclidean, hops
from agent.behaviours.dissemination.estimates import Estimate, EstimateTable, News
from agent.behaviours.dissemination.geodesy import TangentPlane
from agent.behaviours.dissemination.selection import selection
from agent.behaviours.dissemination.wire import Wire
from agent.host import RobotHost
from channels.messages import Grant, Hello, RadioPlan, Report, encode
from emulator.errors import UserError
from emulator.run import Options, Outcome, run
from emulator.scenario_file import load
from logs.reader import LogReader
from scenarios.places import positions

SLOT_NS = 64_000_000
GUARD_NS = 1000
RANGE_M = 36.0
GRID_OF_16 = [[15.0 + 30.0 * (k % 4), 15.0 + 30.0 * (k // 4)] for k in range(16)]


def emulated(
    tmp_path: Path, *overrides: str, robots: int | None = None, name: str = "dissemination"
) -> Outcome:
    scenario = load(name, robots=robots, overrides=list(overrides))
    return run(scenario, Options(out=tmp_path / "run.mcap", fleet="in_process", echo=None))


def entries(log: Path, name: str = "dissemination") -> list[tuple[int, str, dict[str, Any]]]:
    with LogReader(log) as reader:
        return [
            (time_ns, record["robot"], record["data"])
            for time_ns, record in reader.records("/robot")
            if record["entry"] == name
        ]


def radio(log: Path) -> list[tuple[int, dict[str, Any]]]:
    with LogReader(log) as reader:
        return list(reader.records("/radio"))


class Modelled:
    """A team without radio or emulator: packets go over the wire format from one table to the others."""

    def __init__(self, places: Sequence[tuple[float, float]], m: int, scheme: str, **settings: Any) -> None:
        team = len(places)
        self.places, self.m = places, m
        self.distance = settings.pop("distance", "euclidean")
        deployment = settings.pop("deployment_m", None)
        self.deployment = deployment and [
            Estimate(j, 0, x, y, 0.0, 0.0) for j, (x, y) in enumerate(deployment)
        ]
        self.wire = Wire(TangentPlane((0.0, 0.0)), team)
        self.tables = [EstimateTable(number, team) for number in range(team)]
        self.schemes = [selection(scheme, number, team, **settings) for number in range(team)]

    def slot(self, sender: int, time_ms: int) -> dict[str, Any]:
        table = self.tables[sender]
        x, y = self.places[sender]
        table.update_own(Estimate(sender, time_ms, x, y, 0.0, 0.0))
        known = self.deployment or table.listed()
        distances = euclidean(sender, known) if self.distance == "euclidean" else hops(sender, known, RANGE_M)
        chosen = self.schemes[sender].choose(self.m, distances, table.stamps())
        entry = {"sent": chosen, "stamps_ms": table.stamps(), "complete": table.complete}
        packet = self.wire.pack([each for each in map(table.__getitem__, chosen) if each is not None])
        for other in self._neighbours(sender):
            for estimate in self.wire.unpack(packet):
                if self.tables[other].receive(estimate) is News.first:
                    self.schemes[other].heard_first(estimate.number)
        return entry

    def _neighbours(self, sender: int) -> list[int]:
        x, y = self.places[sender]
        return [
            number
            for number, (u, v) in enumerate(self.places)
            if number != sender and (u - x) ** 2 + (v - y) ** 2 <= RANGE_M**2
        ]


@pytest.mark.parametrize(
    ("scheme", "units", "settings"),
    [
        ("location", 4, {}),
        ("location", 3, {"new_estimates": "literal", "alpha": 2.0}),
        ("location", 4, {"distance": "graph"}),
        ("location", 3, {"new_estimates": "true-distance", "deployment_m": GRID_OF_16}),
        ("location", 3, {"new_estimates": "true-distance", "deployment_m": GRID_OF_16, "distance": "graph"}),
        ("round-robin", 3, {}),
        ("freshest-first", 3, {}),
        ("own", 1, {}),
        ("flooding", 16, {}),
    ],
)
def test_robots_on_the_emulator_say_what_the_pure_classes_would(
    tmp_path: Path, scheme: str, units: int, settings: dict[str, Any]
) -> None:
    slot_ns = units * SLOT_NS + GUARD_NS
    params = {"scheme": scheme, **settings}
    scenario = load(
        "dissemination",
        robots=16,
        overrides=[
            "world.area_m=[120, 120]",
            f"radio.tdma.units={units}",
            "radio.tdma.order=fixed",
            f"run.duration_s={4 * 16 * slot_ns / 1e9}",
            *(f"params.{key}={value}" for key, value in params.items()),
        ],
    )
    run(scenario, Options(out=tmp_path / "run.mcap", fleet="in_process", echo=None))
    team = Modelled(
        [(x, y) for x, y in GRID_OF_16],
        units,
        scheme,
        **settings,
    )
    logged = entries(tmp_path / "run.mcap")
    assert len(logged) == 64
    for index, (time_ns, robot, data) in enumerate(logged):
        frame, sender = divmod(index, 16)
        start_ns = index * slot_ns + GUARD_NS // 2
        assert (time_ns, robot) == (start_ns, f"r{sender:02d}")
        assert data == {"frame": frame, **team.slot(sender, start_ns // 1_000_000)}


def _shipped(name: str) -> Path:
    return Path(scenarios.__file__).parent / "dissemination" / f"{name}.toml"


def test_a_slot_takes_m_units_and_a_frame_one_slot_of_each_robot(tmp_path: Path) -> None:
    # Julian et al. 2009, sec. 4: 3000 baud, 192 bits, nine robots: "about 0.6 Hz", 1.7 and 0.2 Hz.
    for units, scheme, rate_hz in ((1, "own", 1.736), (3, "location", 0.579), (9, "flooding", 0.193)):
        log = emulated(
            tmp_path / scheme, f"radio.tdma.units={units}", f"params.scheme={scheme}", "run.duration_s=40",
            name="dissemination-mixed",
        ).log  # fmt: skip
        starts = [time_ns - record["airtime_ns"] for time_ns, record in radio(log) if record["from"] == "r04"]
        periods = {later - earlier for earlier, later in pairwise(starts)}
        assert periods == {9 * (units * SLOT_NS + GUARD_NS)}
        assert round(1e9 / periods.pop(), 3) == rate_hz


def test_packets_are_24_bytes_an_estimate_and_fill_the_slot_to_the_bit(tmp_path: Path) -> None:
    log = emulated(tmp_path, "run.duration_s=20", name="dissemination-mixed").log
    said = {(time_ns, robot): data for time_ns, robot, data in entries(log)}
    sizes = set()
    for time_ns, record in radio(log):
        data = said[time_ns - record["airtime_ns"], record["from"]]
        assert record["bits"] == 192 * len(data["sent"])
        assert record["airtime_ns"] == 64_000_000 * len(data["sent"])
        sizes.add(len(data["sent"]))
    assert sizes == {1, 2, 3}  # at first nobody knows anybody


def test_robots_say_where_they_are_how_high_and_where_they_head(tmp_path: Path) -> None:
    """On the air, as a receiver that knows the origin reads it; flying robots have moved since the start."""
    log = emulated(tmp_path, "run.duration_s=2.0", name="dissemination-mixed").log
    with LogReader(log) as reader:
        truth = list(reader.records("/truth"))
    robots = {robot["robot"]: robot for robot in truth[0][1]["robots"]}
    assert {robot.get("altitude_m", 0.0) for robot in robots.values()} == {0.0, 10.0}
    wire = Wire(TangentPlane((48.1, 11.3)), 9)
    said = radio(log)
    assert {record["from"] for _, record in said} == set(robots)
    for end_ns, record in said:
        start_ns = end_ns - record["airtime_ns"]
        own = wire.unpack(base64.b64decode(record["payload"]["base64"]))[0]
        robot = robots[record["from"]]
        (at,) = positions(truth, {"kind": "bounce", "speed_mps": 0.0}, [start_ns])
        assert own.time_ms == start_ns // 1_000_000
        assert (own.x_m, own.y_m) == pytest.approx(tuple(at[own.number]), abs=0.01)
        assert own.z_m == robot.get("altitude_m", 0.0)
        # Nobody has met a wall yet.
        assert math.remainder(own.yaw_rad - robot["heading_rad"], math.tau) == pytest.approx(0, abs=1e-6)
    assert len({round(robot["heading_rad"], 3) for robot in robots.values()}) == 9


def test_params_that_are_left_out_are_those_of_the_docstring(tmp_path: Path) -> None:
    """For robots at two altitudes, where the distance through the air is another than that over the ground."""
    bare = _shipped("dissemination-mixed").read_text().split("[params]")[0]
    said = {}
    for name, params in (
        ("left out", ""),
        ("written", 'scheme = "location"\nalpha = 1.0\nnew_estimates = "first"\ndistance = "euclidean"\norigin_deg = [0.0, 0.0]\njoins_s = 0.0'),
        ("through the air", 'distance = "euclidean-3d"'),
    ):  # fmt: skip
        (tmp_path / "x.toml").write_text(f"{bare}[params]\n{params}\n")
        outcome = emulated(tmp_path, "run.duration_s=20.0", name=str(tmp_path / "x.toml"))
        said[name] = [record["payload"] for _, record in radio(outcome.log)]
        outcome.log.unlink()
    assert said["left out"] == said["written"] != said["through the air"]


def test_who_comes_and_leaves_does_so_by_the_clock(tmp_path: Path) -> None:
    text = _shipped("dissemination-mixed").read_text()
    text += '\n[[robot]]\nid = "r03"\nparams = { joins_s = 4.0, leaves_s = 10.0 }\n'
    (tmp_path / "x.toml").write_text(text)
    log = emulated(tmp_path, "run.duration_s=20.0", name=str(tmp_path / "x.toml")).log
    spoke = [time_ns for time_ns, robot, _ in entries(log) if robot == "r03"]
    assert 4e9 <= min(spoke) < 6e9
    assert 8e9 < max(spoke) < 10e9
    assert [(time_ns, robot) for time_ns, robot, _ in entries(log, "joined")] == [(4_000_000_000, "r03")]


def test_who_joins_late_has_heard_nothing_before_and_who_leaves_falls_silent(tmp_path: Path) -> None:
    text = _shipped("dissemination-mixed").read_text()
    text += '\n[[robot]]\nid = "r03"\nparams = { joins_s = 20.0 }\n[[robot]]\nid = "r05"\nparams = { leaves_s = 30.0 }\n'
    (tmp_path / "x.toml").write_text(text)
    scenario = load(str(tmp_path / "x.toml"), overrides=["run.duration_s=60"])
    run(scenario, Options(out=tmp_path / "run.mcap", fleet="in_process", echo=None))
    logged = entries(tmp_path / "run.mcap")
    late = [(time_ns, data) for time_ns, robot, data in logged if robot == "r03"]
    assert 20e9 <= late[0][0] < 22e9
    # What it knows with its first words it has heard since it joined.
    assert all(stamp is None or stamp >= 18_000 for stamp in late[0][1]["stamps_ms"])
    gone = [time_ns for time_ns, robot, _ in logged if robot == "r05"]
    assert 28e9 < max(gone) < 30e9
    # Its last state stays with the others, and grows old.
    last = logged[-1][2]["stamps_ms"]
    assert last[5] == max(gone) // 1_000_000
    assert min(stamp for number, stamp in enumerate(last) if number != 5) > 50_000


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("params.scheme=gossip", "params.scheme: must be one of location,"),
        ("params.alpha=-1.0", "params.alpha: must be a number, 0 or more, is -1.0"),
        ("params.alpha=50.0", "params.alpha: must lie within 0 (all alike) to 20, is 50.0"),
        ("params.link_range_m=-1.0", "params.link_range_m: must be a number greater than 0, is -1.0"),
        (
            "params.new_estimates=true-distance",
            "params.distance: the true distances of true-distance are flat",
        ),
        (
            "params.scheme=flooding",
            "radio.tdma.units: flooding sends everything, so a slot must hold 9 estimates, not 3; set units = 9",
        ),
        ("params.origin_deg=[95.0, 0.0]", "params.origin_deg: latitude must lie within -89 to 89 degrees"),
        ("radio.tdma.unit_bits=60", "a slot holds 22 bytes and an estimate has 24; set units = 1 or more"),
    ],
)
def test_one_mistake_one_sentence(tmp_path: Path, override: str, sentence: str) -> None:
    with pytest.raises(UserError) as failed:
        emulated(tmp_path, override, "run.duration_s=20", name="dissemination-mixed")
    assert sentence in str(failed.value)


def test_what_is_no_packet_is_logged_and_left(tmp_path: Path) -> None:
    (tmp_path / "liar.py").write_text(
        "async def lie(robot):\n"
        "    async for slot in robot.radio.slots():\n"
        "        robot.radio.broadcast_bytes(b'\\xff' * [24, 23, 48][slot.frame % 3])\n"
    )
    text = _shipped("dissemination-mixed").read_text()
    text += '\n[[robot]]\nid = "r04"\nbehaviour = "liar.py:lie"\n'
    (tmp_path / "x.toml").write_text(text)
    scenario = load(str(tmp_path / "x.toml"), overrides=["run.duration_s=20"])
    run(scenario, Options(out=tmp_path / "run.mcap", fleet="in_process", echo=None))
    refused = entries(tmp_path / "run.mcap", "refused packet")
    assert {data["from"] for _, _, data in refused} == {"r04"}
    assert {data["why"].split(":")[0] for _, _, data in refused} == {"number", "packet"}
    assert entries(tmp_path / "run.mcap")[-1][2]["stamps_ms"][4] is None


def test_a_radio_without_slots_has_none() -> None:
    hello = Hello("r00", "x:y", {}, 1, 0, (0.0, 0.0, 0.0), RadioPlan(100, 0, None, 8), 1)
    host = RobotHost(hello, disseminate)
    answer = host.exchange(encode(Grant(1, 0)))
    host.close()
    assert answer is not None
    report = msgspec.msgpack.decode(answer, type=Report)
    assert report.ended is not None
    assert report.ended == 'radio.access: must be "tdma", for this behaviour speaks in slots'


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("params.scheme=flooding", "coverage: radio.tdma.units: flooding sends everything"),
        ("radio.access=ideal", 'coverage: radio.access: must be "tdma", for this behaviour speaks in slots'),
        ("params.gain=0.0", "coverage: params.gain: must be a number greater than 0, is 0.0"),
        ("params.area_m=[90.0, -1.0]", "coverage: params.area_m: must be greater than 0 both ways"),
        ("params.density=hilly", "coverage: params.density"),
    ],
)
def test_a_mistake_within_a_task_group_is_told_as_any_other(
    tmp_path: Path, override: str, sentence: str
) -> None:
    with pytest.raises(UserError) as failed:
        emulated(tmp_path, override, "run.duration_s=5", name="coverage")
    assert sentence in str(failed.value)
