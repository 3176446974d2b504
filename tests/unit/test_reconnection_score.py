"""Scores of searches, of histories made by hand on a path of six vertices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from channels.graphs import Graph, Rectangle, hearing
from channels.medium import reach_of
from channels.settings import RadioSettings
from emulator.run import Options, run
from emulator.scenario_file import load
from logs.reader import LogReader
from scenarios.reconnection.score import bytes_sent, moves, plans, reunion, score_history, until
from scenarios.reconnection.score_beliefs import EDGES, calibration, merges
from scenarios.reconnection.score_contacts import agreement, broken, contacts
from scenarios.reconnection.score_history import NAMES, Entry, History, Moment, read

PATH = Graph(tuple((float(x), 0.0) for x in range(6)), tuple((x, x + 1, 1.0) for x in range(5)))
SETTINGS = {"params": {"random_steps": 1, "step_s": 2.0}}


def moment(
    step: int,
    places: Sequence[int],
    networks: Sequence[Sequence[int]],
    *,
    alive: Sequence[int] = (0, 1, 2),
    busy: Sequence[int] = (),
) -> Moment:
    """Robots at these places who told that they were in these networks."""
    of = {robot: tuple(network) for network in networks for robot in network}
    told: dict[int, Mapping[str, Any]] = {
        robot: {"network": of[robot], "searching": step > 0 and robot not in busy} for robot in sorted(of)
    }
    return Moment(step, step * 2_000_000_000, told, tuple(places), tuple(alive))


def history(moments: Sequence[Moment], **entries: Sequence[Entry]) -> History:
    found: dict[str, list[Entry]] = {name: list(entries.get(name, ())) for name in NAMES}
    dead = tuple(robot for robot in range(3) if robot not in moments[-1].alive)
    sent = {(0, "p"): (2, 30), (1, "p"): (2, 34), (1, "k"): (1, 1000), (2, "d"): (3, 60), (2, ""): (1, 4)}
    end_ns = 2_000_000_000 * len(moments)
    return History(("a", "b", "c"), list(moments), found, sent, dead, end_ns, hearing(PATH), SETTINGS)


APART = moment(0, (0, 2, 5), [[0], [1], [2]])
PAIR = moment(1, (1, 2, 5), [[0, 1], [2]])
NEARER = moment(2, (1, 2, 4), [[0, 1], [2]])
WHOLE = moment(3, (2, 3, 4), [[0, 1, 2]])


def test_a_team_is_whole_when_all_search_and_know_of_all() -> None:
    found = score_history(history([APART, PAIR, NEARER, WHOLE]))
    assert (found["reached"], found["steps"], found["time_s"]) == (True, 2, 4.0)
    assert reunion(history([APART, PAIR, NEARER])) is None
    busy = moment(3, (2, 3, 4), [[0, 1, 2]], busy=[1])
    later = moment(4, (2, 3, 4), [[0, 1, 2]])
    assert reunion(history([APART, PAIR, busy, later])) is later
    deaf = moment(3, (2, 3, 4), [[0, 1], [2]])  # together, but nobody has noticed
    assert reunion(history([APART, PAIR, deaf, later])) is later
    late = Moment(3, 0, {0: WHOLE.told[0], 1: WHOLE.told[1]}, WHOLE.places, WHOLE.alive)
    assert reunion(history([APART, PAIR, late, later])) is later


def test_the_dead_are_not_waited_for_unless_one_alone_is_left() -> None:
    left = moment(3, (2, 3, 5), [[0, 1]], alive=[0, 1])
    found = score_history(history([APART, moment(1, (0, 2, 5), [[0], [1], [2]]), left]))
    assert (found["ended"], found["steps"]) == (["c"], 2)
    alone = moment(3, (2, 3, 5), [[0]], alive=[0])
    assert reunion(history([APART, alone])) is None


def test_moves_count_from_the_end_of_the_random_phase_until_all_are_together() -> None:
    after = moment(4, (3, 4, 5), [[0, 1, 2]])
    told = history([APART, PAIR, NEARER, WHOLE, after])
    assert moves(told, until(told, WHOLE)) == {"per_robot": {"a": 1, "b": 1, "c": 1}, "total": 3}
    assert moves(told, until(told, None))["total"] == 6


def test_contacts_are_those_of_true_places() -> None:
    told = history([APART, PAIR, moment(2, (1, 2, 4), [[0], [1], [2]]), WHOLE])
    assert contacts(told, until(told, WHOLE)) == {
        "a-b": {"first_step": 0, "share": 1.0, "in_random_phase": False},
        "a-c": {"first_step": 2, "share": 1 / 3, "in_random_phase": False},
        "b-c": {"first_step": 2, "share": 1 / 3, "in_random_phase": False},
    }
    met_before = history([moment(0, (0, 1, 5), [[0, 1], [2]]), PAIR])
    assert contacts(met_before, until(met_before, None))["a-b"]["in_random_phase"]
    assert agreement(told) == {"asked": 12, "same": 10}
    assert agreement(history([APART, PAIR, NEARER, WHOLE])) == {"asked": 12, "same": 12}


WALL: Rectangle = (1.0, -1.0, 2.0, 1.0)


@pytest.mark.parametrize(
    ("x_m", "settings", "altitudes_m", "networks"),
    [
        ((0, 3, 6), {}, None, [(0, 1, 2)]),  # the range exactly met, the last ones by the one in between
        ((0, 3, 6.001), {}, None, [(0, 1), (2,)]),
        ((0, 3.5, 6.5), {}, None, [(0,), (1, 2)]),
        ((0, 6, 3), {}, None, [(0, 1, 2)]),
        ((0, 3, 6), {}, [0.0, 0.1, 0.1], [(0,), (1, 2)]),
        ((0, 3, 6), {"line_of_sight": True}, None, [(0,), (1, 2)]),
        ((1, 3, 6), {"line_of_sight": True}, None, [(0,), (1, 2)]),
        ((2, 3, 6), {"line_of_sight": True}, None, [(0, 1, 2)]),  # at the wall, and not behind it
    ],
)
def test_with_a_disc_networks_are_by_positions_range_and_sight(
    x_m: Sequence[float], settings: Any, altitudes_m: Any, networks: Any
) -> None:
    reach = reach_of(RadioSettings(range_m=3.0, **settings), altitudes_m, PATH, [WALL])
    positions_m = np.column_stack((x_m, np.zeros(3)))
    # By their places all would be one network, at (0, 1, 2), or none would.
    for places in ((0, 1, 2), (0, 2, 4)):
        at = replace(moment(1, places, networks), positions_m=positions_m)
        told = replace(history([at]), reach=reach)
        assert told.networks(at) == networks
        assert agreement(told) == {"asked": 3, "same": 3}
        assert contacts(told, [at])["b-c"]["share"] == float((1, 2) in networks or (0, 1, 2) in networks)


def test_with_a_disc_the_dead_pass_nothing_on_and_groups_break_by_positions() -> None:
    reach = reach_of(RadioSettings(range_m=3.0), None, PATH, [])
    near, far = (np.column_stack((x_m, np.zeros(3))) for x_m in ((0, 3, 6), (0, 3.5, 6)))
    without = replace(moment(1, (0, 1, 2), [[0], [2]], alive=(0, 2)), positions_m=near)
    assert replace(history([without]), reach=reach).networks(without) == [(0,), (2,)]
    together = replace(moment(1, (0, 1, 2), [[0, 1, 2]]), positions_m=near)
    torn = replace(moment(2, (0, 1, 2), [[0], [1, 2]]), positions_m=far)
    told = replace(history([together, torn]), reach=reach)
    assert broken(told, [together, torn]) == {"told": 1, "true": 1}
    assert broken(replace(told, reach=None), [together, torn]) == {"told": 1, "true": 0}


def test_a_group_is_broken_when_its_members_are_not_in_one_network_a_step_later() -> None:
    apart = moment(2, (0, 3, 5), [[0], [1], [2]])
    torn = history([APART, PAIR, apart])
    assert broken(torn, until(torn, None)) == {"told": 1, "true": 1}
    deaf = moment(2, (1, 2, 5), [[0], [1], [2]])
    lossy = history([APART, PAIR, deaf, NEARER])
    assert broken(lossy, until(lossy, None)) == {"told": 1, "true": 0}
    # Who did not search together may part; and with a member that dies a group may fall apart.
    busy = history([APART, moment(1, (1, 2, 5), [[0, 1], [2]], busy=[1]), apart])
    assert broken(busy, until(busy, None)) == {"told": 0, "true": 0}
    dies = history([APART, WHOLE, moment(4, (2, 3, 4), [[0], [2]], alive=[0, 2])])
    assert broken(dies, until(dies, None)) == {"told": 0, "true": 0}
    # Together by somebody who is busy is not together.
    relay = moment(1, (1, 2, 3), [[0, 1, 2]], busy=[1])
    parted = history([APART, relay, moment(2, (0, 2, 4), [[0], [1], [2]])])
    assert broken(parted, until(parted, None)) == {"told": 0, "true": 0}


def belief(step: int, of: int, places: Mapping[int, float]) -> Entry:
    return step * 2_000_000_000, 0, {"step": step, "of": of, "places": list(map(list, places.items()))}


def test_calibration_is_against_true_places() -> None:
    right, half, wrong = {5: 1.0}, {4: 0.5, 0: 0.5}, {0: 0.02, 1: 0.98}
    entries = [belief(1, 2, right), belief(2, 2, half), belief(3, 2, wrong)]
    found = calibration(history([APART, PAIR, NEARER, WHOLE], belief=entries))
    assert found is not None
    assert (found["asked"], found["zero"]) == (3, 1)
    assert found["mass_at_place"] == pytest.approx((1 + 0.5 + 0) / 3)
    assert found["brier"] == pytest.approx((0 + 0.5 + (0.02**2 + 0.98**2 + 1)) / 3)
    rows = {row["up_to"]: row for row in found["table"]}
    assert list(rows) == list(EDGES)
    assert rows[0.03] == {"up_to": 0.03, "places": 1, "believed": 0.02, "was": 0.0}
    assert rows[1.0]["places"] == 4
    assert rows[1.0]["believed"] == pytest.approx((1 + 0.5 + 0.5 + 0.98) / 4)
    assert rows[1.0]["was"] == 0.5
    assert rows[0.1]["was"] is None
    assert calibration(history([APART])) is None
    gone = moment(2, (1, 2, 4), [[0, 1]], alive=[0, 1])
    assert calibration(history([APART, PAIR, gone], belief=[belief(2, 2, right)])) is None


def test_merges_and_what_was_wrong_are_counted() -> None:
    entries: dict[str, list[Entry]] = {
        "merge": [(0, 0, {"step": 1, "of": [0, 2], "heard": 1, "wrong": [[1, "disjoint"]]}),
                  (0, 0, {"step": 2, "of": [0, 1, 2], "heard": 3, "wrong": []})],
        "outcome": [(0, 1, {"step": 2, "wrong": [[0, "nothing_left"], [2, "nothing_left"]]})],
    }  # fmt: skip
    assert merges(history([APART], **entries)) == {
        "merges": 2,
        "unheard": 1,
        "wrong": {"nothing_left": 2, "everything_heard": 0, "disjoint": 1},
    }


def test_plans_are_told_apart_by_whether_anybody_plans_alone() -> None:
    def made(members: int, nodes: int, contact: float | None, proven: bool | None) -> dict[str, Any]:
        group = list(range(members))
        return {"group": group, "nodes": nodes, "contact": contact, "proven": proven, "turned": [0]}

    assert plans([made(2, 0, None, None)]) is None
    assert plans([made(1, 10, 0.5, True), made(2, 30, 0.25, False), made(3, 50, 0.75, True)]) == {
        "alone": {"plans": 1, "nodes": 10, "contact": 0.5},
        "groups": {"plans": 2, "nodes": 40, "contact": 0.5, "proven": 0.5},
    }


def test_what_is_decided_when_all_are_together_does_not_count() -> None:
    entries = [
        (0, 0, {"step": step, "group": [0, 1], "nodes": 1, "contact": 0.1, "proven": True, "turned": [1]})
        for step in (1, 2, 3)
    ]
    found = score_history(history([APART, PAIR, NEARER, WHOLE], plan=entries))
    assert found["turned_back"] == 2
    assert found["plans"]["groups"]["plans"] == 2


def test_bytes_are_told_by_kind_and_by_robot() -> None:
    found = bytes_sent(history([APART, PAIR, NEARER, WHOLE]))
    assert found["sent"] == {"presences": 64, "facts": 1000, "decisions": 60, "other": 4}
    assert found["messages"] == {"presences": 4, "facts": 1, "decisions": 3, "other": 1}
    assert found["per_robot"] == {"a": 30, "b": 1034, "c": 64}
    assert found["per_robot_and_step"] == 1128 / 12


STAND = """
import asyncio

async def main(robot):
    robot.log("reconnection", {"step": 0, "network": [robot.number], "searching": False})
    robot.radio.broadcast(["p", 1])
    robot.radio.broadcast(["d", {1: 2}])
    robot.radio.broadcast_bytes(b"\\xc1")
    await asyncio.sleep(1.0 + 9.0 * robot.number)
"""
WORLD = """
behaviour = "my_robot.py:main"
robots = 2
[run]
duration_s = 3.0
[world]
placement = "graph"
[world.graph]
vertices = [[1.0, 1.0], [2.0, 1.0]]
edges = [[0, 1, 1.0]]
[radio]
link = "graph"
overhead_bits = 80
"""


def test_a_log_is_read_as_it_was_written(tmp_path: Path) -> None:
    (tmp_path / "my_robot.py").write_text(STAND)
    (tmp_path / "x.toml").write_text(WORLD)
    options = Options(out=tmp_path / "run.mcap", fleet="in_process", echo=None)
    with LogReader(run(load(str(tmp_path / "x.toml")), options).log) as log:
        found = read(log)
    assert [(each.step, each.places, each.alive) for each in found.moments] == [(0, (0, 1), (0, 1))]
    assert found.sent[0, "p"] == (1, 4)  # a list of two, a letter, a number
    assert found.sent[0, "d"] == (1, 6)
    assert found.sent[1, ""] == (1, 1)
    assert found.dead == (0,)


DRIVE = """
import asyncio

async def main(robot):
    if robot.number:
        robot.body.go_to(9.0, 1.0, 1.0)
    async for step in robot.steps(1.0):
        await asyncio.sleep(0.4)
        robot.log("reconnection", {"step": step.index, "network": [robot.number], "searching": False})
"""


@pytest.mark.parametrize(
    ("radio", "more", "together"),
    [
        ("range_m = 2.0", "", [True, True, False]),  # a metre, two and three apart; later when it is logged
        ("range_m = 2.0", '[[robot]]\nid = "r01"\naltitude_m = 0.1', [True, False, False]),
        ("range_m = 9.0\nline_of_sight = true", "", [True, False, False]),
        ("range_m = 9.0", "", [True, True, True]),
        ('link = "graph"', "", [True, True, True]),  # as from where it has left
    ],
)
def test_a_log_says_who_heard_whom_as_the_step_began(
    tmp_path: Path, radio: str, more: str, together: list[bool]
) -> None:
    (tmp_path / "my_robot.py").write_text(DRIVE)
    motion = 'placement = "graph"\nmotion = { kind = "commanded", max_speed_mps = 1.0 }\narea_m = [9, 9]'
    world = WORLD.replace('placement = "graph"', f"{motion}\nobstacles = [[2.4, 0.5, 2.6, 1.5]]")
    (tmp_path / "x.toml").write_text(world.replace('link = "graph"\noverhead_bits = 80', radio) + more)
    options = Options(out=tmp_path / "run.mcap", fleet="in_process", echo=None)
    with LogReader(run(load(str(tmp_path / "x.toml")), options).log) as log:
        found = read(log)
    assert [each.step for each in found.moments] == [0, 1, 2]
    assert [found.networks(each) == [(0, 1)] for each in found.moments] == together


def test_a_log_without_a_graph_is_refused_in_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "my_robot.py").write_text(STAND)
    world = WORLD[: WORLD.index("[world]")] + "[world]\narea_m = [5.0, 5.0]\n[radio]\nrange_m = 9.0\n"
    (tmp_path / "x.toml").write_text(world)
    options = Options(out=tmp_path / "run.mcap", fleet="in_process", echo=None)
    with (
        LogReader(run(load(str(tmp_path / "x.toml")), options).log) as log,
        pytest.raises(ValueError, match="its world has no graph; score a run of robots that search on one"),
    ):
        read(log)
