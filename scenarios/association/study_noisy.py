"""Large samples of association under noise, all at once (Ivanov & Shell 2016, sec. 6.3, carried out).

Every step each of w robots in range transmits in both channels at once with probability p; messages are
lost, lit lamps missed and dark ones seen lit, independently. The observer knows the rates, weighs the
evidence of all w x v pairs, and takes the likeliest one-to-one assignment of visual to wireless ids, ties at
random: the answers of `NoisyIState` (closed, with known rates), for thousands of neighbourhoods at once.
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from agent.behaviours.association.matching import TIE_NOISE
from agent.behaviours.association.rates import ChannelRates
from scenarios.association.study_stationary import check_inclusion
from scenarios.study import Study, error_of_sums

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

CELLS_PER_CHUNK = 2**18
"""Pairs of ids looked at at once: as many as fit a processor's cache, times a few."""
SURE = 0.99

Rate = Annotated[float, Meta(ge=0, le=1)]


class NoisyParameters(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One neighbourhood, and how its channels err."""

    wireless: Annotated[int, Meta(ge=1, le=1000, description="robots heard, w")] = 20
    visual: Annotated[int, Meta(ge=1, le=1000, description="robots seen, v, all of them heard")] = 10
    wireless_loss: Annotated[Rate, Meta(description="probability that a message is lost")] = 0.1
    visual_miss: Annotated[Rate, Meta(description="probability that a lit lamp is missed")] = 0.0
    visual_false: Annotated[Rate, Meta(description="probability that a dark lamp is seen lit")] = 0.0
    p: Annotated[Rate, Meta(description="probability that a robot transmits in a step")] = 0.5
    steps: Annotated[int, Meta(ge=0, le=10_000, description="steps after the roll call")] = 60


class Tallies(Struct, frozen=True):
    """What a chunk has to tell by step (index t: after t steps); whole numbers, which add up exactly."""

    samples: int
    all_right: Ints
    """Samples in which every visual id is assigned to its robot."""
    right: Ints
    """Visual ids assigned to their robot, summed over the samples."""
    right_squared: Ints
    """The same of the squares."""


def rates_of(parameters: NoisyParameters) -> ChannelRates:
    """The rates that the observer is told."""
    return ChannelRates(
        transmission_probability=parameters.p,
        wireless_loss=parameters.wireless_loss,
        visual_miss=parameters.visual_miss,
        visual_false=parameters.visual_false,
    )


class Evidence:
    """What many observers have seen so far of their pairs; robot j is visual id j and wireless id j.

    All `samples` neighbourhoods have `wireless` robots, the first `visual` of which are in sight.
    """

    def __init__(self, rates: ChannelRates, samples: int, wireless: int, visual: int) -> None:
        table = rates.log_likelihood_ratios()
        self._impossible = np.isneginf(table)
        self._table = np.where(self._impossible, 0.0, table)
        self._both = np.zeros((samples, wireless, visual))
        self._heard = np.zeros((samples, wireless, 1))
        self._lit = np.zeros((samples, 1, visual))
        self._steps = 0

    def update(self, heard: Bools, lit: Bools) -> None:
        """Take in one step: who was heard (samples, wireless), and who was seen lit (samples, visual)."""
        self._both += heard[:, :, None] & lit[:, None, :]
        self._heard += heard[:, :, None]
        self._lit += lit[:, None, :]
        self._steps += 1

    def log_likelihood_ratios(self) -> Floats:
        """As `NoisyIState` has them; (samples, wireless, visual)."""
        silent_lit = self._lit - self._both
        heard_dark = self._heard - self._both
        silent_dark = self._steps - self._heard - silent_lit
        counts = ((silent_dark, silent_lit), (heard_dark, self._both))
        total = np.zeros_like(self._both)
        for x, y in ((0, 0), (0, 1), (1, 0), (1, 1)):
            total += self._table[x, y] * counts[x][y]
        for x, y in np.argwhere(self._impossible):
            total[counts[x][y] > 0] = -np.inf
        return total


def likeliest(weights: Floats, generator: np.random.Generator) -> Ints:
    """Row of each column in the assignment of greatest weight, ties at random; (samples, columns).

    `weights` (samples, rows, columns), at least as many rows as columns. All are perturbed by less than
    TIE_NOISE, so that neither index nor rounding (1e-13) decides. Evidence is not overruled: totals of two
    assignments differ by a * K + b * H, with whole numbers K and H of observations, which is 0 or
    far more than the noise can add up to (tested on a grid of rates). An impossible pair is never taken.

    Where the best rows of all columns are different, they are the answer. Only the rest needs solving.
    """
    perturbed = weights + TIE_NOISE * generator.random(weights.shape)
    found: Ints = perturbed.argmax(axis=1)
    ordered = np.sort(found, axis=1)
    contested = (ordered[:, 1:] == ordered[:, :-1]).any(axis=1)
    costs = -perturbed.transpose(0, 2, 1)
    for sample in np.flatnonzero(contested):
        found[sample] = linear_sum_assignment(costs[sample])[1]
    return found


def check(parameters: NoisyParameters) -> None:
    """Raises ValueError for parameters that do not go together, naming the key."""
    check_inclusion(parameters.wireless, parameters.visual)


def chunk(parameters: NoisyParameters) -> int:
    """Neighbourhoods per chunk."""
    return max(1, CELLS_PER_CHUNK // (parameters.wireless * parameters.visual))


def simulate(parameters: NoisyParameters, generator: np.random.Generator, samples: int) -> Tallies:
    """So many neighbourhoods, step by step."""
    evidence = Evidence(rates_of(parameters), samples, parameters.wireless, parameters.visual)
    truth = np.arange(parameters.visual)
    all_right, right, squared = np.zeros((3, parameters.steps + 1), dtype=np.int64)
    for step in range(parameters.steps + 1):
        if step:
            evidence.update(*observations(parameters, generator, samples))
        matches = (likeliest(evidence.log_likelihood_ratios(), generator) == truth).sum(axis=1)
        all_right[step] = (matches == parameters.visual).sum()
        right[step] = matches.sum()
        squared[step] = (matches**2).sum()
    return Tallies(samples, all_right, right, squared)


def observations(
    parameters: NoisyParameters, generator: np.random.Generator, samples: int
) -> tuple[Bools, Bools]:
    """One step of the two channels: who is heard (samples, wireless), and seen lit (samples, visual)."""

    def happens(probability: float, robots: int) -> Bools:
        if probability == 0.0:
            return np.zeros((samples, robots), dtype=np.bool_)
        return generator.random((samples, robots)) < probability

    sent = happens(parameters.p, parameters.wireless)
    heard = sent & ~happens(parameters.wireless_loss, parameters.wireless)
    shown = sent[:, : parameters.visual]
    missed = happens(parameters.visual_miss, parameters.visual)
    imagined = happens(parameters.visual_false, parameters.visual)
    return heard, np.where(shown, ~missed, imagined)


def summarise(parameters: NoisyParameters, partials: list[Tallies]) -> dict[str, Any]:
    """What was found, by step (index t: after t steps; 0: before the first, at random).

    - `p_all_right`: fraction of samples with every visual id assigned to its robot, and `p_all_right_se`;
    - `fraction_right`: mean fraction of visual ids assigned to their robot, and `fraction_right_se`;
    - `t99_all`, `t99_fraction`: the first step at which the one or the other is at least 0.99; None: never;
    - `samples`. Standard errors are None below two samples.
    """
    samples = sum(partial.samples for partial in partials)
    all_right = sum((partial.all_right for partial in partials[1:]), partials[0].all_right).tolist()
    right = sum((partial.right for partial in partials[1:]), partials[0].right).tolist()
    squared = sum((partial.right_squared for partial in partials[1:]), partials[0].right_squared).tolist()
    p_all = [count / samples for count in all_right]
    fraction = [count / (samples * parameters.visual) for count in right]
    return {
        "p_all_right": p_all,
        "p_all_right_se": [error_of_sums(samples, count, count) for count in all_right],
        "fraction_right": fraction,
        "fraction_right_se": [
            error_of_sums(samples, count, square, parameters.visual)
            for count, square in zip(right, squared, strict=True)
        ],
        "t99_all": _first(p_all),
        "t99_fraction": _first(fraction),
        "samples": samples,
    }


def _first(values: list[float]) -> int | None:
    return next((step for step, value in enumerate(values) if value >= SURE), None)


STUDY = Study(
    name="association-noisy",
    title="Association under noise: how often the likeliest assignment is right, step by step",
    parameters=NoisyParameters,
    samples=20_000,
    unit="runs",
    chunk=chunk,
    simulate=simulate,
    summarise=summarise,
    check=check,
)
