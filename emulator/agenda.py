"""The event queue: what happens when, in virtual time."""

from __future__ import annotations

from enum import IntEnum
from heapq import heappop, heappush


class Event(IntEnum):
    """Kinds of events, in the order they are handled within one instant."""

    TRANSMISSION = 0
    EXPOSURE = 1
    SCENE = 2
    WAKE = 3


class Agenda:
    """A heap of (instant [ns], kind, which), in which a robot's wake-up can be moved forward.

    Moving leaves the old entry behind; it is recognised as void when its time comes.
    """

    def __init__(self, robots: int) -> None:
        self._heap: list[tuple[int, int, int]] = []
        self._due: list[int | None] = [None] * robots

    def next_instant(self) -> int | None:
        """The earliest instant at which anything may happen; None: never."""
        return self._heap[0][0] if self._heap else None

    def add(self, at_ns: int, kind: Event, which: int = 0) -> None:
        """Have an event happen. For robots use `wake`."""
        heappush(self._heap, (at_ns, kind, which))

    def wake(self, robot: int, at_ns: int) -> None:
        """Make a robot due at `at_ns`, unless it is due earlier anyway."""
        due = self._due[robot]
        if due is None or at_ns < due:
            self._due[robot] = at_ns
            heappush(self._heap, (at_ns, Event.WAKE, robot))

    def forget(self, robot: int) -> None:
        """Have a robot never be due again."""
        self._due[robot] = None

    def take(self, now_ns: int) -> tuple[list[int], bool, bool, list[int]]:
        """What happens now: tickets of transmissions, whether cameras expose, whether a scene is due, robots.

        Tickets are in the order they were given, robots in robot order.
        """
        heap = self._heap
        tickets: list[int] = []
        robots: list[int] = []
        exposing = scene = False
        while heap and heap[0][0] == now_ns:
            _, kind, which = heappop(heap)
            if kind == _WAKE:
                if self._due[which] == now_ns:
                    self._due[which] = None
                    robots.append(which)
            elif kind == _TRANSMISSION:
                tickets.append(which)
            elif kind == _EXPOSURE:
                exposing = True
            else:
                scene = True
        return tickets, exposing, scene, robots


# Plain numbers: looking a member up in its enumeration costs more than comparing it.
_TRANSMISSION, _EXPOSURE, _WAKE = int(Event.TRANSMISSION), int(Event.EXPOSURE), int(Event.WAKE)
