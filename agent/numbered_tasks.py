"""Tasks whose order in a set is the same in every run.

asyncio keeps tasks in sets (a failing `TaskGroup` cancels its children in set order, `asyncio.wait`
returns sets), and a set is ordered by hash, which for a task is its address in memory.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from itertools import count
from typing import Any


class NumberedTask(asyncio.Task[Any]):
    """A task that hashes by a number instead of its address, so that sets of tasks are reproducible."""

    def __init__(self, number: int, coro: Coroutine[Any, Any, Any], **options: Any) -> None:
        self._number = number
        options.setdefault("name", f"Task-{number}")  # asyncio's counter is shared by the whole process
        super().__init__(coro, **options)

    def __hash__(self) -> int:
        return self._number


def numbered_tasks() -> Callable[..., NumberedTask]:
    """Make a task factory (for `loop.set_task_factory`) that numbers its tasks 0, 1, 2, ..."""
    numbers = count()

    def make(loop: asyncio.AbstractEventLoop, coro: Coroutine[Any, Any, Any], **options: Any) -> NumberedTask:
        return NumberedTask(next(numbers), coro, loop=loop, **options)

    return make
