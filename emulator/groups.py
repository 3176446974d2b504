"""Groups: parts of a team that differ from the rest of it, and which robots belong to them."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import ROUND_HALF_UP, Decimal
from typing import Annotated, Any

from msgspec import Meta, Struct

from channels.randomness import Draws, stable_keys
from channels.settings import Probability
from emulator.placement import Placement

MAX_SPEED_MPS = 10_000.0

Name = Annotated[str, Meta(min_length=1)]
CruiseSpeed = Annotated[float, Meta(ge=0, le=MAX_SPEED_MPS)]
"""Of a robot that nobody tells to move; zero: it stands."""


Altitude = Annotated[float, Meta(ge=-10_000_000.0, le=10_000_000.0)]
"""Above the plane in which all move; the radio reckons with it, cameras and walls do not."""


class GroupSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """What is special about some robots; everything left out is as for all others.

    Exactly one of `robots` and `share` says how many they are; which they are is drawn.
    """

    name: Name
    robots: Annotated[int, Meta(ge=0)] | None = None
    share: Probability | None = None
    """Of the whole team; rounded to the nearest whole number of robots, halves up."""
    behaviour: Name | None = None
    params: dict[str, Any] = {}
    """Over those of the scenario, under a robot's own."""
    placement: Placement | None = None
    altitude_m: Altitude | None = None
    speed_mps: CruiseSpeed | None = None
    """Instead of the speed that `bounce` motion gives all."""


NO_GROUP = GroupSettings("")
"""Of a robot in no group: nothing is special."""


def size(group: GroupSettings, team: int) -> int:
    """How many robots of a team of `team` belong to a group."""
    if group.robots is not None:
        return group.robots
    # In decimals, as it is written: 0.285 of 100 is a half to be rounded up, and no binary fraction.
    exact = Decimal(repr(group.share or 0.0)) * team
    return int(exact.to_integral_value(ROUND_HALF_UP))


def group_of_each(groups: Sequence[GroupSettings], seed: int, ids: Sequence[str]) -> dict[str, GroupSettings]:
    """The group of every robot, `NO_GROUP` for those in none, for groups no larger than the team in all.

    The robots are ranked by a draw of each one's own, and the ranking is cut into one piece per group, so
    that the members are spread over the team, no two groups overlap, and a group that grows keeps those
    it had, unless one before it grows as well.
    """
    draws = Draws(seed, "groups").bits(stable_keys(ids)).tolist()
    ranking = [name for _, name in sorted(zip(draws, ids, strict=True))]
    found = dict.fromkeys(ids, NO_GROUP)
    first = 0
    for group in groups:
        last = first + size(group, len(ids))
        found.update(dict.fromkeys(ranking[first:last], group))
        first = last
    return found
