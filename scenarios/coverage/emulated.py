"""Coverage by robot processes on the emulator, as a study that is read like the simulation.

The shipped scenario `coverage` with another team, radio, scheme: the same parameters give the same process
in both. Starts are the emulator's own, so runs are not paired with those of the simulation.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from agent.behaviours.dissemination.wire import ESTIMATE_BITS
from emulator.scenario import MAX_ROBOTS
from logs.reader import LogReader
from scenarios.coverage.score import coverage
from scenarios.coverage.simulation import Course, CoverageParameters
from scenarios.coverage.study_coverage import check as check_simulated
from scenarios.coverage.study_coverage import summarise
from scenarios.dissemination.knowledge import read
from scenarios.dissemination.score import places
from scenarios.emulated import emulated
from scenarios.study import Study, one_each

SCENARIO = "coverage"
SAMPLE_S = 1.0
"""How often the score looks at the cost."""


def check(parameters: CoverageParameters) -> None:
    """Raises ValueError for what the simulation or the emulator cannot do, naming the key."""
    check_simulated(parameters)
    if parameters.robots > MAX_ROBOTS:
        raise ValueError(f"robots: the emulator takes {MAX_ROBOTS} at most; set fewer")
    if parameters.sample_period != SAMPLE_S:
        raise ValueError("sample_period: a log is looked at every second; set 1")
    if parameters.bits != ESTIMATE_BITS:
        raise ValueError(f"bits: an estimate of the emulator's robots has {ESTIMATE_BITS}; leave it so")
    if parameters.new_estimates == "true-distance":
        raise ValueError("new_estimates: robots that move know no true distances; set first or literal")


def simulate(parameters: CoverageParameters, generator: np.random.Generator, samples: int) -> list[Course]:
    """So many runs."""
    return [_run(parameters, int(generator.integers(2**62))) for _ in range(samples)]


def overrides(parameters: CoverageParameters) -> list[str]:
    """What makes the shipped scenario one of these parameters."""
    side, box = parameters.side, parameters.start_box
    return [
        f"world.area_m=[{side}, {side}]",
        f"world.start_area_m=[{box}, {box}]",
        f"world.motion.max_speed_mps={parameters.max_speed}",
        f"radio.range_m={parameters.range}",
        f"radio.bit_rate_bps={parameters.bit_rate}",
        f"radio.tdma.units={parameters.m}",
        f"radio.tdma.order={parameters.order}",
        f"run.duration_s={parameters.duration}",
        f"params.area_m=[{side}, {side}]",
        f"params.gain={parameters.gain}",
        f"params.max_speed_mps={parameters.max_speed}",
        f"params.control_s={parameters.control_period}",
        f"params.scheme={parameters.scheme}",
        f"params.alpha={parameters.alpha}",
        f"params.new_estimates={parameters.new_estimates}",
    ]


def _run(parameters: CoverageParameters, seed: int) -> Course:
    return emulated(SCENARIO, _course, seed=seed, robots=parameters.robots, overrides=overrides(parameters))


def _course(log: LogReader) -> Course:
    history = read(log)
    found: dict[str, Any] = coverage(history)
    costs = np.array(found["cost_over_optimum"]["per_time"]) * found["optimum"]["value"]
    return Course(costs, places(history, found["cost_over_optimum"]["times_s"][-1:])[0][:, :2])


EMULATED = Study(
    name="coverage-emulated",
    title="Coverage control by robot processes on the emulator",
    parameters=CoverageParameters,
    samples=4,
    unit="runs",
    chunk=one_each,
    simulate=simulate,
    summarise=summarise,
    check=check,
    max_jobs=1,  # the robots of one run keep all processors busy
)
