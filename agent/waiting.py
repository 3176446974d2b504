"""What coroutines wait for: items in a mailbox (radio, camera), and instants of the own clock."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Generic, TypeVar

from channels.units import to_s

Item = TypeVar("Item")


class Mailbox(Generic[Item]):
    """Arrived items, oldest first, and the coroutines that wait for one.

    Unlike asyncio.Queue it tells whether anybody is waiting, which decides whether the emulator
    must wake the robot when something arrives (lazy delivery).
    """

    __slots__ = ("_items", "_waiters")

    def __init__(self) -> None:
        self._items: deque[Item] = deque()
        self._waiters: deque[asyncio.Future[None]] = deque()

    @property
    def awaited(self) -> bool:
        """True while a coroutine waits here."""
        return bool(self._waiters)

    def deliver(self, items: list[Item]) -> None:
        """Add items and wake as many waiting coroutines."""
        self._items.extend(items)
        for _ in items:
            self._wake_one()

    async def take(self) -> Item:
        """The oldest item, waiting for one if there is none. Safe to cancel: nothing is lost."""
        while not self._items:
            waiter: asyncio.Future[None] = asyncio.get_running_loop().create_future()
            self._waiters.append(waiter)
            try:
                await waiter
            except asyncio.CancelledError:
                if waiter in self._waiters:
                    self._waiters.remove(waiter)
                elif self._items:
                    self._wake_one()
                raise
        return self._items.popleft()

    def take_all(self) -> list[Item]:
        """Everything that has arrived, oldest first; never waits."""
        items = list(self._items)
        self._items.clear()
        return items

    def _wake_one(self) -> None:
        while self._waiters:
            waiter = self._waiters.popleft()
            if not waiter.done():
                waiter.set_result(None)
                return


async def sleep_until(when_ns: int) -> None:
    """Sleep until an instant of the own clock; the deadline is exact, not a duration from now."""
    loop = asyncio.get_running_loop()
    reached = loop.create_future()
    timer = loop.call_at(to_s(when_ns), _arrive, reached)
    try:
        await reached
    finally:
        timer.cancel()


def _arrive(future: asyncio.Future[None]) -> None:
    if not future.done():
        future.set_result(None)
