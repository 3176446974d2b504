"""Robots that search for each other, on the emulator: what they do by radio is what the simulation does without."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from agent.behaviours.reconnection.model import check_model, walk_model, ways_of
from emulator.errors import UserError
from scenarios.reconnection.emulated import EmulatedParameters
from scenarios.reconnection.score import score_history
from scenarios.reconnection.score_history import BELIEF
from scenarios.reconnection.study_reconnection import graph_of
from tests.reconnection_runs import emulated, simulated, told_by


def small(**changes: Any) -> EmulatedParameters:
    """Few vertices, and a random phase that is long enough to lose each other."""
    usual = EmulatedParameters(environment="delaunay", vertices=30, random_steps=10, limit=150)
    return replace(usual, **changes)


@pytest.mark.parametrize(
    ("seed", "parameters"),
    [
        (2, small(robots=2)),
        (3, small(robots=3, method="persistent", memory=4)),
        (4, small(robots=4, method="random", environment="maze")),
        (5, small(robots=5, environment="gabriel")),
        (6, small(robots=4, environment="gridholes", travel_steps=1.0)),
        (7, small(robots=3, method="persistent", travel_steps=1.0, environment="delaunay-thinned")),
        (8, small(robots=4, targets="upwards")),
        (9, small(robots=4, tasks=3, task_steps=5)),
        (10, small(robots=4, tasks=2, half_steps=20.0, holding="normal", random_steps=0)),
        (11, small(robots=3, deterministic=True, miss=0.2, horizon=8)),
        (12, small(robots=2, method="random", starts="3,17", random_steps=0, travel_steps=0.5)),
    ],
)
def test_robots_do_step_by_step_what_the_simulation_does(
    tmp_path: Path, seed: int, parameters: EmulatedParameters
) -> None:
    result, expected = simulated(parameters, seed)
    history = emulated(tmp_path, parameters, seed)
    assert told_by(history) == expected
    found = score_history(history)
    assert (found["reached"], found["steps"]) == (
        result.connected,
        result.steps if result.connected else None,
    )
    assert (found["moves"]["total"], found["turned_back"]) == (result.moves, result.turned)
    assert found["broken"] == {"told": 0, "true": 0}
    assert found["agreement"]["same"] == found["agreement"]["asked"] == parameters.robots * len(expected)
    wrong = {name: count for name, count in result.outcomes.items() if name != "usual"}
    assert found["merges"]["wrong"] == wrong
    if parameters.method == "semi-markov" and parameters.robots > 2:
        assert result.plans == found["plans"]["groups"]["plans"]


def test_rounded_beliefs_take_a_fraction_of_the_bytes_and_lead_together_as_well(tmp_path: Path) -> None:
    parameters = small(robots=4, vertices=60)
    exact = score_history(emulated(tmp_path / "exact", parameters, 32))
    rounded = score_history(emulated(tmp_path / "rounded", parameters, 32, "params.exchange=quantised"))
    for found in (exact, rounded):
        assert found["reached"]
        assert found["merges"]["merges"] > 0
    per_merge = [each["radio"]["sent"]["facts"] / each["merges"]["merges"] for each in (rounded, exact)]
    assert per_merge[0] < per_merge[1] / 5
    assert rounded["beliefs"]["zero"] == exact["beliefs"]["zero"] == 0


def test_a_slow_radio_changes_nothing_while_all_is_told_within_its_phase(tmp_path: Path) -> None:
    parameters = small(robots=4)
    _, expected = simulated(parameters, 32)
    slow = emulated(tmp_path, parameters, 32, "radio.bit_rate_bps=5_000_000")
    assert told_by(slow) == expected
    assert score_history(slow)["merges"]["unheard"] == 0
    assert score_history(slow)["merges"]["merges"] > 0
    too_slow = emulated(tmp_path, parameters, 32, "radio.bit_rate_bps=100_000")
    assert score_history(too_slow)["merges"]["unheard"] > 0


def test_clocks_may_drift_apart_by_less_than_a_phase(tmp_path: Path) -> None:
    parameters = small(robots=3, method="persistent", random_steps=300)
    _, expected = simulated(parameters, 3)
    history = emulated(tmp_path, parameters, 3, "clock.drift_ppm=50")
    assert told_by(history) == expected


MORTAL = """
import asyncio
from agent.behaviours.reconnection.reconnect import reconnect

DIES_S = {dies}

async def main(robot):
    try:
        async with asyncio.timeout_at(DIES_S.get(robot.id)):
            await reconnect(robot)
    except TimeoutError:
        pass
"""


@pytest.mark.parametrize("method", ["semi-markov", "persistent"])
def test_the_rest_find_each_other_when_the_planner_dies(tmp_path: Path, method: Any) -> None:
    parameters = small(robots=4, method=method, vertices=60, random_steps=20, limit=60)
    dies_s = {"r00": 24.15}  # as others wait for what it decides
    history = emulated(tmp_path, parameters, 31, behaviour=MORTAL.format(dies=dies_s))
    before = next(moment for moment in history.moments if moment.step == 23)
    assert (0, 3) in before.groups(history.hearing)
    found = score_history(history)
    assert found["ended"] == ["r00"]
    assert found["reached"]
    assert found["steps"] > 4
    assert found["broken"] == {"told": 0, "true": 0}
    # Its member goes on alone, at once, and then with the others.
    moves = {moment.places[3] for moment in history.moments if 25 <= moment.step <= 20 + found["steps"]}
    assert len(moves) > 1


@pytest.mark.parametrize("method", ["semi-markov", "persistent"])
def test_a_radio_that_loses_a_fifth_delays_but_does_not_prevent(tmp_path: Path, method: Any) -> None:
    careful = ("radio.loss=0.2", "params.repeats=3", "params.patience=3", "params.miss=0.2")
    for seed in (31, 33):
        history = emulated(tmp_path, small(robots=4, vertices=40, method=method, miss=0.2), seed, *careful)
        found = score_history(history)
        assert found["reached"]
        assert found["broken"]["true"] == 0
        assert found["agreement"]["asked"] > 0


BABBLER = """
import asyncio
from agent.behaviours.reconnection.reconnect import reconnect

async def main(robot):
    if robot.number:
        return await reconnect(robot)
    heard = []
    while True:
        await asyncio.sleep(0.05)
        heard = (heard + robot.radio.received())[-50:]
        for _ in range(5):
            raw = bytearray(robot.rng.bytes(int(robot.rng.integers(1, 30))))
            if heard:
                raw = bytearray(heard[int(robot.rng.integers(len(heard)))].raw)
                for _ in range(int(robot.rng.integers(1, 4))):
                    raw[int(robot.rng.integers(len(raw)))] = int(robot.rng.integers(256))
                raw = raw[: int(robot.rng.integers(1, 2 * len(raw)))]
            robot.radio.broadcast_bytes(bytes(raw))
"""


@pytest.mark.parametrize("method", ["semi-markov", "persistent"])
def test_nothing_that_is_heard_stops_a_robot(tmp_path: Path, method: Any) -> None:
    everywhere = ("radio.link=disc", "radio.range_m=100", "params.patience=2")
    parameters = small(robots=4, method=method, limit=10)
    history = emulated(tmp_path, parameters, 3, *everywhere, behaviour=BABBLER)
    assert len(history.moments) == parameters.random_steps + parameters.limit + 1
    assert all(len(moment.told) == 3 for moment in history.moments)
    assert score_history(history)["refused"] > 100


def test_a_radio_of_a_range_among_obstacles_does_as_well(tmp_path: Path) -> None:
    radio = ("radio.link=disc", "radio.range_m=1.5", "radio.line_of_sight=true", "world.graph.heard_m=1.5")
    for seed in (31, 33):
        parameters = small(robots=3, environment="gridholes", miss=0.1)
        found = score_history(emulated(tmp_path, parameters, seed, *radio))
        assert found["reached"]
        # On their way robots hear what they do not at their places, and the other way round. That is right.
        assert found["agreement"]["same"] >= 0.98 * found["agreement"]["asked"] > 0
        assert found["broken"] == {"told": 0, "true": 0}


def test_a_radio_that_reaches_farther_than_links_accuses_nobody(tmp_path: Path) -> None:
    radio = ("radio.link=disc", "radio.range_m=1.5")
    history = emulated(tmp_path, small(robots=4, environment="gridholes", limit=30), 31, *radio)
    found = score_history(history)
    assert found["agreement"]["same"] >= 0.98 * found["agreement"]["asked"] > 0
    # By links they would be wrong often, and the log is one in which that shows.
    by_links = score_history(replace(history, reach=None))["agreement"]
    assert by_links["same"] < 0.9 * by_links["asked"]


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ("params.phase_s=0.2", "params.phase_s: three phases of 0.2 s take more than half of a step"),
        ("world.motion.max_speed_mps=0.2", "world.motion.max_speed_mps: r0. comes too late to vertex"),
        ("params.miss=1.0", "params.miss: silence that proves nothing"),
        ("params.method=magic", "params.method"),
    ],
)
def test_what_makes_no_sense_is_told_in_one_sentence(tmp_path: Path, change: str, complaint: str) -> None:
    with pytest.raises(UserError, match=complaint):
        emulated(tmp_path, small(robots=3), 3, change)


@pytest.mark.parametrize("seed", [1, 3])
def test_patience_costs_no_merge_where_nothing_is_lost(tmp_path: Path, seed: int) -> None:
    """Some count on a member that others, who have just been met, know to be gone."""
    parameters = small(robots=5, vertices=20, random_steps=40, limit=30)
    found = score_history(emulated(tmp_path, parameters, seed, "params.patience=2"))
    assert found["merges"]["merges"] > 10
    assert found["merges"]["unheard"] == found["refused"] == 0


LEARNT = """
from agent.behaviours.reconnection.knowledge import Expectation
from agent.behaviours.reconnection.learning import History
from agent.behaviours.reconnection.model import walk_model, ways_of
from agent.behaviours.reconnection.reconnect import reconnect

async def main(robot):
    ways = ways_of(robot.graph, 2.0)
    history = History(ways)
    for vertex in range(len(ways.start) - 1):  # whoever is anywhere goes on to its lowest neighbour
        history.visit(vertex, step=0)
        history.visit(int(ways.head[ways.start[vertex]]), step=3)
        history.forget()
    await reconnect(robot, Expectation(walk_model(robot.graph, ways, mu=history.mu(prior=0.0))))
"""


def test_robots_search_by_a_model_of_one_s_own(tmp_path: Path) -> None:
    parameters = small(robots=2, starts="3,17", random_steps=6, limit=12)
    history = emulated(tmp_path, parameters, 3, "params.log_beliefs_steps=1", behaviour=LEARNT)
    ways = ways_of(graph_of(parameters, 3), 2.0)
    way = [3]
    while (lowest := int(ways.head[ways.start[way[-1]]])) not in way:
        way.append(lowest)
    found = [data["places"] for _, _, data in history.entries[BELIEF] if data["of"] == 0]
    assert len(found) > 5
    assert len({place for places in found for place, _ in places}) > 1
    assert {place for places in found for place, _ in places} <= set(way)


def test_a_model_of_another_graph_is_refused() -> None:
    model = walk_model(graph_of(small(), 4), ways_of(graph_of(small(), 4), 2.0))
    with pytest.raises(ValueError, match=r"expected: its model has other ways than the graph"):
        check_model(model, ways_of(graph_of(small(), 3), 2.0))
