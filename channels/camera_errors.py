"""What cameras get wrong: robots and lamps they miss, lamps they imagine, noise on range and bearing.

Every error is drawn anew for each observer, target and frame, whatever else is in view.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from channels.fates import Bools, Floats
from channels.randomness import Draws, UInts
from channels.settings import CameraSettings


class CameraErrors:
    """The errors of all cameras of a team."""

    def __init__(self, camera: CameraSettings, seed: int) -> None:
        self._camera = camera
        self._bearing_noise_rad = math.radians(camera.bearing_noise_deg)
        self._draws = {
            stream: Draws(seed, stream)
            for stream in ("miss", "lamp_miss", "lamp_false", "range_noise", "bearing_noise")
        }

    @property
    def possible(self) -> bool:
        """Whether there are any."""
        camera = self._camera
        chances = camera.miss, camera.lamp_miss, camera.lamp_false
        return any(chances) or camera.range_noise_m > 0 or camera.bearing_noise_deg > 0

    def shown(self, who: UInts, whom: UInts, frame: int) -> Bools:
        """(K,) whether each of K sightings is in the frame at all; `who` sees `whom`, both (K,) keys."""
        return ~self._happens("miss", self._camera.miss, who, whom, frame)

    def lamp(self, lamp: NDArray[np.uint8], who: UInts, whom: UInts, frame: int) -> NDArray[np.uint8]:
        """(K,) colours that are seen where the lamps show `lamp` (K,)."""
        missed = self._happens("lamp_miss", self._camera.lamp_miss, who, whom, frame)
        imagined = (lamp == 0) & self._happens("lamp_false", self._camera.lamp_false, who, whom, frame)
        return np.where(imagined, np.uint8(1), np.where(missed, np.uint8(0), lamp))

    def range_m(self, exact_m: Floats, who: UInts, whom: UInts, frame: int) -> Floats:
        """(K,) measured ranges, never below zero."""
        if self._camera.range_noise_m == 0:
            return exact_m
        noise_m = self._camera.range_noise_m * self._draws["range_noise"].normal(who, whom, frame)
        return np.maximum(exact_m + noise_m, 0.0)

    def bearing_rad(self, exact_rad: Floats, who: UInts, whom: UInts, frame: int) -> Floats:
        """(K,) measured bearings, not yet brought back into one turn."""
        if self._bearing_noise_rad == 0:
            return exact_rad
        noise_rad = self._bearing_noise_rad * self._draws["bearing_noise"].normal(who, whom, frame)
        return exact_rad + noise_rad

    def _happens(self, stream: str, probability: float, who: UInts, whom: UInts, frame: int) -> Bools:
        if probability == 0:
            return np.zeros(len(who), dtype=np.bool_)
        happens: Bools = self._draws[stream].uniform(who, whom, frame) < probability
        return happens
