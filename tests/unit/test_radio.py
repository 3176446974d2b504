"""The robot's own medium access control, without any loop: instants in, instants out."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import pytest

from agent.drivers.camera import Frame
from agent.outbox import Outbox, TooMuchAtOnce
from agent.parameters import ParameterError
from agent.radio import MessageTooLong, Radio, Slot, SlotAccess
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
from channels.tdma import Schedule

MS = 1_000_000
TDMA = RadioPlan(
    max_payload_bytes=100, overhead_bits=0, bit_rate_bps=1000.0, queue=3,
    slot_ns=100 * MS, guard_ns=10 * MS, slot=1, slots=3,
)  # fmt: skip


class AtZero:
    """A clock that stands still."""

    now_ns = 0


def test_messages_fill_own_slots_in_order() -> None:
    # the second of three slots of 100 ms, of which the first and last 5 are guard; one byte takes 8 ms
    access = SlotAccess(TDMA)
    starts = [access.start(0, size) for size in (5, 5, 5)]
    assert starts == [105 * MS, 145 * MS, 405 * MS]
    assert access.start(0, 1) is None  # three are waiting
    assert access.start(145 * MS - 1, 1) is None
    assert access.start(145 * MS, 1) == 445 * MS  # the first has left


def test_a_message_handed_over_inside_the_slot_goes_at_once_if_it_still_fits() -> None:
    assert SlotAccess(TDMA).start(155 * MS, 5) == 155 * MS  # ends at 195, where the guard begins
    assert SlotAccess(TDMA).start(155 * MS + 1, 5) == 155 * MS + 1  # one nanosecond is forgiven
    assert SlotAccess(TDMA).start(155 * MS + 2, 5) == 405 * MS


def test_a_message_handed_over_in_the_guard_waits_until_it_is_over() -> None:
    assert SlotAccess(TDMA).start(101 * MS, 5) == 105 * MS
    assert SlotAccess(TDMA).start(196 * MS, 0) == 405 * MS


def test_what_fits_no_slot_is_refused_at_once() -> None:
    with pytest.raises(
        MessageTooLong, match=r"a message of 12 bytes takes 0\.096 s on the air and does not fit"
    ):
        SlotAccess(TDMA).start(0, 12)
    assert SlotAccess(TDMA).start(0, 11) == 105 * MS


def test_own_slots_one_after_the_other() -> None:
    access = SlotAccess(TDMA)
    first = access.next_slot(0)
    assert first == Slot(0, 105 * MS, 11)  # 90 ms at 1000 bit/s are 90 bits
    assert access.next_slot(105 * MS) == first
    assert access.next_slot(105 * MS + 1) == Slot(1, 405 * MS, 11)
    assert access.next_slot(3000 * MS) == Slot(10, 3105 * MS, 11)


def test_slots_of_frames_in_an_order_of_their_own() -> None:
    plan = msgspec.structs.replace(TDMA, order_key=7)
    schedule = Schedule(plan.slot_ns, plan.guard_ns, plan.slots, 7)
    access, after_ns = SlotAccess(plan), 0
    for frame in range(50):
        slot = access.next_slot(after_ns)
        assert slot.frame == frame
        assert slot.start_ns == (300 * frame + 100 * schedule.place(1, frame) + 5) * MS
        after_ns = slot.start_ns + 1


@pytest.mark.parametrize(
    ("changes", "capacity"),
    [
        ({}, 11),
        ({"max_payload_bytes": 10}, 10),
        ({"guard_ns": 0}, 12),
        ({"guard_ns": 4 * MS}, 12),
        ({"guard_ns": 4 * MS + 1}, 11),
        ({"overhead_bits": 2}, 11),
        ({"overhead_bits": 3}, 10),
        ({"overhead_bits": 90}, 0),
        ({"overhead_bits": 1000}, 0),
        ({"bit_rate_bps": None}, 100),
    ],
)
def test_a_slot_says_how_much_it_holds(changes: dict[str, Any], capacity: int) -> None:
    access = SlotAccess(msgspec.structs.replace(TDMA, **changes))
    assert access.next_slot(0).bytes == capacity
    if capacity > 0 and "max_payload_bytes" not in changes and "bit_rate_bps" not in changes:
        assert access.start(0, capacity) is not None
        with pytest.raises(MessageTooLong):
            access.start(0, capacity + 1)


def test_without_slots_there_are_none() -> None:
    with pytest.raises(ParameterError, match=r'radio\.access: must be "tdma", for this behaviour'):
        Radio(RadioPlan(4, 0, None, 1), Outbox(), AtZero()).slots()


def test_bytes_go_on_the_air_as_they_are() -> None:
    outbox = Outbox()
    radio = Radio(RadioPlan(4, 0, None, 1), outbox, AtZero())
    assert radio.broadcast_bytes(b"\xc1\x00\xff\x01")  # no msgpack begins with 0xc1
    assert radio.broadcast_bytes(b"")
    assert [(sent.start_ns, sent.payload) for sent in outbox.transmissions] == [
        (0, b"\xc1\x00\xff\x01"),
        (0, b""),
    ]
    with pytest.raises(MessageTooLong, match="a payload of 5 bytes"):
        radio.broadcast_bytes(b"12345")


def test_a_full_queue_refuses_and_says_so() -> None:
    outbox = Outbox()
    radio = Radio(TDMA, outbox, AtZero())
    assert [radio.broadcast_bytes(b"12345") for _ in range(4)] == [True, True, True, False]
    assert [sent.refused for sent in outbox.transmissions] == [False, False, False, True]


def test_a_robot_knows_its_place_in_the_team() -> None:
    hello = Hello("r07", "", {}, 0, 0, (1.0, 2.0, 0.5), TDMA, 2, number=7, team=9, altitude_m=30.5)
    own = Robot(hello, Outbox(), AtZero())
    assert (own.number, own.team_size, own.body.altitude_m) == (7, 9, 30.5)
    assert tuple(own.body.pose) == (1.0, 2.0, 0.5)


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
