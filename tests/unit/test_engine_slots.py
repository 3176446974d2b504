"""Slots as robots see them, in whole runs: robot a owns the first slot of a frame and b the second.

A slot is 100 ms long with a guard of 20 ms, so a message may begin 10 ms into it and end 90 ms into it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from channels.clocks import LocalClock
from channels.settings import TdmaSettings
from channels.tdma import Schedule, slot_order
from emulator.run import Outcome
from logs.reader import LogReader
from tests.support import run_scenario, write_scenario
from tests.unit.test_engine import TOML, radio_ends, run_code

MS = 1_000_000
S = 1_000_000_000
FRAME = 200 * MS
TDMA = 'access = "tdma"\nbit_rate_bps = 1000\ntdma = {{ slot_s = 0.1, guard_s = {guard}{more} }}\nmax_payload_bytes = 10'


def tdma(more: str = "", guard: float = 0.02) -> str:
    return TDMA.format(guard=guard, more=more)


FULL = """
async def main(robot):
    async for slot in robot.radio.slots():
        if robot.id == "a":
            robot.radio.broadcast_bytes(bytes(slot.bytes))
        robot.log("slot", {"v": [slot.frame, slot.start_ns, slot.bytes, robot.now_ns]})
"""
"""Robot a fills its slots to the last bit."""


def radio_records(outcome: Outcome) -> list[tuple[int, dict[str, Any]]]:
    with LogReader(outcome.log) as log:
        return list(log.records("/radio"))


def test_own_slots_each_as_it_begins(tmp_path: Path) -> None:
    outcome, entries = run_code(tmp_path, FULL, radio=tdma(), duration=0.55)
    assert entries == [
        (10, "a", [0, 10 * MS, 10, 10 * MS]),
        (110, "b", [0, 110 * MS, 10, 110 * MS]),
        (210, "a", [1, 210 * MS, 10, 210 * MS]),
        (310, "b", [1, 310 * MS, 10, 310 * MS]),
        (410, "a", [2, 410 * MS, 10, 410 * MS]),
        (510, "b", [2, 510 * MS, 10, 510 * MS]),
    ]
    assert radio_ends(outcome) == [(90.0, "a"), (290.0, "a"), (490.0, "a")]
    assert [record["slot"] for _, record in radio_records(outcome)] == [0, 0, 0]
    assert outcome.progress.dropped == {}
    assert outcome.progress.activations == 2 + 6  # a robot that awaits its slot sleeps until it begins


def test_slept_through_slots_are_skipped(tmp_path: Path) -> None:
    _, entries = run_code(
        tmp_path,
        """
async def main(robot):
    if robot.id == "b":
        return
    async for slot in robot.radio.slots():
        robot.log("slot", {"v": [slot.frame, robot.now_ns // 1_000_000]})
        await asyncio.sleep({1: 0.4, 3: 0.401, 5: 0.08}.get(slot.frame, 0.0))
""",
        radio=tdma(),
    )
    # frame 1 begins at 210; 400 ms later is the very beginning of a slot, a millisecond more is too late
    assert [value for _, _, value in entries] == [
        [0, 10], [1, 210], [3, 610], [6, 1210], [7, 1410], [8, 1610], [9, 1810]
    ]  # fmt: skip


def test_two_that_iterate_see_the_same_slots(tmp_path: Path) -> None:
    _, entries = run_code(
        tmp_path,
        """
async def watch(robot, name):
    async for slot in robot.radio.slots():
        robot.log(name, {"v": [name, slot.frame]})

async def main(robot):
    if robot.id == "a":
        await asyncio.gather(watch(robot, "x"), watch(robot, "y"))
""",
        radio=tdma(),
        duration=0.3,
    )
    assert sorted((at, value) for at, _, value in entries) == [
        (10, ["x", 0]),
        (10, ["y", 0]),
        (210, ["x", 1]),
        (210, ["y", 1]),
    ]


def test_slots_begun_late_and_given_up(tmp_path: Path) -> None:
    """Asked for in the midst of a slot it is the next; one that a timeout has ended is not lost."""
    _, entries = run_code(
        tmp_path,
        """
async def main(robot):
    if robot.id == "b":
        return
    await asyncio.sleep(0.05)
    slots = robot.radio.slots()
    try:
        async with asyncio.timeout(0.1):
            await anext(slots)
    except TimeoutError:
        robot.log("timeout", {"v": robot.now_ns // 1_000_000})
    robot.log("slot", {"v": (await anext(robot.radio.slots())).frame})
""",
        radio=tdma(),
    )
    assert entries == [(150, "a", 150), (210, "a", 1)]


def test_slots_without_tdma(tmp_path: Path) -> None:
    _, entries = run_code(
        tmp_path,
        """
async def main(robot):
    try:
        robot.radio.slots()
    except ValueError as error:
        robot.log("error", {"v": str(error)})
""",
    )
    assert [value for _, _, value in entries] == [
        'radio.access: must be "tdma", for this behaviour speaks in slots'
    ] * 2


@pytest.mark.parametrize("seed", [1, 2])
def test_an_order_drawn_once_for_the_run_is_the_same_in_every_frame(seed: int, tmp_path: Path) -> None:
    speakers, _ = speak_each_slot(tmp_path, "drawn", seed)
    first = ["ab", "ba"].index("".join(speakers[:2]))
    assert speakers == speakers[:2] * 10
    assert first == slot_order(TdmaSettings(slot_s=0.1, order="drawn"), ["a", "b"], seed)[0]


def test_an_order_drawn_for_each_frame_is_the_same_at_the_robot_and_at_the_broker(tmp_path: Path) -> None:
    speakers, outcome = speak_each_slot(tmp_path, "drawn_each_frame", 1)
    frames = [speakers[index : index + 2] for index in range(0, 20, 2)]
    assert all(sorted(frame) == ["a", "b"] for frame in frames)
    assert len({tuple(frame) for frame in frames}) == 2
    assert outcome.progress.dropped == {}
    for end_ns, record in radio_records(outcome):
        start_ns = end_ns - record["airtime_ns"]
        assert start_ns % FRAME == record["slot"] * 100 * MS + 10 * MS


def test_a_message_that_ends_with_the_frame_has_the_slot_in_which_it_began(tmp_path: Path) -> None:
    code = """
async def main(robot):
    async for slot in robot.radio.slots():
        robot.radio.broadcast_bytes(bytes(10))
"""
    # 80 bits at 800 bit/s fill a slot of 100 ms that has no guard.
    radio = tdma(', order = "drawn_each_frame"', guard=0).replace("1000", "800")
    outcome, _ = run_code(tmp_path, code, radio=radio, duration=2.1)
    records = radio_records(outcome)
    assert len(records) >= 20
    for end_ns, record in records:
        assert (end_ns - 100 * MS) % FRAME == record["slot"] * 100 * MS


def speak_each_slot(folder: Path, order: str, seed: int) -> tuple[list[str], Outcome]:
    """Who spoke in ten frames, slot by slot."""
    code = """
async def main(robot):
    async for slot in robot.radio.slots():
        robot.radio.broadcast_bytes(bytes(slot.bytes))
"""
    toml = TOML.format(radio=tdma(f', order = "{order}"'), more="", duration=2.0)
    outcome = run_scenario(write_scenario(folder, code, toml), folder / "log.mcap", "in_process", seed=seed)
    return [sender for _, sender in radio_ends(outcome)], outcome


# --- clocks ------------------------------------------------------------------------------------------


def with_clock(monkeypatch: pytest.MonkeyPatch, *clocks: LocalClock) -> str:
    """Give the robots these clocks; returns what the scenario must say for there to be clocks at all."""
    monkeypatch.setattr("emulator.assemble.draw_clocks", lambda *_: list(clocks))
    return "[clock]\noffset_s = 1.0"


@pytest.mark.parametrize(
    ("ahead_ns", "fate"),
    [
        (10 * MS, "delivered"),  # half of the guard
        (10 * MS + 1, "out_of_slot"),
        (FRAME - 10 * MS, "delivered"),  # a whole frame off is not off: 10 ms behind
        (FRAME - 10 * MS - 1, "out_of_slot"),
    ],
)
@pytest.mark.parametrize("handed_over", ["as the slot begins", "before"])
def test_a_clock_may_be_off_by_half_the_guard_either_way(
    handed_over: str, ahead_ns: int, fate: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    more = with_clock(monkeypatch, LocalClock(ahead_ns), LocalClock())
    code = WAITING if handed_over == "before" else FULL
    outcome, _ = run_code(tmp_path, code, radio=tdma(), more=more, duration=1.0)
    records = radio_records(outcome)
    assert len(records) >= 4
    for end_ns, record in records:
        # By a's own clock it is always the same instant of the frame.
        assert (end_ns + ahead_ns) % FRAME == 90 * MS
        assert record["airtime_ns"] == 80 * MS
        assert record["delivered"] == (["b"] if fate == "delivered" else [])
        assert record["dropped"] == ({} if fate == "delivered" else {"out_of_slot": ["b"]})


WAITING = """
async def main(robot):
    await asyncio.sleep(0.15)
    while robot.id == "a":
        robot.radio.broadcast_bytes(bytes(10))
        await asyncio.sleep(0.2)
    await asyncio.sleep(10)
"""


def test_a_message_half_as_long_as_the_slot_may_be_late_by_the_rest_as_well(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The medium asks that nobody leaves its slot, and no more."""
    code = FULL.replace("bytes(slot.bytes)", "bytes(5)")
    for late_ms, delivered in ((50, True), (51, False)):
        folder = tmp_path / str(late_ms)
        folder.mkdir()
        more = with_clock(monkeypatch, LocalClock(FRAME - late_ms * MS), LocalClock())
        outcome, _ = run_code(folder, code, radio=tdma(), more=more, duration=1.0)
        assert outcome.progress.dropped == ({} if delivered else {"out_of_slot": outcome.progress.sent})
        assert outcome.progress.sent >= 4


@pytest.mark.parametrize(
    ("drift_ppb", "order"),
    [(10**8, "fixed"), (-(10**8), "drawn_each_frame"), (123_457, "drawn_each_frame"), (-123_457, "fixed")],
)
def test_a_packet_made_as_the_slot_begins_goes_out_in_it_whatever_the_drift(
    drift_ppb: int, order: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = LocalClock(0, drift_ppb)
    outcome, entries = run_code(
        tmp_path,
        FULL,
        radio=tdma(f', order = "{order}"'),
        more=with_clock(monkeypatch, clock, LocalClock()),
        duration=8.0,
    )
    slots = [value for _, robot, value in entries if robot == "a"]
    assert [slot[0] for slot in slots] == list(range(len(slots)))
    assert len(slots) >= 35
    records = radio_records(outcome)
    assert len(records) >= len(slots) - 1  # one may be on the air at the end
    for (_, start_ns, _, now_ns), (end_ns, _) in zip(slots, records, strict=False):
        assert start_ns <= now_ns <= start_ns + 1
        assert end_ns - 80 * MS == clock.true(now_ns)


def test_a_clock_that_skips_the_very_nanosecond_of_the_beginning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At a tenth fast, one reading in eleven never comes."""
    start_ns = 10 * MS
    clock = next(
        clock
        for offset_ns in range(11)
        if (clock := LocalClock(offset_ns, 10**8)).local(clock.true(start_ns)) == start_ns + 1
    )
    more = with_clock(monkeypatch, clock, LocalClock())
    outcome, entries = run_code(tmp_path, FULL, radio=tdma(), more=more, duration=0.15)
    assert [value for _, robot, value in entries if robot == "a"] == [[0, start_ns, 10, start_ns + 1]]
    ((end_ns, record),) = radio_records(outcome)
    assert end_ns == clock.true(start_ns) + 80 * MS
    assert record["delivered"] == ["b"]


def test_slots_and_frames_go_by_the_own_clock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two frames ahead, a robot counts two more, and speaks in the orders of later frames: too early."""
    schedule = Schedule(100 * MS, 20 * MS, 2, 99)
    assert {schedule.place(0, frame) == schedule.place(0, frame + 2) for frame in range(10)} == {True, False}
    more = with_clock(monkeypatch, LocalClock(2 * FRAME), LocalClock())
    radio = tdma(', order = "drawn_each_frame"')
    outcome, entries = run_code(tmp_path, FULL, radio=radio, more=more, duration=4.0)
    frames = [value[0] for _, robot, value in entries if robot == "a"]
    assert frames == list(range(2, 22))
    dropped = outcome.progress.dropped["out_of_slot"]
    assert 0 < dropped < 20
    assert outcome.progress.delivered == 20 - dropped


# --- collisions, sharing, altitude, bursts --------------------------------------------------------------


def test_two_that_speak_at_once_hear_nothing(tmp_path: Path) -> None:
    code = """
async def main(robot):
    robot.radio.broadcast_bytes(bytes(10))
    await asyncio.sleep(0.08 if robot.id == "a" else 0.2)
    robot.radio.broadcast_bytes(bytes(10))
    await asyncio.sleep(10)
"""
    outcome, _ = run_code(tmp_path, code, radio="bit_rate_bps = 1000\ncollisions = true")
    fates = [(end_ns // MS, record["from"], record["dropped"]) for end_ns, record in radio_records(outcome)]
    assert fates == [
        (80, "a", {"half_duplex": ["b"]}),
        (80, "b", {"half_duplex": ["a"]}),
        (160, "a", {}),  # begins as they end
        (280, "b", {}),
    ]
    assert (outcome.progress.delivered, outcome.progress.dropped) == (2, {"half_duplex": 2})


GRID = """
behaviour = "my_robot.py:main"
robots = 16
seed = 3
[run]
duration_s = 2.0
[world]
area_m = [16.0, 16.0]
placement = "grid"
[radio]
range_m = 4.1
access = "tdma"
bit_rate_bps = 10000
collisions = true
tdma = {{ units = 1, unit_bits = 80, guard_s = 0.004, reuse = "{reuse}" }}
"""


@pytest.mark.parametrize(
    ("reuse", "slots", "collides"),
    [("none", {16}, False), ("distance_two", {5, 6, 7}, False), ("distance_one", {2}, True)],
)
def test_sharing_slots_gives_more_frames(reuse: str, slots: set[int], collides: bool, tmp_path: Path) -> None:
    code = """
async def main(robot):
    async for slot in robot.radio.slots():
        robot.radio.broadcast_bytes(bytes(slot.bytes))
        robot.log("slot", {"frame": slot.frame, "bytes": slot.bytes})
"""
    scenario = write_scenario(tmp_path, code, GRID.format(reuse=reuse))
    outcome = run_scenario(scenario, tmp_path / "log.mcap", "in_process")
    number = 1 + max(record["slot"] for _, record in radio_records(outcome))
    assert number in slots
    # 24 neighbouring pairs on the grid; 12 ms a slot, 2 s in all
    dropped = outcome.progress.dropped
    assert set(dropped) == {"out_of_range"} | ({"collision"} if collides else set())
    if not collides:
        assert outcome.progress.delivered * 16 == pytest.approx(outcome.progress.sent * 48, rel=0.02)
    with LogReader(outcome.log) as log:
        entries = [record["data"] for _, record in log.records("/robot")]
    assert {entry["bytes"] for entry in entries} == {10}
    frames = 1 + max(entry["frame"] for entry in entries)
    assert frames == -(-2000 // (12 * number))


def test_altitude_is_known_to_the_robot_reckoned_with_and_recorded(tmp_path: Path) -> None:
    code = """
async def main(robot):
    robot.log("altitude", {"v": [robot.number, robot.team_size, robot.body.altitude_m]})
    robot.radio.broadcast("x")
    await asyncio.sleep(1)
"""
    for altitude_m, delivered in ((3.0, 2), (3.01, 0)):
        folder = tmp_path / str(altitude_m)
        folder.mkdir()
        toml = TOML.format(radio="", more="", duration=2.0).replace("range_m = 20.0", "range_m = 5.0")
        toml = toml.replace('id = "b"', f'id = "b"\naltitude_m = {altitude_m}')
        scenario = write_scenario(folder, "import asyncio\n" + code, toml)
        outcome = run_scenario(scenario, folder / "log.mcap", "in_process")
        assert outcome.progress.delivered == delivered
        with LogReader(outcome.log) as log:
            known = [record["data"]["v"] for _, record in log.records("/robot")]
            start = next(record for _, record in log.records("/truth") if record["kind"] == "start")
        assert known == [[0, 2, 0.0], [1, 2, altitude_m]]
        assert [robot.get("altitude_m") for robot in start["robots"]] == [None, altitude_m]


def test_bursts_are_named_in_the_log(tmp_path: Path) -> None:
    code = """
async def main(robot):
    while True:
        robot.radio.broadcast("x")
        await asyncio.sleep(0.01)
"""
    radio = "bursts = { enter = 0.1, leave = 0.3 }\nloss = 0.1"
    outcome, _ = run_code(tmp_path, code, radio=radio, duration=4.0)
    assert set(outcome.progress.dropped) == {"burst", "loss"}
    lost = {
        sender: [
            sorted(record["dropped"]) for _, record in radio_records(outcome) if record["from"] == sender
        ]
        for sender in "ab"
    }
    assert lost["a"] != lost["b"]
    assert outcome.progress.dropped["burst"] == sum(fates.count(["burst"]) for fates in lost.values())
