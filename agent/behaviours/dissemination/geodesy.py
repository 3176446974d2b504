"""Metres on a plane that touches the Earth, and degrees."""

from __future__ import annotations

import math

EQUATOR_M = 6_378_137.0
"""Semi-major axis of the WGS 84 ellipsoid."""
FLATTENING = 1 / 298.257223563
POLE_DEG = 89.0
"""Beyond it degrees of longitude are too short to count in."""


class TangentPlane:
    """x to the east, y to the north [m], from an origin.

    A metre is as many degrees everywhere as at the origin: by the radii of curvature of WGS 84, along
    the meridian for latitude and across it for longitude. There and back is exact up to rounding; against
    the ellipsoid, what is d away errs by about d^2 tan(latitude) / 6400 km: 2 m at 5 km and 30 degrees.

    `origin_deg`: latitude and longitude. Raises ValueError within a degree of a pole or out of range.
    """

    def __init__(self, origin_deg: tuple[float, float]) -> None:
        latitude, longitude = origin_deg
        if not abs(latitude) <= POLE_DEG:
            raise ValueError(f"origin_deg: latitude must lie within -89 to 89 degrees, is {latitude}")
        if not abs(longitude) <= 180:
            raise ValueError(f"origin_deg: longitude must lie within -180 to 180 degrees, is {longitude}")
        self._latitude, self._longitude = latitude, longitude
        squared_eccentricity = FLATTENING * (2 - FLATTENING)
        w = 1 - squared_eccentricity * math.sin(math.radians(latitude)) ** 2
        across = EQUATOR_M / math.sqrt(w)
        along = EQUATOR_M * (1 - squared_eccentricity) / w**1.5
        self._north_m = math.radians(along)
        self._east_m = math.radians(across) * math.cos(math.radians(latitude))

    def to_degrees(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Latitude and longitude; the longitude in -180 to 180."""
        longitude = math.remainder(self._longitude + x_m / self._east_m, 360)
        return self._latitude + y_m / self._north_m, longitude

    def to_metres(self, latitude: float, longitude: float) -> tuple[float, float]:
        """Metres to the east and to the north, by the shorter way around the Earth."""
        east = math.remainder(longitude - self._longitude, 360)
        return east * self._east_m, (latitude - self._latitude) * self._north_m
