"""Which estimates a robot broadcasts in its slot: the schemes, by name (Julian et al. 2009, secs. 2 and 3).

Pure and deterministic: distances and time stamps go in, numbers come out. The arithmetic is that of its
input: with fractions (and a whole `alpha`) it is exact, with floats it is, operation by operation, the one
compiled code repeats.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np

MIN_DISTANCE_M = 0.001
"""Distances count as at least this (1 mm): at 0 the importance would be infinite."""

SCHEMES = ("location", "location-probabilistic", "flooding", "own", "round-robin", "freshest-first")
NEW_ESTIMATES = ("first", "literal", "true-distance")
MOST_ALPHA = 20
"""Beyond it importances leave the range of floats; and the nearest few are all that is ever sent."""

LEAST_COUNTER = 5e-324
"""Rounding must not take a counter to 0, which is for news alone: the near would go before it for ever."""

Distance = Any
"""A number of at least 0: float, or Fraction."""


class Selection(ABC):
    """One robot's choice of estimates, slot after slot.

    `own`: its number; `team`: n. The own estimate always comes first and has no effect on others.
    """

    def __init__(self, own: int, team: int) -> None:
        self.own = own
        self.team = team

    def choose(self, m: int, distances: Sequence[Distance | None], stamps: Sequence[int | None]) -> list[int]:
        """The numbers of at most `m` estimates in the order they are sent, for one slot.

        Both by number: `distances` to the estimated places (None where unknown), `stamps` the time
        stamps (None where unknown). Unknown estimates are never sent: where nothing known is left, the
        list is shorter. Raises ValueError for m < 1, and where the scheme says so.
        """
        if m < 1:
            raise ValueError(f"m: a slot takes at least the own estimate, so m must be 1 or more, not {m}")
        known = [j for j in range(self.team) if j != self.own and stamps[j] is not None]
        return [self.own, *self._others(m - 1, known, distances, stamps)]

    def heard_first(self, number: int) -> None:  # noqa: B027 - most schemes do not care
        """Tell that an estimate of this robot has been received that had not been known before."""

    @abstractmethod
    def _others(
        self, count: int, known: list[int], distances: Sequence[Distance | None], stamps: Sequence[int | None]
    ) -> list[int]:
        """At most `count` of the `known` others."""


class Own(Selection):
    """The own estimate and nothing else: no hop."""

    def _others(self, count: int, known: list[int], *_: object) -> list[int]:
        return []


class Flooding(Selection):
    """Everything known, by number. `choose` raises ValueError where a slot has not room for all n."""

    def _others(self, count: int, known: list[int], *_: object) -> list[int]:
        if count + 1 < self.team:
            raise ValueError(
                f"m: flooding sends everything, so a slot must take {self.team} estimates, not {count + 1}; "
                f"set m to {self.team} or choose another scheme"
            )
        return known


class RoundRobin(Selection):
    """The known others in turn, by number, going on after the last one sent; at first after the own."""

    def __init__(self, own: int, team: int) -> None:
        super().__init__(own, team)
        self._last = own

    def _others(self, count: int, known: list[int], *_: object) -> list[int]:
        later = [j for j in known if j > self._last]
        chosen = (later + [j for j in known if j <= self._last])[:count]
        self._last = chosen[-1] if chosen else self._last
        return chosen


class FreshestFirst(Selection):
    """The others with the newest time stamps; lowest numbers first among equals."""

    def _others(
        self, count: int, known: list[int], distances: Sequence[Distance | None], stamps: Sequence[int | None]
    ) -> list[int]:
        def age(j: int) -> int:
            stamp = stamps[j]
            assert stamp is not None
            return -stamp

        return sorted(known, key=age)[:count]


class Location(Selection):
    """Near ones more often than far ones: Algorithm 1, deterministic.

    Each robot j has an importance f_j = d_j^-alpha (Eq. 1) and a counter c_j, at first 1: "the probability
    that the corresponding index has *not* been selected". For each pick, over all that are selectable yet
    in this slot, c_j becomes c_j (1 - f_j / sum of f) and whoever has the *lowest* counter is picked (as the
    text of sec. 3.2 says; the pseudo-code prints arg max), and its counter is 1 again. Ties: lowest number.
    Counters persist between slots. d_j is at least `MIN_DISTANCE_M`.

    What becomes of an estimate just learned is left open by the paper. `new_estimates`:

    - "literal": its counter is 1, as if it had just been sent;
    - "true-distance": robots count before they are known, by their true distance: they take part in the sum
      and their counters fall, but they are not picked. `distances` must then be given for all;
    - "first": its counter is 0, so that news is relayed at once; the nearest of them first (ties of
      counters go to the nearest here, and then to the lowest number).
    """

    def __init__(self, own: int, team: int, alpha: float, new_estimates: str) -> None:
        super().__init__(own, team)
        check_location(alpha, new_estimates)
        self._alpha = alpha
        self._new = new_estimates
        self.counters: list[Any] = [1] * team
        """Everybody's, by number; the own one stays 1."""

    def heard_first(self, number: int) -> None:
        """News is relayed at once, by "first"."""
        if self._new == "first" and number != self.own:
            self.counters[number] = 0

    def _others(
        self, count: int, known: list[int], distances: Sequence[Distance | None], stamps: Sequence[int | None]
    ) -> list[int]:
        weighed = known
        if self._new == "true-distance":
            weighed = [j for j in range(self.team) if j != self.own]
        importance = importances(weighed, distances, self._alpha)
        chosen: list[int] = []
        for _ in range(min(count, len(known))):
            self._count_down(importance)
            candidates = [j for j in known if j in importance]
            if self._new == "first":
                picked = min(candidates, key=lambda j: (self.counters[j], distances[j], j))
            else:
                picked = min(candidates, key=lambda j: (self.counters[j], j))
            chosen.append(picked)
            self.counters[picked] = 1
            del importance[picked]
        return chosen

    def _count_down(self, importance: dict[int, Any]) -> None:
        total = _total(importance)
        for j, f in importance.items():
            counter = self.counters[j]
            self.counters[j] = counter * (1 - f / total)
            if counter and not self.counters[j]:
                self.counters[j] = LEAST_COUNTER


class LocationProbabilistic(Selection):
    """Near ones more often than far ones, by chance: Eq. 2, drawn without replacement.

    A slot takes min(m, n) - 1 uniform numbers from the generator, however many robots are known.
    """

    def __init__(self, own: int, team: int, alpha: float, generator: np.random.Generator) -> None:
        super().__init__(own, team)
        check_location(alpha, NEW_ESTIMATES[0])
        self._alpha = alpha
        self._generator = generator

    def _others(
        self, count: int, known: list[int], distances: Sequence[Distance | None], stamps: Sequence[int | None]
    ) -> list[int]:
        draws: list[float] = self._generator.random(min(count, self.team - 1)).tolist()
        importance = importances(known, distances, self._alpha)
        chosen: list[int] = []
        for draw in draws[: len(known)]:
            aim = draw * _total(importance)
            passed: Any = 0
            for j, f in importance.items():
                picked = j
                passed = passed + f
                if passed > aim:
                    break
            chosen.append(picked)
            del importance[picked]
        return chosen


def selection(
    scheme: str,
    own: int,
    team: int,
    *,
    alpha: float = 1.0,
    new_estimates: str = "first",
    generator: np.random.Generator | None = None,
) -> Selection:
    """The scheme of this name for one robot. What a scheme has no use for is ignored.

    Raises ValueError for an unknown name, parameters out of range, or chance without a generator.
    """
    if scheme == "location":
        return Location(own, team, alpha, new_estimates)
    if scheme == "location-probabilistic":
        if generator is None:
            raise ValueError("scheme: location-probabilistic draws at random; hand in a generator")
        return LocationProbabilistic(own, team, alpha, generator)
    plain: dict[str, type[Own | Flooding | RoundRobin | FreshestFirst]] = {
        "own": Own,
        "flooding": Flooding,
        "round-robin": RoundRobin,
        "freshest-first": FreshestFirst,
    }
    if scheme not in plain:
        raise ValueError(f"scheme: must be one of {', '.join(SCHEMES)}, is {scheme!r}")
    return plain[scheme](own, team)


def check_location(alpha: float, new_estimates: str) -> None:
    """Raises ValueError for parameters that are out of range, naming the key."""
    if not 0 <= alpha <= MOST_ALPHA:
        raise ValueError(f"alpha: must lie within 0 (all alike) to {MOST_ALPHA}, is {alpha}")
    if new_estimates not in NEW_ESTIMATES:
        raise ValueError(f"new_estimates: must be one of {', '.join(NEW_ESTIMATES)}, is {new_estimates!r}")


def importances(numbers: list[int], distances: Sequence[Distance | None], alpha: float) -> dict[int, Any]:
    """f_j = d_j^-alpha (Eq. 1) of these robots, in their order. Raises ValueError where a d_j is unknown."""
    found: dict[int, Any] = {}
    for j in numbers:
        distance = distances[j]
        if distance is None:
            raise ValueError(
                f"distances: the one to robot {j} is missing; give it for every robot that is known, and "
                'with new_estimates = "true-distance" for all'
            )
        found[j] = max(distance, MIN_DISTANCE_M) ** -alpha
    return found


def _total(importance: dict[int, Any]) -> Any:
    # No `sum`: from Python 3.12 on it adds floats otherwise than compiled code does.
    total: Any = 0
    for f in importance.values():
        total = total + f
    return total
