"""Robot processes against the exact law of the completion time, at 12 wireless and 8 visual ids.

An edge survives exactly while the two ids' activity strings agree. With M = 2^t strings, an observer is done
by step t if its v visual ids have different strings, and none of the other w - v has one of theirs:
prod_{i<v} (1 - i/M) * (1 - v/M)^(w-v).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import kstwo

from agent.loading import forget_user_modules
from logs.reader import LogReader
from scenarios.association.score import read, truth_of
from scenarios.association.score_metrics import Judged, judge
from tests.support import run_scenario, write_scenario

pytestmark = pytest.mark.processes

WIRELESS, VISUAL = 12, 8
CLUSTERS, ROUNDS, SEEDS = 8, 9, 3
STEPS = 13
"""Of every round after its roll call."""
COMPLETIONS = 200

BEHAVIOUR = f'''
"""The behaviours of association begun anew in every round: the same neighbours, other coins."""

import asyncio
import contextlib

from agent.behaviours.association import stationary

ROUND_S = 0.5 * {STEPS + 2}


async def observer(robot):
    await rounds(robot, stationary.associate)


async def neighbour(robot):
    await rounds(robot, stationary.beacon)


async def rounds(robot, behaviour):
    for number in range(1, {ROUNDS} + 1):
        # In the middle of the last step: all steps before it are over, and the next round's are yet to begin.
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout_at(ROUND_S * number - 0.25):
                await behaviour(robot)
'''

TOML = f"""
behaviour = "my_robot.py:neighbour"
[run]
duration_s = {0.5 * (STEPS + 2) * ROUNDS}
[world]
area_m = [{100 * CLUSTERS}.0, 100.0]
[radio]
range_m = 16.0
[camera]
range_m = 10.0
[params]
step_s = 0.5
transmission_probability = 0.5
"""


def clusters() -> str:
    """Observers 100 m apart, each with 8 robots in its camera's range and 4 more in its radio's."""
    tables = []
    for cluster in range(CLUSTERS):
        x, y = 100.0 * cluster + 50.0, 50.0
        tables.append(
            f'[[robot]]\nid = "c{cluster}"\nposition_m = [{x}, {y}]\nbehaviour = "my_robot.py:observer"\n'
        )
        for robot in range(WIRELESS):
            radius, angle = (8.0 if robot < VISUAL else 13.0), 2 * math.pi * robot / WIRELESS
            place = f"[{x + radius * math.cos(angle):.3f}, {y + radius * math.sin(angle):.3f}]"
            tables.append(f'[[robot]]\nid = "c{cluster}-{robot}"\nposition_m = {place}\n')
    return "\n".join(tables)


def completion_steps(folder: Path) -> NDArray[np.int64]:
    """When each observer was done in each round of each run: no two share a coin."""
    scenario = write_scenario(folder, BEHAVIOUR, TOML + clusters())
    steps: list[int] = []
    for seed in range(SEEDS):
        log = run_scenario(scenario, folder / f"{seed}.mcap", "zenoh", seed=seed).log
        for entries in observed_rounds(log):
            assert [entry.step for entry in entries] == list(range(STEPS + 1))
            assert (entries[0].edges, entries[0].visual) == (WIRELESS * VISUAL, VISUAL)
            assert all(entry.right == entry.matched for entry in entries)
            # Whoever is not done by the end is done some time after it: where does not matter.
            steps.append(next((entry.step for entry in entries if entry.complete), STEPS + 1))
    forget_user_modules(folder)  # as later tests expect
    return np.array(steps)


def observed_rounds(log: Path) -> Iterator[list[Judged]]:
    """What one observer logged in one round."""
    with LogReader(log) as reader:
        history = read(reader)
    truth = truth_of(record for _, record in history.truth)
    for cluster in range(CLUSTERS):
        own = [judge(robot, data, truth) for robot, data in history.entries if robot == f"c{cluster}"]
        assert len(own) == ROUNDS * (STEPS + 1)
        for number in range(ROUNDS):
            yield own[number * (STEPS + 1) : (number + 1) * (STEPS + 1)]


def law(wireless: int, visual: int) -> NDArray[np.float64]:
    """Probability of being done by step 0, 1, ..., STEPS."""
    strings = 2.0 ** np.arange(STEPS + 1)
    apart = np.prod([np.maximum(0.0, 1 - i / strings) for i in range(visual)], axis=0)
    return apart * np.maximum(0.0, 1 - visual / strings) ** (wireless - visual)


def largest_gap(steps: NDArray[np.int64], law: NDArray[np.float64]) -> float:
    """Kolmogorov-Smirnov statistic: both functions step at whole numbers only."""
    return float(np.abs((steps[:, None] <= np.arange(STEPS + 1)).mean(axis=0) - law).max())


def p_value(steps: NDArray[np.int64], law: NDArray[np.float64]) -> float:
    """Share of samples of the law itself with as large a gap, in 20 000: right for a law that steps.

    The p-value of Kolmogorov's distribution, for continuous laws, is the larger one, and would let more
    pass: of a continuous law's gaps only those at whole numbers count here.
    """
    cells = np.append(np.diff(law, prepend=0.0), 1.0 - law[-1])
    samples = np.random.default_rng(1).multinomial(len(steps), cells, size=20_000)
    gaps = np.abs(samples.cumsum(axis=1)[:, :-1] / len(steps) - law).max(axis=1)
    return float((gaps >= largest_gap(steps, law) - 1e-12).mean())


def test_robot_processes_follow_the_exact_law(tmp_path: Path) -> None:
    steps = completion_steps(tmp_path)
    assert (steps <= STEPS).sum() >= COMPLETIONS
    exact = law(WIRELESS, VISUAL)
    gap = largest_gap(steps, exact)
    p = p_value(steps, exact)
    continuous = float(kstwo.sf(gap, len(steps)))
    print(
        f"{len(steps)} observers, mean {steps.mean():.3f}, gap {gap:.4f}, p {p:.4f}, at most {continuous:.4f}"
    )
    assert 0.001 < p <= continuous + 0.02
    # The sample tells this law from those beside it.
    assert p_value(steps + 1, exact) < 0.001
    assert p_value(steps, law(WIRELESS + 8, VISUAL + 4)) < 0.001
