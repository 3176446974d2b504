"""How old estimates are, and how often they are renewed: exactly, and by distance and hops.

An estimate ages with time and becomes younger at once when a newer one is received: its age is a sawtooth.
The mean over time is the integral of the teeth over their length, and quantiles are those of the mixture of
uniform distributions that they are: nothing is sampled. Only who has an estimate has an age: how much of the
time robots had none, and which never had one, stands beside it and is not averaged away.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from scipy.sparse.csgraph import shortest_path
from scipy.stats import spearmanr

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

UNREACHABLE = -1
"""Hops between robots that no chain of links connects."""
S_PER_MINUTE = 60.0


class Updates(Struct, frozen=True):
    """Estimates that were newer to their receiver; parallel, by receiver, origin and time of reception."""

    receiver: Ints
    origin: Ints
    received_s: Floats
    made_s: Floats


class Window(NamedTuple):
    """The time that is looked at."""

    from_s: float
    until_s: Floats
    """(n,): for each receiver; a dead one has no estimates that age."""

    @property
    def length_s(self) -> Floats:
        """(n,)."""
        return np.maximum(self.until_s - self.from_s, 0.0)


class Around(NamedTuple):
    """How far apart robots are from certain instants on; the last lasts for ever."""

    begins_s: Floats
    """(T,): ascending, the first not after anything that is looked at."""
    distance_m: Floats
    """(T, n, n)."""
    hops: Ints
    """(T, n, n); `UNREACHABLE` where no chain of links leads."""

    def epoch(self, time_s: Floats) -> Ints:
        """Which of the T counts at these instants."""
        epoch: Ints = np.searchsorted(self.begins_s, time_s, side="right") - 1
        return epoch

    def mean_distance_m(self, from_s: float, until_s: float) -> Floats:
        """(n, n): over this time; where it has no length, that of its beginning."""
        ends = np.append(self.begins_s[1:], np.inf)
        lasts = np.maximum(np.minimum(ends, until_s) - np.maximum(self.begins_s, from_s), 0.0)
        if not lasts.any():
            at_once: Floats = self.distance_m[self.epoch(np.array(from_s))]
            return at_once
        mean: Floats = np.tensordot(lasts / lasts.sum(), self.distance_m, axes=1)
        return mean


class Teeth(NamedTuple):
    """The sawtooth, or pieces of it: from age `low_s` to age `high_s`, second by second."""

    receiver: Ints
    origin: Ints
    begins_s: Floats
    low_s: Floats
    high_s: Floats

    def where(self, chosen: Bools) -> Teeth:
        """Some of them."""
        return Teeth(
            self.receiver[chosen], self.origin[chosen],
            self.begins_s[chosen], self.low_s[chosen], self.high_s[chosen],
        )  # fmt: skip


# --- the sawtooth --------------------------------------------------------------------------------


def teeth(updates: Updates, window: Window) -> Teeth:
    """One tooth from each update to the next, or to the end of the window."""
    robots = len(window.until_s)
    pair = updates.receiver * robots + updates.origin
    following = np.append(updates.received_s[1:], 0.0)
    last = np.append(pair[1:] != pair[:-1], True)[: len(pair)]
    until = window.until_s[updates.receiver]
    ends = np.minimum(np.where(last, until, following[: len(pair)]), until)
    begins = np.maximum(updates.received_s, window.from_s)
    found = Teeth(
        updates.receiver, updates.origin, begins, begins - updates.made_s, ends - updates.made_s
    )  # fmt: skip
    return found.where(ends > begins)


def cut(whole: Teeth, at_s: Floats) -> Teeth:
    """The same, cut at these instants (ascending)."""
    ends = whole.begins_s + (whole.high_s - whole.low_s)
    first = np.searchsorted(at_s, whole.begins_s, side="right")
    cuts = np.searchsorted(at_s, ends, side="left") - first
    row = np.repeat(np.arange(len(ends)), cuts + 1)
    place = np.arange(len(row)) - np.repeat(np.cumsum(cuts + 1) - cuts - 1, cuts + 1)
    padded = np.append(at_s, np.inf)
    begins = np.where(place == 0, whole.begins_s[row], padded[first[row] + place - 1])
    stops = np.where(place == cuts[row], ends[row], padded[np.minimum(first[row] + place, len(at_s))])
    low = whole.low_s[row] + (begins - whole.begins_s[row])
    return Teeth(whole.receiver[row], whole.origin[row], begins, low, low + (stops - begins))


def mean_age(low_s: Floats, high_s: Floats) -> float | None:
    """Mean over time; None where there is none."""
    length = float((high_s - low_s).sum())
    return float(((high_s - low_s) * (high_s + low_s) / 2).sum()) / length if length > 0 else None


def quantile(low_s: Floats, high_s: Floats, part: float) -> float | None:
    """The age that estimates do not exceed for this part (0 to 1) of the time; None where there is none."""
    edges = np.concatenate([low_s, high_s])
    order = np.argsort(edges, kind="stable")
    edges = edges[order]
    teeth_there = np.cumsum(np.where(order < len(low_s), 1, -1))[:-1]
    reached = np.cumsum(teeth_there * np.diff(edges))
    if not len(reached) or not reached[-1] > 0:
        return None
    aim = part * reached[-1]
    place = int(np.searchsorted(reached, aim))
    return float(edges[place + 1] - (reached[place] - aim) / max(1, teeth_there[place]))


def spearman(one: Floats, other: Floats) -> float | None:
    """Rank correlation; None where one of them is the same throughout, or there are fewer than two."""
    if len(one) < 2 or np.ptp(one) == 0 or np.ptp(other) == 0:
        return None
    return float(spearmanr(one, other).statistic)


def remotest(distance_m: Floats) -> int:
    """Whose mean distance from all others is largest: the "worst case" receiver (paper, sec. 4)."""
    return int(distance_m.sum(axis=1).argmax())


# --- of a team -----------------------------------------------------------------------------------


def around(begins_s: Floats, places_m: Floats, range_m: float) -> Around:
    """Distances and hops; `places_m` (T, n, 2), or (T, n, 3). At exactly the range robots are linked."""
    squared = sum((of_all[:, :, None] - of_all[:, None, :]) ** 2 for of_all in np.moveaxis(places_m, 2, 0))
    hops = [shortest_path(linked, unweighted=True) for linked in squared <= range_m * range_m]
    whole = np.array(hops)
    return Around(
        begins_s, np.sqrt(squared), np.where(np.isinf(whole), UNREACHABLE, whole).astype(np.int64)
    )  # fmt: skip


def summary(updates: Updates, window: Window, where: Around, bin_m: float) -> dict[str, Any]:
    """Age and updates of a team of n robots in a window of time.

    - `age_s`: `mean` and `p95` over all pairs and all the time in which the receiver knew anything.
    - `updates_per_minute`: estimates that were newer to the receiver, a minute: the mean over all pairs.
    - `by_distance`: the same (`age_s`, `updates_per_minute`) by how far apart a pair was at the time: bins
      `from_m` to `to_m`, which is included (and 0 in the first); those where no pair ever was are left out.
    - `by_hops`: the same by hops at the time; "unreachable": no chain of links led from one to the other.
    - `never_known`: of the pairs (`of`), those whose receiver never had an estimate (`pairs`);
      `unknown_part`: the part of the time, over all pairs, in which it had none.
    - `spearman`: rank correlations of the mean distance of a pair with its updates a minute, and with its
      mean age where it has one: over `all_pairs`, and over those whose receiver is the `remotest` robot.
      None where there is nothing to rank.
    """
    received = updates.received_s
    inside = (received >= window.from_s) & (received <= window.until_s[updates.receiver])
    renewals = Teeth(updates.receiver, updates.origin, received, received, received).where(inside)
    pieces = cut(teeth(updates, window), where.begins_s)
    by_distance = _by_class(_bins(where.distance_m, bin_m), where, window, pieces, renewals)
    by_hops = _by_class(where.hops, where, window, pieces, renewals)
    pairs_s = float(window.length_s.sum()) * (len(window.until_s) - 1)
    return {
        "age_s": _age(pieces),
        "updates_per_minute": _rate(len(renewals.receiver), pairs_s),
        "by_distance": [
            {"from_m": bin_m * number, "to_m": bin_m * (number + 1), **found}
            for number, found in by_distance.items()
        ],
        "by_hops": {
            "unreachable" if number == UNREACHABLE else str(number): found
            for number, found in by_hops.items()
        },
        **_unknown(updates, window, pieces),
        "spearman": _correlations(window, where, pieces, renewals),
    }


def _by_class(
    classes: Ints, where: Around, window: Window, pieces: Teeth, renewals: Teeth
) -> dict[int, dict[str, Any]]:
    """Age and updates of the pairs in each of the classes, ascending, -1 last; `classes` (T, n, n)."""
    robots = len(window.until_s)
    ends = np.append(where.begins_s[1:], np.inf)
    lasts = np.minimum(ends[:, None], window.until_s) - np.maximum(where.begins_s, window.from_s)[:, None]
    exposure = np.maximum(lasts, 0.0)[:, :, None] * ~np.eye(robots, dtype=bool)
    time_s = np.bincount((classes + 1).ravel(), weights=exposure.ravel())
    of_pieces = classes[where.epoch(pieces.begins_s), pieces.receiver, pieces.origin]
    of_renewals = classes[where.epoch(renewals.begins_s), renewals.receiver, renewals.origin]
    return {
        number: {
            "age_s": _age(pieces.where(of_pieces == number)),
            "updates_per_minute": _rate(
                int(np.count_nonzero(of_renewals == number)), float(time_s[number + 1])
            ),
        }
        for number in sorted(
            (np.flatnonzero(time_s > 0) - 1).tolist(), key=lambda number: number % len(time_s)
        )
    }


def _bins(distance_m: Floats, bin_m: float) -> Ints:
    """Bin k holds the distances above k bins, up to k + 1; 0 is in bin 0."""
    return np.maximum(np.ceil(distance_m / bin_m).astype(np.int64) - 1, 0)


def _age(pieces: Teeth) -> dict[str, float | None]:
    low, high = pieces.low_s, pieces.high_s
    return {"mean": mean_age(low, high), "p95": quantile(low, high, 0.95)}


def _rate(count: int, time_s: float) -> float | None:
    return count * S_PER_MINUTE / time_s if time_s > 0 else None


def _unknown(updates: Updates, window: Window, pieces: Teeth) -> dict[str, Any]:
    robots = len(window.until_s)
    known = np.eye(robots, dtype=bool)
    in_time = updates.received_s < window.until_s[updates.receiver]
    known[updates.receiver[in_time], updates.origin[in_time]] = True
    all_s = float(window.length_s.sum()) * (robots - 1)
    known_s = float((pieces.high_s - pieces.low_s).sum())
    return {
        "never_known": {"pairs": int(np.count_nonzero(~known)), "of": robots * (robots - 1)},
        "unknown_part": max(0.0, 1 - known_s / all_s) if all_s > 0 else None,
    }


def _correlations(window: Window, where: Around, pieces: Teeth, renewals: Teeth) -> dict[str, Any]:
    robots = len(window.until_s)
    distance = where.mean_distance_m(window.from_s, float(window.until_s.max()))
    minutes = np.where(window.length_s > 0, window.length_s, np.nan)[:, None] / S_PER_MINUTE
    updates = _summed(renewals, np.ones(len(renewals.receiver)), robots) / minutes
    lengths = pieces.high_s - pieces.low_s
    known_s = _summed(pieces, lengths, robots)
    integral = _summed(pieces, lengths * (pieces.high_s + pieces.low_s) / 2, robots)
    age = np.divide(integral, known_s, out=np.full((robots, robots), np.nan), where=known_s > 0)
    pairs = ~np.eye(robots, dtype=bool)
    remote = pairs & (np.arange(robots) == remotest(distance))[:, None]
    return {
        name: {
            "distance_and_updates": _ranked(distance[chosen], updates[chosen]),
            "distance_and_age": _ranked(distance[chosen], age[chosen]),
        }
        for name, chosen in (("all_pairs", pairs), ("remotest", remote))
    }


def _summed(pieces: Teeth, values: Floats, robots: int) -> Floats:
    """(n, n), by receiver and origin."""
    pair = pieces.receiver * robots + pieces.origin
    sums: Floats = np.bincount(pair, weights=values, minlength=robots * robots).astype(np.float64)
    return sums.reshape(robots, robots)


def _ranked(one: Floats, other: Floats) -> float | None:
    defined = ~np.isnan(other)
    return spearman(one[defined], other[defined])
