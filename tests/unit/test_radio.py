"""The robot's own medium access control, without any loop: instants in, instants out."""

from __future__ import annotations

import pytest

from agent.outbox import Outbox, TooMuchAtOnce
from agent.radio import MessageTooLong, Radio, SlotAccess
from channels.messages import MAX_TRANSMISSIONS, Message, RadioPlan, encode_payload

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
