"""Studies of estimates and of coverage, beside the same by the classes that robots run.

Each function does its work and returns how many slots, or centroids, that were.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from agent.behaviours.coverage.controller import centroid
from agent.behaviours.dissemination.estimates import Estimate, EstimateTable, News
from agent.behaviours.dissemination.selection import selection
from scenarios.coverage.kernels import centroids
from scenarios.dissemination import study_age, study_propagation
from scenarios.dissemination.lattices import Lattice
from scenarios.dissemination.study_age import AgeParameters, Placement
from scenarios.dissemination.study_propagation import PropagationParameters
from tests.bench.measure import SampleFailed

FRAMES = 16
GRID = PropagationParameters(max_frames=FRAMES, subgraphs="10x10")
"""m = 7 and "first", from a cold start until almost everybody knows of almost everybody."""
SQUARE = AgeParameters()
ROBOTS = 9
SIDE_M = 90.0


class Team:
    """Robots that stand still, of the classes with the scheme "location"; they relay by "first"."""

    def __init__(self, m: int, links: NDArray[np.bool_], distances: NDArray[np.float64]) -> None:
        robots = len(distances)
        self._m = m
        self._neighbours = [np.flatnonzero(row).tolist() for row in links]
        self._distances = distances.tolist()
        self._tables = [EstimateTable(number, robots) for number in range(robots)]
        self._selections = [selection("location", number, robots) for number in range(robots)]

    def slot(self, sender: int, now: int) -> None:
        """One slot, from its start to its end."""
        table = self._tables[sender]
        table.update_own(Estimate(sender, now, 0.0, 0.0, 0.0, 0.0))
        chosen = self._selections[sender].choose(self._m, self._distances[sender], table.stamps())
        packet = [estimate for number in chosen if (estimate := table[number]) is not None]
        for receiver in self._neighbours[sender]:
            hearing, chooser = self._tables[receiver], self._selections[receiver]
            for estimate in packet:
                if hearing.receive(estimate) is News.first:
                    chooser.heard_first(estimate.number)


def grid(rng: np.random.Generator, runs: int) -> int:
    """Slots of the grid by the classes."""
    lattice = Lattice(GRID.rows, GRID.columns, GRID.neighbours)
    slots = FRAMES * lattice.robots
    for _ in range(runs):
        team = Team(GRID.m, lattice.links(), lattice.euclidean())
        order = rng.permutation(lattice.robots).tolist()
        for now in range(slots):
            team.slot(order[now % len(order)], now)
    return runs * slots


def compiled_grid(rng: np.random.Generator, runs: int) -> int:
    """Slots of the grid by the study. Raises SampleFailed where a run ends before its last frame."""
    if study_propagation.simulate(GRID, rng, runs).any():
        raise SampleFailed("propagation: a run was over early; measure fewer frames")
    return runs * FRAMES * GRID.rows * GRID.columns


def square(_rng: np.random.Generator, placements: int) -> int:
    """Slots of nine robots by the classes."""
    for placement in _placements(placements):
        around = study_age.neighbourhood(SQUARE, placement)
        team = Team(SQUARE.m, around.hops[0] == 1, around.distance_m[0])
        order = placement.order.tolist()
        for now in range(SQUARE.slots):
            team.slot(order[now % len(order)], now)
    return placements * SQUARE.slots


def compiled_square(rng: np.random.Generator, placements: int) -> int:
    """Slots of nine robots by the study, every update noted and put in order."""
    for placement in _placements(placements):
        study_age.updates(SQUARE, placement, rng)
    return placements * SQUARE.slots


def scored_square(rng: np.random.Generator, placements: int) -> int:
    """Slots of nine robots as the study has them in the end, with placements drawn and ages scored."""
    study_age.simulate(SQUARE, rng, placements)
    return placements * SQUARE.slots


@cache
def _placements(count: int) -> list[Placement]:
    rng = np.random.default_rng(1)  # the first of them are the same, however many
    return [study_age.draw(SQUARE, rng) for _ in range(count)]


def cells(rng: np.random.Generator, teams: int) -> int:
    """Centroids by the controller's geometry library."""
    for places in rng.random((teams, ROBOTS, 2)) * SIDE_M:
        listed = [(x, y) for x, y in places.tolist()]
        for own, place in enumerate(listed):
            centroid(place, listed[:own] + listed[own + 1 :], (SIDE_M, SIDE_M))
    return teams * ROBOTS


def compiled_cells(rng: np.random.Generator, teams: int) -> int:
    """Centroids by compiled code, where everybody knows of everybody."""
    area = np.array((SIDE_M, SIDE_M))
    for pictures in np.repeat(rng.random((teams, 1, ROBOTS, 2)) * SIDE_M, ROBOTS, axis=1):
        centroids(pictures, area)
    return teams * ROBOTS
