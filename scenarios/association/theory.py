"""Channel association of robots that stand still: the exact law of its completion time.

Ivanov & Shell (2014, "Probabilistic Algorithm"; 2016, sec. 4.3) knew of no closed form. There is one.

*Setting* (2016, Alg. 1). An observer hears w wireless ids and sees v <= w visual ids, whose wireless ids are
among them. In every step each robot is silent and dark, or sends and shows a light in one of C colours, which
it names in its message. So each id emits one symbol out of C + 1 a step, with probabilities
r = (1-p, p/C, ..., p/C), independently of all others; the strings of a robot's two ids are the same.

*Completion.* An edge is kept in a step exactly if its two ends emit the same symbol. After t steps a visual
and a wireless id are joined exactly if their strings agree, and it is done when every visual id is joined to
its own wireless id only: when the string of each of v "visible" robots differs from those of all w-1 others.
Strings of the u = w-v others may agree. (v = w is the same event as v = w-1: all are different.)

*Equal symbols* (p = 1/2 with one colour). All M = (C+1)^t strings are equally likely. The visible robots need
different ones, one after the other, and each other robot needs one of the M-v left:

    P(T <= t) = prod_{i<v} (1 - i/M) * (1 - v/M)^(w-v).

*Any p.* Let f_t(u, v) be that probability. Ids with different symbols in the first step are told apart by it;
those with the same symbol exactly if their strings of the other t-1 steps tell them apart. For two symbols

    f_t(u, v) = sum_{a,b} Bin(a; u, p) Bin(b; v, p) f_{t-1}(a, b) f_{t-1}(u-a, v-b),

f_0(u, v) = 1 if v = 0 or (u, v) = (0, 1), else 0; in exponential generating functions, for any symbols,
F_t(x, y) = prod_s F_{t-1}(r_s x, r_s y). All terms are positive: `mixing` loses nothing to cancellation.

*Tail.* Two given strings agree with probability c^t, c = sum_s r_s^2, and N = C(v,2) + v(w-v) pairs must not:
P(T > t) <= N c^t (Bonferroni), and asymptotically equal.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom

from agent.behaviours.association.istate import survival
from scenarios.association.mixing import Chances, mix, mix_alike

Floats = NDArray[np.float64]

CERTAIN = 5e-17
"""Survival below which the law is cut: half of what separates 1 from the next smaller float."""
MOST_IDS_EQUAL = 1000
"""Most wireless ids for symbols of equal probability: a second or so."""
MOST_IDS = 200
"""Most wireless ids for other probabilities: some seconds, more for rare or very frequent transmissions."""
MOST_STEPS = 50_000
"""Longest law that is worked out step by step."""
_TIE = 1e-12
"""Relative rounding that is granted where a quantile falls on a jump of a law that is not exact."""


class CompletionLaw:
    """The law of the number of steps until the association is complete; the initial step is not counted.

    Exact: with equal symbols every probability is the rational number correctly rounded; else the absolute
    error is about 1e-15, and that of `survival` relative to it about 1e-13.

    Attributes
    ----------
    cdf, survival : float64 arrays, index t = 0, 1, ...: P(T <= t) and P(T > t), until the former rounds to 1
    mean, sd : steps

    Raises ValueError for parameters out of range, and where transmissions are so rare or so frequent
    that the law is longer than `MOST_STEPS`, or never completes.

    """

    def __init__(self, wireless: int, visual: int, p: float = 0.5, colours: int = 1) -> None:
        check_neighbourhood(wireless, visual, p, colours)
        self.wireless, self.visual, self.p, self.colours = wireless, visual, p, colours
        self._exact = True
        if pairs_to_tell_apart(wireless, visual) == 0:
            self.cdf, self.survival = np.ones(1), np.zeros(1)
        elif symbols := _equal_symbols(p, colours):
            self.cdf, self.survival = _equal_law(wireless, visual, symbols)
        else:
            self._exact = False
            self.cdf, self.survival = _general_law(wireless, visual, p, colours)
        self.cdf.flags.writeable = self.survival.flags.writeable = False
        self.mean, self.sd = self._moments()

    def quantile(self, q: float) -> int:
        """The smallest number of steps t with P(T <= t) >= q; q in [0, 1)."""
        if not 0 <= q < 1:
            raise ValueError(f"q: {q} is no level of a quantile; give a number from 0 to below 1")
        tolerance = 0.0 if self._exact else _TIE * min(q, 1 - q)
        return int(np.argmax(self.cdf >= q - tolerance))

    def _moments(self) -> tuple[float, float]:
        """Mean sum P(T>t) and E[T^2] = sum (2t+1) P(T>t); beyond the last step by the bound N c^t."""
        c = agreement(self.p, self.colours)
        end = len(self.survival)
        steps = np.arange(end)
        rest = rest2 = 0.0
        if end > 1:  # else it was complete from the start, and p may be anything
            bound = pairs_to_tell_apart(self.wireless, self.visual) * c**end
            rest = bound / (1 - c)
            rest2 = (2 * end + 1) * rest + 2 * bound * c / (1 - c) ** 2
        mean = math.fsum([*self.survival, rest])
        second = math.fsum([*((2 * steps + 1) * self.survival), rest2])
        return mean, math.sqrt(max(0.0, second - mean * mean))


def fraction_matched(wireless: int, steps: int, p: float = 0.5, colours: int = 1) -> Floats:
    """Exact expected fraction of visual ids that are matched (2016, sec. 4.4) after t = 0 ... steps.

    A visual id is matched if no other of w ids has its string: sum over strings s of q_s (1-q_s)^(w-1), which
    does not depend on v. With equal symbols (1 - (C+1)^-t)^(w-1).
    Shape (steps + 1,). Raises ValueError for parameters out of range.
    """
    check_neighbourhood(wireless, min(wireless, 1), p, colours, certain_too=True)
    _check_at_least("wireless", wireless, 1)
    _check_at_least("steps", steps, 0)
    if symbols := _equal_symbols(p, colours):
        others = -(float(symbols) ** -np.arange(steps + 1.0))
        return _power_of_complement(others, wireless - 1)
    return np.array([_fraction_matched_at(t, wireless, p, colours) for t in range(steps + 1)])


def fraction_matched_model(
    wireless: int, steps: int, p: float = 0.5, colours: int = 1, *, visual: int | None = None
) -> Floats:
    """The model of 2016, Eqs. 2 and 3, after t = 0 ... steps: ((v-1)/v)^F_t with F_t = (wv - v) m^t.

    The paper sets v = w (`visual` None), and m = 1/2: the probability that two ids agree in a step.
    For v = 1 it gives 0 while F_t > 0, as printed. Shape (steps + 1,).
    """
    v = wireless if visual is None else visual
    check_neighbourhood(wireless, v, p, colours, certain_too=True)
    _check_at_least("visual", v, 1)
    _check_at_least("steps", steps, 0)
    false_edges = (wireless * v - v) * agreement(p, colours) ** np.arange(steps + 1.0)
    return np.asarray(((v - 1) / v) ** false_edges)


def lower_bound(visual: int) -> int:
    """Fewest steps in which the paper's best case is done: ceil(log2 v) (2014, "Probabilistic Algorithm")."""
    _check_at_least("visual", visual, 0)
    return max(0, visual - 1).bit_length()


def exact_lower_bound(wireless: int, visual: int, colours: int = 1) -> int:
    """Fewest steps with a positive probability to be done: (C+1)^t >= min(w, v+1) strings are needed.

    Where an invisible id is heard, it must not have the string of a visible one, so that v = 2^k takes a
    step more than `lower_bound` has it.
    """
    check_neighbourhood(wireless, visual, 0.5, colours)
    strings, steps = 1, 0
    while visual and strings < min(wireless, visual + 1):
        strings, steps = strings * (colours + 1), steps + 1
    return steps


def agreement(p: float, colours: int = 1) -> float:
    """The probability c = sum_s r_s^2 that two robots emit the same symbol in a step; m in 2016, Eq. 1."""
    return survival(p, colours)


def pairs_to_tell_apart(wireless: int, visual: int) -> int:
    """How many pairs of robots must not share a string: each that has a visible one."""
    return visual * (visual - 1) // 2 + visual * (wireless - visual)


def check_neighbourhood(
    wireless: int, visual: int, p: float, colours: int, *, certain_too: bool = False
) -> None:
    """Raise ValueError, key in front, unless these describe a neighbourhood that is completed some time.

    `certain_too`: it need not be.
    """
    _check_at_least("wireless", wireless, 0)
    _check_at_least("visual", visual, 0)
    _check_at_least("colours", colours, 1)
    if visual > wireless:
        raise ValueError(
            f"visual: {visual} visual ids, but {wireless} wireless ones; "
            "channel inclusion wants no more visual than wireless ids"
        )
    if not 0 <= p <= 1:
        raise ValueError(f"p: {p} is no probability; give a number above 0 and below 1")
    if certain_too or pairs_to_tell_apart(wireless, visual) == 0:
        return
    if p == 0 or (p == 1 and colours == 1):
        raise ValueError(f"p: with {p:g} all robots do the same for ever; give a number above 0 and below 1")
    most = MOST_IDS_EQUAL if _equal_symbols(p, colours) else MOST_IDS
    if wireless > most:
        raise ValueError(f"wireless: {wireless} ids are more than can be worked out; give at most {most}")
    c = agreement(p, colours)
    if c == 1 or math.log(CERTAIN / pairs_to_tell_apart(wireless, visual)) < MOST_STEPS * math.log(c):
        raise ValueError(f"p: {p} needs more than {MOST_STEPS} steps; give a number farther from 0 and 1")


def _check_at_least(key: str, value: int, least: int) -> None:
    if value < least:
        raise ValueError(f"{key}: {value} is too few; give {least} or more")


def _equal_symbols(p: float, colours: int) -> int:
    """How many symbols there are if all have one probability, else 0."""
    if p == 1:
        return colours
    return colours + 1 if math.isclose(1 - p, p / colours, rel_tol=4e-16) else 0


def _equal_law(wireless: int, visual: int, symbols: int) -> tuple[Floats, Floats]:
    """The product formula in integers; dividing two integers rounds correctly."""
    cdf, survival = [0.0], [1.0]
    strings = 1
    while survival[-1] > CERTAIN:
        strings *= symbols
        ways = (
            math.perm(strings, visual) * (strings - visual) ** (wireless - visual) if strings >= visual else 0
        )
        all_ways = strings**wireless
        cdf.append(ways / all_ways)
        survival.append((all_ways - ways) / all_ways)
    return np.array(cdf), np.array(survival)


def _general_law(wireless: int, visual: int, p: float, colours: int) -> tuple[Floats, Floats]:
    """The recursion, until the survival is negligible."""
    chances = Chances.before_any_step(wireless - visual, visual)
    cdf, survival = [chances.done[-1, -1]], [chances.undone[-1, -1]]
    while survival[-1] > CERTAIN:
        chances = mix(mix_alike(chances, colours), chances, p)
        cdf.append(chances.done[-1, -1])
        survival.append(chances.undone[-1, -1])
    return np.array(cdf), np.array(survival)


def _fraction_matched_at(t: int, wireless: int, p: float, colours: int) -> float:
    """Strings with k transmissions are equally likely; together they have a binomial probability."""
    # Beyond twelve standard deviations and some there is less mass than anybody asks for.
    reach = 12 * math.sqrt(t * p * (1 - p)) + 50
    k = np.arange(max(0, math.floor(t * p - reach)), min(t, math.ceil(t * p + reach)) + 1)
    own = binom.pmf(k, t, p)
    q = (1 - p) ** (t - k) * (p / colours) ** k
    return math.fsum(own * _power_of_complement(-q, wireless - 1))


def _power_of_complement(minus_q: Floats, exponent: int) -> Floats:
    """(1-q)^n, also for q near 0, where 1-q would lose q's digits, and for q = 1."""
    if exponent == 0:
        return np.ones_like(minus_q)
    with np.errstate(divide="ignore"):
        return np.asarray(np.exp(exponent * np.log1p(minus_q)))
