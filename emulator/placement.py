"""Where robots start: sides of squares, grids, directions. Pure functions of numbers."""

from __future__ import annotations

import math

Vector = tuple[float, float]


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
    return speed_mps * quantised(math.cos(heading_rad)), speed_mps * quantised(math.sin(heading_rad))


def grid(robots: int, width_m: float, height_m: float) -> list[Vector]:
    """Centres of the cells of a grid of about square cells, row by row from (0, 0).

    The last row may have free cells.
    """
    columns = min(robots, math.ceil(math.sqrt(robots * width_m / height_m)))
    rows = math.ceil(robots / columns)
    cell_x_m, cell_y_m = width_m / columns, height_m / rows
    return [((k % columns + 0.5) * cell_x_m, (k // columns + 0.5) * cell_y_m) for k in range(robots)]


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
