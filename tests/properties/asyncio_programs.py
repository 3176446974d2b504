"""Made-up asyncio programs: data that hypothesis draws, played by coroutines on any event loop.

A program is a list of tasks, a task a list of operations, an operation a tuple: its name, its arguments.
Delays are counted in ticks, whose length the player is told, so that the same program can be played in
virtual time and, faster, in real time. Whatever happens is noted with the loop's time.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Sequence
from typing import Any

from hypothesis import strategies as st

Op = tuple[Any, ...]
Program = tuple[tuple[Op, ...], ...]
Note = Callable[[str], None]

MAX_TASKS = 4


def programs(ticks: st.SearchStrategy[int]) -> st.SearchStrategy[Program]:
    """Programs of up to four tasks whose delays are drawn from `ticks`."""
    small = st.integers(0, 1)
    timed = st.tuples(st.sampled_from(["sleep", "later", "at", "hold"]), ticks)
    simple: st.SearchStrategy[Op] = (
        timed
        | st.tuples(st.sampled_from(["put", "get", "set", "clear", "wait"]), small)
        | st.tuples(st.sampled_from(["soon", "drop", "notify", "await_notify", "fail", "generate", "sleep0"]))
        | st.tuples(st.just("cancel"), st.integers(0, MAX_TASKS - 1))
    )
    ops = _sequence(simple, 4)
    for _ in range(2):
        block = st.tuples(st.sampled_from(["timeout", "wait_for"]), ticks, ops)
        children = st.lists(ops, min_size=1, max_size=3)
        fork = st.tuples(st.sampled_from(["group", "gather", "wait_all"]), children)
        ops = _sequence(timed | simple | block | fork, 5)
    return st.lists(ops, min_size=1, max_size=MAX_TASKS).map(lambda tasks: tuple(tasks))


def _sequence(op: st.SearchStrategy[Op], most: int) -> st.SearchStrategy[tuple[Op, ...]]:
    return st.lists(op, min_size=1, max_size=most).map(lambda ops: tuple(ops))


def bursts() -> st.SearchStrategy[Op]:
    """Many timers with many ties, of which some are cancelled: beyond 100 asyncio rebuilds its heap."""
    return st.tuples(st.just("burst"), st.integers(2, 160), st.integers(1, 6), st.integers(1, 4))


class Player:
    """Plays one program; `note` is told everything that happens."""

    def __init__(self, program: Program, tick_s: float, note: Note) -> None:
        self._program = program
        self._tick_s = tick_s
        self._note = note
        self._queues: list[asyncio.Queue[str]] = [asyncio.Queue(), asyncio.Queue(maxsize=1)]
        self._events = [asyncio.Event(), asyncio.Event()]
        self._lock = asyncio.Lock()
        self._condition = asyncio.Condition()
        self._handles: list[asyncio.Handle] = []
        self._tasks: list[asyncio.Task[None]] = []

    async def play(self) -> None:
        """Run all tasks of the program until each has ended."""
        self._tasks = [
            asyncio.create_task(self._root(str(number), ops)) for number, ops in enumerate(self._program)
        ]
        await asyncio.wait(self._tasks)
        self._note("end")

    async def _root(self, path: str, ops: Sequence[Op]) -> None:
        try:
            await self._all(path, ops)
        except ValueError:
            self._note(f"{path} failed")

    async def _all(self, path: str, ops: Sequence[Op]) -> str:
        for number, op in enumerate(ops):
            here = f"{path}.{number}:{op[0]}"
            self._note(here)
            try:
                outcome = await getattr(self, f"_do_{op[0]}")(here, *op[1:])
            except BaseException as error:
                self._note(f"{here} {type(error).__name__}")
                raise
            self._note(f"{here} -> {outcome}")
        return path

    async def _do_sleep(self, _path: str, ticks: int) -> None:
        await asyncio.sleep(ticks * self._tick_s)

    async def _do_sleep0(self, _path: str) -> None:
        await asyncio.sleep(0)

    async def _do_later(self, path: str, ticks: int) -> None:
        loop = asyncio.get_running_loop()
        self._handles.append(loop.call_later(ticks * self._tick_s, self._note, f"{path} called"))

    async def _do_at(self, path: str, ticks: int) -> None:
        loop = asyncio.get_running_loop()
        when_s = loop.time() + (ticks - 1) * self._tick_s
        self._handles.append(loop.call_at(when_s, self._note, f"{path} called"))

    async def _do_soon(self, path: str) -> None:
        self._handles.append(asyncio.get_running_loop().call_soon(self._note, f"{path} called"))

    async def _do_drop(self, _path: str) -> None:
        if self._handles:
            self._handles.pop().cancel()

    async def _do_burst(self, path: str, count: int, spread: int, keep_one_in: int) -> None:
        loop = asyncio.get_running_loop()
        for number in range(count):
            delay_s = number * 5 % (spread + 1) * self._tick_s
            handle = loop.call_later(delay_s, self._note, f"{path} called {number}")
            if number % keep_one_in:
                handle.cancel()

    async def _do_put(self, path: str, queue: int) -> None:
        await self._queues[queue].put(path)

    async def _do_get(self, _path: str, queue: int) -> str:
        return await self._queues[queue].get()

    async def _do_set(self, _path: str, event: int) -> None:
        self._events[event].set()

    async def _do_clear(self, _path: str, event: int) -> None:
        self._events[event].clear()

    async def _do_wait(self, _path: str, event: int) -> None:
        await self._events[event].wait()

    async def _do_hold(self, path: str, ticks: int) -> None:
        async with self._lock:
            self._note(f"{path} held")
            await asyncio.sleep(ticks * self._tick_s)

    async def _do_notify(self, _path: str) -> None:
        async with self._condition:
            self._condition.notify()

    async def _do_await_notify(self, _path: str) -> None:
        async with self._condition:
            await self._condition.wait()

    async def _do_fail(self, path: str) -> None:
        raise ValueError(path)

    async def _do_cancel(self, _path: str, task: int) -> bool:
        return self._tasks[task].cancel() if task < len(self._tasks) else False

    async def _do_generate(self, path: str) -> None:
        async def numbers() -> AsyncIterator[int]:
            try:
                for number in range(3):
                    yield number
                    await asyncio.sleep(0)
            finally:
                self._note(f"{path} closed")

        async for number in numbers():
            if number == 1:
                break

    async def _do_timeout(self, path: str, ticks: int, ops: Sequence[Op]) -> str:
        try:
            async with asyncio.timeout(ticks * self._tick_s):
                return await self._all(path, ops)
        except TimeoutError:
            return "timed out"

    async def _do_wait_for(self, path: str, ticks: int, ops: Sequence[Op]) -> str:
        try:
            return await asyncio.wait_for(self._all(path, ops), ticks * self._tick_s)
        except TimeoutError:
            return "timed out"

    async def _do_group(self, path: str, children: Sequence[Sequence[Op]]) -> str:
        outcome = "all well"
        try:
            async with asyncio.TaskGroup() as group:
                for number, ops in enumerate(children):
                    group.create_task(self._all(f"{path}/{number}", ops))
        except* ValueError as errors:
            outcome = str(errors.exceptions)
        return outcome

    async def _do_gather(self, path: str, children: Sequence[Sequence[Op]]) -> list[str]:
        coros = [self._all(f"{path}/{number}", ops) for number, ops in enumerate(children)]
        return [repr(result) for result in await asyncio.gather(*coros, return_exceptions=True)]

    async def _do_wait_all(self, path: str, children: Sequence[Sequence[Op]]) -> list[str]:
        tasks = [
            asyncio.create_task(self._all(f"{path}/{number}", ops), name=f"{path}/{number}")
            for number, ops in enumerate(children)
        ]
        done, pending = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in pending:
            task.cancel()
        return [task.get_name() for task in done] + [task.get_name() for task in pending]
