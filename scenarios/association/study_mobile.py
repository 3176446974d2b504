"""Large samples of mobile association: whole worlds of robots, all observers at once (2016, sec. 5.4-5.5)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from scenarios.association.mobile_simulation import Counts, MobileAssociation, stamp_type
from scenarios.association.mobile_world import World, cells_per_side, robots_in
from scenarios.study import Study

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

DEEP_RANGES = 3
"""An observer is deep if it is farther than so many visual ranges from every wall."""
MOST_BYTES = 2.5e9
BYTES_PER_EDGE = 70
"""At the first step's peak, as measured in worlds of 5 to 17 million edges."""
LONGEST_WARM_UP = 100_000

Length = Annotated[float, Meta(gt=0, le=1e6)]


class MobileParameters(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One kind of world. Lengths in robot diameters; defaults as in sec. 5.5."""

    range: Annotated[Length, Meta(description="radius in which a robot is seen")] = 16.0
    speed: Annotated[Length, Meta(description="diameters a mobile robot drives in a step")] = 1.4
    separation: Annotated[
        Length,
        Meta(description="of grid positions; if the world is no multiple of it, the nearest that fits"),
    ] = 4.0
    mobile_fraction: Annotated[
        float, Meta(gt=0, le=1, description="part of the robots that drive and observe (at least one robot)")
    ] = 0.05
    world: Annotated[Length, Meta(description="side of the square world")] = 400.0
    drop_time: Annotated[
        int, Meta(ge=1, le=10_000, description="silent steps after which a wireless id is dropped")
    ] = 20
    wireless_range: Annotated[Length, Meta(description="radius in which it is heard (range)")] | None = None
    p: Annotated[float, Meta(gt=0, le=1, description="probability that a robot transmits in a step")] = 0.5
    steps: Annotated[int, Meta(ge=1, le=100_000, description="steps measured, after a warm-up")] = 100

    @property
    def earshot(self) -> float:
        """Radius in which a robot is heard."""
        return self.range if self.wireless_range is None else self.wireless_range

    @property
    def warm_up(self) -> int:
        """Steps after which nothing is left of the start.

        What stood in range at the start has left it after 2 ranges of driving, and is forgotten `drop_time`
        steps later. (A robot that drives alongside can stay longer, but has been told apart long since.)
        """
        return math.ceil(2 * self.earshot / self.speed) + self.drop_time


def check(parameters: MobileParameters) -> None:
    """Raises ValueError for parameters that do not go together, naming the key."""
    side = parameters.world
    if parameters.earshot < parameters.range:
        raise ValueError(
            f"wireless_range: {parameters.earshot:g} is less than range ({parameters.range:g}), but who is "
            "seen is heard here (channel inclusion); set at least the range"
        )
    if cells_per_side(side, parameters.separation) < 2:
        raise ValueError(
            f"separation: {parameters.separation:g} leaves one robot alone in a world of {side:g}; "
            f"set {side / 2:g} or less"
        )
    if parameters.speed >= side:
        raise ValueError(f"speed: in a world of {side:g} a robot drives less than {side:g} a step; set less")
    if parameters.warm_up > LONGEST_WARM_UP:
        raise ValueError(
            f"speed: at {parameters.speed:g} a step it takes {parameters.warm_up} steps, more than "
            f"{LONGEST_WARM_UP}, to leave the start behind; set a higher speed"
        )
    bytes_ = _memory(parameters)
    if bytes_ > MOST_BYTES:
        raise ValueError(
            f"world: takes about {bytes_ / 1e9:.1f} GB, more than {MOST_BYTES / 1e9:g}; set a smaller world, "
            "mobile_fraction or range, or a larger separation"
        )


def _memory(parameters: MobileParameters) -> float:
    robots, observers = robots_in(parameters.world, parameters.separation, parameters.mobile_fraction)
    density = robots / parameters.world**2
    seen, heard = (
        min(robots, density * math.pi * reach**2) for reach in (parameters.range, parameters.earshot)
    )
    arrays = 2 if parameters.earshot == parameters.range else 3
    stamp = np.dtype(stamp_type(parameters.warm_up + parameters.steps, parameters.drop_time)).itemsize
    edges = parameters.p**2 * seen * heard  # the first step's are the most: everything is new
    return observers * (robots * arrays * stamp + edges * BYTES_PER_EDGE)


def chunk(parameters: MobileParameters) -> int:
    """Worlds per chunk."""
    return 1


# --- one world -----------------------------------------------------------------------------------

COLUMNS = (
    "observers",
    "observers with visual ids",
    "fraction",
    "fraction squared",
    "observers with true edges",
    "ratio",
    "ratio squared",
    "visual",
    "edges",
    "true_edges",
    "matched",
    "right",
)
"""What is summed up over observers, for each step."""
OBSERVERS, WITH_VISUAL, FRACTION, _, WITH_TRUE, RATIO, _, VISUAL, EDGES, TRUE_EDGES, MATCHED, RIGHT = range(
    12
)
GROUPS = ("deep", "all")


def simulate(parameters: MobileParameters, generator: np.random.Generator, samples: int) -> list[Floats]:
    """Sums over observers for each of so many worlds; shape (2, warm-up + steps + 1, columns) each.

    First index: `GROUPS`; second: steps, of which 0 is the empty start; third: `COLUMNS`.
    """
    return [_one_world(parameters, generator) for _ in range(samples)]


def _one_world(parameters: MobileParameters, generator: np.random.Generator) -> Floats:
    world = World(
        generator,
        side=parameters.world,
        separation=parameters.separation,
        mobile_fraction=parameters.mobile_fraction,
        speed=parameters.speed,
    )
    steps = parameters.warm_up + parameters.steps
    association = MobileAssociation(
        world.mobile,
        world.robots,
        drop_time=parameters.drop_time,
        wireless_exceeds_visual=parameters.earshot > parameters.range,
        steps=steps,
    )
    sums = np.zeros((len(GROUPS), steps + 1, len(COLUMNS)))
    everyone = np.ones(world.mobile, dtype=np.bool_)
    for step in range(1, steps + 1):
        world.move()
        active = generator.random(world.robots) < parameters.p
        in_view = world.in_range(parameters.range)
        in_earshot = in_view if parameters.earshot == parameters.range else world.in_range(parameters.earshot)
        association.observe(in_view, in_earshot, active)
        counts = association.counts()
        for group, chosen in enumerate((world.deep(DEEP_RANGES * parameters.range), everyone)):
            sums[group, step] = _sums(counts, chosen)
    return sums


def _sums(counts: Counts, chosen: Bools) -> list[float]:
    """Sums over the chosen observers, one for each of `COLUMNS` (sec. 4.2 and 5.3)."""
    visual, edges, true_edges = counts.visual[chosen], counts.edges[chosen], counts.true_edges[chosen]
    matched, right = counts.matched[chosen], counts.right[chosen]
    with_visual = visual > 0
    fraction = matched[with_visual] / visual[with_visual]
    with_true = true_edges > 0
    ratio = edges[with_true] / true_edges[with_true]
    return [
        len(visual), len(fraction), fraction.sum(), (fraction**2).sum(),
        len(ratio), ratio.sum(), (ratio**2).sum(),
        visual.sum(), edges.sum(), true_edges.sum(), matched.sum(), right.sum(),
    ]  # fmt: skip


# --- many worlds ---------------------------------------------------------------------------------


def summarise(parameters: MobileParameters, partials: Sequence[list[Floats]]) -> dict[str, Any]:
    """The steady state, over the steps after the warm-up, for `deep` observers and for `all`.

    - `fraction_matched`: visual ids with exactly one candidate over visual ids in the list: `mean` and `sd`
      over observers and steps, `se` of the mean from the worlds, which are independent;
    - `ratio`: total to true edges, likewise, where there are true edges;
    - `ratio_of_sums`: all edges of all observers to all true ones;
    - `visual_ids_in_list`: their mean number;
    - `matches_right`: the part of the matches that are right.

    None stands for what no observer had. Besides: `samples`, `robots`, `observers`, `warm_up`, and
    `separation` as it was (see `cells_per_side`).
    """
    worlds = np.array([world for partial in partials for world in partial])
    settled = worlds[:, :, parameters.warm_up + 1 :].sum(axis=2)
    robots, observers = robots_in(parameters.world, parameters.separation, parameters.mobile_fraction)
    return {
        **{name: _steady(settled[:, group]) for group, name in enumerate(GROUPS)},
        "samples": len(worlds),
        "robots": robots,
        "observers": observers,
        "separation": parameters.world / cells_per_side(parameters.world, parameters.separation),
        "warm_up": parameters.warm_up,
    }


def summarise_series(parameters: MobileParameters, partials: Sequence[list[Floats]]) -> dict[str, Any]:
    """The steady state as `summarise` has it, and `series`, step by step from the empty start (index 0).

    For `deep` and `all`: `fraction_matched` and `ratio`, each with lists `mean`, `sd` and `se`; None where
    no observer had any.
    """
    worlds = np.array([world for partial in partials for world in partial])
    series = {}
    for group, name in enumerate(GROUPS):
        moments = [_moments(worlds[:, group, step]) for step in range(worlds.shape[2])]
        series[name] = {
            metric: {key: [moment[metric][key] for moment in moments] for key in ("mean", "sd", "se")}
            for metric in ("fraction_matched", "ratio")
        }
    return {**summarise(parameters, partials), "series": series}


def _steady(worlds: Floats) -> dict[str, Any]:
    total = worlds.sum(axis=0)
    return {
        **_moments(worlds),
        "ratio_of_sums": _quotient(total[EDGES], total[TRUE_EDGES]),
        "visual_ids_in_list": _quotient(total[VISUAL], total[OBSERVERS]),
        "matches_right": _quotient(total[RIGHT], total[MATCHED]),
    }


def _moments(worlds: Floats) -> dict[str, dict[str, float | None]]:
    return {
        "fraction_matched": _moment(worlds[:, WITH_VISUAL : FRACTION + 2]),
        "ratio": _moment(worlds[:, WITH_TRUE : RATIO + 2]),
    }


def _moment(worlds: Floats) -> dict[str, float | None]:
    """Mean, standard deviation and error of values, from each world's count, sum and sum of squares.

    The mean is a quotient of sums over worlds; its error is that of a ratio estimator, which needs no
    assumption of how the values of one world hang together.
    """
    counts, sums, squares = worlds.T
    count = counts.sum()
    if not count:
        return {"mean": None, "sd": None, "se": None}
    mean = sums.sum() / count
    sd = math.sqrt(max(0.0, squares.sum() / count - mean**2))
    error = None
    if len(worlds) > 1:
        residual = sums - mean * counts
        error = math.sqrt(len(worlds) / (len(worlds) - 1) * float((residual**2).sum())) / float(count)
    return {"mean": float(mean), "sd": sd, "se": error}


def _quotient(above: float, below: float) -> float | None:
    return float(above / below) if below else None


STUDY = Study(
    name="association-mobile",
    title="Mobile association: fraction matched and ratio of total to true edges",
    parameters=MobileParameters,
    samples=20,
    unit="worlds",
    chunk=chunk,
    simulate=simulate,
    summarise=summarise,
    check=check,
)

SERIES = Study(
    name="association-mobile-series",
    title="Mobile association, step by step from the start",
    parameters=MobileParameters,
    samples=20,
    unit="worlds",
    chunk=chunk,
    simulate=simulate,
    summarise=summarise_series,
    check=check,
)
"""For figures: too long to print."""
