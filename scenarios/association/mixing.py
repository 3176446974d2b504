"""Sharing out ids over two sets of symbols: one step of the recursion in `theory`.

A `Chances` holds, for every number of invisible and of visible ids, the probability that those ids are told
apart (`done`) and that they are not (`undone`). Both are kept, and the smaller one is never computed by
subtraction.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.stats import binom

Floats = NDArray[np.float64]

NEGLIGIBLE_MASS = 1e-30
"""Of the binomial number of ids in the rarer group; far below the smallest survival of interest (1e-16)."""


@dataclass(frozen=True)
class Chances:
    """Probabilities for u = 0, 1, ... invisible (rows) and v = 0, 1, ... visible ids (columns)."""

    done: Floats
    undone: Floats

    @staticmethod
    def before_any_step(invisible: int, visible: int) -> Chances:
        """Nobody is told apart from anybody: done with nobody in sight, or with one id only."""
        done = np.zeros((invisible + 1, visible + 1))
        done[:, 0] = 1.0
        done[0, :2] = 1.0
        return Chances(done, 1.0 - done)


def mix(first: Chances, second: Chances, share: float) -> Chances:
    """The chances when every id belongs to the first group with probability `share`, else to the second.

    Ids of different groups are told apart; those within a group are with the chances given:
    done(u, v) = sum_{a,b} Bin(a; u, share) Bin(b; v, share) first.done(a, b) second.done(u-a, v-b).
    """
    if share > 0.5:
        first, second, share = second, first, 1.0 - share
    rows, columns = (size - 1 for size in first.done.shape)
    if rows < columns:  # the loop of `_convolve` runs over columns: let there be few
        turned = mix(_transposed(first), _transposed(second), share)
        return _transposed(turned)
    row, column = _weights(rows, share), _weights(columns, share)
    common = np.stack([second.done, second.undone]) * (row.second[:, None] * column.second)
    common = _convolve(first.done * (row.first[:, None] * column.first), common)
    done, undone = common / (row.total[:, None] * column.total)
    undone += row.binomials @ first.undone @ column.binomials.T
    return Chances(np.where(undone < 0.5, 1.0 - undone, done), np.where(done < 0.5, 1.0 - done, undone))


def mix_alike(chances: Chances, groups: int) -> Chances:
    """The chances when every id belongs to one of so many groups, uniformly, all with the same chances."""
    mixed, mixed_groups = chances, 1
    for binary_digit in bin(groups)[3:]:
        mixed, mixed_groups = mix(mixed, mixed, 0.5), 2 * mixed_groups
        if binary_digit == "1":
            mixed, mixed_groups = mix(chances, mixed, 1 / (mixed_groups + 1)), mixed_groups + 1
    return mixed


def _transposed(chances: Chances) -> Chances:
    return Chances(chances.done.T, chances.undone.T)


@dataclass(frozen=True)
class _Weights:
    """Weights whose products are binomial ones: Bin(a; n, share) = first[a] * second[n-a] / total[n]."""

    first: Floats
    second: Floats
    total: Floats
    binomials: Floats
    """Matrix [n, a] of Bin(a; n, share)."""


@lru_cache(maxsize=64)
def _weights(ids: int, share: float) -> _Weights:
    """Poisson probabilities, which neither under- nor overflow where it matters.

    The first are cut off where the rest is negligible. The total is summed up rather than taken from the
    formula: then all that is rounded away cancels where all chances are one, and errors do not double with
    every step.
    """
    kept = int(np.count_nonzero(binom.sf(np.arange(ids), ids, share) > NEGLIGIBLE_MASS))
    first = np.where(np.arange(ids + 1) <= kept, _poisson(ids, share * ids), 0.0)
    second = _poisson(ids, (1.0 - share) * ids)
    total = np.convolve(first[: kept + 1], second)[: ids + 1]
    return _Weights(first, second, total, _toeplitz(second) * first / total[:, None])


def _poisson(ids: int, mean: float) -> Floats:
    """Probabilities of 0 ... ids, by their ratios: more precise than by logarithms of factorials."""
    ratios = np.concatenate([[np.exp(-mean)], mean / np.arange(1.0, ids + 1)])
    return np.asarray(np.cumprod(ratios))


def _toeplitz(values: Floats) -> Floats:
    """Lower triangular matrix whose product with a column is the convolution with it."""
    size = len(values)
    padded = np.concatenate([values[::-1], np.zeros(size - 1)])
    return np.ascontiguousarray(sliding_window_view(padded, size)[::-1])


def _convolve(rare: Floats, common: Floats) -> Floats:
    """Convolution over the last two axes, cut to the shape; by columns of `rare` that are not all zero.

    Direct: a fast Fourier transform would lose the small values to the large ones.
    """
    result = np.zeros_like(common)
    columns = common.shape[-1]
    for column in np.flatnonzero(rare.any(axis=0)):
        result[..., column:] += _toeplitz(rare[:, column]) @ common[..., : columns - column]
    return result
