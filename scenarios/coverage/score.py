"""Score of Voronoi coverage from a log (Julian et al. 2009, sec. 4, Fig. 3)."""

from __future__ import annotations

from typing import Any

import numpy as np

from agent.behaviours.coverage.density import density_from
from agent.parameters import pair
from channels.units import NS_PER_S
from logs.reader import LogReader
from scenarios.coverage.cost import cost, mean_until, optimum
from scenarios.coverage.study_coverage import FIRST_S
from scenarios.dissemination.knowledge import History, read
from scenarios.dissemination.score import PLACES_S, places, score_history

MOST_INSTANTS = 2000
"""At which costs are computed; in longer runs they are farther apart than a second."""


def score(log: LogReader) -> dict[str, Any]:
    """Score of one log: all that `scenarios.dissemination.score` tells, and `coverage`."""
    history = read(log)
    return score_history(history) | {"coverage": coverage(history)}


def coverage(history: History) -> dict[str, Any]:
    """How well the area of `params.area_m` is covered, by the true places of all whose behaviour runs.

    - `cost_over_optimum`: the cost over the least that the whole team could have: `final` (at the end);
      `times_s`: every second and the end of the run, and at those `per_time`; None where nobody is left;
    - `mean_first_40_s`: its mean over the first 40 s (trapezoids); None for a shorter run;
    - `optimum`: `value` [m^4 times the unit of the density], and whether it is `exact`.

    Raises ValueError for params that make no sense.
    """
    area_m = pair(history.params, "area_m")
    density = density_from(history.params, area_m)
    least = optimum(len(history.robots), area_m, density)
    times_s = _times_s(history)
    ended_s = np.array(history.ended_ns) / NS_PER_S
    costs: list[float | None] = []
    for time_s, place in zip(times_s, places(history, times_s), strict=True):
        there = place[(ended_s > time_s) | (ended_s >= times_s[-1]), :2]
        costs.append(cost(there, area_m, density) / least.value if len(there) else None)
    known = [(time_s, value) for time_s, value in zip(times_s, costs, strict=True) if value is not None]
    return {
        "cost_over_optimum": {"final": costs[-1], "times_s": times_s, "per_time": costs},
        "mean_first_40_s": mean_until(FIRST_S, *zip(*known, strict=True)) if known else None,
        "optimum": {"value": least.value, "exact": least.exact},
    }


def _times_s(history: History) -> list[float]:
    """Instants to look at; the last is the end of the run."""
    end_s = history.end_ns / NS_PER_S
    return [*np.arange(0.0, end_s, max(PLACES_S, end_s / MOST_INSTANTS)).tolist(), end_s]
