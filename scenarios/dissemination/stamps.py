"""Time stamps as one robot receives them, by robot processes on the emulator (Julian et al. 2009, Fig. 5).

The shipped scenario `dissemination-mixed`: who stands still and is farthest from all others is `beta`, the
"worst case" receiver.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct

from channels.units import NS_PER_S
from logs.reader import LogReader
from scenarios.dissemination.knowledge import History, knowledge, read
from scenarios.dissemination.parameters import Alpha, Scheme, SlotLength, check_flooding
from scenarios.dissemination.score import distances
from scenarios.dissemination.score_age import S_PER_MINUTE, Floats, spearman
from scenarios.emulated import emulated
from scenarios.runs import start_of
from scenarios.study import Study, mean_and_error, one_each

SCENARIO = "dissemination-mixed"
ROBOTS = 9
MS_PER_S = 1000


class StampsParameters(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the nine robots of the scenario say, and for how long."""

    m: SlotLength = 3
    alpha: Alpha = 1.0
    scheme: Scheme = "location"
    duration: Annotated[float, Meta(gt=0, le=10_000, description="of a run [s]")] = 100.0


def check(parameters: StampsParameters) -> None:
    """Raises ValueError for parameters that do not go together, naming the key."""
    check_flooding(parameters.scheme, parameters.m, ROBOTS)


def simulate(
    parameters: StampsParameters, generator: np.random.Generator, samples: int
) -> list[dict[str, Any]]:
    """What beta received in each of so many runs, see `received`."""
    return [_run(parameters, int(generator.integers(2**62))) for _ in range(samples)]


def summarise(_parameters: StampsParameters, partials: Sequence[list[dict[str, Any]]]) -> dict[str, Any]:
    """`first`: what beta received in the first run; over all runs `spearman`, as `mean` and `se`, of mean
    distance with updates a minute (None where there is nothing to rank); `samples`.
    """
    found = [one for partial in partials for one in partial]
    ranks = [
        rank
        for one in found
        if (rank := spearman(_column(one, "distance_m"), _column(one, "updates_per_minute"))) is not None
    ]
    mean, error = mean_and_error(ranks) if ranks else (None, None)
    return {"first": found[0], "spearman": {"mean": mean, "se": error}, "samples": len(found)}


def received(history: History) -> dict[str, Any]:
    """What the remotest robot that stands still received of each other robot.

    `receiver`: its id; `duration_s`; `robots`: of each other `robot` its mean `distance_m`, whether it
    `moves`, `updates_per_minute`, and at every update when it was received (`received_s`) and the time stamp
    by the clock of the other (`stamp_s`). Where all move, it is the remotest of all.
    """
    known = knowledge(history.transmissions, len(history.robots))
    end_s = history.end_ns / NS_PER_S
    range_m = float(history.settings["radio"]["range_m"])
    apart = distances(history, range_m).mean_distance_m(0.0, end_s)
    moves = _moves(history)
    beta = _remotest(apart, moves)
    of_beta = known.receiver == beta
    robots = []
    for number, name in enumerate(history.robots):
        rows = of_beta & (known.origin == number)
        if number != beta:
            robots.append({
                "robot": name,
                "distance_m": float(apart[beta, number]),
                "moves": moves[number],
                "updates_per_minute": int(rows.sum()) * S_PER_MINUTE / end_s,
                "received_s": (known.received_ns[rows] / NS_PER_S).tolist(),
                "stamp_s": (known.stamp_ms[rows] / MS_PER_S).tolist(),
            })  # fmt: skip
    return {"receiver": history.robots[beta], "duration_s": end_s, "robots": robots}


def overrides(parameters: StampsParameters) -> list[str]:
    """What makes the shipped scenario one of these parameters."""
    return [
        f"run.duration_s={parameters.duration}",
        f"radio.tdma.units={parameters.m}",
        f"params.scheme={parameters.scheme}",
        f"params.alpha={parameters.alpha}",
    ]


def _run(parameters: StampsParameters, seed: int) -> dict[str, Any]:
    return emulated(SCENARIO, _received, seed=seed, overrides=overrides(parameters))


def _received(log: LogReader) -> dict[str, Any]:
    return received(read(log))


def _moves(history: History) -> list[bool]:
    start = start_of(history.truth)
    told = {record["robot"] for _, record in history.truth if record["kind"] == "motion"}
    return [any(robot["velocity_mps"]) or robot["robot"] in told for robot in start["robots"]]


def _remotest(apart: Floats, moves: Sequence[bool]) -> int:
    sums = apart.sum(axis=1)
    if not all(moves):
        sums = np.where(moves, -1.0, sums)
    return int(sums.argmax())


def _column(found: dict[str, Any], key: str) -> Floats:
    return np.array([robot[key] for robot in found["robots"]], dtype=np.float64)


STAMPS = Study(
    name="dissemination-stamps",
    title="Time stamps of the most current estimates at the remotest robot, on the emulator",
    parameters=StampsParameters,
    samples=8,
    unit="runs",
    chunk=one_each,
    simulate=simulate,
    summarise=summarise,
    check=check,
    max_jobs=1,  # the robots of one run keep all processors busy
)
