"""Estimates on the air: six 32-bit integers each (Julian et al. 2009, sec. 4).

| field | unit | least | most |
|---|---|---|---|
| identification: the robot's number | 1 | 0 | n - 1 |
| time stamp | ms | 0 | 2^31 - 1 (24.8 days) |
| latitude | 1e-7 degrees (1.1 cm) | -900 000 000 | 900 000 000 |
| longitude | 1e-7 degrees | -1 800 000 000 | 1 800 000 000 |
| altitude | mm | -2^31 | 2^31 - 1 (2147 km) |
| yaw | 1e-6 rad | -3 141 593 | 3 141 593 |

Signed, big-endian, in this order: 24 bytes or 192 bits. A packet is nothing but its estimates, one after
the other. Values are rounded to the nearest unit.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable

from agent.behaviours.dissemination.estimates import Estimate
from agent.behaviours.dissemination.geodesy import TangentPlane

ESTIMATE_BYTES = 24
ESTIMATE_BITS = 8 * ESTIMATE_BYTES

_LAYOUT = struct.Struct(">6i")
_MOST = 2**31 - 1
_DEGREE = 10_000_000
_FIELDS = ("number", "time stamp", "latitude", "longitude", "altitude", "yaw")
_LEAST = (0, 0, -90 * _DEGREE, -180 * _DEGREE, -(2**31), -3_141_593)
_GREATEST = (_MOST, _MOST, 90 * _DEGREE, 180 * _DEGREE, _MOST, 3_141_593)


class PacketError(ValueError):
    """A packet that is none, or estimates that do not fit into one."""


class Wire:
    """Packs and unpacks the estimates of one team.

    `plane`: how places in metres become degrees, the same for all; `team`: n.
    """

    def __init__(self, plane: TangentPlane, team: int) -> None:
        self._plane = plane
        self._greatest = (team - 1, *_GREATEST[1:])

    def pack(self, estimates: Iterable[Estimate]) -> bytes:
        """One packet of these estimates. Raises PacketError, which names the field, for what does not fit.

        Any finite yaw fits: it is turned into -pi to pi.
        """
        return b"".join(_LAYOUT.pack(*self._integers(each)) for each in estimates)

    def unpack(self, packet: bytes) -> list[Estimate]:
        """The estimates of a packet, in their order. Raises PacketError for what nobody can have packed."""
        if len(packet) % ESTIMATE_BYTES:
            size = len(packet)
            raise PacketError(f"packet: {size} bytes are no whole number of estimates of {ESTIMATE_BYTES}")
        return [self._estimate(fields) for fields in _LAYOUT.iter_unpack(packet)]

    def _integers(self, estimate: Estimate) -> tuple[int, ...]:
        latitude, longitude = self._plane.to_degrees(estimate.x_m, estimate.y_m)
        values = (
            latitude * _DEGREE,
            longitude * _DEGREE,
            estimate.z_m * 1000,
            math.remainder(estimate.yaw_rad, math.tau) * 1_000_000
            if math.isfinite(estimate.yaw_rad)
            else math.nan,
        )
        for name, value in zip(_FIELDS[2:], values, strict=True):
            if not math.isfinite(value):
                raise PacketError(f"{name}: of robot {estimate.number} is {value}; it must be finite")
        fields = (estimate.number, estimate.time_ms, *map(round, values))
        self._check(fields)
        return fields

    def _estimate(self, fields: tuple[int, ...]) -> Estimate:
        self._check(fields)
        number, time_ms, latitude, longitude, altitude, yaw = fields
        x_m, y_m = self._plane.to_metres(latitude / _DEGREE, longitude / _DEGREE)
        return Estimate(number, time_ms, x_m, y_m, altitude / 1000, yaw / 1_000_000)

    def _check(self, fields: tuple[int, ...]) -> None:
        for name, value, least, most in zip(_FIELDS, fields, _LEAST, self._greatest, strict=True):
            if not least <= value <= most:
                raise PacketError(f"{name}: an estimate has {value}; it must lie within {least} to {most}")
