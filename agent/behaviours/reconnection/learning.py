"""How robots move, from how they have moved: "if the robots are performing a repetitive task, such as
surveillance, historic path data will be available" (Vandermeulen et al., sec. III.B).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from agent.behaviours.reconnection.model import Ways, uniform
from channels.graphs import Floats, Ints


class History:
    """Which ways robots went, and how long everything took.

    Told of the vertices that robots come to, in the order of each, it gives what `model.walk_model` takes.
    """

    def __init__(self, ways: Ways) -> None:
        self._ways = ways
        self._number = {
            pair: way for way, pair in enumerate(zip(ways.tail.tolist(), ways.head.tolist(), strict=True))
        }
        self._last: dict[int, tuple[int, int]] = {}
        self.went: Ints = np.zeros(len(ways.tail), dtype=np.int64)
        """(2 E,): how often each way was gone."""
        self.on_way: list[list[int]] = [[] for _ in ways.tail]
        """How many steps each of these times took, for every way."""
        self.stayed: dict[int, list[int]] = {}
        """How many steps robots stayed at each vertex."""

    def visit(self, vertex: int, step: int, left: int | None = None, robot: int = 0) -> None:
        """A robot came to a vertex in this step and was there last in step `left`, by default the same.

        Raises ValueError where no way leads there from where that robot was before, or not in that time;
        `forget` it first, if it has been out of sight.
        """
        left = step if left is None else left
        if not 0 <= vertex < len(self._ways.start) - 1 or left < step:
            raise ValueError(f"visit: none can be at vertex {vertex} from step {step} to step {left}")
        if robot in self._last:
            before, departed = self._last[robot]
            way, steps = self._number.get((before, vertex)), step - departed - 1
            if way is None or steps < 1:
                raise ValueError(
                    f"visit: from vertex {before}, left after step {departed}, "
                    f"no way leads to vertex {vertex} at step {step}"
                )
            self.went[way] += 1
            self.on_way[way].append(steps)
        self.stayed.setdefault(vertex, []).append(left - step + 1)
        self._last[robot] = vertex, left

    def forget(self, robot: int = 0) -> None:
        """Where this robot goes next does not follow from where it was."""
        self._last.pop(robot, None)

    def mu(self, prior: float = 1.0) -> Floats:
        """`learnt_mu` of all that was told."""
        return learnt_mu(self._ways, self.went, prior)

    def holding(self, prior: float = 1.0, spread: float = 0.5) -> list[Floats]:
        """`learnt_holding` of all that was told."""
        return learnt_holding(self._ways, self.on_way, prior, spread)

    def dwell(self, prior: float = 1.0) -> Mapping[int, Floats]:
        """`learnt_dwell` of the stays at every vertex where there was one."""
        return {vertex: learnt_dwell(stays, prior) for vertex, stays in sorted(self.stayed.items())}


def learnt_mu(ways: Ways, went: Sequence[int] | Ints, prior: float = 1.0) -> Floats:
    """How likely each way is once its tail is left: (2 E,), from how often each was gone.

    "The fraction of times where a robot at v went to w next" (sec. III.B) after `prior` is added to every
    count, so that nothing is impossible that has only never happened; 0 gives the fraction itself. Out of
    vertices of which nothing is known all ways are equally likely.
    """
    if not (math.isfinite(prior) and prior >= 0):
        raise ValueError(f"prior: must be a number of 0 or more, is {prior}")
    counts = np.asarray(went, dtype=np.float64)
    if counts.shape != ways.tail.shape or np.any(counts < 0):
        raise ValueError(f"went: must be {len(ways.tail)} counts, one for each way")
    degrees = np.diff(ways.start)
    totals = np.repeat(np.add.reduceat(counts, ways.start[:-1]), degrees)
    degrees = np.repeat(degrees, degrees)
    known = totals + prior * degrees > 0
    return np.where(known, (counts + prior) / np.where(known, totals + prior * degrees, 1.0), 1.0 / degrees)


def learnt_holding(
    ways: Ways, on_way: Sequence[Sequence[int]], prior: float = 1.0, spread: float = 0.5
) -> list[Floats]:
    """Distributions of the steps on every way, from how many it took each time.

    What one assumes otherwise, `model.uniform` about the usual, counts as `prior` samples, and alone where
    there are none: with a prior, nothing that is usually possible becomes impossible.
    """
    if not (math.isfinite(prior) and prior >= 0):
        raise ValueError(f"prior: must be a number of 0 or more, is {prior}")
    if len(on_way) != len(ways.tail):
        raise ValueError(f"on_way: must be {len(ways.tail)} lists of samples, one for each way")
    found = []
    for steps, samples in zip(ways.steps.tolist(), on_way, strict=True):
        gamma = uniform(steps, spread)
        if samples:
            longest = max(len(gamma), *samples)
            assumed = np.pad(gamma, (0, longest - len(gamma)))
            counted = empirical(samples, longest=longest) * len(samples)
            gamma = (counted + prior * assumed) / (len(samples) + prior)
        found.append(gamma)
    return found


def learnt_dwell(stays: Sequence[int], prior: float = 1.0) -> Floats:
    """Distribution of the steps at a vertex, from how many there were each time, at least once.

    That every number up to the longest is equally likely counts as `prior` samples, as in `learnt_holding`:
    who once worked there may pass through, or work for less. What took longer than ever stays impossible.
    """
    if not (math.isfinite(prior) and prior >= 0):
        raise ValueError(f"prior: must be a number of 0 or more, is {prior}")
    return empirical(stays, smoothing=prior / max(stays, default=1))


def empirical(samples: Sequence[int], smoothing: float = 0.0, longest: int | None = None) -> Floats:
    """How often each number of steps, from 1, occurred: fractions of at least one sample.

    `smoothing` is added to every count up to `longest`, by default the longest sample. Raises ValueError
    for samples below 1 or above `longest`, and where there is nothing to count.
    """
    most = max(samples, default=0) if longest is None else longest
    if any(not 1 <= sample <= most for sample in samples):
        raise ValueError(f"samples: holding times must be 1 to {most} steps, one is {min(samples)}")
    if not (math.isfinite(smoothing) and smoothing >= 0):
        raise ValueError(f"smoothing: must be a number of 0 or more, is {smoothing}")
    if most < 1 or not (len(samples) or smoothing):
        raise ValueError("samples: there are none; give some, or smoothing and longest")
    counts = np.bincount(np.asarray(samples, dtype=np.int64), minlength=most + 1)[1:] + smoothing
    return np.asarray(counts / counts.sum())
