"""How often the two channels err: what one step tells about a pair, and what many steps tell of the rates.

The model (Ivanov & Shell 2016, sec. 6.3, made definite). In each step every robot sends a message pair
with probability p: one coin, both channels. A message that was sent is missed with probability
`wireless_loss`, and one that was not is heard all the same with `wireless_false`; a lit lamp is missed
with `visual_miss`, and a dark one seen lit with `visual_false`. All errors are independent of each other.
"""

from __future__ import annotations

import math
from collections.abc import Collection

import msgspec
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

Floats = NDArray[np.float64]

RATES = ("wireless_loss", "wireless_false", "visual_miss", "visual_false")
"""The four error rates, as they are called in `ChannelRates` and in scenarios."""

PRIOR_OBSERVATIONS = 10.0
"""How many observations a first guess of a rate counts for, unless told otherwise."""

_ROUNDS = 500
_TOLERANCE = 1e-9


class ChannelRates(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Transmission probability and error rates, each in [0, 1]. Raises ValueError for others."""

    transmission_probability: float = 0.5
    wireless_loss: float = 0.0
    wireless_false: float = 0.0
    visual_miss: float = 0.0
    visual_false: float = 0.0

    def __post_init__(self) -> None:
        for name in self.__struct_fields__:
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise ValueError(f"{name}: a probability lies in [0, 1], {value} does not; mend it")

    def joint(self) -> Floats:
        """P(x, y) of one step for the two ids of one robot; (2, 2), x: heard, y: seen lit."""
        given_sent = np.outer(
            [self.wireless_loss, 1.0 - self.wireless_loss], [self.visual_miss, 1.0 - self.visual_miss]
        )
        given_not = np.outer(
            [1.0 - self.wireless_false, self.wireless_false], [1.0 - self.visual_false, self.visual_false]
        )
        p = self.transmission_probability
        joint: Floats = p * given_sent + (1.0 - p) * given_not
        return joint

    def heard(self) -> Floats:
        """P(x) of one step for any wireless id; (2,)."""
        heard: Floats = self.joint().sum(axis=1)
        return heard

    def lit(self) -> Floats:
        """P(y) of one step for any visual id; (2,)."""
        lit: Floats = self.joint().sum(axis=0)
        return lit

    def log_likelihood_ratios(self) -> Floats:
        """l[x][y] = log P(x, y | one robot) / (P(x) P(y)); (2, 2), in nats.

        -inf where two ids of one robot cannot be so: it strikes the edge out for good, as Alg. 1 does.
        0 where P(x) or P(y) is 0: what cannot happen at all tells nothing about who belongs to whom.
        """
        joint = self.joint()
        apart = np.outer(joint.sum(axis=1), joint.sum(axis=0))
        with np.errstate(divide="ignore", invalid="ignore"):
            ratios: Floats = np.where(apart > 0.0, np.log(joint) - np.log(apart), 0.0)
        return ratios


def check_estimable(names: Collection[str]) -> None:
    """Raise ValueError unless these rates can be estimated from what a robot hears and sees.

    With p known there are three numbers to learn from, P(x), P(y) and P(x, y) of true pairs, and hence
    at most three rates.
    """
    for name in names:
        if name not in RATES:
            raise ValueError(f"{name}: there is no rate of this name; the rates are {', '.join(RATES)}")
    if len(set(names)) == len(RATES):
        raise ValueError(
            "wireless_false: not all four rates can be estimated; give this one as a number (most radios: 0)"
        )


def estimated(
    guess: ChannelRates,
    names: Collection[str],
    pairs: Floats,
    heard: Floats,
    lit: Floats,
    *,
    prior_observations: float = PRIOR_OBSERVATIONS,
    start: ChannelRates | None = None,
) -> ChannelRates:
    """Most probable values of the rates in `names`; the others, and p, are as in `guess`.

    `pairs` (2, 2): how often (x, y) was observed of two ids of one robot; `heard` (2,) and `lit` (2,):
    how often x of a wireless id, or y of a visual id, was observed alone. Counts may be expected ones, such
    as pairs weighted with their posteriors: that makes an M-step of EM of this. Every rate has a Beta prior
    worth `prior_observations` observations at the value in `guess`; 0: maximum likelihood.

    With m_w, f_w, m_v, f_v for loss, false, miss, false, and q = 1 - p:
        P(x=1) = p (1 - m_w) + q f_w,  P(y=1) = p (1 - m_v) + q f_v,
        P(x=1, y=1) = p (1 - m_w) (1 - m_v) + q f_w f_v.
    Given p and f_w these have one solution wherever the radio tells anything (1 - m_w != f_w, 0 < p < 1):
    m_w follows from the first, and the others are then linear in m_v and f_v with determinant
    p q (f_w - 1 + m_w). Solved by EM over who sent (Dempster, Laird & Rubin 1977), which keeps the rates
    in [0, 1] and takes ids observed alone into account; it begins at `start`, or at `guess`.

    Raises ValueError as `check_estimable` does.
    """
    check_estimable(names)
    table, alone_x, alone_y = pairs.tolist(), heard.tolist(), lit.tolist()
    current = _Values(start or guess)
    for _ in range(_ROUNDS):
        tallies = current.tallies(table, alone_x, alone_y)
        largest = 0.0
        for name in names:
            errors, chances = tallies[name]
            weight = chances + prior_observations
            if weight > 0.0:
                value = (errors + prior_observations * getattr(guess, name)) / weight
                largest = max(largest, abs(value - current.rates[name]))
                current.rates[name] = value
        if largest < _TOLERANCE:
            break
    known = {name: getattr(guess, name) for name in RATES if name not in names}
    rates = {name: min(max(current.rates[name], 0.0), 1.0) for name in names}
    return msgspec.structs.replace(guess, **known, **rates)


class _Values:
    """Rates while they are being estimated, as plain numbers."""

    def __init__(self, rates: ChannelRates) -> None:
        self.rates: dict[str, float] = {name: getattr(rates, name) for name in RATES}
        self._p = rates.transmission_probability

    def tallies(
        self, pairs: list[list[float]], heard: list[float], lit: list[float]
    ) -> dict[str, tuple[float, float]]:
        """Expected errors, and expected chances for an error, of each rate (the E-step)."""
        rates = self.rates
        x_sent = (rates["wireless_loss"], 1.0 - rates["wireless_loss"])
        x_not = (1.0 - rates["wireless_false"], rates["wireless_false"])
        y_sent = (rates["visual_miss"], 1.0 - rates["visual_miss"])
        y_not = (1.0 - rates["visual_false"], rates["visual_false"])
        sent_x, sent_y, not_x, not_y = [0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]
        for x in (0, 1):
            share = self._sent(x_sent[x], x_not[x])
            sent_x[x] += share * heard[x]
            not_x[x] += (1.0 - share) * heard[x]
            share = self._sent(y_sent[x], y_not[x])
            sent_y[x] += share * lit[x]
            not_y[x] += (1.0 - share) * lit[x]
            for y in (0, 1):
                share = self._sent(x_sent[x] * y_sent[y], x_not[x] * y_not[y])
                sent, kept = share * pairs[x][y], (1.0 - share) * pairs[x][y]
                sent_x[x] += sent
                sent_y[y] += sent
                not_x[x] += kept
                not_y[y] += kept
        return {
            "wireless_loss": (sent_x[0], math.fsum(sent_x)),
            "wireless_false": (not_x[1], math.fsum(not_x)),
            "visual_miss": (sent_y[0], math.fsum(sent_y)),
            "visual_false": (not_y[1], math.fsum(not_y)),
        }

    def _sent(self, given_sent: float, given_not: float) -> float:
        """P(sent | what was observed); what cannot be observed under these rates tells nothing: p."""
        sent, kept = self._p * given_sent, (1.0 - self._p) * given_not
        return sent / (sent + kept) if sent + kept > 0.0 else self._p
