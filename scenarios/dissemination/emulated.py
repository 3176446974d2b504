"""Dissemination by robot processes on the emulator, as studies that are read like the compiled ones.

`PROPAGATION` runs the shipped scenario `dissemination` on another grid; the same parameters give the same
process in both, so that figures can show what the emulator's robots do beside what the simulation says.
`AGE` runs `dissemination-mixed`, where robots fly and others stand, with what can go wrong on a radio.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from agent.behaviours.dissemination.wire import ESTIMATE_BITS
from channels.units import MAX_TIME_NS, NS_PER_S
from emulator.scenario import MAX_ROBOTS
from emulator.scenario_file import load
from scenarios.dissemination.lattices import Lattice
from scenarios.dissemination.parameters import Alpha, Scheme, SlotLength, check_flooding
from scenarios.dissemination.score import score
from scenarios.dissemination.study_propagation import PropagationParameters, summarise
from scenarios.dissemination.study_propagation import check as check_simulated
from scenarios.emulated import emulated
from scenarios.study import Study, described, one_each

Ints = NDArray[np.int64]

GRID = "dissemination"
MIXED = "dissemination-mixed"
SPACING_M = 30.0
RANGE_M = {4: 36.0, 8: 43.0}
"""Between the distances of the neighbours and of the next robots after them."""
UNIT_S = ESTIMATE_BITS / 3000.0
GUARD_S = 1e-6


# --- propagation ---------------------------------------------------------------------------------


def check_propagation(parameters: PropagationParameters) -> None:
    """Raises ValueError for what the simulation or the emulator cannot do, naming the key."""
    check_simulated(parameters)
    if parameters.neighbours not in RANGE_M:
        raise ValueError("neighbours: the emulator places robots on square grids; set 4 or 8")
    if parameters.rows * parameters.columns > MAX_ROBOTS:
        raise ValueError(f"rows: the emulator takes {MAX_ROBOTS} robots at most; set fewer")


def propagation_overrides(parameters: PropagationParameters) -> list[str]:
    """What makes the shipped scenario one of these parameters."""
    rows, columns = parameters.rows, parameters.columns
    frame_s = _slots(parameters) * (parameters.m * UNIT_S + GUARD_S)
    relay = parameters.m > 1 and parameters.scheme != "own"
    frames = parameters.max_frames if relay else 1
    places = (Lattice(rows, columns, parameters.neighbours).places() + 0.5) * SPACING_M
    return [
        f"world.area_m=[{columns * SPACING_M}, {rows * SPACING_M}]",
        f"radio.range_m={RANGE_M[parameters.neighbours]}",
        f"radio.tdma.units={parameters.m}",
        f"radio.tdma.order={parameters.order}",
        f"radio.tdma.reuse={parameters.reuse}",
        f"run.duration_s={min(frames * frame_s, MAX_TIME_NS / NS_PER_S)}",
        *(
            f"params.{key}={getattr(parameters, key)}"
            for key in ("scheme", "alpha", "new_estimates", "distance")
        ),
        f"params.link_range_m={RANGE_M[parameters.neighbours]}",
        f"params.deployment_m={places.tolist()}",
        f"params.subgraphs={parameters.subgraphs}",
    ]


def simulate_propagation(
    parameters: PropagationParameters, generator: np.random.Generator, samples: int
) -> Ints:
    """Slots until each part of the grid is done, in so many runs; 0 where it is not in time."""
    return np.array([_propagation(parameters, int(generator.integers(2**62))) for _ in range(samples)])


def _propagation(parameters: PropagationParameters, seed: int) -> list[int]:
    grid = Lattice(parameters.rows, parameters.columns, parameters.neighbours)
    overrides = propagation_overrides(parameters)
    found = emulated(GRID, score, seed=seed, robots=grid.robots, overrides=overrides)
    units = [found["propagation"][name]["units"] for name in grid.parts(parameters.subgraphs)]
    return [0 if of_part is None else round(of_part / parameters.m) for of_part in units]


def _slots(parameters: PropagationParameters) -> int:
    return len(Lattice(parameters.rows, parameters.columns, parameters.neighbours).slots(parameters.reuse))


PROPAGATION = Study(
    name="propagation-emulated",
    title="Dissemination on a grid, by robot processes on the emulator",
    parameters=PropagationParameters,
    samples=8,
    unit="runs",
    chunk=one_each,
    simulate=simulate_propagation,
    summarise=summarise,
    check=check_propagation,
    max_jobs=1,  # the robots of one run keep all processors busy
)


# --- age, with what can go wrong -----------------------------------------------------------------


class AgeParameters(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Five flying and four standing robots (`dissemination-mixed`), and what goes wrong."""

    m: SlotLength = 3
    alpha: Alpha = 1.0
    scheme: Scheme = "location"
    duration: Annotated[float, Meta(gt=0, le=10_000, description="of a run [s]")] = 300.0
    loss: Annotated[float, Meta(ge=0, le=1, description="of packets, each by itself")] = 0.0
    burst_loss: Annotated[float, Meta(ge=0, le=0.5, description="of packets, in bursts; in the long run")] = (
        0.0
    )
    burst_length: Annotated[float, Meta(ge=2, le=1000, description="of a burst, mean [packets]")] = 10.0
    dying: Annotated[int, Meta(ge=0, le=9, description="robots that fall silent after half of the run")] = 0
    late: Annotated[int, Meta(ge=0, le=9, description="robots that join after half of the run")] = 0
    drift_ppm: Annotated[float, Meta(ge=0, le=100_000, description="most that a clock is off its pace")] = 0.0
    guard: Annotated[float, Meta(ge=0, le=10, description="silence in a slot [s]")] = GUARD_S


def check_age(parameters: AgeParameters) -> None:
    """Raises ValueError for parameters that do not go together, naming the key."""
    check_flooding(parameters.scheme, parameters.m, 9)
    if parameters.dying + parameters.late > 9:
        raise ValueError("dying: there are 9 robots, and who joins late does not die; set fewer")


def simulate_age(
    parameters: AgeParameters, generator: np.random.Generator, samples: int
) -> list[dict[str, Any]]:
    """The scores of so many runs."""
    return [_aged(parameters, int(generator.integers(2**62))) for _ in range(samples)]


def _aged(parameters: AgeParameters, seed: int) -> dict[str, Any]:
    with tempfile.TemporaryDirectory(prefix="heliograph-") as folder:
        file = Path(folder) / f"{MIXED}.toml"
        file.write_text(load(MIXED).text.decode() + age_tables(parameters))
        return emulated(str(file), score, seed=seed, overrides=age_overrides(parameters))


def age_tables(parameters: AgeParameters) -> str:
    """Tables of the robots that die or come late, to be added to the scenario's file."""
    half = parameters.duration / 2
    dying = [(number, "leaves_s") for number in range(parameters.dying)]
    late = [(8 - number, "joins_s") for number in range(parameters.late)]
    return "".join(
        f'\n[[robot]]\nid = "r{number:02d}"\nparams = {{ {key} = {half} }}\n' for number, key in dying + late
    )


def age_overrides(parameters: AgeParameters) -> list[str]:
    """What makes the shipped scenario one of these parameters."""
    said = [
        f"run.duration_s={parameters.duration}",
        f"radio.tdma.units={parameters.m}",
        f"radio.tdma.guard_s={parameters.guard}",
        f"radio.loss={parameters.loss}",
        f"clock.drift_ppm={parameters.drift_ppm}",
        f"params.scheme={parameters.scheme}",
        f"params.alpha={parameters.alpha}",
    ]
    if parameters.burst_loss > 0:
        leave = 1 / parameters.burst_length
        enter = leave * parameters.burst_loss / (1 - parameters.burst_loss)
        said += [f"radio.bursts.enter={enter}", f"radio.bursts.leave={leave}"]
    return said


def summarise_age(_parameters: AgeParameters, partials: Sequence[list[dict[str, Any]]]) -> dict[str, Any]:
    """`mean` and `se` over runs (None for a single one), except for `samples`.

    `age_s` and `age_p95_s`: mean and 95th percentile of the age of an estimate, while its receiver has one;
    `updates_per_minute`; `unknown_part`: of the time and the pairs, without an estimate; `slots_missed`: the
    part of own slots without a transmission in them.
    """
    scores = [score for partial in partials for score in partial]
    slots = [each["slots_used"] + each["slots_missed"] for each in scores]
    return {
        "age_s": described([each["age_s"]["mean"] for each in scores]),
        "age_p95_s": described([each["age_s"]["p95"] for each in scores]),
        "updates_per_minute": described([each["updates_per_minute"] for each in scores]),
        "unknown_part": described([each["unknown_part"] for each in scores]),
        "slots_missed": described(
            [each["slots_missed"] / of for each, of in zip(scores, slots, strict=True) if of]
        ),
        "samples": len(scores),
    }


AGE = Study(
    name="age-emulated",
    title="Age of estimates among flying and standing robots on the emulator, with what can go wrong",
    parameters=AgeParameters,
    samples=8,
    unit="runs",
    chunk=one_each,
    simulate=simulate_age,
    summarise=summarise_age,
    check=check_age,
    max_jobs=1,
)
