"""How right beliefs were, from a log: against the true places of the robots they are about."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from typing import Any

from agent.behaviours.reconnection.belief import Outcome
from scenarios.reconnection.score_history import BELIEF, MERGE, OUTCOME, History

EDGES = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0)
"""Upper ends of the table's rows: most of a hundred places and more have little of one belief."""


def mean(values: Sequence[float]) -> float | None:
    """None of nothing."""
    return sum(values) / len(values) if values else None


def calibration(history: History) -> dict[str, Any] | None:
    """What was believed of robots that were absent, each time that it was logged; None where it never was.

    - `asked`: how many beliefs; `zero`: how many held the true place for impossible;
    - `mass_at_place`, `brier`: means of what was believed of the true place, and of the sum over all places
      of (p - [the robot is there])^2, from 0 (certain, and right) to 2 (certain, and wrong);
    - `table`: of the places held for possible, by what was believed of each, `up_to`: how many
      (`places`), what was `believed` of them (mean), and at what share of them the robot `was`.

    Robots that are dead do not count, for nobody claims to know where these are.
    """
    masses, errors = list[float](), list[float]()
    bins: list[list[tuple[float, bool]]] = [[] for _ in EDGES]
    for places, true_place in _beliefs(history):
        mass = places.get(true_place, 0.0)
        masses.append(mass)
        errors.append(sum(p * p for p in places.values()) - 2 * mass + 1)
        for place, p in places.items():
            bins[min(bisect_left(EDGES, p), len(EDGES) - 1)].append((p, place == true_place))
    if not masses:
        return None
    return {
        "asked": len(masses),
        "zero": masses.count(0.0),
        "mass_at_place": mean(masses),
        "brier": mean(errors),
        "table": [
            {
                "up_to": up_to,
                "places": len(each),
                "believed": mean([p for p, _ in each]),
                "was": mean([float(there) for _, there in each]),
            }
            for up_to, each in zip(EDGES, bins, strict=True)
        ],
    }


def merges(history: History) -> dict[str, Any]:
    """How often groups that met merged what they believed, and how often beliefs turned out wrong.

    `merges`; `unheard`: how many groups there were whose beliefs did not get through; `wrong`: how often a
    belief was so in each way of `belief.Outcome`, by an observation or a merge.
    """
    made = [data for _, _, data in history.entries[MERGE]]
    observed = [data for _, _, data in history.entries[OUTCOME]]
    wrong = {outcome.name: 0 for outcome in Outcome if outcome is not Outcome.usual}
    for data in (*made, *observed):
        for _, name in data["wrong"]:
            wrong[name] += 1
    return {
        "merges": len(made),
        "unheard": sum(len(data["of"]) - data["heard"] for data in made),
        "wrong": wrong,
    }


def _beliefs(history: History) -> Iterator[tuple[dict[int, float], int]]:
    """What was believed of each place, and the true one."""
    moments = {moment.step: moment for moment in history.moments}
    for _, _, data in history.entries[BELIEF]:
        moment = moments.get(data["step"])
        if moment is not None and data["of"] in moment.alive:
            yield dict(data["places"]), moment.places[data["of"]]
