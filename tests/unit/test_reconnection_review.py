"""Corners of reconnection: members that are not heard, names that are none, numbers written oddly."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest

from agent.behaviours.reconnection.facts import longest, told
from agent.behaviours.reconnection.graph_file import read_graph, write_graph
from agent.behaviours.reconnection.knowledge import Knowledge
from agent.behaviours.reconnection.messages import (
    MOST_STEPS,
    Course,
    Decision,
    Presence,
    Presences,
    encode,
    largest,
)
from agent.behaviours.reconnection.methods import METHODS, Method, Plan, Planner
from agent.behaviours.reconnection.model import ways_of
from agent.behaviours.reconnection.pieces import PieceError, least_limit, split
from agent.behaviours.reconnection.reconnect import Reconnection
from agent.behaviours.reconnection.settings import enough_of
from agent.behaviours.reconnection.settings import graph_of as graph_of_robot
from agent.behaviours.reconnection.team import Motion, departed
from agent.parameters import ParameterError
from channels.graphs import Graph, hearing
from emulator.errors import InvalidError, UserError
from emulator.graph_sources import with_graph
from emulator.graphs import GraphSettings
from emulator.scenario_file import load
from scenarios.reconnection import emulated as emulated_study
from scenarios.reconnection.emulated import EmulatedParameters
from scenarios.reconnection.emulated import check as check_emulated
from scenarios.reconnection.score import score_history
from scenarios.reconnection.study_reconnection import ReconnectionParameters, check, search_of
from tests.reconnection_runs import emulated, simulated, told_by

LINE = Graph(((0, 0), (1, 0), (2, 0)), ((0, 1, 1.0), (1, 2, 1.0)))
WAYS = ways_of(LINE, 2)
THERE = Motion(1)
LEAVES = departed(WAYS, THERE, 2)
STEP: Any = SimpleNamespace(index=7, start_ns=0)


class Heard(SimpleNamespace):
    """An exchange in which all has been heard that ever will be."""

    async def listen(self, until_ns: int) -> None:
        """Nothing comes."""

    def tell_decision(self, decision: Decision) -> None:
        """To nobody."""


def member(number: int, decisions: dict[int, Decision], monkeypatch: pytest.MonkeyPatch) -> Any:
    """Robot `number` of two at one vertex, of which robot 0 plans that robot 1 leaves; patient for a step."""
    plan = Plan({0: THERE, 1: LEAVES})
    monkeypatch.setattr(Planner, "decided", lambda *_: plan)
    robot: Any = object.__new__(Reconnection)
    presences = {each: Presence(each, Course(*THERE), True, (0, 1)) for each in (0, 1)}
    robot.__dict__ |= {
        "_robot": SimpleNamespace(number=number, log=lambda *_: None),
        "_member": SimpleNamespace(motion=THERE, searching=lambda _: True, drawn=lambda _: 0.0),
        "_network": presences,
        "_missing": {},
        "_decided": {},
        "_group": (0, 1),
        "_patience": 2,
        "_phase_ns": 0,
        "_step": STEP.index,
        "_ways": WAYS,
        "_hearing": hearing(LINE),
        "_planner": object.__new__(Planner),
        "_targets": ((1, 2), (0, 2), (0, 1)),
        "_known": None,
        "_exchange": Heard(decisions=decisions),
    }
    return robot


@pytest.mark.parametrize("number", [0, 1])
async def test_who_is_not_heard_counts_as_doing_what_was_decided(
    number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    decision = Decision(STEP.index, 0, {0: Course(*THERE), 1: Course(*LEAVES)})
    robot = member(number, {0: decision}, monkeypatch)
    robot._ages = lambda _: ()
    await robot._decide(STEP)
    other, does = 1 - number, (LEAVES, THERE)[number]
    robot._exchange.presences = {number: robot._network[number]}
    robot._network = robot._connected()
    after = robot._network[other].course.motion()
    assert (after.place, after.towards, after.elapsed) == (1, does.towards, 1)
    assert after.left == max(0, does.left - 1)


async def test_goes_on_doing_so_while_it_is_not_heard(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = member(0, {}, monkeypatch)
    robot._ages = lambda _: ()
    await robot._decide(STEP)
    for elapsed in (1, 2):
        robot._exchange.presences = {0: robot._network[0]}
        robot._network = robot._connected()
        assert robot._network[1].course.motion() == LEAVES._replace(
            elapsed=elapsed, left=LEAVES.left - elapsed
        )
        robot._decided = {}  # as where nothing is decided
    robot._exchange.presences = {0: robot._network[0]}
    assert list(robot._connected()) == [0]


@pytest.mark.parametrize("method", METHODS)
def test_groups_that_no_move_keeps_together_are_stuck(method: Method, tmp_path: Path) -> None:
    chain = Graph(
        tuple((float(x), 0.0) for x in range(8)),
        tuple((x, x + 1, 1.0) for x in range(7)),
        links=((0, 3), (4, 7)),
        starts=(0, 3, 4, 7),
    )
    write_graph(tmp_path / "chain.json", chain)
    parameters = ReconnectionParameters(
        robots=4, method=method, graph=str(tmp_path / "chain.json"), random_steps=0, limit=500
    )
    course = search_of(parameters, 1).run(0, parameters.limit)
    assert (course.steps, course.connected, course.stuck, course.moves) == (500, False, True, 0)
    # Three of them: the one by itself moves on, and may find the others.
    found = search_of(msgspec.structs.replace(parameters, robots=3), 1).run(0, 500)
    assert found.moves > 0
    assert not found.stuck


def test_name_of_a_graph_file_that_is_none() -> None:
    settings: Any = SimpleNamespace(world=SimpleNamespace(graph=GraphSettings(file="a\0b.json")), seed=1)
    with pytest.raises(InvalidError, match=r"is no name of a file .*; name a JSON file") as refused:
        with_graph(settings, Path())
    assert refused.value.key == "world.graph.file"
    with pytest.raises(ValueError, match=r"^'a\\x00b': is no name of a file"):
        read_graph("a\0b")


@pytest.mark.parametrize("starts", ["00,5", "0,05", "0, 01"])
def test_starts_are_written_as_elsewhere(starts: str) -> None:
    with pytest.raises(ValueError, match=r"^starts: .* write their numbers as 0,5$"):
        check(ReconnectionParameters(robots=2, starts=starts))
    check(ReconnectionParameters(robots=2, starts="0, 50"))


# --- limits of what is told ------------------------------------------------------------------------


def test_the_longest_message_is_as_long_as_it_is_said_to_be() -> None:
    everybody = tuple(range(5))
    course = Course(2, 1, MOST_STEPS, MOST_STEPS)
    ages = (200, 200)  # of vertex 1, which has two neighbours
    presences = [Presence(number, course, True, everybody, ages) for number in everybody]
    assert largest(5, WAYS, 200) == len(encode(Presences(MOST_STEPS, presences)))
    silent = [Presence(number, course, True, everybody) for number in everybody]
    assert largest(5, WAYS) == len(encode(Presences(MOST_STEPS, silent))) < largest(5, WAYS, 200)
    decision = Decision(MOST_STEPS, 4, dict.fromkeys(everybody, course))
    assert len(encode(decision)) <= largest(5, WAYS)


@pytest.mark.parametrize("exact", [True, False])
def test_beliefs_are_no_longer_than_they_are_said_to_be(exact: bool) -> None:
    generator = np.random.default_rng(1)
    for states in (1, 7, 300):
        for share in (0.0, 0.5, 1.0):
            belief = np.where(generator.random(states) < share, generator.random(states), 0.0)
            belief[0] += 0.1
            known = Knowledge({}, {61: belief / belief.sum()}, {61: MOST_STEPS})
            blob = told(known, exact=exact)
            assert len(blob) <= longest(states, 1)


@pytest.mark.parametrize("length", [1, 65_535, 65_536, 300_000])
def test_the_least_limit_for_pieces_is_the_least(length: int) -> None:
    blob, least = bytes(length), least_limit(length)
    assert max(map(len, split(blob, least))) <= least
    with pytest.raises(PieceError):
        split(blob, least - 1)


@pytest.mark.parametrize("method", ["semi-markov", "persistent"])
def test_a_radio_for_short_messages_only_is_refused_at_the_start(tmp_path: Path, method: Method) -> None:
    parameters = EmulatedParameters(
        environment="delaunay", vertices=30, random_steps=5, limit=20, robots=3, method=method
    )
    needed = set()
    for limit in (20, 40):
        with pytest.raises(
            UserError, match=r"radio\.max_payload_bytes: \d+ are too few for what 3 robots"
        ) as refused:
            emulated(tmp_path, parameters, 3, f"radio.max_payload_bytes={limit}")
        said = re.search(r"set (\d+) or more", str(refused.value))
        assert said is not None
        needed.add(int(said[1]))
    (least,) = needed
    with pytest.raises(UserError, match=f"set {least} or more"):
        emulated(tmp_path, parameters, 3, f"radio.max_payload_bytes={least - 1}")
    same = told_by(emulated(tmp_path, parameters, 3, f"radio.max_payload_bytes={least}"))
    assert same == simulated(parameters, 3)[1]


# --- how many are enough -----------------------------------------------------------------------------


@pytest.mark.parametrize(("given", "team", "enough"), [(0, 5, 5), (3, 5, 3), (5, 5, 5), (3, 4, 3), (2, 2, 2)])
def test_the_whole_team_is_more_than_half(given: int, team: int, enough: int) -> None:
    assert enough_of({"enough": given}, team) == enough


@pytest.mark.parametrize(("given", "team"), [(2, 4), (1, 2), (6, 5), (2, 5)])
def test_fewer_or_more_are_no_whole_team(given: int, team: int) -> None:
    with pytest.raises(
        ParameterError, match=rf"^params\.enough: {given} of {team} .*; set {team // 2 + 1} to "
    ):
        enough_of({"enough": given}, team)


@pytest.mark.parametrize(("missing", "whole"), [({}, True), ({1: 1}, False)])
def test_who_is_only_assumed_to_be_there_does_not_make_the_team_whole(
    missing: dict[int, int], whole: bool
) -> None:
    robot: Any = object.__new__(Reconnection)
    logged = []
    robot.__dict__ |= {
        "_robot": SimpleNamespace(log=lambda _, entry: logged.append(entry)),
        "_member": SimpleNamespace(motion=THERE, searching=lambda _: True),
        "_network": {each: Presence(each, Course(*THERE), True, (0, 1)) for each in (0, 1)},
        "_missing": missing,
        "_enough": 2,
        "_step": 7,
    }
    robot._log_step()
    assert [entry["whole"] for entry in logged] == [whole]
    assert logged[0]["network"] == (0, 1)


def test_a_team_that_is_too_large_is_refused() -> None:
    for robots, fits in ((12, True), (13, False)):
        robot: Any = SimpleNamespace(graph=LINE, team_size=robots)
        if fits:
            assert graph_of_robot(robot) is LINE
        else:
            with pytest.raises(ParameterError, match=r"^robots: 13 are too many to search; set 12 or less$"):
                graph_of_robot(robot)


@pytest.mark.parametrize("change", ["horizon=31", "width=4097"])
def test_a_study_takes_no_longer_plans(change: str) -> None:
    key, value = change.split("=")
    most = msgspec.convert({key: int(value) - 1}, ReconnectionParameters)
    assert getattr(most, key) == int(value) - 1
    with pytest.raises(msgspec.ValidationError, match=key):
        msgspec.convert({key: int(value)}, ReconnectionParameters)


# --- the same files for both studies ---------------------------------------------------------------------


FILES = {
    "lengths left out": {"vertices": [[0, 0], [3, 0], [3, 4]], "edges": [[0, 1], [1, 2, 1.5]]},
    "below 0": {
        "vertices": [[-5, -2], [-4, -2], [-3, -2], [-2, -2], [-1, -2], [0, 1.5]],
        "edges": [[0, 1], [1, 2], [2, 3], [3, 4], [4, 5]],
        "obstacles": [[-5, -1, -4, 0]],
    },
    "shorter than it is far": {
        "vertices": [[9 * x, 0] for x in range(6)],
        "edges": [[x, x + 1, 0.5] for x in range(5)],
    },
}


def test_a_world_reads_what_a_study_reads(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_bytes(msgspec.json.encode(FILES["lengths left out"]))
    scenario = load("reconnection", overrides=[f"world.graph={{ file = '{tmp_path / 'a.json'}' }}"])
    found = read_graph(tmp_path / "a.json")
    assert found.edges == ((0, 1, 3.0), (1, 2, 1.5))
    assert scenario.world.graph is not None
    assert tuple(scenario.world.graph.edges) == found.edges


@pytest.mark.parametrize("name", ["below 0", "shorter than it is far"])
@pytest.mark.parametrize("starts", [None, "0,5,2"])
def test_the_emulated_study_takes_the_files_of_the_simulated_one(
    name: str, starts: str | None, tmp_path: Path
) -> None:
    (tmp_path / "a.json").write_bytes(msgspec.json.encode(FILES[name]))
    for seed in (1, 2):
        parameters = EmulatedParameters(
            graph=str(tmp_path / "a.json"), starts=starts, robots=3, random_steps=4, limit=40
        )
        check_emulated(parameters)
        assert told_by(emulated(tmp_path, parameters, seed)) == simulated(parameters, seed)[1]


@pytest.mark.parametrize("edges", ["[[0, 2]]", "[[0, -1]]"])
def test_an_end_that_is_no_vertex_is_told_of(edges: str, tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(f'{{"vertices": [[0, 0], [1, 0]], "edges": {edges}}}')
    settings: Any = SimpleNamespace(world=SimpleNamespace(graph=GraphSettings(file="a.json")), seed=1)
    with pytest.raises(InvalidError, match=r"edges\[0\]: there is no vertex"):
        with_graph(settings, tmp_path)


def test_who_meets_in_the_step_of_the_limit_is_too_late(monkeypatch: pytest.MonkeyPatch) -> None:
    score = {
        "moves": {"total": 4}, "turned_back": 0, "broken": {"true": 0}, "radio": {"per_robot_and_step": 1.0},
    }  # fmt: skip
    parameters = EmulatedParameters(limit=10)
    for steps, connected in ((9, True), (10, False), (None, False)):
        found = score | {"reached": steps is not None, "steps": steps}
        monkeypatch.setattr(emulated_study, "emulated", lambda *_, found=found, **__: found)
        (run,) = emulated_study.simulate(parameters, np.random.default_rng(1), 1)
        assert (run.steps, run.connected) == (steps or 10, connected)


def test_a_run_that_is_just_too_long_is_the_same_in_both_studies(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    usual = EmulatedParameters(
        robots=2, environment="delaunay", vertices=30, method="persistent", random_steps=10, compare=True
    )
    (seed,) = np.random.default_rng(1).integers(2**31, size=1).tolist()
    steps = search_of(usual, seed).run(usual.random_steps, 500).steps
    assert 0 < steps < 500
    for limit in (steps, steps + 1):
        parameters = msgspec.structs.replace(usual, limit=limit)
        found = score_history(emulated(tmp_path, parameters, seed))
        assert found["steps"] == steps
        monkeypatch.setattr(emulated_study, "emulated", lambda *_, found=found, **__: found)
        (run,) = emulated_study.simulate(parameters, np.random.default_rng(1), 1)
        assert (run.seed, run.steps, run.connected, run.same) == (seed, steps, limit > steps, True)
