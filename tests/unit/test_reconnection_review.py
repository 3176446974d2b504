"""Corners of reconnection: members that are not heard, names that are none, numbers written oddly."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from agent.behaviours.reconnection.graph_file import read_graph, write_graph
from agent.behaviours.reconnection.messages import Course, Decision, Presence
from agent.behaviours.reconnection.methods import METHODS, Method, Plan, Planner
from agent.behaviours.reconnection.model import ways_of
from agent.behaviours.reconnection.reconnect import Reconnection
from agent.behaviours.reconnection.team import Motion, departed
from channels.graphs import Graph, hearing
from emulator.errors import InvalidError
from emulator.graph_sources import with_graph
from emulator.graphs import GraphSettings
from scenarios.reconnection.study_reconnection import ReconnectionParameters, check, search_of

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
