"""What the params of `reconnect` say, checked. All functions raise ParameterError for what makes no sense."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from agent.behaviours.reconnection.knowledge import Expectation, expectation
from agent.behaviours.reconnection.member import Member, begun
from agent.behaviours.reconnection.methods import METHODS, Rules
from agent.behaviours.reconnection.model import HOLDINGS, Ways, ways_of
from agent.parameters import (
    ParameterError,
    choice,
    flag,
    not_negative,
    positive,
    probability,
    whole_number,
)
from agent.robot import Robot
from channels.graphs import Graph, starts, vertices_at
from channels.units import to_ns

MOST_ROBOTS = 12
"""Joint decisions are enumerated: up to (degree + 1)^members of a group, too many for more robots."""
MOST_TRAVEL_STEPS = 100.0
LONGEST_STEPS = 1_000_000
MOST_HORIZON = 30
MOST_TASKS = 1000
MOST_TASK_STEPS = 100_000
MOST_HALF_STEPS = 1e9
MOST_REPEATS = 100
MOST_STEP_S = 86_400.0


def graph_of(robot: Robot) -> Graph:
    """The world's graph."""
    if robot.graph is None:
        raise ParameterError("world.graph: is missing; robots search on the vertices of a graph")
    if robot.team_size > MOST_ROBOTS:
        raise ParameterError(f"robots: {robot.team_size} are too many to search; set {MOST_ROBOTS} or less")
    return robot.graph


def step_s_of(params: Mapping[str, Any]) -> float:
    """Length of a step [s]."""
    return positive(params, "step_s", 1.0, most=MOST_STEP_S)


def ways_for(params: Mapping[str, Any], graph: Graph) -> Ways:
    """The graph's ways, by how fast the team goes."""
    travel_steps = positive(params, "travel_steps", 2.0, most=MOST_TRAVEL_STEPS)
    try:
        return ways_of(graph, travel_steps)
    except ValueError as error:
        raise ParameterError(f"params.{error}") from None


def phase_ns_of(params: Mapping[str, Any], step_s: float) -> int:
    """Length of a phase [ns]."""
    phase_s = positive(params, "phase_s", step_s / 10)
    if 3 * phase_s > step_s / 2:
        raise ParameterError(
            f"params.phase_s: three phases of {phase_s:g} s take more than half of a step of {step_s:g} s; "
            f"set {step_s / 6:g} or less"
        )
    if to_ns(phase_s) < 1:
        raise ParameterError(f"params.phase_s: {phase_s:g} s is less than a nanosecond; set more")
    return to_ns(phase_s)


def enough_of(params: Mapping[str, Any], team_size: int) -> int:
    """How many robots are the whole team: more than half, so that no two networks are, each by itself."""
    enough = whole_number(params, "enough", 0, least=0) or team_size
    if not team_size < 2 * enough <= 2 * team_size:
        raise ParameterError(
            f"params.enough: {enough} of {team_size} robots cannot be the whole team; "
            f"set {team_size // 2 + 1} to {team_size}, or 0: all"
        )
    return enough


def rules_of(params: Mapping[str, Any]) -> Rules:
    """How groups decide."""
    method = choice(params, "method", METHODS, "semi-markov")
    miss = probability(params, "miss", 0.0)
    if miss == 1:
        raise ParameterError(
            "params.miss: silence that proves nothing leaves nothing to plan; set less than 1"
        )
    return Rules(
        method=method,
        horizon=whole_number(params, "horizon", 12, most=MOST_HORIZON),
        deterministic=flag(params, "deterministic", False),
        memory=whole_number(params, "memory", 10, most=LONGEST_STEPS),
        miss=miss,
    )


def expectation_of(
    params: Mapping[str, Any], graph: Graph, ways: Ways, targets: Sequence[Sequence[int]]
) -> Expectation:
    """How others are expected to move."""
    return expectation(
        graph,
        ways,
        targets,
        holding=choice(params, "holding", HOLDINGS, "uniform"),
        half_steps=not_negative(params, "half_steps", 0.0, most=MOST_HALF_STEPS),
        **_own_business(params),
    )


def member_of(robot: Robot, graph: Graph, ways: Ways) -> Member:
    """The robot as it begins. Draws from `robot.rng`."""
    return begun(ways, _start_of(robot, graph), robot.rng, **_own_business(robot.params))


def _own_business(params: Mapping[str, Any]) -> dict[str, int]:
    """What a robot does before it searches, as `member.begun` and `knowledge.expectation` take it."""
    return {
        "random_steps": whole_number(params, "random_steps", 50, least=0, most=LONGEST_STEPS),
        "tasks": whole_number(params, "tasks", 0, least=0, most=MOST_TASKS),
        "task_steps": whole_number(params, "task_steps", 10, most=MOST_TASK_STEPS),
    }


def _start_of(robot: Robot, graph: Graph) -> int:
    pose = robot.body.pose
    vertex = int(vertices_at(graph.vertices, np.array([[pose.x_m, pose.y_m]]))[0])
    if vertex != starts(graph, robot.team_size)[robot.number]:
        raise ParameterError(
            f"world.placement: {robot.id} does not start where the graph has it; "
            'set world.placement = "graph", and no position_m of its own'
        )
    return vertex
