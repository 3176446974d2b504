"""The radio medium: who hears a transmission, when, and why not.

Gates are asked in this order, and the first that refuses a receiver names the reason:

    range           out_of_range        disc around the sender, or links of the world's graph (`link`)
    sight           no_line_of_sight    an obstacle between the two (`line_of_sight`)
    queue           queue_full          it never left the sender
    length          too_long            no slot could hold it (TDMA)
    slot            out_of_slot         not wholly inside the sender's own slot, by true time (TDMA)
    receiver        receiver_down       the receiver's radio is off
    half duplex     half_duplex         the receiver was transmitting itself (`collisions`)
    collision       collision           another transmission reached the receiver as well (`collisions`)
    bursts          burst               chance that remembers (`bursts`)
    loss            loss                chance that does not

All is decided when a transmission ends, with the places the robots have then. Length comes before slot
because what fits no slot lies inside none. TDMA settings count where access is TDMA; under ideal access
they are ignored, so that one word in a scenario switches between the two.

The medium owns no clock and no socket: it is told the instant, and everything it says is a function of
its arguments, the settings and the seed. Only `admit` remembers: what the senders' radios are busy with.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from channels.fates import Batch, Bools, Fates, Floats, Gate, Ints, OnAir, Reason
from channels.gates.bandwidth import QueueGate, TransmitQueues
from channels.gates.bursts import BurstGate
from channels.gates.collision import CollisionGate, HalfDuplexGate
from channels.gates.graph import Links
from channels.gates.loss import Jitter, LossGate
from channels.gates.range import Disc, RangeGate, Reach
from channels.gates.receiver import ReceiverGate
from channels.gates.sight import Shadowed, Shadows, SightGate
from channels.gates.tdma import LengthGate, SlotGate
from channels.graphs import Graph, Rectangle
from channels.randomness import stable_keys
from channels.settings import RadioSettings
from channels.tdma import Schedule, schedule_of, slot_order
from channels.units import airtime_ns, to_ns

__all__ = ["Fates", "Medium", "Reason"]

_DELIVERED = np.uint8(Reason.delivered)
_NOT_A_CANDIDATE = np.uint8(Reason.not_a_candidate)


def range_of(settings: RadioSettings, altitudes_m: Sequence[float] | None, graph: Graph | None) -> Reach:
    """Who is in range of whom, obstacles apart. Raises ValueError for a link model without what it needs."""
    if settings.link == "graph":
        if graph is None:
            raise ValueError("link is graph, but the world has none")
        return Links(graph)
    if settings.range_m is None:
        raise ValueError("link is disc, but there is no range_m")
    return Disc(settings.range_m, None if altitudes_m is None else np.array(altitudes_m))


def shadows_of(settings: RadioSettings, obstacles: Sequence[Rectangle]) -> Shadows | None:
    """Who is hidden from whom; None where nobody ever is."""
    if settings.link != "disc" or not settings.line_of_sight or not obstacles:
        return None
    return Shadows(obstacles)


def reach_of(
    settings: RadioSettings,
    altitudes_m: Sequence[float] | None,
    graph: Graph | None,
    obstacles: Sequence[Rectangle],
) -> Reach:
    """Whom a transmission reaches at all, be it heard or in the way; raises as `range_of`."""
    reach, shadows = range_of(settings, altitudes_m, graph), shadows_of(settings, obstacles)
    return reach if shadows is None else Shadowed(reach, shadows)


class Medium:
    """One radio channel shared by a team. Robots are indexed in the order of `robots`.

    `slots`: which slot is whose, where robots share them; None: each has one of its own, by the settings.
    `altitudes_m`: how high each robot is; None: all on one plane. `graph`, `obstacles`: the world's, in
    metres, for link models that ask for them. Raises ValueError for TDMA without its settings, or with slots
    that nothing fits into, and for a link model without what it needs.
    """

    def __init__(
        self,
        settings: RadioSettings,
        robots: Sequence[str],
        seed: int,
        *,
        slots: Sequence[int] | None = None,
        altitudes_m: Sequence[float] | None = None,
        graph: Graph | None = None,
        obstacles: Sequence[Rectangle] = (),
    ) -> None:
        self._settings = settings
        self._range = range_of(settings, altitudes_m, graph)
        self._shadows = shadows_of(settings, obstacles)
        self._keys = stable_keys(robots)
        self.schedule: Schedule | None = None
        """None: no slots."""
        self.slots: Sequence[int] = [0] * len(robots)
        """The slot of each robot; all 0 without slots."""
        if settings.access == "tdma":
            if settings.tdma is None:
                raise ValueError("access is tdma, but there are no tdma settings")
            self.slots = slot_order(settings.tdma, robots, seed) if slots is None else slots
            self.schedule = schedule_of(settings, max(self.slots) + 1, seed)
        self._queues = TransmitQueues(len(robots), settings.queue)
        # A latency that rounds to nothing would let an effect reach another robot at its own instant.
        self._latency_ns = np.full(len(robots), max(1, to_ns(settings.latency_s)), dtype=np.int64)
        jitter_ns = to_ns(settings.jitter_s)
        self._jitter = Jitter(jitter_ns, self._keys, seed) if jitter_ns > 0 else None
        self._gates = self._chain(seed)

    def _chain(self, seed: int) -> list[Gate]:
        gates: list[Gate] = [RangeGate(self._range)]
        reach = self._range
        if self._shadows is not None:
            gates.append(SightGate(self._shadows))
            reach = Shadowed(reach, self._shadows)
        gates.append(QueueGate())
        if self.schedule is not None:
            gates += [LengthGate(self.schedule), SlotGate(self.schedule, self.slots)]
        gates.append(ReceiverGate())
        if self._settings.collisions:
            gates += [HalfDuplexGate(), CollisionGate(reach)]
        if self._settings.bursts is not None:
            gates.append(BurstGate(self._settings.bursts, self._keys, seed))
        if self._settings.loss > 0:
            gates.append(LossGate(self._settings.loss, self._keys, seed))
        return gates

    @property
    def collides(self) -> bool:
        """Whether it matters what else is on the air."""
        return self._settings.collisions

    def place_of(self, sender: int, start_ns: int) -> int | None:
        """Where in the frame of an instant a robot's own slot is; None without slots."""
        if self.schedule is None:
            return None
        return self.schedule.place(self.slots[sender], start_ns // self.schedule.frame_ns)

    def airtime_ns(self, payload_bytes: int) -> int:
        """Time a message with so much payload occupies the sender's radio; 0 at unlimited bit rate."""
        return airtime_ns(8 * payload_bytes + self._settings.overhead_bits, self._settings.bit_rate_bps)

    def admit(self, sender: int, now_ns: int, airtime_ns: int) -> int | None:
        """Hand a message to the sender's radio: the instant it starts (>= now), or None: queue full.

        The radio works through its queue in order. A message counts until its transmission has ended.
        Instants given for one sender must never decrease.
        """
        if self._settings.bit_rate_bps is None:
            return now_ns
        return self._queues.admit(sender, now_ns, airtime_ns)

    def transmit(
        self,
        now_ns: int,
        senders: Ints,
        seqs: Ints,
        airtimes_ns: NDArray[np.int64],
        refused: Bools,
        positions: Floats,
        listening: Bools,
        on_air: OnAir | None = None,
        places: Ints | None = None,
    ) -> Fates:
        """Fates of the transmissions that end now; shapes and meanings as in `Batch`.

        `positions` and `places` must not be written to afterwards: what follows from them is kept as long
        as the same array objects come back.
        """
        batch = Batch(now_ns, senders, seqs, airtimes_ns, refused, positions, listening, on_air, places)
        reason = np.zeros((len(senders), len(positions)), dtype=np.uint8)
        reason[np.arange(len(senders)), senders] = _NOT_A_CANDIDATE
        for gate in self._gates:
            refusals = gate.refuses(batch)
            if refusals is not None:
                # Arithmetic, because assignment under a scattered mask costs ten times as much.
                first = refusals & (reason == _DELIVERED)
                reason += first.view(np.uint8) * np.uint8(gate.reason)
        delay_ns = np.repeat(self._latency_ns[None, :], len(senders), axis=0)
        if self._jitter is not None:
            delay_ns += self._jitter.delays_ns(batch)
        return Fates(reason, delay_ns)
