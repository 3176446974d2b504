"""One robot of a team, without its radio: where it is, where it has been, and its own business.

A robot wanders for the first steps, then does its own tasks, if it has any, and only then searches, together
with whoever it is connected to that searches as well (Vandermeulen et al., secs. II.C, V).
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from agent.behaviours.reconnection.baselines import Ages, Visits, wander
from agent.behaviours.reconnection.model import Ways
from agent.behaviours.reconnection.team import Motion, departed, moved
from channels.randomness import Draws

OWN, GROUP, TASKS = range(3)
"""What a draw is for."""


class Task(NamedTuple):
    """Something to do somewhere."""

    vertex: int
    steps: int
    """How long it takes there, 1 or more."""


class Member:
    """Starts at `start`; `draws` are its own, asked for by step and purpose."""

    def __init__(
        self, ways: Ways, start: int, draws: Draws, random_steps: int, tasks: Iterable[Task] = ()
    ) -> None:
        self.motion = Motion(start)
        self._ways, self._draws = ways, draws
        self._random_steps = random_steps
        self._tasks = list(tasks)
        self._work_left = 0
        self._visits = Visits(len(ways.start) - 1, start)

    def searching(self, step: int) -> bool:
        """Whether it has nothing else to do."""
        return step >= self._random_steps and not self._tasks

    def ages(self, memory: int) -> Ages:
        """For "persistent": see `Visits.ages`; empty while it is on the way."""
        return self._visits.ages(self._ways, self.motion.place, memory) if self.motion.free else ()

    def drawn(self, step: int) -> float:
        """The draw by which it decides for its group."""
        return float(self._draws.uniform(step, GROUP))

    def mind_own_business(self, step: int) -> None:
        """Decide where to go, unless it searches or is on the way."""
        if not self.motion.free or self.searching(step):
            return
        if step < self._random_steps:
            towards = wander(self._ways, self.motion.place, float(self._draws.uniform(step, OWN)))
        else:
            towards = self._next_for_tasks()
        if towards >= 0:
            self.motion = departed(self._ways, self.motion, towards)

    def advance(self) -> None:
        """One step later."""
        arrives = not self.motion.free and self.motion.left == 1
        before, self.motion = self.motion, moved(self.motion)
        if arrives and self.motion.place != before.place:
            self._visits.note(self.motion.place)
        if self._work_left:
            self._work_left -= 1
            if not self._work_left:
                # Here, not when it next decides: whether it searches must not change within a step.
                del self._tasks[0]

    def _next_for_tasks(self) -> int:
        """The next vertex on the way to the first task; -1: stay, it is here."""
        task = self._tasks[0]
        if self.motion.place != task.vertex:
            return next_on_the_way(self._ways, self.motion.place, task.vertex)
        self._work_left = self._work_left or task.steps
        return -1


def begun(
    ways: Ways, start: int, generator: np.random.Generator, *, random_steps: int, tasks: int, task_steps: int
) -> Member:
    """A member whose draws, and so many tasks of up to `task_steps`, come from a robot's fresh generator."""
    draws = Draws.of_key(int(generator.integers(2**63)))
    own = drawn_tasks(draws, len(ways.start) - 1, tasks, task_steps)
    return Member(ways, start, draws, random_steps, own)


def drawn_tasks(draws: Draws, vertices: int, count: int, longest: int) -> list[Task]:
    """So many tasks anywhere, each of 1 to `longest` steps."""
    where = (draws.uniform(np.arange(count), TASKS, 0) * vertices).astype(np.int64)
    how_long = 1 + (draws.uniform(np.arange(count), TASKS, 1) * longest).astype(np.int64)
    return [Task(vertex, steps) for vertex, steps in zip(where.tolist(), how_long.tolist(), strict=True)]


def next_on_the_way(ways: Ways, start: int, goal: int) -> int:
    """The first vertex on a shortest way, in steps, to another one; the lowest of several (Dijkstra 1959)."""
    far = np.iinfo(np.int64).max
    steps = np.full(len(ways.start) - 1, far)
    steps[goal] = 0
    waiting = [(0, goal)]
    while waiting:
        known, vertex = heapq.heappop(waiting)
        if vertex == start:
            break
        if known > steps[vertex]:
            continue
        for way in range(ways.start[vertex], ways.start[vertex + 1]):
            longer, other = known + int(ways.steps[way]) + 1, int(ways.head[way])
            if longer < steps[other]:
                steps[other] = longer
                heapq.heappush(waiting, (longer, other))
    out = range(int(ways.start[start]), int(ways.start[start + 1]))
    return int(ways.head[min(out, key=lambda way: _through(ways, steps, way, far))])


def _through(ways: Ways, steps: Sequence[int] | np.ndarray, way: int, far: int) -> int:
    known = int(steps[ways.head[way]])
    return far if known == far else known + int(ways.steps[way]) + 1
