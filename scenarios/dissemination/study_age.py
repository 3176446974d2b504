"""How old estimates are, and how often they are renewed, by distance (Julian et al. 2009, sec. 4, Fig. 5).

Robots stand at random in a square. From a cold start, one slot after the other: its owner chooses at most m
estimates as they are at its start, and all in range have them at its end. A slot takes m units, whether it
is full or not; one unit is the air time of one estimate.

Placements that are not connected are drawn again, unless they are wanted: what no chain of links reaches is
never known, under any scheme. Places and the order of slots do not depend on what robots say, so that studies
with one seed compare schemes on the same teams.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from scenarios.dissemination.kernels import (
    PROBABILISTIC,
    Team,
    fresh_team,
    importances,
    rule,
    talk,
)
from scenarios.dissemination.parameters import (
    Alpha,
    BitRate,
    Bits,
    NewEstimates,
    Order,
    Scheme,
    SlotLength,
    check_flooding,
)
from scenarios.dissemination.score_age import Around, Updates, Window, around, summary
from scenarios.study import Study, mean_and_error

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

PLACEMENTS_PER_CHUNK = 10
MOST_RECEPTIONS = 20_000_000
"""Estimates at receivers, in one placement, beyond which a study is refused."""
TRIALS = 1000
"""Placements of which one must be connected, or a study of connected ones is refused."""


class AgeParameters(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A team in a square, its radio, and what it says: as in the paper, which does not tell the side."""

    robots: Annotated[int, Meta(ge=2, le=400, description="robots, n")] = 9
    side: Annotated[float, Meta(gt=0, le=1e7, description="side of the square they stand in [m]")] = 75.0
    range: Annotated[float, Meta(gt=0, le=1e7, description="how far a robot is heard [m]")] = 30.0
    connected: Annotated[
        bool, Meta(description="draw again until a chain of links joins all; false: take all placements")
    ] = True
    m: SlotLength = 3
    alpha: Alpha = 1.0
    scheme: Scheme = "location"
    new_estimates: NewEstimates = "first"
    distance: Annotated[
        Literal["euclidean", "graph"],
        Meta(description="what importance depends on; graph: hops, n where no chain of links leads"),
    ] = "euclidean"
    order: Order = "drawn"
    bit_rate: BitRate = 3000.0
    bits: Bits = 192
    duration: Annotated[float, Meta(gt=0, le=1e6, description="how long robots talk [s]")] = 300.0
    warm_up: Annotated[
        float, Meta(ge=0, le=1e6, description="time from the start that does not count [s]")
    ] = 0.0
    bin: Annotated[float, Meta(gt=0, le=1e7, description="width of the bins of distance [m]")] = 15.0

    @property
    def slot_s(self) -> float:
        """Length of a slot."""
        return self.m * self.bits / self.bit_rate

    @property
    def slots(self) -> int:
        """Whole slots within the duration."""
        # A slot that ends with the duration is whole, whatever rounding makes of the quotient.
        return math.floor(self.duration / self.slot_s * (1 + 1e-12))


class Placement(Struct, frozen=True):
    """Where the robots stand, and the order of their slots."""

    places_m: Floats
    """(n, 2)."""
    order: Ints
    """(n,): who transmits in each slot."""
    redrawn: int = 0
    """Placements before this one that were not connected."""


def check(parameters: AgeParameters) -> None:
    """Raises ValueError for parameters that do not go together, naming the key."""
    robots, m = parameters.robots, parameters.m
    check_flooding(parameters.scheme, m, robots)
    if parameters.slots < 1:
        raise ValueError(
            f"duration: {parameters.duration:g} s hold no slot, which takes {parameters.slot_s:g} s; set more"
        )
    if parameters.warm_up >= parameters.duration:
        raise ValueError(
            f"warm_up: nothing of {parameters.duration:g} s is left after {parameters.warm_up:g} s; set less"
        )
    if parameters.slots * min(m, robots) * (robots - 1) > MOST_RECEPTIONS:
        raise ValueError("duration: makes more estimates than memory holds; set less, or a lower bit_rate")
    if parameters.connected and not _can_be_connected(parameters):
        raise ValueError(
            f"side: fewer than one of {TRIALS} placements is connected; set less, or a larger range, "
            "or connected=false"
        )


def chunk(_parameters: AgeParameters) -> int:
    """Placements per chunk."""
    return PLACEMENTS_PER_CHUNK


def simulate(parameters: AgeParameters, generator: np.random.Generator, samples: int) -> list[dict[str, Any]]:
    """`score_age.summary` of so many placements, with `redrawn`: those before it that were not connected."""
    placements = [draw(parameters, generator) for _ in range(samples)]
    chance = generator.spawn(1)[0]
    return [
        _summary(parameters, placement, updates(parameters, placement, chance)) for placement in placements
    ]


def summarise(parameters: AgeParameters, partials: list[list[dict[str, Any]]]) -> dict[str, Any]:
    """What `score_age.summary` holds, each number as `mean` and `se` over placements.

    Each stands beside the number of `placements` in which it is defined; where there is none, both are None.
    Besides: `frame_rate_hz`, `slot_s`, `redrawn` (placements that were not connected), `samples`.
    """
    found = [summary for partial in partials for summary in partial]
    redrawn = [one.pop("redrawn") for one in map(dict, found)]
    found = [{key: value for key, value in one.items() if key != "redrawn"} for one in found]
    bins = {place["from_m"]: place["to_m"] for one in found for place in one["by_distance"]}
    by_bin = [{place["from_m"]: place for place in one["by_distance"]} for one in found]
    hops = dict.fromkeys(name for one in found for name in one["by_hops"])
    whole = ("age_s", "updates_per_minute", "unknown_part", "spearman")
    return {
        **{key: _moments([one[key] for one in found]) for key in whole},
        "by_distance": [
            {"from_m": low, "to_m": bins[low]} | _parts([one[low] for one in by_bin if low in one])
            for low in sorted(bins)
        ],
        "by_hops": {
            name: _parts([one["by_hops"][name] for one in found if name in one["by_hops"]])
            for name in sorted(hops, key=_rank)
        },
        "never_known": {key: sum(one["never_known"][key] for one in found) for key in ("pairs", "of")},
        "slot_s": parameters.slot_s,
        "frame_rate_hz": 1 / (parameters.slot_s * parameters.robots),
        "redrawn": sum(redrawn),
        "samples": len(found),
    }


# --- one placement -------------------------------------------------------------------------------


def draw(parameters: AgeParameters, generator: np.random.Generator) -> Placement:
    """A random placement, connected if it has to be."""
    redrawn = 0
    places = _places(parameters, generator)
    while parameters.connected and not _is_connected(places, parameters.range):
        places = _places(parameters, generator)
        redrawn += 1
    order = np.arange(parameters.robots)
    drawn = generator.permutation(order)
    return Placement(places, order if parameters.order == "fixed" else drawn, redrawn)


def updates(parameters: AgeParameters, placement: Placement, chance: np.random.Generator) -> Updates:
    """Every estimate that was newer to its receiver; `chance` for what is drawn while robots talk."""
    where = neighbourhood(parameters, placement)
    robots, slots = parameters.robots, parameters.slots
    distances = where.distance_m[0]
    if parameters.distance == "graph":
        distances = np.where(where.hops[0] < 0, robots, where.hops[0]).astype(np.float64)
    importance = importances(distances, parameters.alpha)
    orders = np.tile(placement.order, (-(-slots // robots), 1))
    if parameters.order == "drawn_each_frame":
        orders = chance.permuted(orders, axis=1)
    code = rule(parameters.scheme, parameters.m, parameters.new_estimates)
    picks = min(parameters.m, robots) - 1 if code[0] == PROBABILISTIC else 0
    found = np.empty((slots * min(parameters.m, robots) * (robots - 1), 4), dtype=np.int64)
    count = talk(code, where.hops[0] == 1, distances, importance, *_arrays(fresh_team(robots)),
                  orders.ravel()[:slots], chance.random((slots, picks)), found)  # fmt: skip
    return _sorted(found[:count], parameters)


def neighbourhood(parameters: AgeParameters, placement: Placement) -> Around:
    """Who is how far from whom, for good."""
    return around(np.zeros(1), placement.places_m[None], parameters.range)


def _summary(parameters: AgeParameters, placement: Placement, newer: Updates) -> dict[str, Any]:
    window = Window(parameters.warm_up, np.full(parameters.robots, parameters.duration))
    found = summary(newer, window, neighbourhood(parameters, placement), parameters.bin)
    return found | {"redrawn": placement.redrawn}


def _sorted(found: Ints, parameters: AgeParameters) -> Updates:
    """From rows of receiver, origin, slots until reception, and until the stamp."""
    receiver, origin, received, made = found[np.lexsort((found[:, 2], found[:, 1], found[:, 0]))].T
    slot_s = parameters.slot_s
    # A slot that ends with the duration does so whatever rounding makes of the product.
    return Updates(receiver, origin, np.minimum(received * slot_s, parameters.duration), made * slot_s)


def _arrays(team: Team) -> tuple[Ints, Floats, Ints]:
    return team.stamps, team.counters, team.last


# --- placements ----------------------------------------------------------------------------------


def _places(parameters: AgeParameters, generator: np.random.Generator) -> Floats:
    return generator.random((parameters.robots, 2)) * parameters.side


def _is_connected(places_m: Floats, range_m: float) -> bool:
    squared = ((places_m[:, None] - places_m[None]) ** 2).sum(axis=2)
    return bool(connected_components(squared <= range_m * range_m, return_labels=False) == 1)


def _can_be_connected(parameters: AgeParameters) -> bool:
    trial = np.random.default_rng(0)
    return any(_is_connected(_places(parameters, trial), parameters.range) for _ in range(TRIALS))


# --- over placements -----------------------------------------------------------------------------


def _parts(found: Sequence[dict[str, Any]]) -> dict[str, Any]:
    return {key: _moments([one[key] for one in found]) for key in ("age_s", "updates_per_minute")}


def _moments(values: Sequence[Any]) -> dict[str, Any]:
    """Numbers as `mean` and `se` of those that are defined; dicts of numbers key by key."""
    if isinstance(values[0], dict):
        return {key: _moments([value[key] for value in values]) for key in values[0]}
    defined = [value for value in values if value is not None]
    mean, error = mean_and_error(defined) if defined else (None, None)
    return {"mean": mean, "se": error, "placements": len(defined)}


def _rank(hops: str) -> float:
    return float(hops) if hops.isdigit() else math.inf


STUDY = Study(
    name="age",
    title="Dissemination in a square: age of estimates, and updates a minute by distance",
    parameters=AgeParameters,
    samples=150,
    unit="placements",
    chunk=chunk,
    simulate=simulate,
    summarise=summarise,
    check=check,
)
