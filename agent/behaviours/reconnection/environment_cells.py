"""Random environments of cells in a grid: with holes, and mazes. Cell (x, y) is the unit square around it."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from agent.behaviours.reconnection.environment_parts import scaled, thinned
from channels.graphs import Bools, Floats, Graph, Ints, Rectangle
from channels.randomness import Draws

WALL = 0.1
"""How thick the walls of a maze are, in units."""

_LONGEST_SIDES = 1.25
"""Ratio of the sides of a rectangle of cells, at most (small ones excepted)."""
_TRIES = 4
"""How many holes are tried for each cell, before what is still too much goes cell by cell."""


def gridholes(vertices: int, seed: int, *, holes: float, side: int, rim: int) -> Graph:
    """A square grid of which disjoint rectangular holes are cut out; they are obstacles."""
    columns = rows = math.ceil(math.sqrt(vertices / (1 - holes)))
    free = np.ones((rows, columns), dtype=bool)
    draws = Draws(seed, "environment/gridholes")
    cut = [*_holes(free, vertices, draws, side, rim), *_single_holes(free, vertices, draws)]
    obstacles = [(x - 0.5, y - 0.5, x + w - 0.5, y + h - 0.5) for x, y, w, h in sorted(cut)]
    return scaled(_places(free), _pairs(_numbers(free)), obstacles)


def _holes(
    free: Bools, vertices: int, draws: Draws, side: int, rim: int
) -> Iterator[tuple[int, int, int, int]]:
    """Cut random holes (x, y, width, height) that leave so many cells, in one piece, and its corners."""
    rows, columns = free.shape
    surplus = free.size - vertices
    for attempt in range(_TRIES * free.size):
        if surplus == 0:
            return
        u = draws.uniform(attempt, np.arange(4))
        width, height = int(u[0] * side) + 1, int(u[1] * side) + 1
        room = columns - 2 * rim - width + 1, rows - 2 * rim - height + 1
        if width * height > surplus or min(room) <= 0:
            continue
        x, y = rim + int(u[2] * room[0]), rim + int(u[3] * room[1])
        hole = free[y : y + height, x : x + width]
        if not hole.all():
            continue
        hole[:] = False
        if free[np.ix_([0, -1], [0, -1])].all() and _still_in_one_piece(free, x, y, width, height):
            surplus -= width * height
            yield x, y, width, height
        else:
            hole[:] = True


def _single_holes(free: Bools, vertices: int, draws: Draws) -> Iterator[tuple[int, int, int, int]]:
    """Cut single cells until so many are left: inner ones if possible, corners last.

    There always is one, since of any connected graph at least two vertices can be spared.
    """
    rows, columns = free.shape
    y, x = np.divmod(np.arange(free.size), columns)
    sides = np.isin(y, (0, rows - 1)).astype(int) + np.isin(x, (0, columns - 1))
    order = np.lexsort((draws.bits(np.arange(free.size), -1), sides)).tolist()
    while np.count_nonzero(free) > vertices:
        for cell in order:
            at = int(x[cell]), int(y[cell])
            if free.flat[cell]:
                free.flat[cell] = False
                if _still_in_one_piece(free, *at, 1, 1):
                    yield *at, 1, 1
                    break
                free.flat[cell] = True


def maze(vertices: int, seed: int, *, loops: float) -> Graph:
    """A random spanning tree of a grid and a share of its other edges; walls are obstacles."""
    columns, rows = _rectangle(vertices)
    free = np.ones((rows, columns), dtype=bool)
    surplus = free.size - vertices
    # What is too much is taken from the middle of the uppermost row: robots start in corners.
    free[-1, (columns - surplus) // 2 :][:surplus] = False
    numbers = _numbers(free)
    pairs = _pairs(numbers)
    kept = vertices - 1 + round(loops * (len(pairs) - (vertices - 1)))
    left = thinned(vertices, pairs, kept, Draws(seed, "environment/maze"))
    return scaled(_places(free), left, _walls(numbers, left))


def _walls(numbers: Ints, pairs: Ints) -> list[Rectangle]:
    """Walls between cells that are joined no more, those in one line as one."""
    joined = {(int(a), int(b)) for a, b in pairs}
    upright = [(x - WALL / 2, y0, x + WALL / 2, y1) for x, y0, y1 in _lines(numbers, joined)]
    level = [(x0, y - WALL / 2, x1, y + WALL / 2) for y, x0, x1 in _lines(numbers.T, joined)]
    return upright + level


def _lines(numbers: Ints, joined: set[tuple[int, int]]) -> Iterator[tuple[float, float, float]]:
    """Where walls stand between cells of one row, as seen along the rows: place, from where, to where."""
    for x in range(numbers.shape[1] - 1):
        sides = zip(numbers[:, x].tolist(), numbers[:, x + 1].tolist(), strict=True)
        closed = [min(pair) >= 0 and pair not in joined for pair in sides]
        turns = np.flatnonzero(np.diff([False, *closed, False]))
        for start, end in turns.reshape(-1, 2).tolist():
            yield x + 0.5, start - 0.5, end - 0.5


def _rectangle(cells: int) -> tuple[int, int]:
    """Columns and rows of the smallest rectangle of so many cells or more; of several, the squarest."""
    most = max(2, math.floor(math.sqrt(cells * _LONGEST_SIDES)))
    least = min(most, math.ceil(math.sqrt(cells / _LONGEST_SIDES)))
    sides = [(columns, math.ceil(cells / columns)) for columns in range(least, most + 1)]
    return min(sides, key=lambda pair: (pair[0] * pair[1], abs(pair[0] - pair[1])))


def _places(free: Bools) -> Floats:
    """x, y of every free cell."""
    return np.argwhere(free)[:, ::-1].astype(np.float64)


def _numbers(free: Bools) -> Ints:
    """Number of every free cell, along the rows, and -1 of others."""
    return np.where(free, np.cumsum(free).reshape(free.shape) - 1, -1)


def _pairs(numbers: Ints) -> Ints:
    """Pairs of cells that are neighbours, in order: (E, 2)."""
    beside = [numbers[:, :-1].ravel(), numbers[:, 1:].ravel()]
    above = [numbers[:-1].ravel(), numbers[1:].ravel()]
    pairs = np.concatenate([np.stack(beside, axis=1), np.stack(above, axis=1)])
    pairs = pairs[(pairs >= 0).all(axis=1)]
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]


def _still_in_one_piece(free: Bools, x: int, y: int, width: int, height: int) -> bool:
    """Whether cells that were in one piece still are, now that a hole has been cut."""
    around = np.pad(free, 1)[y : y + height + 2, x : x + width + 2]
    ring = np.concatenate([around[0, :-1], around[:-1, -1], around[-1, :0:-1], around[:0:-1, 0]])
    # One goes around a hole if what is free around it is one run; otherwise there may be another way.
    return int(np.count_nonzero(ring & ~np.roll(ring, 1))) <= 1 or _in_one_piece(free)


def _in_one_piece(free: Bools) -> bool:
    columns = free.shape[1] + 1
    left = bytearray(np.pad(free, ((0, 1), (0, 1))).tobytes())
    reached = [left.index(1)]
    left[reached[0]] = 0
    for cell in reached:
        # Beyond each row and after the last there are blocked cells; negative indices lead to the last.
        for other in (cell - columns, cell - 1, cell + 1, cell + columns):
            if left[other]:
                left[other] = 0
                reached.append(other)
    return not any(left)
