"""The information state of association over channels that err: how likely each voice is each light's.

Pure bookkeeping: observations go in, chances come out. No radio, no camera, no time. Every edge between a
wireless and a visual id carries counts of what was observed of its two ends together, and hence the
likelihood ratio of their being one robot (Ivanov & Shell 2016, sec. 6.3: edges "can no longer be eliminated
based on a single or even multiple observations"; 2014: "an appropriate statistical measure is computed and
stored for each possible association"). Over all ways to assign visual ids to wireless ids one to one, equally
likely beforehand, these give the best way and the posterior of every pair.

Without errors it strikes out exactly the edges that `StationaryIState` does.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from agent.behaviours.association.matching import ALONE, best_matching, posteriors
from agent.behaviours.association.rates import ChannelRates, check_estimable, estimated

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]


class NoisyIState:
    """Counts and chances for one stationary robot's neighbourhood.

    `rates`: how often the channels err. Those named in `estimate` are learnt from what is observed, and
    begin at their value in `rates`, which must lie between 0 and 1.
    `wireless`: ids known beforehand; `closed`: there are no others. Otherwise a robot whose roll call was
    missed may turn up late, and until then its light is not anybody's who was heard.
    `nobody`: prior probability that a robot in sight cannot be heard at all (0: channel inclusion holds).
    `out_of_sight`: how many robots are expected to be heard and not seen, which together with the last two
    says how likely a light is nobody's so far. By default as many as there are wireless ids above visual ids,
    at least 1. (Prior: their number is Poisson distributed, and every robot in sight is by itself out of
    radio range with probability `nobody`; given how many are heard, all assignments are equally likely.)

    Raises ValueError for rates that cannot be estimated, or a number out of range.
    """

    def __init__(
        self,
        rates: ChannelRates,
        *,
        estimate: Collection[str] = (),
        wireless: Iterable[str] = (),
        closed: bool = False,
        nobody: float = 0.0,
        out_of_sight: float | None = None,
    ) -> None:
        _check(rates, estimate, nobody, out_of_sight)
        self._guess = rates
        self._rates = rates
        self._estimate = sorted(estimate)
        self._closed = closed
        self._nobody = nobody
        self._out_of_sight = out_of_sight
        self._wireless: dict[str, int] = {name: row for row, name in enumerate(sorted(set(wireless)))}
        self._visual: dict[int, int] = {}
        self._steps = 0
        self._roll_calls = 0
        self._heard = np.zeros(len(self._wireless), dtype=np.int64)
        self._lit = np.zeros((0, 2), dtype=np.int64)
        self._counts = np.zeros((len(self._wireless), 0, 2, 2), dtype=np.int64)
        self._posteriors: Floats | None = None

    @property
    def wireless(self) -> list[str]:
        """Wireless ids known so far: the rows of every matrix."""
        return list(self._wireless)

    @property
    def visual(self) -> list[int]:
        """Visual ids known so far: the columns of every matrix."""
        return list(self._visual)

    @property
    def rates(self) -> ChannelRates:
        """The rates in use, estimated ones included."""
        return self._rates

    @property
    def counts(self) -> Counts:
        """How often each pair was observed so; (w, v, 2, 2), the last two: heard, seen lit. A copy."""
        return self._counts.copy()

    def roll_call(self, heard: Iterable[str], in_view: Iterable[int]) -> None:
        """Take in a step in which everybody sent: it brings ids, and tells nothing about pairs."""
        self._add_wireless(heard)
        self._add_visual(in_view)
        self._roll_calls += 1
        self._posteriors = None

    def update(self, heard: Collection[str], lamps: Mapping[int, int]) -> None:
        """Take in one step: who was heard; of each visual id in the frame, whether it was lit (or 0).

        A wireless id that is new was silent in all earlier steps, so its past is known. A visual id begins
        without evidence, and one that is missing from the frame gets none in this step. An id is never
        dropped: robots are stationary.
        """
        self._add_wireless(heard)
        self._add_visual(lamps)
        x = np.fromiter((name in heard for name in self._wireless), dtype=np.int64, count=len(self._wireless))
        y = np.fromiter(map(bool, lamps.values()), dtype=np.int64, count=len(lamps))
        columns = np.fromiter(map(self._visual.__getitem__, lamps), dtype=np.intp, count=len(lamps))
        rows = np.arange(len(x))
        self._counts[rows[:, None], columns, x[:, None], y] += 1
        self._heard += x
        self._lit[columns, y] += 1
        self._steps += 1
        self._posteriors = None
        if self._estimate:
            self._learn()

    def log_likelihood_ratios(self) -> Floats:
        """Log of P(all that was observed of both | one robot) / P(... | two robots) of every pair; (w, v).

        -inf: the rates leave no room for it.
        """
        return _log_ratio(self._counts, self._rates)

    def assignment(self, rng: np.random.Generator) -> dict[int, str]:
        """Visual id -> wireless id in the likeliest one-to-one assignment; ties fall at random.

        Without those visual ids that are likelier nobody's, so far; ids in the order of `visual`.
        """
        names = self.wireless
        chosen = best_matching(self.log_likelihood_ratios().T, self._log_alone(), rng).tolist()
        pairs = zip(self._visual, chosen, strict=True)
        return {visual_id: names[row] for visual_id, row in pairs if row != ALONE}

    def posteriors(self) -> Floats:
        """P(pair is one robot | all that was observed) of every pair; (w, v). Do not write to it.

        What is missing to 1 in a column is the chance of its being nobody's who has been heard so far.
        """
        if self._posteriors is None:
            self._posteriors = posteriors(self.log_likelihood_ratios().T, self._log_alone()).T
        return self._posteriors

    def edges(self, threshold: float) -> dict[int, list[str]]:
        """Visual id -> wireless ids whose posterior is above the threshold, in order of their names."""
        names = self.wireless
        above = self.posteriors() > threshold
        return {
            visual_id: sorted(names[row] for row in np.flatnonzero(above[:, column]))
            for visual_id, column in self._visual.items()
        }

    def claims(self, confidence: float) -> dict[int, tuple[str, float]]:
        """Visual id -> (wireless id, posterior), where that reaches `confidence`; others: not yet.

        Claimed are pairs of the likeliest assignment. How ties in it are broken does not matter: a pair
        that an equally likely assignment lacks has a posterior of 0.5 at most. Raises ValueError unless
        0.5 < confidence <= 1.
        """
        if not 0.5 < confidence <= 1.0:
            raise ValueError(f"confidence: must be above 0.5, and 1 at most, is {confidence}")
        chances = self.posteriors()
        chosen = best_matching(self.log_likelihood_ratios().T, self._log_alone()).tolist()
        names = self.wireless
        return {
            visual_id: (names[row], float(chances[row, column]))
            for (visual_id, column), row in zip(self._visual.items(), chosen, strict=True)
            if row != ALONE and chances[row, column] >= confidence
        }

    def strangers(self, confidence: float) -> list[int]:
        """Visual ids whose robot is out of radio range with at least that probability; see `nobody`."""
        if not self._nobody:
            return []
        unmatched = 1.0 - self.posteriors().sum(axis=0)
        odds = math.log(self._nobody / (1.0 - self._nobody))
        unheard = np.full(len(self._visual), -np.inf) if self._closed else self._log_unheard()
        chances = unmatched * np.exp(odds - np.logaddexp(odds, unheard))
        return [visual_id for visual_id, column in self._visual.items() if chances[column] >= confidence]

    def _add_wireless(self, heard: Iterable[str]) -> None:
        new = sorted(set(heard) - self._wireless.keys())
        if not new:
            return
        if self._closed:
            raise ValueError(f"{new[0]} was heard, which is not among the known wireless ids")
        for name in new:
            self._wireless[name] = len(self._wireless)
        silent = np.zeros((len(new), *self._counts.shape[1:]), dtype=np.int64)
        silent[:, :, 0, :] = self._lit
        self._counts = np.concatenate([self._counts, silent])
        self._heard = np.concatenate([self._heard, np.zeros(len(new), dtype=np.int64)])

    def _add_visual(self, in_view: Iterable[int]) -> None:
        new = sorted(set(in_view) - self._visual.keys())
        if not new:
            return
        for visual_id in new:
            self._visual[visual_id] = len(self._visual)
        unseen = np.zeros((len(self._wireless), len(new), 2, 2), dtype=np.int64)
        self._counts = np.concatenate([self._counts, unseen], axis=1)
        self._lit = np.concatenate([self._lit, np.zeros((len(new), 2), dtype=np.int64)])

    def _log_alone(self) -> Floats:
        """Log weight of a visual id's being nobody's so far, on the scale of `log_likelihood_ratios`; (v,).

        It is out of radio range; or its robot has sent nothing that was received, roll calls included.
        """
        weight = np.full(len(self._visual), _log(self._nobody / (1.0 - self._nobody)))
        if not self._closed:
            weight = np.logaddexp(weight, self._log_unheard())
        expected = self._out_of_sight
        if expected is None:
            expected = max(1.0, float(len(self._wireless) - len(self._visual)))
        return weight + _log(expected)

    def _log_unheard(self) -> Floats:
        """Log of P(nothing heard so far, lamp as seen | one robot) / P(lamp as seen); (v,)."""
        silent = np.zeros((1, len(self._visual), 2, 2), dtype=np.int64)
        silent[0, :, 0, :] = self._lit
        quiet = self._steps * _log(self._rates.heard()[0]) if self._steps else 0.0
        missed = self._roll_calls * _log(self._rates.wireless_loss) if self._roll_calls else 0.0
        ratio: Floats = _log_ratio(silent, self._rates)[0] + (quiet + missed)
        return ratio

    def _learn(self) -> None:
        """One round of EM: posteriors under the rates so far, then the rates under these."""
        chances = self.posteriors()
        pairs = np.einsum("wv,wvxy->xy", chances, self._counts)
        heard = np.array([len(self._wireless) * self._steps - self._heard.sum(), self._heard.sum()])
        lit = (1.0 - chances.sum(axis=0)) @ self._lit
        alone = np.maximum(heard - pairs.sum(axis=1), 0.0)
        self._rates = estimated(
            self._guess, self._estimate, pairs, alone, np.maximum(lit, 0.0), start=self._rates
        )
        self._posteriors = None


def _log_ratio(counts: Counts, rates: ChannelRates) -> Floats:
    """Sum of the log likelihood ratios of all that was counted; (..., 2, 2) -> (...).

    One observation that cannot be makes it -inf, however many others there are: 0 * -inf is 0 here.
    """
    table = rates.log_likelihood_ratios()
    impossible = np.isneginf(table)
    total = (counts * np.where(impossible, 0.0, table)).sum(axis=(-2, -1))
    return np.where((counts * impossible).any(axis=(-2, -1)), -np.inf, total)


def _log(value: float) -> float:
    return math.log(value) if value > 0.0 else -math.inf


def _check(rates: ChannelRates, estimate: Collection[str], nobody: float, out_of_sight: float | None) -> None:
    check_estimable(estimate)
    for name in estimate:
        if not 0.0 < getattr(rates, name) < 1.0:
            raise ValueError(f"{name}: a rate to be estimated begins between 0 and 1; 0.1 is a fair guess")
    if not 0.0 <= nobody < 1.0:
        raise ValueError(f"nobody: a probability below 1 is needed, {nobody} is none; 0 if all are heard")
    if out_of_sight is not None and not 0.0 <= out_of_sight < math.inf:
        raise ValueError(f"out_of_sight: how many robots are expected, 0 or more; {out_of_sight} is not")
