"""Mobile association by robot processes on the emulator, as a study that is read like the vectorised one.

The shipped scenario `association-mobile` with another world: the same parameters give the same process in
both, so that figures can show what the emulator's robots do beside what the simulation says.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from emulator.scenario import MAX_ROBOTS
from scenarios.association.mobile_world import robots_in
from scenarios.association.score_mobile import score
from scenarios.association.study_mobile import MobileParameters
from scenarios.association.study_mobile import check as check_simulated
from scenarios.emulated import emulated
from scenarios.study import Study, described, one_each

SCENARIO = "association-mobile"
STEP_S = 0.5
METRICS = ("fraction_matched", "ratio")


def check(parameters: MobileParameters) -> None:
    """Raises ValueError for what the simulation or the emulator cannot do, naming the key."""
    check_simulated(parameters)
    robots, _ = robots_in(parameters.world, parameters.separation, parameters.mobile_fraction)
    if robots > MAX_ROBOTS:
        raise ValueError(
            f"world: {robots} robots are more than the {MAX_ROBOTS} the emulator takes; set less"
        )


def simulate(
    parameters: MobileParameters, generator: np.random.Generator, samples: int
) -> list[dict[str, Any]]:
    """The scores of so many runs."""
    return [_score(parameters, int(generator.integers(2**62))) for _ in range(samples)]


def summarise(_parameters: MobileParameters, partials: Sequence[list[dict[str, Any]]]) -> dict[str, Any]:
    """`fraction_matched` and `ratio` of all observers in the steady state, `mean` and `se` each.

    The standard error comes from the runs' means, since observers of one world meet the same robots; None
    for a single run. Besides: `samples` (runs), `observers` (in all of them).
    """
    scores = [score for partial in partials for score in partial]
    return {
        **{metric: described(score["all"][metric]["mean"] for score in scores) for metric in METRICS},
        "observers": sum(score["observers"] for score in scores),
        "samples": len(scores),
    }


def overrides(parameters: MobileParameters) -> list[str]:
    """What makes the shipped scenario one of these parameters; 1 m is one robot diameter."""
    steps = parameters.warm_up + parameters.steps
    return [
        f"world.area_m=[{parameters.world}, {parameters.world}]",
        f"group.mobile.share={parameters.mobile_fraction}",
        f"group.mobile.speed_mps={parameters.speed / STEP_S}",
        f"radio.range_m={parameters.earshot}",
        f"camera.range_m={parameters.range}",
        f"run.duration_s={steps * STEP_S}",
        f"params.step_s={STEP_S}",
        f"params.transmission_probability={parameters.p}",
        f"params.drop_time={parameters.drop_time}",
        f"params.wireless_exceeds_visual={str(parameters.earshot > parameters.range).lower()}",
        f"params.steady_from_step={parameters.warm_up + 1}",
    ]


def _score(parameters: MobileParameters, seed: int) -> dict[str, Any]:
    robots, _ = robots_in(parameters.world, parameters.separation, parameters.mobile_fraction)
    return emulated(SCENARIO, score, robots=robots, seed=seed, overrides=overrides(parameters))


EMULATED = Study(
    name="association-mobile-emulated",
    title="Mobile association by robot processes on the emulator",
    parameters=MobileParameters,
    samples=8,
    unit="runs",
    chunk=one_each,
    simulate=simulate,
    summarise=summarise,
    check=check,
    max_jobs=1,  # the robots of one run keep all processors busy
)
