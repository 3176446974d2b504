"""Searching without a belief, to compare with: at random, and persistently (Vandermeulen et al., sec. V)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from agent.behaviours.reconnection.model import Ways
from agent.behaviours.reconnection.planner import joint_moves
from agent.behaviours.reconnection.team import Motion, arrays
from channels.graphs import Bools, Ints

Ages = tuple[int, ...]


class Visits:
    """When a robot has been where, counted in its moves."""

    def __init__(self, vertices: int, start: int) -> None:
        self._last = np.full(vertices, -1)
        self._moves = 0
        self._last[start] = 0

    def note(self, vertex: int) -> None:
        """The robot has come to a vertex."""
        self._moves += 1
        self._last[vertex] = self._moves

    def ages(self, ways: Ways, vertex: int, memory: int) -> Ages:
        """For each neighbour of a vertex how many moves ago it was left, at most `memory`."""
        last = self._last[ways.head[ways.start[vertex] : ways.start[vertex + 1]]]
        ages = np.where(last < 0, memory, np.minimum(self._moves - last, memory))
        return tuple(ages.tolist())


def wander(ways: Ways, vertex: int, u: float) -> int:
    """A neighbour at random, for a uniform draw u from [0, 1)."""
    start, end = int(ways.start[vertex]), int(ways.start[vertex + 1])
    return int(ways.head[start + int(u * (end - start))])


def random_moves(ways: Ways, hearing: Bools, motions: Sequence[Motion], u: float) -> Ints:
    """One of all joint decisions that keep the group together, at random: (m,), as `planner.joint_moves`.

    Members may wait although they could move: two who always move when they can change places for ever where
    ways of different lengths let them do nothing else at once.
    """
    moves = joint_moves(ways, hearing, *arrays(motions))
    return _drawn(moves, u)


def persistent_moves(
    ways: Ways, hearing: Bools, motions: Sequence[Motion], ages: Sequence[Ages], memory: int, u: float
) -> Ints:
    """Of those decisions, at random one that leads where members have not been for longest: (m,).

    `ages`: as of `Visits`, for the place of each member. A decision counts the ages, `memory` at most, of
    the vertices that members go to; to wait counts 0. A robot by itself therefore goes to a neighbour that
    it has not visited in its last `memory` moves, else to the one that it visited least recently.
    """
    moves = joint_moves(ways, hearing, *arrays(motions))
    worth = np.zeros(len(moves), dtype=np.int64)
    for column, motion, each in zip(moves.T, motions, ages, strict=True):
        if motion.free:
            known = np.zeros(len(hearing) + 1, dtype=np.int64)
            near = ways.head[ways.start[motion.place] : ways.start[motion.place + 1]]
            known[near] = np.minimum(each, memory)
            worth += known[column]
    return _drawn(moves[worth == worth.max()], u)


def _drawn(moves: Ints, u: float) -> Ints:
    return np.asarray(moves[int(u * len(moves))])
