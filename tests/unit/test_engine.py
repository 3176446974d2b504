"""Exact lists of what happens when, on tiny teams anyone can follow by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from emulator.errors import RunFailed
from emulator.run import Outcome
from logs.reader import LogReader
from tests.support import run_scenario, write_scenario

MS = 1_000_000

TOML = """
behaviour = "my_robot.py:main"
robots = ["a", "b"]
[run]
duration_s = {duration}
[world]
area_m = [10.0, 10.0]
[[robot]]
id = "a"
position_m = [1.0, 5.0]
heading_rad = 0.0
[[robot]]
id = "b"
position_m = [5.0, 5.0]
heading_rad = 0.0
[radio]
range_m = 20.0
latency_s = 0.002
{radio}
{more}
"""


def run_code(
    folder: Path, code: str, *, radio: str = "", more: str = "", duration: float = 2.0
) -> tuple[Outcome, list[tuple[int, str, Any]]]:
    """Outcome, and what the robots logged: (milliseconds, robot, value of the entry's only field)."""
    toml = TOML.format(radio=radio, more=more, duration=duration)
    header = "import asyncio\nfrom agent import Robot\n\n"
    scenario = write_scenario(folder, header + code, toml)
    outcome = run_scenario(scenario, folder / "log.mcap", "in_process")
    with LogReader(outcome.log) as log:
        entries = [
            (at // MS if at % MS == 0 else at / MS, record["robot"], next(iter(record["data"].values())))
            for at, record in log.records("/robot")
        ]
    return outcome, entries


def radio_ends(outcome: Outcome) -> list[tuple[float, str]]:
    with LogReader(outcome.log) as log:
        return [(at / MS, record["from"]) for at, record in log.records("/radio")]


def test_a_waiting_robot_is_woken_at_the_instant_of_arrival(tmp_path: Path) -> None:
    outcome, entries = run_code(
        tmp_path,
        """
async def main(robot):
    if robot.id == "a":
        await asyncio.sleep(0.5)
        robot.radio.broadcast("ping")
        return
    message = await robot.radio.receive()
    robot.log("got", {"v": [message.payload, message.sender, message.received_ns, robot.now_ns]})
""",
    )
    assert entries == [(502, "b", ["ping", "a", 502 * MS, 502 * MS])]
    assert outcome.progress.activations == 4  # both at 0, a at 500, b at 502
    assert outcome.progress.ended_by == "all robots ended"
    assert outcome.progress.now_ns == 502 * MS


def test_a_robot_that_sleeps_is_not_woken_by_messages(tmp_path: Path) -> None:
    outcome, entries = run_code(
        tmp_path,
        """
async def main(robot):
    if robot.id == "a":
        for _ in range(10):
            robot.radio.broadcast("x")
            await asyncio.sleep(0.1)
    else:
        await asyncio.sleep(0.75)
        robot.log("late", {"v": [m.received_ns // 1_000_000 for m in robot.radio.received()]})
        await asyncio.sleep(10)
""",
    )
    assert entries == [(750, "b", [2, 102, 202, 302, 402, 502, 602, 702])]
    assert outcome.progress.activations == 1 + 11 + 1
    assert outcome.progress.sent == 10
    assert outcome.progress.delivered == 10
    assert outcome.progress.now_ns == 2000 * MS


def test_a_message_that_arrives_at_the_waking_instant_is_there(tmp_path: Path) -> None:
    _, entries = run_code(
        tmp_path,
        """
async def main(robot):
    if robot.id == "a":
        await asyncio.sleep(0.498)
        robot.radio.broadcast("just in time")
    else:
        await asyncio.sleep(0.5)
        robot.log("heard", {"v": [m.payload for m in robot.radio.received()]})
""",
    )
    assert entries == [(500, "b", ["just in time"])]


def test_a_timeout_beats_a_later_message(tmp_path: Path) -> None:
    _, entries = run_code(
        tmp_path,
        """
async def main(robot):
    if robot.id == "a":
        await asyncio.sleep(0.5)
        robot.radio.broadcast("too late")
        return
    try:
        async with asyncio.timeout(0.501):
            await robot.radio.receive()
    except TimeoutError:
        robot.log("timeout", {"v": robot.now_ns // 1_000_000})
    message = await robot.radio.receive()
    robot.log("then", {"v": message.payload})
""",
    )
    assert entries == [(501, "b", 501), (502, "b", "too late")]


def test_simultaneous_broadcasts_arrive_in_robot_order(tmp_path: Path) -> None:
    _, entries = run_code(
        tmp_path,
        """
async def main(robot):
    robot.radio.broadcast(robot.id + "1")
    robot.radio.broadcast(robot.id + "2")
    await asyncio.sleep(1)
    robot.log("heard", {"v": [m.payload for m in robot.radio.received()]})
""",
    )
    assert entries == [(1000, "a", ["b1", "b2"]), (1000, "b", ["a1", "a2"])]


def test_a_radio_works_through_its_queue_at_its_bit_rate(tmp_path: Path) -> None:
    # a payload of 10 characters is 11 bytes: 88 + 12 bits at 1000 bit/s are 100 ms on the air
    outcome, entries = run_code(
        tmp_path,
        """
async def main(robot):
    if robot.id == "a":
        await asyncio.sleep(0.5)
        for number in range(4):
            robot.radio.broadcast(f"number {number}..")
    else:
        async for message in robot.radio:
            robot.log("heard", {"v": message.payload})
""",
        radio="bit_rate_bps = 1000\noverhead_bits = 12\nqueue = 3",
    )
    # the fourth finds three that have not left, and is refused at once
    assert radio_ends(outcome) == [(500.0, "a"), (600.0, "a"), (700.0, "a"), (800.0, "a")]
    assert entries == [(602, "b", "number 0.."), (702, "b", "number 1.."), (802, "b", "number 2..")]
    assert outcome.progress.dropped == {"queue_full": 1}
    with LogReader(outcome.log) as log:
        times = [(record["seq"], record["airtime_ns"] // MS) for _, record in log.records("/radio")]
    assert times == [(3, 0), (0, 100), (1, 100), (2, 100)]  # and never goes on the air


def test_a_record_tells_when_a_transmission_ended_and_how_long_it_took(tmp_path: Path) -> None:
    outcome, entries = run_code(
        tmp_path,
        """
async def main(robot):
    if robot.id == "a":
        await asyncio.sleep(0.5)
        robot.radio.broadcast_bytes(b"0123456789")
    else:
        message = await robot.radio.receive()
        robot.log("heard", {"v": [message.raw.decode(), message.received_ns]})
    await asyncio.sleep(10)
""",
        radio="bit_rate_bps = 1000\noverhead_bits = 20",
    )
    with LogReader(outcome.log) as log:
        ((ended_ns, record),) = log.records("/radio")
    assert (ended_ns, record["airtime_ns"], record["bits"]) == (600 * MS, 100 * MS, 100)
    assert (record["delivered"], record["delay_ns"]) == (["b"], [2 * MS])
    assert entries == [(602, "b", ["0123456789", 602 * MS])]


def test_what_is_still_on_the_air_when_the_run_ends_reaches_nobody(tmp_path: Path) -> None:
    code = """
async def main(robot):
    await asyncio.sleep(0.5)
    if robot.id == "a":
        robot.radio.broadcast_bytes(b"0123456789")
        robot.radio.broadcast_bytes(b"0123456789")
    await asyncio.sleep(10)
"""
    for duration, sent, unsent in ((0.57, 0, 2), (0.58, 1, 1), (0.66, 2, 0)):
        folder = tmp_path / str(duration)
        folder.mkdir()
        outcome, _ = run_code(folder, code, radio="bit_rate_bps = 1000", duration=duration)
        assert (outcome.progress.sent, outcome.progress.unsent) == (sent, unsent)


def test_a_message_is_lost_to_whoever_ends_while_it_is_on_the_air(tmp_path: Path) -> None:
    outcome, _ = run_code(
        tmp_path,
        """
async def main(robot):
    if robot.id == "a":
        robot.radio.broadcast_bytes(b"0123456789")
        await asyncio.sleep(1)
    await asyncio.sleep(0.04)
""",
        radio="bit_rate_bps = 1000",
    )
    assert outcome.progress.dropped == {"receiver_down": 1}


def test_a_message_outlives_its_sender(tmp_path: Path) -> None:
    outcome, entries = run_code(
        tmp_path,
        """
async def main(robot):
    if robot.id == "a":
        robot.radio.broadcast_bytes(b"0123456789")
        return
    robot.log("heard", {"v": (await robot.radio.receive()).sender})
""",
        radio="bit_rate_bps = 1000",
    )
    assert entries == [(82, "b", "a")]
    assert outcome.progress.delivered == 1


def test_tdma_speaks_in_its_own_slot(tmp_path: Path) -> None:
    # 80 bits at 1000 bit/s: 80 ms in slots of 100 ms, 5 ms into them; a owns [0, 100), b [100, 200), ...
    outcome, entries = run_code(
        tmp_path,
        """
async def main(robot):
    await asyncio.sleep(0.03 if robot.id == "a" else 0.01)
    accepted = [robot.radio.broadcast(f"message {number}") for number in range(3)]
    robot.log("accepted", {"v": accepted})
    await asyncio.sleep(10)
""",
        radio='access = "tdma"\nbit_rate_bps = 1000\nqueue = 2\nmax_payload_bytes = 10\n'
        "tdma = { slot_s = 0.1, guard_s = 0.01 }",
    )
    assert entries == [(10, "b", [True, True, False]), (30, "a", [True, True, False])]
    assert radio_ends(outcome) == [
        (10.0, "b"),  # refused: its queue was full
        (30.0, "a"),  # refused
        (185.0, "b"),
        (285.0, "a"),
        (385.0, "b"),
        (485.0, "a"),
    ]
    assert outcome.progress.dropped == {"queue_full": 2}
    assert outcome.progress.delivered == 4


CAMERA = """
[camera]
range_m = 20.0
frame_rate_hz = 4.0
phase_s = 0.1
latency_s = 0.005
[lamp]
latency_s = 0.001
colours = 3
"""


def test_what_a_camera_sees_and_when(tmp_path: Path) -> None:
    _, entries = run_code(
        tmp_path,
        """
async def main(robot):
    if robot.id == "a":
        robot.lamp.show(2)
        await asyncio.sleep(0.349)
        robot.lamp.off()          # in effect at 350 ms, the instant of an exposure
        await asyncio.sleep(0.001)
        robot.lamp.on()           # in effect at 351 ms: a millisecond late
        return
    async for frame in robot.camera:
        sighting, = frame.sightings
        robot.log("seen", {"v": [frame.captured_ns // 1_000_000, sighting.range_m, sighting.lamp]})
""",
        more=CAMERA,
        duration=0.7,
    )
    assert entries == [(105, "b", [100, 4.0, 2]), (355, "b", [350, 4.0, 0]), (605, "b", [600, 4.0, 1])]


def test_steps_observe_and_flash(tmp_path: Path) -> None:
    _, entries = run_code(
        tmp_path,
        """
async def main(robot):
    async for step in robot.steps(0.5):
        if (step.index % 2 == 0) == (robot.id == "a"):
            robot.radio.broadcast(step.index)
            robot.lamp.flash(step)
        observed = await step.observe()
        robot.log("o", {"v": [step.index, [m.payload for m in observed.heard], sorted(observed.lamps().values())]})
""",
        more=CAMERA,
        duration=1.5,
    )
    assert entries == [
        (500, "a", [0, [], [0]]),
        (500, "b", [0, [0], [1]]),
        (1000, "a", [1, [1], [1]]),
        (1000, "b", [1, [], [0]]),
        (1500, "a", [2, [], [0]]),
        (1500, "b", [2, [2], [1]]),
    ]


def test_slept_through_steps_are_skipped(tmp_path: Path) -> None:
    _, entries = run_code(
        tmp_path,
        """
async def main(robot):
    if robot.id == "b":
        return
    async for step in robot.steps(0.25):
        robot.log("step", {"v": step.index})
        if step.index == 1:
            await asyncio.sleep(0.6)
        if step.index == 4:
            return
""",
    )
    assert [entry[:1] + entry[2:] for entry in entries] == [(0, 0), (250, 1), (850, 3), (1000, 4)]


def test_commanded_motion_changes_who_is_in_range(tmp_path: Path) -> None:
    toml = TOML.format(radio="", more="", duration=4.0).replace(
        "area_m = [10.0, 10.0]",
        'area_m = [40.0, 10.0]\nmotion = { kind = "commanded", max_speed_mps = 20.0 }',
    )
    code = """
import asyncio
async def main(robot):
    if robot.id == "a":
        robot.body.go_to(39.0, 5.0, 19.0)   # 38 m: there in 2 s, 24 m from b after 1.474 s
    for _ in range(4):
        robot.radio.broadcast("here")
        await asyncio.sleep(1.0)
        robot.log("x", {"x": robot.body.pose.x_m})
"""
    scenario = write_scenario(tmp_path, code, toml)
    outcome = run_scenario(scenario, tmp_path / "log.mcap", "in_process")
    with LogReader(outcome.log) as log:
        heard = [(at // MS, record["from"], record["delivered"]) for at, record in log.records("/radio")]
        places = [record["data"]["x"] for _, record in log.records("/robot") if record["robot"] == "a"]
    assert places == [20.0, 39.0, 39.0, 39.0]
    assert heard == [
        (0, "a", ["b"]), (0, "b", ["a"]),
        (1000, "a", ["b"]), (1000, "b", ["a"]),
        (2000, "a", []), (2000, "b", []),
        (3000, "a", []), (3000, "b", []),
    ]  # fmt: skip


@pytest.mark.parametrize(("starts", "towards", "hears"), [(9.0, 12.0, False), (12.0, 9.0, True)])
def test_range_is_that_at_the_end_of_a_transmission(
    starts: float, towards: float, hears: bool, tmp_path: Path
) -> None:
    # b stands at 5 m and hears up to 10 m; a is there in 300 ms, and its message takes 800 ms
    toml = TOML.format(radio="bit_rate_bps = 1000", more="", duration=2.0).replace(
        "range_m = 20.0", "range_m = 5.0"
    )
    toml = toml.replace(
        "area_m = [10.0, 10.0]",
        'area_m = [40.0, 10.0]\nmotion = { kind = "commanded", max_speed_mps = 20.0 }',
    )
    toml = toml.replace("position_m = [1.0, 5.0]", f"position_m = [{starts}, 5.0]")
    code = f"""
import asyncio
async def main(robot):
    if robot.id == "a":
        robot.body.go_to({towards}, 5.0, 10.0)
        robot.radio.broadcast_bytes(bytes(100))
    await asyncio.sleep(10)
"""
    outcome = run_scenario(write_scenario(tmp_path, code, toml), tmp_path / "log.mcap", "in_process")
    assert (outcome.progress.delivered, outcome.progress.dropped) == (
        (1, {}) if hears else (0, {"out_of_range": 1})
    )


def test_a_slow_clock_wakes_late_and_stamps_by_its_own_time(tmp_path: Path) -> None:
    outcome, entries = run_code(
        tmp_path,
        """
async def main(robot):
    start = robot.now_ns
    await asyncio.sleep(1.0)
    robot.log("slept", {"v": robot.now_ns - start})
""",
        more="[clock]\ndrift_ppm = 1000\noffset_s = 0.5",
        duration=3.0,
    )
    assert [value for _, _, value in entries] == [10**9, 10**9]
    woken = [at for at, _, _ in entries]
    assert woken[0] != woken[1]
    assert all(abs(at - 1000) <= 1.001 for at in woken)
    assert outcome.progress.ended_by == "all robots ended"


def test_a_robot_that_returned_hears_nothing(tmp_path: Path) -> None:
    outcome, _ = run_code(
        tmp_path,
        """
async def main(robot):
    if robot.id == "a":
        return
    await asyncio.sleep(0.5)
    robot.radio.broadcast("anybody?")
""",
    )
    assert outcome.progress.dropped == {"receiver_down": 1}


@pytest.mark.parametrize(
    ("stop", "end_ms", "why"),
    [('stop = { entry = "state", field = "ready" }', 600, "stop rule"), ("", 2000, "duration")],
)
def test_stop_rule(stop: str, end_ms: int, why: str, tmp_path: Path) -> None:
    code = """
import asyncio
async def main(robot):
    for tick in range(100):
        await asyncio.sleep(0.1 if robot.id == "a" else 0.2)
        robot.log("state", {"ready": tick >= 2})
"""
    toml = TOML.format(radio="", more="", duration=2.0).replace(
        "duration_s = 2.0", f"duration_s = 2.0\n{stop}"
    )
    outcome = run_scenario(write_scenario(tmp_path, code, toml), tmp_path / "log.mcap", "in_process")
    assert outcome.progress.ended_by == why
    assert outcome.progress.now_ns == end_ms * MS


@pytest.mark.parametrize(("of", "why"), [('"all"', "duration"), ('"running"', "stop rule")])
def test_stop_rule_waits_for_robots_that_have_ended_if_it_is_for_all(
    of: str, why: str, tmp_path: Path
) -> None:
    code = """
import asyncio
async def main(robot):
    if robot.id == "a":
        return
    for tick in range(100):
        await asyncio.sleep(0.1)
        robot.log("state", {"ready": True})
"""
    rule = f'duration_s = 2.0\nstop = {{ entry = "state", field = "ready", of = {of} }}'
    toml = TOML.format(radio="", more="", duration=2.0).replace("duration_s = 2.0", rule)
    outcome = run_scenario(write_scenario(tmp_path, code, toml), tmp_path / "log.mcap", "in_process")
    assert outcome.progress.ended_by == why
    assert outcome.progress.now_ns == (2000 if why == "duration" else 100) * MS


def test_messages_that_wait_for_their_slot_when_the_run_ends_are_counted(tmp_path: Path) -> None:
    outcome, _ = run_code(
        tmp_path,
        """
async def main(robot):
    await asyncio.sleep(0.12)
    robot.radio.broadcast("x")
    await asyncio.sleep(10)
""",
        radio='access = "tdma"\nbit_rate_bps = 1000\nmax_payload_bytes = 10\ntdma = { slot_s = 0.1 }',
        duration=0.15,
    )
    # b speaks in [100, 200) ms; a would have to wait until 200
    assert (outcome.progress.sent, outcome.progress.unsent) == (1, 1)


@pytest.mark.parametrize(
    ("command", "story"),
    [
        (
            "robot._outbox.transmit(Transmission(0, b'x' * 1025))",
            "robot a sent a payload of 1025 bytes, past",
        ),
        ("robot._outbox.command_lamp(LampCommand(0, 2))", "robot a showed colour 2, past lamp.colours = 1"),
    ],
)
def test_a_robot_that_goes_round_its_own_limits(command: str, story: str, tmp_path: Path) -> None:
    code = f"""
from channels.messages import LampCommand, Transmission
async def main(robot):
    if robot.id == "a":
        {command}
"""
    with pytest.raises(RunFailed, match=story):
        run_code(tmp_path, code)


@pytest.mark.parametrize(
    ("text", "story"),
    [
        ('b"no json"', "robot a logged what is no JSON: "),
        ('b"1], [2"', "robot a logged what is no JSON: "),
        ("""b'{"a":1},{"b":2}'""", "robot a logged what is no JSON: "),
        ("""b'{"a":1}],[{"b":2}'""", "robot a logged what is no JSON: "),
        ('b"[1]"', "robot a logged a list instead of an object"),
        ('b"{\\"a\\":" + b"[" * 1023 + b"]" * 1023 + b"}"', "robot a logged what is no JSON: "),
    ],
)
def test_entries_that_are_none(text: str, story: str, tmp_path: Path) -> None:
    """A robot that goes round its own API cannot spoil the log."""
    code = f"""
from channels.messages import LogEntry
async def main(robot):
    if robot.id == "a":
        robot._outbox.log(LogEntry("odd", {text}))
"""
    with pytest.raises(RunFailed, match=story):
        run_code(tmp_path, code)
    with LogReader(tmp_path / "log.mcap") as log:
        assert list(log.records("/robot")) == []
