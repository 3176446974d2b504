"""Search a little before robots are forked: to load compiled code takes each of them a second otherwise."""

from __future__ import annotations

from agent.behaviours.reconnection import belief as beliefs
from agent.behaviours.reconnection.knowledge import Expectation, Knowledge, heard_by, merged
from agent.behaviours.reconnection.methods import METHODS, Planner, Rules
from agent.behaviours.reconnection.model import walk_model, ways_of
from agent.behaviours.reconnection.team import Motion
from channels.graphs import Graph, hearing

PATH = Graph(tuple((float(x), 0.0) for x in range(6)), tuple((x, x + 1, 1.0) for x in range(5)))
TRAVEL_STEPS = 2.0


def search_a_little() -> None:
    """Observe, merge and plan, alone and in a group, with every method."""
    ways, near = ways_of(PATH, TRAVEL_STEPS), hearing(PATH)
    expected = Expectation(walk_model(PATH, ways))
    group = {0: Motion(0), 1: Motion(1)}
    heard = heard_by(near, group.values())
    known, _ = Knowledge({2: Motion(5)}).ticked(expected, ways, [2], heard, 0.0)
    known, _ = merged([known, known], group)
    beliefs.observed(expected.model, heard, beliefs.advanced(expected.model, known.believed[2]))
    beliefs.by_place(expected.model, known.believed[2])
    ages = {robot: (1,) * int(ways.start[robot + 1] - ways.start[robot]) for robot in group}
    for method in METHODS:
        planner = Planner(ways, near, expected, Rules(method=method, horizon=2))
        for members in ([0], [0, 1]):
            motions = {robot: group[robot] for robot in members}
            planner.decided(motions, (2,), known, {robot: ages[robot] for robot in members}, 0.5)
