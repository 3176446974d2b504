"""The robots' own clocks: what each reads at a true instant, in exact integer arithmetic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from channels.randomness import Draws, stable_keys
from channels.settings import ClockSettings
from channels.units import to_ns

_BILLION = 10**9
_PPB_PER_PPM = 1000


@dataclass(frozen=True, slots=True)
class LocalClock:
    """A clock that starts `offset_ns` ahead and runs fast by `drift_ppb` parts per billion.

    Readings are integers, so a clock can read the same at two neighbouring instants or skip a
    nanosecond, but it never runs backwards. Raises ValueError for a clock that stands still or does.
    """

    offset_ns: int = 0
    drift_ppb: int = 0

    def __post_init__(self) -> None:
        if self.drift_ppb <= -_BILLION:
            raise ValueError(f"a drift of {self.drift_ppb} ppb: the clock would not run forwards")

    def local(self, true_ns: int) -> int:
        """Reading at a true instant."""
        return self.offset_ns + true_ns + true_ns * self.drift_ppb // _BILLION

    def true(self, local_ns: int) -> int:
        """Smallest true instant, from 0 on, at which the clock reads `local_ns` or later."""
        elapsed_ns = local_ns - self.offset_ns
        # floor(t * rate) >= elapsed exactly when t * rate >= elapsed: round t up.
        return max(0, -(-elapsed_ns * _BILLION // (_BILLION + self.drift_ppb)))


def draw_clocks(settings: ClockSettings, robots: Sequence[str], seed: int) -> list[LocalClock]:
    """One clock per robot, in robot order; depends on the robot's name and the seed alone."""
    keys = stable_keys(robots)
    bound_ppb = round(settings.drift_ppm * _PPB_PER_PPM)
    drifts = Draws(seed, "clock_drift").uniform(keys) * (2 * bound_ppb + 1)
    offsets = Draws(seed, "clock_offset").uniform(keys) * to_ns(settings.offset_s)
    return [
        LocalClock(int(offset), int(drift) - bound_ppb)
        for offset, drift in zip(offsets.tolist(), drifts.tolist(), strict=True)
    ]
