"""Where robots start: sides of squares, grids, directions. Pure functions of seed, ids and numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

from channels.graphs import Graph, starts
from channels.randomness import Draws, stable_keys

Vector = tuple[float, float]
Placement = Literal["uniform", "grid", "jittered_grid", "graph"]
"""Anywhere in the area; in the centre of a cell of its own; anywhere in a cell of its own; at a start of the
world's graph."""

CENTRE = (0.5, 0.5)


def quantised(angle_rad: float) -> float:
    """An angle, sine or cosine to 1e-9: the last bits of libm's functions differ between machines."""
    return round(angle_rad, 9)


def heading_of(velocity_mps: Vector, *, otherwise: float) -> float:
    """Direction of a velocity [rad], to 1e-9; `otherwise` for a velocity of zero."""
    if velocity_mps == (0.0, 0.0):
        return otherwise
    # Adding zero turns -0.0 into 0.0, which atan2 would take to the other side of pi.
    return quantised(math.atan2(velocity_mps[1] + 0.0, velocity_mps[0]))


def along(heading_rad: float, speed_mps: float) -> Vector:
    """Velocity [m/s] in a direction; equal on every machine, its speed right to 1e-9."""
    if speed_mps == 0:
        return 0.0, 0.0  # no component of which is -0.0
    return speed_mps * quantised(math.cos(heading_rad)), speed_mps * quantised(math.sin(heading_rad))


def places(
    placement: Placement,
    seed: int,
    ids: Sequence[str],
    width_m: float,
    height_m: float,
    graph: Graph | None = None,
) -> list[Vector]:
    """Where each robot of a team starts [m] if all of it is placed in one way, in team order.

    What is drawn for a robot depends on the seed, the placement and its own id only; its cell of a grid
    follows from its index in the team. `jittered_grid`: Ivanov & Shell 2016, sec. 5.4, perturbed uniformly
    by up to half a grid spacing in either direction along each axis. `graph`: of the placement of that name.
    """
    if placement == "graph":
        assert graph is not None
        return [graph.vertices[vertex] for vertex in starts(graph, len(ids))]
    if placement == "grid":
        return grid(len(ids), width_m, height_m)
    if placement == "jittered_grid":
        return grid(len(ids), width_m, height_m, _drawn(seed, "jitter", ids))
    return [(x * width_m, y * height_m) for x, y in _drawn(seed, "placement", ids)]


def drawn_headings(seed: int, ids: Sequence[str]) -> list[float]:
    """A direction [rad] for each robot, uniform, to 1e-9."""
    draws = Draws(seed, "placement").uniform(stable_keys(ids), 2)
    return [quantised(math.pi * (2.0 * float(draw) - 1.0)) for draw in draws]


def grid(
    robots: int, width_m: float, height_m: float, within: Sequence[Vector] | None = None
) -> list[Vector]:
    """One place in each cell of a grid of about square cells, row by row from (0, 0).

    `within`: where in its cell each robot is, as shares of the cell; None: in the centre. The last row may
    have free cells.
    """
    columns = min(robots, math.ceil(math.sqrt(robots * width_m / height_m)))
    rows = math.ceil(robots / columns)
    cell_x_m, cell_y_m = width_m / columns, height_m / rows
    return [
        # Rounding must not carry anybody out of the area.
        (min((k % columns + x) * cell_x_m, width_m), min((k // columns + y) * cell_y_m, height_m))
        for k, (x, y) in enumerate(within or [CENTRE] * robots)
    ]


def _drawn(seed: int, stream: str, ids: Sequence[str]) -> list[Vector]:
    """Two numbers in [0, 1) for each robot, uniform."""
    draws, keys = Draws(seed, stream), stable_keys(ids)
    return list(zip(draws.uniform(keys, 0).tolist(), draws.uniform(keys, 1).tolist(), strict=True))


def side_for_neighbours(robots: int, neighbours: float, range_m: float) -> float:
    """Side [m] of the square in which one of `robots` has `neighbours` others in range, in the mean.

    With as many neighbours as there are others, the square is the largest in which all are in range
    of each other. The rest is bisection on the distribution of the distance between two points.
    """
    if robots - 1 <= neighbours:
        return range_m / math.sqrt(2.0)
    near, far = 1.0 / math.sqrt(2.0), 1.0
    while (robots - 1) * probability_in_range(1.0 / far) > neighbours:
        near, far = far, 2.0 * far
    for _ in range(60):
        middle = 0.5 * (near + far)
        if (robots - 1) * probability_in_range(1.0 / middle) > neighbours:
            near = middle
        else:
            far = middle
    # Nine digits are all a user can want, and equal on every machine, whatever its arctangent.
    return float(f"{range_m * far:.9g}")


def probability_in_range(reach: float) -> float:
    """Probability that two uniform points in the unit square are at most `reach` apart.

    Edge effects included ("square line picking"; Philip 2007, "The probability distribution of the
    distance between two random points in a box").
    """
    square = reach * reach
    if reach <= 1.0:
        return math.pi * square - 8.0 / 3.0 * square * reach + 0.5 * square * square
    if square >= 2.0:
        return 1.0
    u = math.sqrt(square - 1.0)
    arc = math.pi - 2.0 - 4.0 * math.atan(u)
    return 1.0 / 3.0 + arc * square - 0.5 * square * square + 8.0 / 3.0 * u * u * u + 4.0 * u
