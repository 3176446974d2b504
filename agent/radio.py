"""The radio as a behaviour sees it, and the medium access control that keeps to the robot's slot.

Broadcasts are handed to the medium with the instant at which they start, by the robot's own clock:
at once where access is ideal, at the next own slot under TDMA. What is not yet on the air occupies
the transmit queue.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from agent.clock import Clock
from agent.outbox import Outbox
from agent.parameters import ParameterError
from agent.waiting import Mailbox, sleep_until
from channels.messages import Message, RadioPlan, Transmission, encode_payload
from channels.tdma import Schedule
from channels.units import airtime_ns, bits_within, to_s


class MessageTooLong(ValueError):
    """A payload that can never be sent: over the scenario's limit, or longer than a slot."""


class Slot(NamedTuple):
    """One own time slot. Times by the own clock."""

    frame: int
    """Counts the frames from time 0."""
    start_ns: int
    """First instant at which a message may begin: half of the guard is over."""
    bytes: int
    """Most payload bytes that one message can carry in it."""


class Radio:
    """Broadcast and receive. Messages wait here until the behaviour takes them."""

    def __init__(self, plan: RadioPlan, outbox: Outbox, clock: Clock) -> None:
        self._plan = plan
        self._outbox = outbox
        self._clock = clock
        self._inbox: Mailbox[Message] = Mailbox()
        self._access = SlotAccess(plan) if plan.slot_ns else None

    def broadcast(self, payload: object) -> bool:
        """Send to whoever is in range. False where the own queue for slots is full.

        Without slots the radio itself drops what its queue cannot hold. Both are recorded, `queue_full`.

        `payload`: anything msgpack carries (numbers, text, bytes, lists, dicts, None).
        Raises MessageTooLong, TypeError for other objects, TooMuchAtOnce past 1000 at one instant.
        """
        return self.broadcast_bytes(encode_payload(payload))

    def broadcast_bytes(self, raw: bytes) -> bool:
        """Send bytes as they are, which receivers find in `message.raw`; otherwise as `broadcast`.

        For formats that count their bits: msgpack, which `broadcast` uses, adds some of its own.
        """
        if len(raw) > self._plan.max_payload_bytes:
            raise MessageTooLong(
                f"a payload of {len(raw)} bytes; the scenario's radio.max_payload_bytes is "
                f"{self._plan.max_payload_bytes}"
            )
        now = self._clock.now_ns
        start = now if self._access is None else self._access.start(now, len(raw))
        if start is None:
            self._outbox.transmit(Transmission(now, raw, refused=True))
            return False
        self._outbox.transmit(Transmission(start, raw))
        return True

    def slots(self) -> Slots:
        """Own time slots, each as it begins: `async for slot in robot.radio.slots()`.

        One that the behaviour sleeps through is skipped. Raises ParameterError where the radio has no slots.
        """
        if self._access is None:
            raise ParameterError('radio.access: must be "tdma", for this behaviour speaks in slots')
        return Slots(self._access, self._clock)

    async def receive(self) -> Message:
        """The next message, waiting for it if none has arrived. Cancelling it loses nothing."""
        return await self._inbox.take()

    def received(self) -> list[Message]:
        """All messages that have arrived and were not taken yet, oldest first; never waits."""
        return self._inbox.take_all()

    def __aiter__(self) -> Radio:
        return self

    async def __anext__(self) -> Message:
        return await self._inbox.take()

    @property
    def max_payload_bytes(self) -> int:
        """Most bytes of one message; under TDMA a slot may carry less (`Slot.bytes`)."""
        return self._plan.max_payload_bytes

    @property
    def awaited(self) -> bool:
        """True while the behaviour waits for a message."""
        return self._inbox.awaited

    def deliver(self, messages: list[Message]) -> None:
        """Called by the link: messages that have arrived, oldest first."""
        self._inbox.deliver(messages)


class Slots:
    """Asynchronous iterator over own slots; each waits until it begins."""

    __slots__ = ("_access", "_after_ns", "_clock")

    def __init__(self, access: SlotAccess, clock: Clock) -> None:
        self._access = access
        self._clock = clock
        self._after_ns = clock.now_ns

    def __aiter__(self) -> Slots:
        return self

    async def __anext__(self) -> Slot:
        slot = self._access.next_slot(max(self._after_ns, self._clock.now_ns))
        self._after_ns = slot.start_ns + 1
        if slot.start_ns > self._clock.now_ns:
            await sleep_until(slot.start_ns)
        return slot


class SlotAccess:
    """TDMA at the sender: gives every message its start within own slots, first come first served."""

    def __init__(self, plan: RadioPlan) -> None:
        self._plan = plan
        self._schedule = Schedule(plan.slot_ns, plan.guard_ns, plan.slots, plan.order_key)
        self._ends: deque[int] = deque()

    def next_slot(self, after_ns: int) -> Slot:
        """The first own slot that begins at or after an instant."""
        start_ns = self._schedule.next_start(self._plan.slot, after_ns)
        return Slot(start_ns // self._schedule.frame_ns, start_ns, self._capacity())

    def _capacity(self) -> int:
        plan = self._plan
        if plan.bit_rate_bps is None:
            return plan.max_payload_bytes
        bits = bits_within(plan.slot_ns - plan.guard_ns, plan.bit_rate_bps) - plan.overhead_bits
        return max(0, min(bits // 8, plan.max_payload_bytes))

    def start(self, now_ns: int, payload_bytes: int) -> int | None:
        """Start of the transmission by the own clock [ns], or None where the queue is full.

        Raises MessageTooLong where no slot can ever hold it.
        """
        plan = self._plan
        airtime = airtime_ns(8 * payload_bytes + plan.overhead_bits, plan.bit_rate_bps)
        if not self._schedule.fits(airtime):
            raise MessageTooLong(
                f"a message of {payload_bytes} bytes takes {to_s(airtime)} s on the air and does not fit "
                f"a slot of {to_s(plan.slot_ns)} s with {to_s(plan.guard_ns)} s guard; send less, or "
                "lengthen the slot in radio.tdma"
            )
        while self._ends and self._ends[0] <= now_ns:
            self._ends.popleft()
        if len(self._ends) >= plan.queue:
            return None
        earliest = max(now_ns, self._ends[-1]) if self._ends else now_ns
        start = earliest
        if not self._schedule.keeps_guard(plan.slot, earliest, airtime):
            start = self._schedule.next_start(plan.slot, earliest)
        self._ends.append(start + airtime)
        return start
