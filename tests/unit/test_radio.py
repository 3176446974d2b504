"""The robot's own medium access control, without any loop: instants in, instants out."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable

import numpy as np
import pytest

from agent.drivers.camera import Frame
from agent.outbox import Outbox, TooMuchAtOnce
from agent.radio import MessageTooLong, Radio, SlotAccess
from agent.robot import Observation, Robot
from channels.messages import (
    MAX_TRANSMISSIONS,
    Hello,
    LampCommand,
    Message,
    MotionCommand,
    RadioPlan,
    Report,
    WireFrame,
    decode_report,
    encode,
    encode_payload,
)

MS = 1_000_000
TDMA = RadioPlan(
    max_payload_bytes=100, overhead_bits=0, bit_rate_bps=1000.0, queue=3,
    slot_ns=100 * MS, guard_ns=10 * MS, slot=1, slots=3,
)  # fmt: skip


class AtZero:
    """A clock that stands still."""

    now_ns = 0


def test_messages_fill_own_slots_in_order() -> None:
    # the second of three slots of 100 ms, of which 10 ms are guard; one byte takes 8 ms
    access = SlotAccess(TDMA)
    starts = [access.start(0, size) for size in (5, 5, 5)]
    assert [start // MS for start in starts if start is not None] == [100, 140, 400]
    assert access.start(0, 1) is None  # three are waiting
    assert access.start(141 * MS, 1) == 440 * MS  # the first has left


def test_a_message_handed_over_inside_the_slot_goes_at_once_if_it_still_fits() -> None:
    assert SlotAccess(TDMA).start(150 * MS, 5) == 150 * MS  # ends at 190, where the guard begins
    assert SlotAccess(TDMA).start(151 * MS, 5) == 400 * MS


def test_what_fits_no_slot_is_refused_at_once() -> None:
    with pytest.raises(
        MessageTooLong, match=r"a message of 12 bytes takes 0\.096 s on the air and does not fit"
    ):
        SlotAccess(TDMA).start(0, 12)
    assert SlotAccess(TDMA).start(0, 11) == 100 * MS


def test_limits_of_broadcast() -> None:
    outbox = Outbox()
    radio = Radio(RadioPlan(4, 0, None, 1), outbox, AtZero())
    assert radio.broadcast("abc")
    with pytest.raises(MessageTooLong, match="a payload of 5 bytes"):
        radio.broadcast("abcd")
    for _ in range(MAX_TRANSMISSIONS - 1):
        radio.broadcast(0)
    with pytest.raises(TooMuchAtOnce):
        radio.broadcast(0)
    assert len(outbox.transmissions) == MAX_TRANSMISSIONS


async def test_receiving_on_an_ordinary_loop_loses_nothing_when_cancelled() -> None:
    import asyncio

    radio = Radio(RadioPlan(4, 0, None, 1), Outbox(), AtZero())
    impatient = asyncio.ensure_future(radio.receive())
    patient = asyncio.ensure_future(radio.receive())
    await asyncio.sleep(0)
    assert radio.awaited
    radio.deliver([Message(0, "a", encode_payload(1))])
    impatient.cancel()  # it had been woken for the message, and gives it up
    assert (await patient).payload == 1
    assert not radio.awaited


def robot(outbox: Outbox) -> Robot:
    return Robot(Hello("r00", "", {}, 0, 0, (0.0, 0.0, 0.0), TDMA, 2), outbox, AtZero())


@pytest.mark.parametrize(
    "command",
    [
        lambda robot: robot.log("", {}),
        lambda robot: robot.log("x" * 101, {}),
        lambda robot: robot.log("\ud800", {}),
        lambda robot: robot.log("odd", {"x": math.nan}),
        lambda robot: robot.body.drive(math.inf, 0.0),
        lambda robot: robot.body.drive(0.0, math.nan),
        lambda robot: robot.body.go_to(0.0, math.nan, 1.0),
        lambda robot: robot.body.go_to(0.0, 0.0, -1.0),
        lambda robot: robot.lamp.show(3),
    ],
)
def test_what_the_wire_would_refuse_is_refused_at_the_call(command: Callable[[Robot], None]) -> None:
    outbox = Outbox()
    with pytest.raises(ValueError):  # noqa: PT011
        command(robot(outbox))
    assert [outbox.entries, outbox.motion, outbox.lamp] == [[], [], []]


def test_a_lamp_takes_whole_numbers_only() -> None:
    outbox = Outbox()
    with pytest.raises(TypeError):
        robot(outbox).lamp.show(1.5)  # type: ignore[arg-type]
    robot(outbox).lamp.show(np.int64(2))  # type: ignore[arg-type]
    robot(outbox).body.drive(np.float32(0.5), 1)  # type: ignore[arg-type]
    assert outbox.lamp == [LampCommand(0, 2)]
    assert decode_report(encode(Report(0, None, motion=outbox.motion))).motion == [MotionCommand((0.5, 1.0))]


def test_what_was_heard_and_seen_has_an_order_and_works_as_a_set() -> None:
    frames = [
        Frame(WireFrame(0, struct.pack("<3i", 5, 7, 9), bytes(12), bytes(12), b"\0\1\2")),
        Frame(WireFrame(0, struct.pack("<2i", 3, 7), bytes(8), bytes(8), b"\1\1")),
    ]
    observed = Observation([Message(0, name, b"") for name in ("r9", "r1", "r9", "r5")], frames)
    assert list(observed.heard_from()) == ["r9", "r1", "r5"]
    assert list(observed.lit()) == [7, 9, 3]
    known = {"r0"}
    known |= observed.heard_from()
    assert type(known) is set
    assert known == {"r0", "r1", "r5", "r9"}
    assert 5 not in observed.lit()
    assert len(observed.lit()) == 3
