"""What a sample of a study costs, beside the same sample by the classes that robots run."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from agent.behaviours.association.istate import StationaryIState
from agent.behaviours.association.mobile_istate import MobileIState
from agent.behaviours.association.noisy_istate import NoisyIState
from agent.behaviours.association.rates import ChannelRates
from scenarios.association import study_mobile, study_noisy, study_stationary
from scenarios.association.mobile_world import World
from tests.bench.measure import Figures

WIRELESS, VISUAL = 20, 10
NAMES = [f"r{number:03d}" for number in range(1000)]


def measure_studies() -> Figures:
    """CPU microseconds of neighbourhoods, steps, slots and centroids, one each."""
    from tests.bench import team_studies  # here: other cells' processes do without a compiler in memory

    return {
        "stationary_class_us": _cost(_neighbourhoods, 500),
        "stationary_us": _cost(_vectorised_neighbourhoods, 50_000),
        "mobile_class_us": _cost(_observers, 20),
        "mobile_us": _cost(_vectorised_observers, 1),
        "noisy_class_us": _cost(_noisy, 5),
        "noisy_us": _cost(_vectorised_noisy, 2000),
        "propagation_class_us": _cost(team_studies.grid, 1),
        "propagation_us": _cost(team_studies.compiled_grid, 50),
        "age_class_us": _cost(team_studies.square, 10),
        "age_us": _cost(team_studies.compiled_square, 60),
        "age_scored_us": _cost(team_studies.scored_square, 60),
        "coverage_class_us": _cost(team_studies.cells, 50),
        "coverage_us": _cost(team_studies.compiled_cells, 5000),
    }


def _cost(work: Callable[[np.random.Generator, int], int], size: int) -> float:
    work(np.random.default_rng(0), min(size, 100))  # what is done once only is no part of it
    begun = time.process_time()
    done = work(np.random.default_rng(1), size)
    return (time.process_time() - begun) / done * 1e6


def _neighbourhoods(rng: np.random.Generator, samples: int) -> int:
    for _ in range(samples):
        istate = StationaryIState(NAMES[:WIRELESS], range(VISUAL))
        while not istate.is_final():
            active = np.flatnonzero(rng.random(WIRELESS) < 0.5).tolist()
            istate.update([NAMES[robot] for robot in active], [robot for robot in active if robot < VISUAL])
    return samples


def _vectorised_neighbourhoods(rng: np.random.Generator, samples: int) -> int:
    parameters = study_stationary.StationaryParameters(wireless=WIRELESS, visual=VISUAL)
    size = study_stationary.chunk(parameters)
    for _ in range(-(-samples // size)):
        study_stationary.simulate(parameters, rng, size)
    return -(-samples // size) * size


def _observers(rng: np.random.Generator, steps: int) -> int:
    world = World(rng, side=100.0, separation=4.0, mobile_fraction=0.05, speed=1.4)
    istates = [MobileIState() for _ in range(world.mobile)]
    for _ in range(steps):
        world.move()
        active = rng.random(world.robots) < 0.5
        observers, others = np.divmod(world.in_range(16.0), world.robots)
        for observer, istate in enumerate(istates):
            seen = others[observers == observer].tolist()
            lit = [robot for robot in seen if active[robot]]
            istate.update([NAMES[robot] for robot in lit], seen, lit)
    return steps * world.mobile


def _vectorised_observers(rng: np.random.Generator, worlds: int) -> int:
    parameters = study_mobile.MobileParameters(steps=20)
    study_mobile.simulate(parameters, rng, worlds)
    robots = round(parameters.world / parameters.separation) ** 2
    return worlds * (parameters.warm_up + parameters.steps) * round(parameters.mobile_fraction * robots)


def _noisy(rng: np.random.Generator, samples: int) -> int:
    steps = 20
    for _ in range(samples):
        istate = NoisyIState(ChannelRates(wireless_loss=0.1), wireless=NAMES[:WIRELESS], closed=True)
        for _ in range(steps):
            active = rng.random(WIRELESS) < 0.5
            heard = np.flatnonzero(active & (rng.random(WIRELESS) < 0.9)).tolist()
            istate.update(
                {NAMES[robot] for robot in heard}, dict(enumerate(active[:VISUAL].astype(int).tolist()))
            )
            istate.claims(0.99)
    return samples * steps


def _vectorised_noisy(rng: np.random.Generator, samples: int) -> int:
    parameters = study_noisy.NoisyParameters(wireless=WIRELESS, visual=VISUAL, steps=20)
    study_noisy.simulate(parameters, rng, samples)
    return samples * parameters.steps
