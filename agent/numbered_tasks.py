"""Tasks whose order in a set is the same in every run, and whose end is not left to the garbage collector.

asyncio keeps tasks in sets (a failing `TaskGroup` cancels its children in set order, `asyncio.wait`
returns sets), and a set is ordered by hash, which for a task is its address in memory.

It also keeps weak references only. A task that waits for what nobody else knows of is garbage, and ends when
that is collected: at no time that a scenario could tell.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from itertools import count
from typing import Any

LEAST_KEPT = 64


class NumberedTask(asyncio.Task[Any]):
    """A task that hashes by a number instead of its address, so that sets of tasks are reproducible."""

    def __init__(self, number: int, coro: Coroutine[Any, Any, Any], **options: Any) -> None:
        self._number = number
        options.setdefault("name", f"Task-{number}")  # asyncio's counter is shared by the whole process
        super().__init__(coro, **options)

    def __hash__(self) -> int:
        return self._number


class _Kept:
    """Coroutines that have not ended.

    What a coroutine waits for knows the task that it is to wake, which is kept thereby. Not the task itself
    is held: that an exception was never asked for is told when the task goes, which is to be as it ends.
    """

    def __init__(self) -> None:
        self._coroutines: list[Any] = []
        self._room = LEAST_KEPT

    def add(self, coro: Any) -> None:
        if len(self._coroutines) >= self._room:
            self._coroutines = [each for each in self._coroutines if getattr(each, "cr_frame", None)]
            self._room = max(LEAST_KEPT, 2 * len(self._coroutines))
        self._coroutines.append(coro)


def numbered_tasks() -> Callable[..., NumberedTask]:
    """Make a task factory (for `loop.set_task_factory`) that numbers its tasks from 0, and keeps them."""
    numbers, kept = count(), _Kept()

    def make(loop: asyncio.AbstractEventLoop, coro: Coroutine[Any, Any, Any], **options: Any) -> NumberedTask:
        kept.add(coro)
        return NumberedTask(next(numbers), coro, loop=loop, **options)

    return make
