"""How long until robots on a grid know of each other (Julian et al. 2009, sec. 4, Fig. 2).

Robots stand still and all relay. From a cold start, one slot after the other: its owner chooses at most m
estimates, and its neighbours have them at the end of the slot. A slot takes m units, whether it is full or
not; one unit is the air time of one estimate. A part of the grid is done at the end of the slot in which
the last of its ordered pairs (i, j) is completed: i holds an estimate of j.

Distances are the true ones. Robots on the emulator go by estimated places: rounded to 1 cm, which breaks
ties, and by hops over those they know of.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from scenarios.dissemination.kernels import (
    Team,
    fresh_team,
    importances,
    propagate,
    rule,
)
from scenarios.dissemination.lattices import ALL, Lattice, Neighbours
from scenarios.dissemination.parameters import Alpha, NewEstimates, Order, Scheme, SlotLength
from scenarios.study import Study, error_of_sums

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

RUNS_PER_CHUNK = 20
FRAMES_AT_ONCE = 16
DRAWS_AT_ONCE = 2**22
"""Chance is drawn for so many frames at a time, or fewer where they take more numbers than this."""


class PropagationParameters(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A grid, and what its robots say. The defaults are the paper's."""

    rows: Annotated[int, Meta(ge=1, le=40, description="rows of the grid")] = 10
    columns: Annotated[int, Meta(ge=1, le=40, description="robots in each row")] = 10
    neighbours: Annotated[
        Neighbours,
        Meta(description="robots that hear one in the middle: 4 or 8, or 6 on a triangular lattice"),
    ] = 4
    m: SlotLength = 7
    alpha: Alpha = 1.0
    scheme: Scheme = "location"
    new_estimates: NewEstimates = "first"
    subgraphs: Annotated[
        str, Meta(description="centred parts of the grid, as 2x2,4x6; all: its centred squares")
    ] = ALL
    distance: Annotated[
        Literal["euclidean", "graph"], Meta(description="what importance depends on; graph: hops")
    ] = "euclidean"
    order: Order = "drawn"
    reuse: Annotated[
        Literal["none", "distance_two"],
        Meta(description="of slots: by nobody, or by robots more than two hops apart"),
    ] = "none"
    max_frames: Annotated[
        int, Meta(ge=1, le=1_000_000, description="frames after which a run counts as incomplete")
    ] = 2000


class Setting(Struct, frozen=True):
    """What all runs of a study share; arrays in the order and types the compiled loop takes them."""

    rule: Ints
    neighbours: Ints
    """Who hears each robot, one robot's after the other's."""
    neighbours_from: Ints
    """(n + 1,): where those of each robot begin."""
    senders: Ints
    """(n,): who transmits in each slot of a frame, one slot's after the other's."""
    senders_from: Ints
    """(slots + 1,)."""
    distances: Floats
    importance: Floats
    members: NDArray[np.bool_]
    """(parts, n)."""

    @property
    def slots(self) -> int:
        """In a frame."""
        return len(self.senders_from) - 1


def check(parameters: PropagationParameters) -> None:
    """Raises ValueError for parameters that do not go together, naming the key."""
    grid = _lattice(parameters)
    grid.parts(parameters.subgraphs)
    if parameters.scheme == "flooding" and parameters.m < grid.robots:
        raise ValueError(
            f"m: flooding sends everything, so a slot must take {grid.robots} estimates, not {parameters.m}; "
            f"set m to {grid.robots}"
        )


def chunk(parameters: PropagationParameters) -> int:
    """Runs per chunk."""
    return RUNS_PER_CHUNK


def simulate(parameters: PropagationParameters, generator: np.random.Generator, samples: int) -> Ints:
    """Slots until each part of the grid is done; shape (samples, parts), 0 where it is not in time."""
    setting = _setting(parameters)
    return np.array([_run(parameters, setting, generator) for _ in range(samples)])


def summarise(parameters: PropagationParameters, partials: list[Ints]) -> dict[str, Any]:
    """Propagation times over the runs that were completed.

    - `units`, `frames`: by part of the grid `mean`, `sd` and `se` (None where there are too few runs to
      tell), and `incomplete`, the runs left out;
    - `slots_per_frame`, `samples`.
    """
    slots = np.concatenate(partials)
    names = list(_lattice(parameters).parts(parameters.subgraphs))
    per_frame = _setting(parameters).slots
    return {
        "units": {name: _summary(of, parameters.m, 1) for name, of in zip(names, slots.T, strict=True)},
        "frames": {name: _summary(of, 1, per_frame) for name, of in zip(names, slots.T, strict=True)},
        "slots_per_frame": per_frame,
        "samples": len(slots),
    }


def _summary(slots: Ints, times: int, scale: int) -> dict[str, float | int | None]:
    """Of slots * times / scale."""
    done: list[int] = (slots[slots > 0] * times).tolist()
    runs, total = len(done), sum(done)
    error = error_of_sums(runs, total, sum(value * value for value in done), scale)
    return {
        "mean": total / (runs * scale) if runs else None,
        "sd": None if error is None else error * math.sqrt(runs),
        "se": error,
        "incomplete": len(slots) - runs,
    }


def _lattice(parameters: PropagationParameters) -> Lattice:
    return Lattice(parameters.rows, parameters.columns, parameters.neighbours)


@lru_cache(maxsize=4)
def _setting(parameters: PropagationParameters) -> Setting:
    grid = _lattice(parameters)
    distances = grid.euclidean() if parameters.distance == "euclidean" else grid.hops()
    slots = grid.slots(parameters.reuse)
    links = grid.links()
    parts = grid.parts(parameters.subgraphs)
    members = np.zeros((len(parts), grid.robots), dtype=np.bool_)
    for row, numbers in zip(members, parts.values(), strict=True):
        row[numbers] = True
    return Setting(
        rule(parameters.scheme, parameters.m, parameters.new_estimates),
        np.nonzero(links)[1],
        np.cumsum([0, *links.sum(axis=1)]),
        np.concatenate(slots),
        np.cumsum([0, *map(len, slots)]),
        distances,
        importances(distances, parameters.alpha),
        members,
    )


# --- one run -------------------------------------------------------------------------------------


def _run(parameters: PropagationParameters, setting: Setting, generator: np.random.Generator) -> Ints:
    """Slots until each part is done, or 0."""
    robots = len(setting.distances)
    team = fresh_team(robots)
    of_part = setting.members.sum(axis=1)
    missing, done = of_part * (of_part - 1), np.zeros(len(of_part), dtype=np.int64)
    order = np.arange(setting.slots)
    if parameters.order == "drawn":
        generator.shuffle(order)
    picks = min(parameters.m, robots) - 1 if parameters.scheme == "location-probabilistic" else 0
    at_once = min(FRAMES_AT_ONCE, 1 + DRAWS_AT_ONCE // (1 + robots * picks))
    before = None
    for frame in range(0, _frames(parameters, robots), at_once):
        frames = min(at_once, _frames(parameters, robots) - frame)
        orders = np.tile(order, (frames, 1))
        if parameters.order == "drawn_each_frame":
            orders = generator.permuted(orders, axis=1)
        draws = generator.random((frames * robots, picks))
        _advance(frame * setting.slots, setting, team, orders, draws, missing, done)
        after = _memory(parameters, team, (frame + frames) * setting.slots)
        if not missing.any() or (after is not None and after == before):
            break
        before = after
    return done


def _frames(parameters: PropagationParameters, robots: int) -> int:
    """Frames to go; one where nobody relays: by then everybody has heard all that it ever hears."""
    relay = parameters.scheme != "own" and min(parameters.m, robots) > 1
    return parameters.max_frames if relay else 1


def _memory(parameters: PropagationParameters, team: Team, now: int) -> bytes | None:
    """All that the future depends on, if that is little: when it comes back, everything goes on as before."""
    if parameters.order == "drawn_each_frame" or parameters.scheme not in ("freshest-first", "round-robin"):
        return None
    ages = np.where(team.stamps < 0, -1, now - team.stamps)
    return ages.tobytes() + team.last.tobytes()


def _advance(
    first_slot: int, setting: Setting, team: Team, orders: Ints, draws: Floats, missing: Ints, done: Ints
) -> None:
    s, t = setting, team
    propagate(
        first_slot, s.rule, s.neighbours, s.neighbours_from, s.senders, s.senders_from, s.distances,
        s.importance, s.members, t.stamps, t.counters, t.last, orders, draws, missing, done,
    )  # fmt: skip


STUDY = Study(
    name="propagation",
    title="Dissemination on a grid: time until all robots of its middle know of each other",
    parameters=PropagationParameters,
    samples=1000,
    unit="runs",
    chunk=chunk,
    simulate=simulate,
    summarise=summarise,
    check=check,
)
