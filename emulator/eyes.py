"""From exposure to frame: when cameras look, what they see, and the frames robots are granted."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from msgspec import Raw
from numpy.typing import NDArray

from channels.clocks import LocalClock
from channels.messages import WireFrame, encode
from channels.settings import CameraSettings
from channels.units import NS_PER_S, to_ns
from channels.visual import Capture, VisualChannel


class Eyes:
    """The cameras of the team, which expose at common instants."""

    def __init__(self, settings: CameraSettings, robots: Sequence[str], seed: int) -> None:
        self._channel = VisualChannel(settings, robots, seed)
        self._robots = robots
        self._period_ns = NS_PER_S / settings.frame_rate_hz
        self._phase_ns = (
            to_ns(settings.phase_s) if settings.phase_s is not None else round(self._period_ns / 2)
        )
        self._taken = 0
        self.latency_ns = to_ns(settings.latency_s)

    def exposure_ns(self, frame: int) -> int:
        """Instant of one frame, counted from 0."""
        return self._phase_ns + round(frame * self._period_ns)

    def next_exposure_ns(self) -> int:
        """Instant of the frame after the one being taken."""
        return self.exposure_ns(self._taken + 1)

    def expose(
        self,
        now_ns: int,
        poses: NDArray[np.float64],
        lamps: NDArray[np.uint8],
        observers: Sequence[int],
    ) -> Capture:
        """One frame of every observer. `poses` (N, 3): x, y [m], heading [rad]; `lamps` (N,) colours."""
        capture = self._channel.capture(self._taken, poses, lamps, np.array(observers, dtype=np.intp))
        self._taken += 1
        return capture

    def identities(self, capture: Capture) -> dict[str, object]:
        """Ground truth on the visual ids that a capture has introduced or ended."""
        names = self._robots
        return {
            "kind": "visual ids",
            "entered": [
                {"observer": names[observer], "visual": visual, "robot": names[target]}
                for observer, visual, target in capture.entered
            ],
            "left": [
                {"observer": names[observer], "visual": visual, "robot": names[target]}
                for observer, visual, target in capture.left
            ],
        }

    def frames(
        self, now_ns: int, capture: Capture, clocks: Sequence[LocalClock] | None
    ) -> Iterator[tuple[int, Raw]]:
        """Every observer's frame, encoded for it."""
        visual = capture.visual.astype("<i4").tobytes()
        ranges = capture.range_m.astype("<f4").tobytes()
        bearings = capture.bearing_rad.astype("<f4").tobytes()
        lamps = capture.lamp.tobytes()
        offsets = capture.offsets.tolist()
        for position, robot in enumerate(capture.observers.tolist()):
            first, last = offsets[position], offsets[position + 1]
            four = slice(4 * first, 4 * last)
            reads = now_ns if clocks is None else clocks[robot].local(now_ns)
            frame = WireFrame(reads, visual[four], ranges[four], bearings[four], lamps[first:last])
            yield robot, Raw(encode(frame))
