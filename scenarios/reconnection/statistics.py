"""Whether one method is faster than another, of times with heavy tails (Vandermeulen et al., sec. V).

Times that are censored enter as the limit, as everywhere: what is said of means is said of lower bounds;
ranks are right as long as only the slower of two methods is censored.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from scipy import stats

from channels.graphs import Floats

Interval = tuple[float, float]

LEVEL = 0.95
RESAMPLES = 9999
_SEED = 2011
_AT_ONCE = 1_000_000
"""Numbers in one array."""


class Comparison(Struct, frozen=True):
    """The times of one method against those of another, run by run."""

    welch: float
    """P value of Welch's t-test that the means are equal, two-sided; 1 where nothing varies and they are."""
    mann_whitney: float
    """P value of the Mann-Whitney U test that neither tends to be greater, two-sided."""
    wins: float
    """Share of the pairs in which the first is less; ties count half."""
    ratio: float
    """Mean of the first over mean of the second; NaN where that is 0."""
    ratio_interval: Interval
    """Bootstrap interval of it, pairs being drawn together."""


def compared(first: Sequence[float], second: Sequence[float]) -> Comparison:
    """Two samples of which numbers i belong together. Raises ValueError where they do not pair up."""
    one, other = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    if one.shape != other.shape or len(one) < 2:
        raise ValueError(f"{len(one)} and {len(other)} times: must be as many, and two or more")
    return Comparison(
        welch=welch(one, other),
        mann_whitney=float(stats.mannwhitneyu(one, other, alternative="two-sided").pvalue),
        wins=float(np.mean(one < other) + np.mean(one == other) / 2),
        ratio=_ratio(one.mean(), other.mean()),
        ratio_interval=ratio_interval(one, other),
    )


def welch(one: Floats, other: Floats) -> float:
    """P value of Welch's t-test (Welch 1947), two-sided."""
    if one.std() == other.std() == 0:  # no estimate of anything; SciPy warns
        return float(one[0] == other[0])
    return float(stats.ttest_ind(one, other, equal_var=False).pvalue)


def mean_interval(times: Sequence[float]) -> Interval:
    """Bootstrap interval of the mean, percentiles (Efron 1979), at `LEVEL`; the same for the same times."""
    values = np.asarray(times, dtype=np.float64)
    return _percentiles(_resampled(values[:, None])[:, 0])


def ratio_interval(first: Sequence[float] | Floats, second: Sequence[float] | Floats) -> Interval:
    """Bootstrap interval of the ratio of two means of paired times."""
    means = _resampled(np.stack([first, second], axis=1).astype(np.float64))
    with np.errstate(divide="ignore", invalid="ignore"):
        return _percentiles(means[:, 0] / means[:, 1])


def t_interval(times: Sequence[float]) -> Interval:
    """Student's interval of the mean at `LEVEL`, as the paper's error bars; of a single time, itself."""
    values = np.asarray(times, dtype=np.float64)
    mean = float(values.mean())
    if len(values) < 2:
        return mean, mean
    half = float(stats.t.ppf((1 + LEVEL) / 2, len(values) - 1) * values.std(ddof=1)) / math.sqrt(len(values))
    return mean - half, mean + half


def share_interval(count: int, total: int) -> Interval:
    """Wilson's interval of a share at `LEVEL` (Wilson 1927)."""
    found = stats.binomtest(count, total).proportion_ci(LEVEL, method="wilson")
    return float(found.low), float(found.high)


def _ratio(one: float, other: float) -> float:
    return float(one / other) if other else math.nan


def _resampled(rows: Floats) -> Floats:
    """Means of so many resamples of the rows: (RESAMPLES, columns)."""
    generator = np.random.Generator(np.random.PCG64(_SEED))
    size = max(1, _AT_ONCE // len(rows))
    means = []
    for begin in range(0, RESAMPLES, size):
        chosen = generator.integers(len(rows), size=(min(size, RESAMPLES - begin), len(rows)))
        means.append(rows[chosen].mean(axis=1))
    return np.concatenate(means)


def _percentiles(values: Floats) -> Interval:
    low, high = np.quantile(values, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(low), float(high)
