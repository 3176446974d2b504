"""A finer model of channel association by moving robots, for what Ivanov & Shell 2016 leave open (sec. 5.7).

Observer and geometry as in `mobile_models`; p = 1/2, equal ranges. What the paper's models do not have:

- *Ids are listed at their first activation* (sec. 5.2), not on entering. Those listed in one step, a *batch*,
  come from all age regions: of those that entered k steps ago, a share of 2^-(k+1).
- *Batches are random.* A robot stands anywhere in its own grid cell, with equal probability (sec. 5.4), and
  cells are independent: a batch is a sum of independent Bernoulli variables, one per cell. Its variance,
  mean - sum_c pi_c^2, is below a Poisson variable's. That is Var[v_new] of Eq. 10, which the paper took from
  its simulation.
- *The others that an id meets* are its batch, and big batches have more ids: E[v(v-1)]/E[v], not E[v]-1.
- *A false edge* of a batch listed a steps ago is left with probability 2^-a, also where its wireless id has
  left the range and only stays in the list. Robot j is matched with probability
  prod_{c != j} (1 - 2^-a pi_c); and edges to robots out of range, which are silent, go together.
- *The mean of quotients* (over observers) differs from the quotient of means. By the delta method,
  E[X/L] = E[X]/E[L] (1 + Var[L]/E[L]^2 - Cov[X,L]/(E[X]E[L])), L the visual ids in the list.
- *Mobile robots among the others* (sec. 6.2) are independent of all, and cross the range at their speed
  relative to the observer, which is 4/pi times its own on average: more of them are new in a step.

Sums over cells are averaged over direction and phase of the grid, by a quadrature: points of the disc, on
lines along the motion, weighted with their area. Neglected: ids that come again, walls.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenarios.association.mobile_models import MobileSystem, age_regions

Floats = NDArray[np.float64]

OLDEST_BATCH = 26
"""Steps after which all is taken for matched: false edges are left with 2^-26."""
GRIDS = 8
"""Directions and phases of the grid that are averaged over; the results vary by less than 1e-4 with them."""
_GRID_POINTS = 16
"""Points per separation; fewer where the range spans so many robots that it does not matter."""


@dataclass(frozen=True)
class NewIds:
    """Mean and variance of the number of ids that are new in a step: in the frontier, or listed."""

    mean: float
    frontier_variance: float
    listed_mean: float
    listed_variance: float


@dataclass(frozen=True)
class BatchModel:
    """The finer model's steady state."""

    fraction_matched: float
    """Mean over observers of matched / visual ids in the list."""
    fraction_matched_of_sums: float
    ratio: float
    """Mean over observers of total / true edges."""
    ratio_of_sums: float
    visual_ids_in_list: float
    visual_ids_in_list_sd: float


@dataclass(frozen=True)
class _Grid:
    """One direction and phase of the grid; arrays are by cell."""

    listed: list[Floats]
    """For batches by how long ago they were listed, a: [b, cell], b = 0 ... a: probability that the cell's
    robot was listed then and stayed for at least b steps more."""
    ever: Floats
    """Its robot is in the list, whenever it came there."""
    frontier: Floats
    """Its robot is in the frontier."""

    def all_listed(self) -> Floats:
        """[a, cell]: listed a steps ago."""
        return np.array([stayed[0] for stayed in self.listed])

    def in_range(self) -> Floats:
        """[a, cell]: listed a steps ago, and still in range."""
        return np.array([stayed[-1] for stayed in self.listed])


def new_ids(system: MobileSystem) -> NewIds:
    """What is new in a step, all other robots standing still; for Eq. 10."""
    frontier2, listed, listed2 = np.mean(
        [
            ((grid.frontier**2).sum(), grid.listed[0].sum(), (grid.listed[0] ** 2).sum())
            for grid in _grids(system, oldest=1)
        ],
        axis=0,
    )
    mean = system.new_ids()
    return NewIds(mean, mean - float(frontier2), float(listed), float(listed - listed2))


def batch_model(system: MobileSystem, mobile_fraction: float = 0.0) -> BatchModel:
    """The steady state when a fraction of the other robots moves too, as fast as the observer, anywhere.

    Raises ValueError for a fraction not in [0, 1].
    """
    if not 0 <= mobile_fraction <= 1:
        raise ValueError(f"mobile_fraction: {mobile_fraction} is no fraction; give a number from 0 to 1")
    mobile = _Mobile.of(system, mobile_fraction)
    moments = [_moments(grid, mobile) for grid in _grids(system, OLDEST_BATCH, 1 - mobile_fraction)]
    ids, ids_variance, matched, matched_cov, false, false_cov = (float(x) for x in np.mean(moments, axis=0))

    def mean_quotient(mean: float, covariance: float) -> float:
        return mean / ids * (1 + ids_variance / ids**2) - covariance / ids**2

    return BatchModel(
        fraction_matched=mean_quotient(matched, matched_cov),
        fraction_matched_of_sums=matched / ids,
        ratio=1 + mean_quotient(false, false_cov),
        ratio_of_sums=1 + false / ids,
        visual_ids_in_list=ids,
        visual_ids_in_list_sd=math.sqrt(ids_variance),
    )


@dataclass(frozen=True)
class _Mobile:
    """Mobile robots among the others: Poisson numbers."""

    listed: float
    """Mean number in a batch."""
    in_range: Floats
    """By batch age: mean number listed then and still in range."""
    ever: float
    """Mean number in the list."""

    @staticmethod
    def of(system: MobileSystem, fraction: float, directions: int = 64) -> _Mobile:
        """Averages over directions; at an angle x to the observer's the relative speed is 2d sin(x/2)."""
        listed = ever = 0.0
        in_range = np.zeros(OLDEST_BATCH)
        for angle in (np.arange(directions) + 0.5) * math.pi / directions if fraction else ():
            relative = max(2 * system.speed * math.sin(angle / 2), 1e-3 * system.radius)
            regions = age_regions(system.radius, relative) * system.density * fraction / directions
            first = 0.5 ** np.arange(1, len(regions) + 1)
            listed += float(regions @ first)
            ever += float(regions @ (1 - first))
            for age in range(min(OLDEST_BATCH, len(regions))):
                in_range[age] += regions[age:] @ first[: len(regions) - age]
        return _Mobile(listed, in_range, ever)


def _moments(grid: _Grid, mobile: _Mobile) -> tuple[float, ...]:
    """Of one grid: E[L], Var[L], E[X], Cov[X, L] for X the matched ids, and for X the false edges."""
    ids = grid.ever.sum() + mobile.ever
    variance = (grid.ever * (1 - grid.ever)).sum() + mobile.ever
    return float(ids), float(variance), *_matched(grid, mobile), *_false_edges(grid, mobile)


def _matched(grid: _Grid, mobile: _Mobile) -> tuple[float, float]:
    """Mean of the matched ids, and their covariance with the ids in the list.

    A covariance is the sum over robots of the probability to be in the list, times what the mean gains then.
    """
    here, moving = grid.in_range(), mobile.in_range
    older = grid.ever - here.sum(0)  # in the list for so long that they are matched
    older_moving = mobile.ever - moving.sum()
    elsewhere = older.sum() - older + older_moving  # matched, if the robot of this cell is not in the list
    mean = older.sum() + older_moving
    covariance = 0.0
    for age, stayed in enumerate(grid.listed):
        likely, edge = _false_edge(stayed)
        _, edge_moving = _false_edge(moving[: age + 1, None])
        nobody = likely * np.prod(1 - edge, axis=1, keepdims=True) * np.exp(-edge_moving)
        alone = 1 / (1 - edge)  # times `nobody`: no edge to any other cell
        candidates = (here[age] * alone).sum(1, keepdims=True) + moving[age]
        matched = float((nobody * candidates).sum())
        without = (nobody * alone * (candidates - here[age] * alone)).sum(0)
        mean += matched
        elsewhere = elsewhere + without
        covariance += float((here[age] * ((nobody * alone).sum(0) - 0.5**age * without)).sum())
        covariance += float(moving[age] * (nobody.sum() - 0.5**age * matched))
    covariance += float((grid.ever * elsewhere).sum() + older.sum() + older_moving - grid.ever.sum() * mean)
    return float(mean), covariance


def _false_edge(stayed: Floats) -> tuple[Floats, Floats]:
    """Probability of a false edge to the robot of each cell, given how long the visual id has been dark, k.

    `stayed` [b, cell]: listed a steps ago and in range for at least b of them. Out of range a robot is
    silent: it agrees with a visual id that is dark ever since it left. Returns the probabilities of
    k = 0 ... a, [k, 1], and the edges', [k, cell].
    """
    age = len(stayed) - 1
    b = np.arange(age)[:, None]
    left = 0.5**b * (stayed[:-1] - stayed[1:])  # and disagreed with nothing before
    since = np.concatenate([np.zeros((1, stayed.shape[1])), np.cumsum(left[::-1], axis=0)])
    likely = np.append(0.5 ** np.arange(1.0, age + 1), 0.5**age)[:, None]
    return likely, since + 0.5**age * stayed[-1]


def _false_edges(grid: _Grid, mobile: _Mobile) -> tuple[float, float]:
    """Mean of the false edges, and their covariance with the ids in the list; see `_matched`."""
    listed, here, moving = grid.all_listed(), grid.in_range(), mobile.in_range[:, None]
    left = 0.5 ** np.arange(len(listed))[:, None]
    batch = listed.sum(1, keepdims=True) + mobile.listed
    here_all = here.sum(1, keepdims=True) + moving
    own = left * (batch - listed)
    by_batch = (here * own).sum(1, keepdims=True) + moving * left * batch
    mean = by_batch.sum()
    elsewhere = (by_batch - here * own - left * listed * (here_all - here)).sum(0)
    covariance = (grid.ever * elsewhere).sum() - grid.ever.sum() * mean
    covariance += (here * (own + left * (here_all - here))).sum() + (moving * left * (batch + here_all)).sum()
    return float(mean), float(covariance)


def _grids(system: MobileSystem, oldest: int, occupied: float = 1.0) -> Iterator[_Grid]:
    """Quadrature for directions and phases from a sequence of low discrepancy (powers of 1/1.2207...)."""
    across, behind, chord, area = _points(system)
    weight = area * system.density * occupied
    entered = np.floor(behind / system.speed + 1e-9)
    stays = np.floor((chord - behind) / system.speed + 1e-9)
    first = 0.5 ** (entered + 1)
    ages = np.arange(oldest)
    for number in range(GRIDS):
        angle, *phase = (0.5 + number * 1.2207440846057596 ** -np.arange(1.0, 4.0)) % 1
        direction = complex(math.cos(angle * math.pi / 4), math.sin(angle * math.pi / 4))
        along = chord / 2 - behind - ages[:, None] * system.speed
        place = (along + 1j * across) * direction / system.separation
        rows = np.floor(place.real + phase[0]).astype(np.int64)
        columns = np.floor(place.imag + phase[1]).astype(np.int64)
        cells, cell = np.unique(rows * 2**32 + columns, return_inverse=True)
        cell = cell.reshape(rows.shape)

        yield _Grid(
            listed=[_stayed(weight * first, stays, at, age, len(cells)) for age, at in enumerate(cell)],
            ever=_stayed(weight * (1 - first), stays, cell[0], 0, len(cells))[0],
            frontier=_stayed(weight * (entered == 0), stays, cell[0], 0, len(cells))[0],
        )


def _stayed(weight: Floats, stays: Floats, cell: NDArray[np.int64], age: int, cells: int) -> Floats:
    """[b, cell]: sums of the weights of points in each cell that stay for at least b of `age` steps."""
    exactly = np.minimum(stays, age).astype(np.int64)
    counts = np.bincount(exactly * cells + cell, weight, (age + 1) * cells).reshape(age + 1, cells)
    return np.asarray(np.cumsum(counts[::-1], axis=0)[::-1])


def _points(system: MobileSystem) -> tuple[Floats, Floats, Floats, Floats]:
    """Points of the disc: distance from the line of motion, behind the front arc, length of chord, area.

    Lines along the motion lie as sines of equal angles, which is exact enough at the disc's sides; on a line
    points are spaced by a part of the speed, so that every one has one age.
    """
    radius, speed = system.radius, system.speed
    per_separation = min(_GRID_POINTS, max(4, int(9 * _GRID_POINTS * system.separation / radius)))
    spacing = min(system.separation / per_separation, radius / 16)
    lines = max(64, math.ceil(math.pi * radius / spacing))
    angle = ((np.arange(lines) + 0.5) / lines - 0.5) * math.pi
    step = speed / math.ceil(speed / spacing)
    front = np.arange(math.ceil(2 * radius / step)) * step
    across, chord = radius * np.sin(angle)[:, None], 2 * radius * np.cos(angle)[:, None]
    width = radius * np.cos(angle)[:, None] * math.pi / lines
    length = np.clip(chord - front, 0, step)
    inside = length > 0

    def spread(values: Floats) -> Floats:
        return np.asarray(np.broadcast_to(values, length.shape)[inside])

    return spread(across), spread(front + length / 2), spread(chord), spread(width * length)
