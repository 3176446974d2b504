"""Radio traffic played through `Airwaves` and `Medium` without engine or robots, one nanosecond a byte."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from heapq import heappop, heappush
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from channels.medium import Medium, Reason
from channels.settings import RadioSettings
from emulator.airwaves import Airwaves

BYTE_A_NANOSECOND = 8e9
"""Bit rate at which a payload of n bytes, without overhead, is on the air for n ns."""


class Send(NamedTuple):
    """A robot hands over a message."""

    at_ns: int
    sender: int
    airtime_ns: int
    refused: bool = False


class Heard(NamedTuple):
    """The fate of one message."""

    ended_ns: int
    reasons: list[str]
    """One per robot."""


def medium_of(robots: int, **settings: Any) -> Medium:
    """A medium with collisions at that bit rate, and a range of 5 m."""
    more = {
        name: settings.pop(name)
        for name in ("slots", "altitudes_m", "graph", "obstacles")
        if name in settings
    }
    defaults = {"range_m": 5.0, "bit_rate_bps": BYTE_A_NANOSECOND, "collisions": True}
    radio = RadioSettings(**{**defaults, **settings})
    return Medium(radio, [f"r{index}" for index in range(robots)], 1, **more)


def play(
    medium: Medium,
    sends: Sequence[Send],
    positions: Callable[[int], NDArray[np.float64]],
    places: Callable[[int], NDArray[np.int64] | None] = lambda _now: None,
) -> dict[tuple[int, int], Heard]:
    """What becomes of every (sender, sequence number); within one instant in the order of the engine."""
    robots = len(medium.slots)
    airwaves = Airwaves(medium, [f"r{index}" for index in range(robots)], 0)
    handed: dict[int, list[Send]] = {}
    for send in sends:
        handed.setdefault(send.at_ns, []).append(send)
    events = [(at_ns, 0) for at_ns in sorted(handed)]
    heard: dict[tuple[int, int], Heard] = {}

    def schedule(at_ns: int, ticket: int) -> None:
        heappush(events, (at_ns, ticket))

    def decide(now_ns: int) -> None:
        batch = airwaves.take_batch()
        if batch is None:
            return
        fates = airwaves.decide(now_ns, batch, positions(now_ns), places(now_ns))
        for sender, seq, row in zip(batch.senders, batch.seqs, fates.reason.tolist(), strict=True):
            heard[sender, seq] = Heard(now_ns, [Reason(code).name for code in row])

    while events:
        now_ns = events[0][0]
        tickets: list[int] = []
        while events and events[0][0] == now_ns:
            tickets.append(heappop(events)[1])
        for ticket in filter(None, tickets):
            airwaves.proceed(now_ns, ticket, schedule)
        decide(now_ns)
        for send in sorted(handed.get(now_ns, []), key=lambda send: send.sender):
            airwaves.submit(send.sender, now_ns, bytes(send.airtime_ns), send.refused, now_ns, schedule)
        decide(now_ns)
    return heard
