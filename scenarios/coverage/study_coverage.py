"""Coverage control by what robots hear of each other: the cost over time (Julian et al. 2009, Fig. 3)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenarios.coverage.cost import Optimum, mean_until, optimum
from scenarios.coverage.simulation import NS_PER_MS, Course, CoverageParameters, simulate_one
from scenarios.dissemination.parameters import check_flooding
from scenarios.study import Study, mean_and_error, one_each, spread

Floats = NDArray[np.float64]

FIRST_S = 40.0
"""What counts as the beginning."""
MOST_EVENTS = 10_000_000
"""Slots, control instants and looks of one run."""


def check(parameters: CoverageParameters) -> None:
    """Raises ValueError for parameters that do not go together, naming the key."""
    robots, m = parameters.robots, parameters.m
    check_flooding(parameters.scheme, m, robots)
    if parameters.start_box > parameters.side:
        raise ValueError(
            f"start_box: {parameters.start_box:g} m is more than the side of the square; set "
            f"{parameters.side:g} or less"
        )
    if parameters.gain * parameters.control_period > 1:
        raise ValueError(
            f"control_period: in {parameters.control_period:g} s at gain {parameters.gain:g} robots pass the "
            f"centroid; set {1 / parameters.gain:g} or less"
        )
    if parameters.slot_ns * robots < NS_PER_MS:
        raise ValueError("bit_rate: a frame takes less than 1 ms, which time stamps cannot tell; set less")
    periods = (parameters.slot_ns / 1e9, parameters.control_period, parameters.sample_period)
    if parameters.duration * sum(1 / period for period in periods) > MOST_EVENTS:
        raise ValueError(
            f"duration: makes more than {MOST_EVENTS} events a run; set less, or longer periods or slots"
        )


def simulate(parameters: CoverageParameters, generator: np.random.Generator, samples: int) -> list[Course]:
    """So many runs."""
    return [simulate_one(parameters, generator) for _ in range(samples)]


def summarise(parameters: CoverageParameters, partials: Sequence[list[Course]]) -> dict[str, Any]:
    """The cost over the least there is, which is 1 for the best places.

    - `cost_over_optimum`: `final` (at the end); `times_s`, and at those `per_time`: lists `mean` and `se`;
    - `mean_first_40_s`: its mean over the first 40 s (trapezoids); None where runs are shorter;
    - `per_run`: lists `final` and `mean_first_40_s`, in the order of the runs. Runs of equal number and seed
      start alike whatever the radio, the scheme and m: they can be compared one by one;
    - `final_places_m`: x and y of everybody at the end of the first run;
    - `optimum`: `value` [m^4], and whether it is `exact` (else the best that a search found);
    - `frame_rate_hz`, `samples`.

    Over runs: `mean`, `sd` and `se`; the latter two are None for a single run.
    """
    runs = [course for partial in partials for course in partial]
    least = optimum(parameters.robots, (parameters.side, parameters.side))
    ratios = np.array([course.costs for course in runs]) / least.value
    times_s = [time_ns / 1e9 for time_ns in parameters.times_ns]
    final = ratios[:, -1].tolist()
    early = [mean for row in ratios if (mean := mean_until(FIRST_S, times_s, row)) is not None]
    return {
        "cost_over_optimum": {
            "final": spread(final),
            "times_s": times_s,
            "per_time": per_time(ratios),
        },
        "mean_first_40_s": spread(early) if early else None,
        "per_run": {"final": final, "mean_first_40_s": early or None},
        "final_places_m": runs[0].places.tolist(),
        "optimum": _described(least),
        "frame_rate_hz": 1e9 / (parameters.robots * parameters.slot_ns),
        "samples": len(runs),
    }


def per_time(ratios: Floats) -> dict[str, list[float | None]]:
    """Lists `mean` and `se` over runs, one for each time; `ratios` has shape (runs, times)."""
    moments = [mean_and_error(column) for column in ratios.T.tolist()]
    return {"mean": [mean for mean, _ in moments], "se": [error for _, error in moments]}


def _described(least: Optimum) -> dict[str, float | bool]:
    return {"value": least.value, "exact": least.exact}


STUDY = Study(
    name="coverage",
    title="Coverage control: cost over the least there is, by what robots hear of each other",
    parameters=CoverageParameters,
    samples=60,
    unit="runs",
    chunk=one_each,
    simulate=simulate,
    summarise=summarise,
    check=check,
)
