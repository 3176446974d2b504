"""The Zenoh fleet alone: real robot processes that do nothing, no engine, no recording."""

from __future__ import annotations

from collections.abc import Sequence

from channels.messages import Hello, RadioPlan, RawGrant, encode
from channels.units import to_ns
from emulator.fleet import Fleet
from tests.bench.behaviours import IDLE_PERIOD_S
from tests.bench.measure import Figures, Meter

BEHAVIOUR = "tests.bench.behaviours:idle"
WARM_UP = 10
ANSWER_TIMEOUT_S = 60.0


def measure_bare(robots: int, activations: int) -> Figures:
    """Cost per activation with all robots due at every instant, and (`turns_`) with one."""
    from emulator.fleet.zenoh import ZenohFleet  # here, as in the product: a fork before is a clean one

    fleet = ZenohFleet([BEHAVIOUR], None, ANSWER_TIMEOUT_S, echo=None)
    try:
        fleet.start([_hello(robot) for robot in range(robots)])
        grants = _Grants(robots)
        everyone = range(robots)
        for _ in range(WARM_UP):
            _exchange(fleet, grants.of(everyone))
        dense, turns = Meter(fleet.pids), Meter(fleet.pids)
        steps = max(1, activations // robots)
        dense.begin()
        for _ in range(steps):
            _exchange(fleet, grants.of(everyone))
        dense.end()
        turns.begin()
        for turn in range(activations):
            _exchange(fleet, grants.of([turn % robots]))
        turns.end()
    finally:
        fleet.close()
    return {**dense.per_activation(steps * robots), **turns.per_activation(activations, "turns_")}


class _Grants:
    """Grants that bring nothing but the next half second."""

    def __init__(self, robots: int) -> None:
        self._numbers = [0] * robots
        self._now_ns = 0

    def of(self, due: Sequence[int]) -> list[tuple[int, bytes]]:
        self._now_ns += to_ns(IDLE_PERIOD_S)
        return [(robot, self._next(robot)) for robot in due]

    def _next(self, robot: int) -> bytes:
        self._numbers[robot] += 1
        return encode(RawGrant(self._numbers[robot], self._now_ns))


def _hello(robot: int) -> Hello:
    plan = RadioPlan(max_payload_bytes=1024, overhead_bits=0, bit_rate_bps=None, queue=64)
    return Hello(f"r{robot:02d}", BEHAVIOUR, {}, robot, 0, (0.0, 0.0, 0.0), plan, 1)


def _exchange(fleet: Fleet, grants: list[tuple[int, bytes]]) -> None:
    for _ in fleet.exchange(grants, _nothing):
        pass


def _nothing() -> None:
    return
