"""The radio as a behaviour sees it, and the medium access control that keeps to the robot's slot.

Broadcasts are handed to the medium with the instant at which they start, by the robot's own clock:
at once where access is ideal, at the next own slot under TDMA. What is not yet on the air occupies
the transmit queue.
"""

from __future__ import annotations

from collections import deque

from agent.clock import Clock
from agent.outbox import Outbox
from agent.waiting import Mailbox
from channels.messages import Message, RadioPlan, Transmission, encode_payload
from channels.tdma import Schedule
from channels.units import airtime_ns, to_s


class MessageTooLong(ValueError):
    """A payload that can never be sent: over the scenario's limit, or longer than a slot."""


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
        raw = encode_payload(payload)
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
    def awaited(self) -> bool:
        """True while the behaviour waits for a message."""
        return self._inbox.awaited

    def deliver(self, messages: list[Message]) -> None:
        """Called by the link: messages that have arrived, oldest first."""
        self._inbox.deliver(messages)


class SlotAccess:
    """TDMA at the sender: gives every message its start within own slots, first come first served."""

    def __init__(self, plan: RadioPlan) -> None:
        self._plan = plan
        self._schedule = Schedule(plan.slot_ns, plan.guard_ns, plan.slots)
        self._ends: deque[int] = deque()

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
                "lengthen radio.tdma.slot_s"
            )
        while self._ends and self._ends[0] <= now_ns:
            self._ends.popleft()
        if len(self._ends) >= plan.queue:
            return None
        earliest = max(now_ns, self._ends[-1]) if self._ends else now_ns
        start = earliest
        if not self._schedule.inside(plan.slot, earliest, airtime):
            start = self._schedule.next_start(plan.slot, earliest)
        self._ends.append(start + airtime)
        return start
