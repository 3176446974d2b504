"""The broker is the only way through: what a robot with valid credentials may not do."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from agent.link.session import channel, robot_config
from channels.keys import from_all_robots, to_broker, to_robot
from channels.messages import Hello, RadioPlan, RawGrant, Report, encode
from emulator.fleet import RobotFailure
from emulator.fleet.zenoh import MAX_REFUSED, ZenohFleet

pytestmark = pytest.mark.processes

ROBOTS = ("r00", "r01")


def nothing() -> None:
    pass


@pytest.fixture
def fleet(tmp_path: Path) -> Iterator[ZenohFleet]:
    (tmp_path / "idle.py").write_text(
        "import asyncio\nasync def main(robot):\n    await asyncio.sleep(1e5)\n"
    )
    fleet = ZenohFleet(["idle.py:main"], tmp_path, answer_timeout_s=2.0, echo=None)
    plan = RadioPlan(100, 0, None, 10)
    fleet.start([Hello(robot, "idle.py:main", {}, 1, 0, (0.0, 0.0, 0.0), plan, 1) for robot in ROBOTS])
    yield fleet
    fleet.close()


@pytest.fixture
def intruder(fleet: ZenohFleet) -> Iterator[zenoh.Session]:
    """A second session with the credentials of r00, as a robot that breaks the rules might open."""
    with zenoh.open(robot_config(fleet.endpoint, "r00", fleet.passwords["r00"])) as session:
        yield session


def exchange(fleet: ZenohFleet, number: int, robots: tuple[int, ...] = (0, 1)) -> list[Report]:
    return list(fleet.exchange([(robot, encode(RawGrant(number, number))) for robot in robots], nothing))


def test_a_robot_hears_nothing_that_is_for_others(fleet: ZenohFleet, intruder: zenoh.Session) -> None:
    keys = [to_robot(fleet.run, "r01"), to_broker(fleet.run, "r01"), from_all_robots(fleet.run), "**"]
    spies = [intruder.declare_subscriber(key, channel()) for key in keys]
    for number in range(1, 30):
        exchange(fleet, number)
    # its own grants are all it may receive, whatever it subscribed to
    heard = set()
    for spy in spies:
        while (sample := spy.try_recv()) is not None:
            heard.add(str(sample.key_expr))
    assert heard <= {to_robot(fleet.run, "r00")}


def test_a_robot_cannot_speak_for_another_or_to_another(fleet: ZenohFleet, intruder: zenoh.Session) -> None:
    forged = encode(Report(1, None, ended="forged"))
    for key in (to_broker(fleet.run, "r01"), to_robot(fleet.run, "r01"), to_broker(fleet.run, "_supervisor")):
        intruder.put(key, forged)
    # what the intruder may send arrives, and it was sent last: the rest would have come before it
    intruder.put(to_broker(fleet.run, "r00"), b"marker")
    for number in range(1, 10_000):
        assert [report.ended for report in exchange(fleet, number)] == [None, None]
        if fleet.refused:
            break
    assert {robot for robot, _ in fleet.refused} == {0}


@pytest.mark.parametrize(
    "garbage", [b"", b"\xc1", b"\x93\x01\x02", b"\xdd\xff\xff\xff\xff", b"\x91" * 100_000, b"\x00" * 99]
)
def test_garbage_is_refused_and_counted(fleet: ZenohFleet, intruder: zenoh.Session, garbage: bytes) -> None:
    intruder.put(to_broker(fleet.run, "r00"), garbage)
    for number in range(1, 10_000):
        assert [report.ended for report in exchange(fleet, number)] == [None, None]
        if fleet.refused:
            break
    assert [robot for robot, _ in fleet.refused] == [0]


def test_a_flood_of_garbage_ends_in_a_story(fleet: ZenohFleet, intruder: zenoh.Session) -> None:
    for _ in range(2 * MAX_REFUSED):
        intruder.put(to_broker(fleet.run, "r00"), b"garbage")

    def exchange_for_ever() -> None:
        for number in range(1, 10_000):
            exchange(fleet, number)

    with pytest.raises(RobotFailure, match=f"r00 sent more than {MAX_REFUSED} messages that are no reports"):
        exchange_for_ever()


def test_a_stranger_does_not_get_in(fleet: ZenohFleet) -> None:
    config = robot_config(fleet.endpoint, "r00", "a guess")
    config.insert_json5("connect/timeout_ms", "0")
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)
    assert len(exchange(fleet, 1)) == 2


def test_only_garbage_ends_in_a_story(tmp_path: Path) -> None:
    code = """
import asyncio
async def main(robot):
    await asyncio.sleep(1.0)
    import agent.host
    agent.host.encode = lambda report: b"garbage"
"""
    (tmp_path / "rogue.py").write_text(code)
    fleet = ZenohFleet(["rogue.py:main"], tmp_path, answer_timeout_s=1.0, echo=None)
    try:
        fleet.start([Hello("r00", "rogue.py:main", {}, 1, 0, (0.0, 0.0, 0.0), RadioPlan(9, 0, None, 1), 1)])
        exchange(fleet, 1, (0,))
        with pytest.raises(RobotFailure, match="1 malformed messages were refused, the last: "):
            list(fleet.exchange([(0, encode(RawGrant(2, 2 * 10**9)))], nothing))
    finally:
        fleet.close()
