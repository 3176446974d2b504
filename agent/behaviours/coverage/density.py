"""How much it matters to cover each point of the area: phi(q) of Cortes et al. (2004), and its moments.

phi(q) = floor + sum of weight exp(-|q - centre|^2 / (2 sigma^2)). By the divergence theorem every moment over
a cell is an integral along its edges: exact for the floor; for a Gaussian a smooth function of one variable,
by Gauss-Legendre quadrature with 12 points for every 2 sigma of an edge. Its error is below 1e-14 of what the
Gaussian has over the whole plane (mass 2 pi sigma^2 weight; sigma times that for x and y).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from agent.behaviours.coverage.cells import Place

Floats = NDArray[np.float64]

LEAST_SIGMA = 0.01
"""Of the area's longer side: finer hills are points."""
MOST_SIGMA = 100.0
"""Likewise: wider ones are as good as flat, and their moments lose digits."""
LEAST_FLOOR = 1e-6
"""Of the highest weight: with less, cells far from all hills would have no mass worth the name."""
MOST_HILLS = 64
PANEL_SIGMAS = 2.0

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)


class Moments(Struct, frozen=True):
    """Integrals over a cell, of phi times powers of the distance from a point."""

    mass: float
    x: float
    """Of (x - x of the point) phi."""
    y: float
    square: float
    """Of |q - point|^2 phi: what a robot at the point costs (no factor 1/2)."""


class Hill(Struct, frozen=True):
    """One Gaussian."""

    x_m: float
    y_m: float
    sigma_m: float
    """Standard deviation, in all directions."""
    weight: float
    """Its height."""


class Density(Struct, frozen=True):
    """A sum of Gaussians on a floor; without Gaussians it is uniform."""

    floor: float = 1.0
    hills: tuple[Hill, ...] = ()

    def __call__(self, x_m: Floats, y_m: Floats) -> Floats:
        """Its value at points; any shape."""
        value = np.full(np.shape(x_m), self.floor)
        for hill in self.hills:
            square = (x_m - hill.x_m) ** 2 + (y_m - hill.y_m) ** 2
            value += hill.weight * np.exp(-square / (2 * hill.sigma_m**2))
        return value

    def moments(self, ring: Floats, about: Place) -> Moments:
        """Of a cell with these corners, counterclockwise, shape (corners, 2) [m]."""
        found = self.floor * _uniform(ring - np.array(about))
        for hill in self.hills:
            centre = np.array((hill.x_m, hill.y_m))
            of_hill = hill.weight * _gaussian(ring - centre, hill.sigma_m)
            found = found + _shifted(of_hill, centre - np.array(about))
        return Moments(*found.tolist())


UNIFORM = Density()


def density_from(params: Mapping[str, Any], area_m: tuple[float, float]) -> Density:
    """The density that `params.density` describes: "uniform" (or nothing), or a table of floor and hills.

    `{floor = 1.0, hills = [{x_m = 20.0, y_m = 70.0, sigma_m = 10.0, weight = 5.0}]}`. Raises ValueError,
    "params.density...: what is wrong and what helps".
    """
    described = params.get("density", "uniform")
    if described == "uniform":
        return UNIFORM
    if not isinstance(described, Mapping):
        raise ValueError(f'params.density: must be "uniform" or a table of floor and hills, is {described!r}')
    _only(described, ("floor", "hills"), "params.density")
    listed = described.get("hills", ())
    if isinstance(listed, str | Mapping) or not isinstance(listed, Sequence) or len(listed) > MOST_HILLS:
        raise ValueError(f"params.density.hills: must be a list of at most {MOST_HILLS} tables")
    hills = tuple(_hill(each, f"params.density.hills[{place}]", area_m) for place, each in enumerate(listed))
    floor = _number({"floor": 1.0, **described}, "floor", "params.density", 0.0)
    least = LEAST_FLOOR * max((hill.weight for hill in hills), default=0.0)
    if not floor > 0 or floor < least:
        raise ValueError(
            f"params.density.floor: must be greater than 0 and at least {LEAST_FLOOR:g} of the highest "
            f"weight, is {floor:g}"
        )
    return Density(floor, hills)


def _hill(described: Any, key: str, area_m: tuple[float, float]) -> Hill:
    if not isinstance(described, Mapping):
        raise ValueError(f"{key}: must be a table of x_m, y_m, sigma_m and weight, is {described!r}")
    _only(described, ("x_m", "y_m", "sigma_m", "weight"), key)
    side = max(area_m)
    return Hill(
        x_m=_number(described, "x_m", key, -math.inf),
        y_m=_number(described, "y_m", key, -math.inf),
        sigma_m=_number(described, "sigma_m", key, LEAST_SIGMA * side, MOST_SIGMA * side),
        weight=_number(described, "weight", key, 0.0),
    )


def _number(table: Mapping[str, Any], name: str, key: str, least: float, most: float = math.inf) -> float:
    words = "a number"
    if math.isfinite(least):
        words += f" of at least {least:g}" + (f" and at most {most:g}" if math.isfinite(most) else "")
    if name not in table:
        raise ValueError(f"{key}.{name}: is missing; write {words}")
    value = table[name]
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not math.isfinite(value) or not least <= value <= most:
        raise ValueError(f"{key}.{name}: must be {words}, is {value!r}")
    return float(value)


def _only(table: Mapping[str, Any], names: Sequence[str], key: str) -> None:
    for name in table:
        if name not in names:
            raise ValueError(f"{key}.{name}: is not known here; there are {', '.join(names)}")


# --- moments about the origin: mass, x, y, square ------------------------------------------------


def _uniform(ring: Floats) -> Floats:
    """Of density 1, by triangles from the origin to each edge."""
    begin, end = ring, np.roll(ring, -1, axis=0)
    double = begin[:, 0] * end[:, 1] - begin[:, 1] * end[:, 0]
    first = double @ (begin + end) / 6
    square = double @ (begin * begin + begin * end + end * end).sum(axis=1) / 12
    return np.array((double.sum() / 2, first[0], first[1], square))


def _gaussian(ring: Floats, sigma: float) -> Floats:
    """Of g(q) = exp(-|q|^2 / (2 sigma^2)), by the fluxes through the edges of three fields.

    phi(r^2) q, with phi(u) = sigma^2 (1 - exp(-u / (2 sigma^2))) / u, has the divergence g; -sigma^2 g in
    the direction of x that of x g; and g q that of 2 g - |q|^2 g / sigma^2.
    """
    points, steps = _along(ring, sigma)
    square = (points**2).sum(axis=1)
    outwards = points[:, 0] * steps[:, 1] - points[:, 1] * steps[:, 0]
    scaled = square / (2 * sigma**2)
    height = np.exp(-scaled)
    # (1 - exp(-s)) / s, which is 1 at 0
    quotient = np.where(scaled > 0, -np.expm1(-scaled) / np.where(scaled > 0, scaled, 1.0), 1.0)
    mass = (quotient / 2 * outwards).sum()
    first = -(sigma**2) * (height @ np.stack([steps[:, 1], -steps[:, 0]], axis=1))
    return np.array((mass, first[0], first[1], sigma**2 * (2 * mass - height @ outwards)))


def _along(ring: Floats, sigma: float) -> tuple[Floats, Floats]:
    """Points on the edges, and the piece of edge that each stands for; shape (points, 2) each."""
    points, steps = [], []
    for begin, edge in zip(ring, np.roll(ring, -1, axis=0) - ring, strict=True):
        panels = max(1, math.ceil(math.hypot(*edge) / (PANEL_SIGMAS * sigma)))
        part = ((np.arange(panels)[:, np.newaxis] + (_NODES + 1) / 2) / panels).ravel()
        points.append(begin + part[:, np.newaxis] * edge)
        steps.append(np.tile(_WEIGHTS / (2 * panels), panels)[:, np.newaxis] * edge)
    return np.concatenate(points), np.concatenate(steps)


def _shifted(moments: Floats, by: Floats) -> Floats:
    """Moments about a point, from those about another point that lies `by` from it."""
    mass, x, y, square = moments
    return np.array((
        mass, x + by[0] * mass, y + by[1] * mass,
        square + 2 * (by[0] * x + by[1] * y) + (by[0] ** 2 + by[1] ** 2) * mass,
    ))  # fmt: skip
