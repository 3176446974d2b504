"""What a team may do: move from vertex to vertex, and never break up (Vandermeulen et al., sec. II).

Time goes in steps. A robot that decides at step t to go from u to w is on the way, at elapsed 1 .. tau, at
steps t + 1 .. t + tau, and at w at t + tau + 1. It communicates as from u, its place, until it arrives.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from agent.behaviours.reconnection import kernels
from agent.behaviours.reconnection.model import Ways
from channels.graphs import Bools, Ints


class Motion(NamedTuple):
    """Where a robot is, and what it is committed to."""

    place: int
    """The vertex it is at, or has left and communicates from."""
    towards: int = -1
    """The vertex it is on the way to; its own place: it has been turned back; -1: it is at its place."""
    elapsed: int = 0
    """How many steps it has been on the way, or waiting."""
    left: int = 0
    """How many steps until it arrives."""

    @property
    def free(self) -> bool:
        """Whether it can decide: it is at a vertex."""
        return self.towards < 0


def way_between(ways: Ways, tail: int, head: int) -> int:
    """Number of the way. Raises ValueError where there is none."""
    start, end = int(ways.start[tail]), int(ways.start[tail + 1])
    way = start + int(np.searchsorted(ways.head[start:end], head))
    if way == end or ways.head[way] != head:
        raise ValueError(f"no way leads from vertex {tail} to vertex {head}")
    return way


def departed(ways: Ways, motion: Motion, towards: int) -> Motion:
    """The motion of a free robot that decides to go to a neighbouring vertex, at the step of the decision."""
    return Motion(motion.place, towards, 0, int(ways.steps[way_between(ways, motion.place, towards)]) + 1)


def turned_back(motion: Motion) -> Motion:
    """Back to the place it has left, which takes as long as it has been on the way."""
    if motion.free or motion.towards == motion.place:
        return motion
    if motion.elapsed == 0:
        return Motion(motion.place)
    return Motion(motion.place, motion.place, motion.elapsed, motion.elapsed)


def moved(motion: Motion) -> Motion:
    """The same one step later."""
    if motion.free:
        return motion._replace(elapsed=motion.elapsed + 1)
    if motion.left == 1:
        return Motion(motion.towards)
    return motion._replace(elapsed=motion.elapsed + 1, left=motion.left - 1)


def arrays(motions: Iterable[Motion]) -> tuple[Ints, Ints, Ints]:
    """Places, `towards` and remaining steps, as `kernels.safe` and `planner` take them."""
    table = np.array([(m.place, m.towards, m.left) for m in motions], dtype=np.int64).reshape(-1, 3)
    places, towards, remaining = np.ascontiguousarray(table.T)
    return places, towards, remaining


def networks(places: Mapping[int, int], hearing: Bools) -> list[tuple[int, ...]]:
    """Who is connected to whom, directly or by others, for the place of each robot.

    In order of their lowest numbers. Connected are those for whom the second smallest eigenvalue of the
    Laplacian of their network is positive (Eq. 12); to walk the network finds the same.
    """
    waiting = dict.fromkeys(sorted(places))
    found = []
    while waiting:
        reached = [next(iter(waiting))]
        del waiting[reached[0]]
        for robot in reached:
            near = [other for other in waiting if hearing[places[robot], places[other]]]
            reached += near
            for other in near:
                del waiting[other]
        found.append(tuple(sorted(reached)))
    return found


def turn_backs(motions: Sequence[Motion], hearing: Bools) -> tuple[int, ...]:
    """Which of a connected team's members must turn back, so that it stays connected: as few as possible.

    Indices into `motions`; of equally many, the lowest. Commitments that were made before two groups met
    may lead apart. To turn everybody back always does: then no place changes.
    """
    committed = [i for i, motion in enumerate(motions) if not motion.free and motion.towards != motion.place]
    for count in range(len(committed)):
        for chosen in combinations(committed, count):
            tried = [turned_back(motion) if i in chosen else motion for i, motion in enumerate(motions)]
            if kernels.safe(*arrays(tried), hearing):
                return chosen
    return tuple(committed)


def everybody(robots: int) -> tuple[tuple[int, ...], ...]:
    """Everybody searches for everybody."""
    return tuple(tuple(j for j in range(robots) if j != i) for i in range(robots))


def upwards(robots: int) -> tuple[tuple[int, ...], ...]:
    """Everybody searches for those of a higher number; the last one stands still (sec. II.C)."""
    return tuple(tuple(range(i + 1, robots)) for i in range(robots))


TARGETS: dict[str, Callable[[int], tuple[tuple[int, ...], ...]]] = {"all": everybody, "upwards": upwards}
"""Whom each robot of a team of so many searches for, by name."""


def sinks(targets: Sequence[Sequence[int]]) -> frozenset[int]:
    """Who searches for nobody, and stays where it is."""
    return frozenset(robot for robot, found in enumerate(targets) if not found)


def _heights(targets: Sequence[Sequence[int]]) -> list[int]:
    """The most searches in a row from each robot to one that searches for nobody; -1: round in circles."""
    heights = [-1] * len(targets)
    ready = [i for i, found in enumerate(targets) if not found]
    height = 0
    while ready:
        for i in ready:
            heights[i] = height
        height += 1
        ready = [
            i for i, found in enumerate(targets) if heights[i] < 0 and all(heights[j] >= 0 for j in found)
        ]
    return heights


def targets_of(
    group: Iterable[int], connected: Iterable[int], targets: Sequence[Sequence[int]]
) -> tuple[int, ...]:
    """For whom a group searches: all that its members search for, but for those that are connected.

    Under a target graph that rules out livelock (connected, no circles, one sink: sec. II.C), members may
    still not search for whom they would by themselves: with 0 > 1 > 2, the group of 0 and 2 and the robot 1
    would search for each other. So that searches of groups do not go in circles either, a group searches
    only for those below its lowest member, by the most searches in a row that lead to the sink; whoever is
    with the sink stands still.
    """
    members = list(group)
    heights = _heights(targets)
    ordered = min(heights) == 0 and heights.count(0) == 1
    lowest = min(heights[i] for i in members) if ordered else len(targets)
    found = {j for i in members for j in targets[i] if heights[j] < lowest}
    return tuple(sorted(found - set(connected)))
