"""What the robot sees: frames of sightings, each robot in view under an id of the observer's own."""

from __future__ import annotations

from typing import NamedTuple

from agent.waiting import Mailbox
from channels.messages import WireFrame
from channels.units import to_s


class Sighting(NamedTuple):
    """One robot in one frame. The visual id means nothing to anybody else."""

    visual_id: int
    range_m: float
    bearing_rad: float
    """Relative to the own heading, in (-pi, pi], counter-clockwise."""
    lamp: int
    """Colour of its lamp; 0: dark."""

    @property
    def lit(self) -> bool:
        """Whether its lamp was on."""
        return self.lamp != 0


class Frame:
    """One exposure of the camera."""

    __slots__ = ("_wire",)

    def __init__(self, wire: WireFrame) -> None:
        self._wire = wire

    @property
    def captured_ns(self) -> int:
        """Instant of exposure by the own clock [ns]."""
        return self._wire.captured_ns

    @property
    def captured_s(self) -> float:
        """Instant of exposure by the own clock [s]."""
        return to_s(self._wire.captured_ns)

    @property
    def visual_ids(self) -> list[int]:
        """Ids of all robots in the frame, ascending."""
        return memoryview(self._wire.visual).cast("i").tolist()

    @property
    def lamps(self) -> bytes:
        """Lamp colours, one byte each, in the order of `visual_ids`."""
        return self._wire.lamp

    @property
    def sightings(self) -> list[Sighting]:
        """Everything in the frame, ordered by visual id."""
        wire = self._wire
        ranges = memoryview(wire.range_m).cast("f").tolist()
        bearings = memoryview(wire.bearing_rad).cast("f").tolist()
        return list(map(Sighting, self.visual_ids, ranges, bearings, wire.lamp))


class Camera:
    """Frames wait here until the behaviour takes them."""

    def __init__(self) -> None:
        self._frames: Mailbox[Frame] = Mailbox()

    async def frame(self) -> Frame:
        """The next frame, waiting for it if there is none. Cancelling it loses nothing."""
        return await self._frames.take()

    def frames(self) -> list[Frame]:
        """All frames that were not taken yet, oldest first; never waits."""
        return self._frames.take_all()

    def __aiter__(self) -> Camera:
        return self

    async def __anext__(self) -> Frame:
        return await self._frames.take()

    @property
    def awaited(self) -> bool:
        """True while the behaviour waits for a frame."""
        return self._frames.awaited

    def deliver(self, frames: list[WireFrame]) -> None:
        """Called by the link: frames that have become available, oldest first."""
        self._frames.deliver([Frame(frame) for frame in frames])
