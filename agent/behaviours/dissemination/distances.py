"""How far a robot takes the others to be, from its estimates (Julian et al. 2009, sec. 2.2: d(p_i, p_j)).

Distances are lists by number, the own one included (0); None: unknown.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial

from agent.behaviours.dissemination.estimates import Estimate

DISTANCES = ("euclidean", "euclidean-3d", "graph")

Distances = list[float | None]
DistanceFunction = Callable[[int, Sequence[Estimate | None]], Distances]
"""From the own number and everybody's estimates by number, the own known."""


def distance_function(name: str, link_range_m: float | None = None) -> DistanceFunction:
    """The one of this name. Raises ValueError for an unknown name, or "graph" without a link range > 0."""
    if name == "euclidean":
        return euclidean
    if name == "euclidean-3d":
        return euclidean_3d
    if name == "graph":
        if link_range_m is None or not link_range_m > 0:
            raise ValueError("link_range_m: distance graph counts hops; give the range of a link, above 0 m")
        return partial(hops, link_range_m=link_range_m)
    raise ValueError(f"distance: must be one of {', '.join(DISTANCES)}, is {name!r}")


def euclidean(own: int, estimates: Sequence[Estimate | None]) -> Distances:
    """Over the ground [m]; altitude does not count."""
    here = _own(own, estimates)
    return [None if it is None else math.hypot(it.x_m - here.x_m, it.y_m - here.y_m) for it in estimates]


def euclidean_3d(own: int, estimates: Sequence[Estimate | None]) -> Distances:
    """Through the air [m]."""
    here = _own(own, estimates)
    return [None if it is None else _apart(here, it) for it in estimates]


def hops(own: int, estimates: Sequence[Estimate | None], link_range_m: float) -> Distances:
    """Hops in the connectivity graph over the estimated places.

    Two robots are linked when they are at most `link_range_m` apart, altitude included. Where no path of
    known robots leads, n hops: more than any path has, so that who is cut off counts least and is still
    sent at times.
    """
    found: Distances = [None if each is None else float(len(estimates)) for each in estimates]
    frontier = [_own(own, estimates)]
    beyond = [each for each in estimates if each is not None and each.number != own]
    found[own] = reached = 0.0
    while frontier:
        reached += 1.0
        linked: list[Estimate] = []
        rest: list[Estimate] = []
        for one in beyond:
            near = any(_apart(one, other) <= link_range_m for other in frontier)
            (linked if near else rest).append(one)
        for one in linked:
            found[one.number] = reached
        frontier, beyond = linked, rest
    return found


def _own(own: int, estimates: Sequence[Estimate | None]) -> Estimate:
    here = estimates[own]
    if here is None:
        raise ValueError(f"number: robot {own} does not know its own place; update_own comes first")
    return here


def _apart(one: Estimate, other: Estimate) -> float:
    return math.hypot(other.x_m - one.x_m, other.y_m - one.y_m, other.z_m - one.z_m)
