"""The papers' models of channel association by moving robots (Ivanov & Shell 2016, sec. 5.6 to 5.8).

An observer drives straight at speed d (per step) through robots that stand still with density 1/separation^2;
radio and camera both reach to the radius r. Lengths are in robot diameters, or whatever unit all three have.

*Literal* is what is printed; *corrected* is the same model without the faults found:

- Eq. 11 takes a true edge for lost if either of its ids leaves, as if they were two robots. They are one:
  p_T- = v_exit / v_rest. (For false edges it is right if wireless ids are dropped as they leave. The paper's
  algorithm keeps them for the drop time, so that an edge goes with its visual id; then v_exit / v_rest holds
  for false edges too, as Eq. 12 has it.)
- Eq. 3 is applied (sec. 5.7) with w = v = the mean number of new ids, which makes no sense below one id (None
  here), and is an approximation above. The corrected model uses the exact fraction (1 - 2^-t)^n with the
  number n of other new ids that a new id meets on average, E[v(v-1)] / E[v] = lambda_F+ / lambda_T+.
- Eq. 8 reads "row vector times M^t", and m_F- in Eq. 12 is m_F.

In an age region i = 1, 2, ... (sec. 5.6.1) t = i - 1 observations have removed edges; the first only adds
them. `mobile_batches` has a finer model, and what Var[v_new] in Eq. 10 is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SURVIVES = 0.5
"""m_F: the probability that a false edge outlives an observation (sec. 4.3.3); m_T is 1."""
MOST_REGIONS = 2000
"""Of age; speeds below a thousandth of the radius are as good as standing still."""
MOST_ROBOTS = 10_000
"""In range; a matter of time and memory only."""


@dataclass(frozen=True)
class MobileSystem:
    """What the models are functions of (sec. 5.5); raises ValueError where a value is not positive."""

    radius: float
    speed: float
    separation: float

    def __post_init__(self) -> None:
        for key, value in (("range", self.radius), ("speed", self.speed), ("separation", self.separation)):
            if not (value > 0 and math.isfinite(value)):
                raise ValueError(f"{key}: {value} is not a positive length; give a number above 0")
        if 2 * self.radius > MOST_REGIONS * self.speed:
            raise ValueError(
                f"speed: {self.speed} is too slow for these models; "
                f"give at least {2 / MOST_REGIONS} of the range, or use the stationary law"
            )

        robots = math.pi * self.radius**2 * self.density
        if robots > MOST_ROBOTS:
            raise ValueError(
                f"separation: {self.separation} puts {robots:.0f} robots in range; "
                f"give a larger one, for at most {MOST_ROBOTS}"
            )

    @property
    def density(self) -> float:
        """Robots per unit of area."""
        return self.separation**-2

    def regions(self) -> Floats:
        """Expected population of every age region, the frontier first (sec. 5.6.1)."""
        return self.density * age_regions(self.radius, self.speed)

    def new_ids(self) -> float:
        """Expected robots in the frontier, E[v_new]; as many leave."""
        return float(self.regions()[0])


def overlap_area(radius: float, distance: float | Floats) -> Floats:
    """Area covered by both of two discs whose centres are `distance` apart (Eq. 5); 0 from 2r on."""
    half = np.minimum(np.asarray(distance, dtype=float) / 2, radius)
    lens = 2 * radius**2 * np.arccos(half / radius) - 2 * half * np.sqrt(radius**2 - half**2)
    return np.asarray(lens)


def age_regions(radius: float, speed: float) -> Floats:
    """Areas that have been in range for 1, 2, ... steps, present one included; together the whole disc."""
    behind = overlap_area(radius, speed * np.arange(math.ceil(2 * radius / speed) + 1.0))
    return behind[:-1] - behind[1:]


def new_false_edges(mean: float, variance: float) -> float:
    """lambda_F+ (Eq. 10): each of v new visual ids gets false edges to v - 1 new wireless ones, E[v(v-1)].

    Raises ValueError where no number of ids has that mean and variance: v(v-1) is never negative.
    """
    edges = variance + mean**2 - mean
    if edges < 0:
        raise ValueError(
            f"new_ids_variance: {variance} is impossible for {mean:.4g} new ids a step; "
            f"give at least {mean - mean**2:.4g}, or leave it out"
        )
    return edges


def fraction_matched_literal(system: MobileSystem, variance: float | None = None) -> float | None:
    """Sec. 5.7: Eqs. 2 and 3 for every age region, with w = v = E[v_new]; None where that is below 1.

    F_init is w v - v of these means, as sec. 4.4.2 has it; or, given Var[v_new], what Eq. 10 makes of it. The
    paper says that its model underestimates, without saying which it took: the first overestimates, the
    second underestimates.
    """
    populations = system.regions()
    v = system.new_ids()
    if v < 1:
        return None
    initial = v * v - v if variance is None else new_false_edges(v, variance)
    false_edges = initial * SURVIVES ** np.arange(len(populations))
    return _weighted(((v - 1) / v) ** false_edges, populations)


def fraction_matched_corrected(system: MobileSystem, variance: float) -> float:
    """Sec. 5.7 with the exact fraction for an id that came with E[v(v-1)] / E[v] others."""
    populations = system.regions()
    others = new_false_edges(system.new_ids(), variance) / system.new_ids()
    matched = (1 - SURVIVES ** np.arange(len(populations))) ** others
    return _weighted(matched, populations)


@dataclass(frozen=True)
class BranchingModel:
    """A branching process with migration: one mean matrix for true and false edges, or one for each.

    The first type is the migrator, who stays and brings the new edges.
    """

    true_edges: Floats
    """Mean matrix M whose other types are true edges (Eq. 6 without its last row and column; Eq. 12)."""
    false_edges: Floats

    def steady_state(self) -> tuple[float, float]:
        """Expected true and false edges in the long run: P = lambda (I - M')^-1, for one type Eq. 9."""
        return _steady(self.true_edges), _steady(self.false_edges)

    def ratio(self) -> float:
        """Total to true edges in the steady state (sec. 5.3)."""
        true, false = self.steady_state()
        return (true + false) / true

    def after(self, true: Floats, false: Floats, steps: int) -> tuple[Floats, Floats]:
        """Populations (Eq. 7, 13: migrator first) after so many steps: row vector times M^t (Eq. 8)."""
        return (
            np.asarray(true @ np.linalg.matrix_power(self.true_edges, steps)),
            np.asarray(false @ np.linalg.matrix_power(self.false_edges, steps)),
        )


def two_region_model(system: MobileSystem, variance: float, *, corrected: bool) -> BranchingModel:
    """The frontier and the rest (Eqs. 6 to 11). No edge changes its type: Eq. 6's matrix is given as two.

    Where more robots leave than the rest holds (fast robots), all leave.
    """
    populations = system.regions()
    new, rest = populations[0], populations[1:].sum()
    exit_ = min(1.0, new / rest) if rest > 0 else 1.0
    either = 1 - (1 - exit_) ** 2  # Eq. 11
    return BranchingModel(
        true_edges=np.array([[1, new], [0, 1 - (exit_ if corrected else either)]]),
        false_edges=np.array([[1, new_false_edges(new, variance)], [0, SURVIVES * (1 - either)]]),
    )


def multi_region_model(system: MobileSystem, variance: float) -> BranchingModel:
    """All age regions (Eqs. 12 and 13), for true edges with m = 1; nothing in it needs correction."""
    populations = system.regions()
    new = float(populations[0])
    stays = populations[1:] / populations[:-1]
    return BranchingModel(
        true_edges=_regions_matrix(new, stays),
        false_edges=_regions_matrix(new_false_edges(new, variance), SURVIVES * stays),
    )


def _regions_matrix(new_edges: float, growth: Floats) -> Floats:
    """Eq. 12."""
    regions = len(growth) + 1
    matrix = np.zeros((regions + 1, regions + 1))
    matrix[0, :2] = 1, new_edges
    matrix[np.arange(1, regions), np.arange(2, regions + 1)] = growth
    return matrix


def _steady(matrix: Floats) -> float:
    """Sum of the types but the migrator, where P = lambda + P M'."""
    types = matrix[1:, 1:]
    return float(np.linalg.solve(np.eye(len(types)) - types.T, matrix[0, 1:]).sum())


def _weighted(values: NDArray[np.floating[Any]], weights: Floats) -> float:
    return float((values * weights).sum() / weights.sum())
