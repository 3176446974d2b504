"""Environments from images: an approximate cellular decomposition of an occupancy grid.

The image is cut into square blocks, from the lower left. The free pixels of a block that hang together (by
their sides) are a cell, unless they are too few: two cells where a wall runs through a block. A cell's vertex
is that of its pixels that is nearest to the centre of all of them. Cells that touch across the border of
their blocks are joined by an edge, as long as it is from vertex to vertex by way of the pixel side through
which that is shortest. Of what is not in one piece, the part with the most cells is kept.

One block is one unit; x goes to the right and y upwards from the image's lower left corner.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from msgspec import Struct

from channels.graphs import MOST_VERTICES, Bools, Floats, Graph, Ints, Rectangle

FREE = 0.196
"""Pixels less dark than this, of 0 (white) to 1 (black), are free: as ROS's map_server's `free_thresh`."""
MIN_SHARE = 0.1
"""Which share of a block a cell fills at least."""

_OVERLAP = 1e-3
"""By how much of a pixel obstacles are larger than drawn: nobody sees between two that touch at a corner
(nor along a single corner)."""
_NEEDS = "environments from images need {}; install heliograph[desk]"


class Decomposition(Struct, frozen=True):
    """What has become of an image."""

    graph: Graph
    too_small: int
    """How many cells were left out because they filled too little of their block."""
    cut_off: int
    """How many because no way leads to them."""


def occupancy(seed: int, image: str, cell: int, free: float = FREE, min_share: float = MIN_SHARE) -> Graph:
    """`from_image` as a generator of scenarios; the seed changes nothing."""
    return from_image(image, cell, free, min_share)


def from_image(path: str | Path, cell: int, free: float = FREE, min_share: float = MIN_SHARE) -> Graph:
    """The environment that a PGM or PNG image shows; `decomposed` says what was left out."""
    return decomposed(path, cell, free, min_share).graph


def decomposed(
    path: str | Path, cell: int, free: float = FREE, min_share: float = MIN_SHARE
) -> Decomposition:
    """Decompose an image into cells of blocks of `cell` x `cell` pixels.

    Free are pixels whose darkness, of 0 (white) to 1 (black), is less than `free`; a cell has at least
    `min_share` of a block's pixels. Raises ValueError, "key: what is wrong"; keys are the parameters of
    `occupancy`.
    """
    if isinstance(cell, bool) or not isinstance(cell, int) or cell < 1:
        raise ValueError(f"cell: must be a whole number of pixels, 1 or more, is {cell}")
    for name, value in (("free", free), ("min_share", min_share)):
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= 1:
            raise ValueError(f"{name}: must be a number from 0 to 1, is {value}")
    open_pixels = _darkness(path) < free
    if not open_pixels.any():
        raise ValueError(
            f"image: {path} has no pixel lighter than free = {free}; white is free, black is not"
        )
    labels, too_small = _labelled(open_pixels, cell, min_share)
    if too_small and labels.max() < 0:
        raise ValueError(f"min_share: no cell of {path} fills {min_share} of its block; choose less")
    graph, cut_off = _largest_part(labels, cell)
    _check_count(path, cell, len(graph.vertices))
    obstacles = _obstacles(~open_pixels, cell)
    return Decomposition(Graph(graph.vertices, graph.edges, obstacles=obstacles), too_small, cut_off)


def _darkness(path: str | Path) -> Floats:
    """(rows, columns) from below, 0 (white) to 1 (black)."""
    try:
        from PIL import Image
    except ModuleNotFoundError:
        raise ModuleNotFoundError(_NEEDS.format("Pillow"), name="PIL") from None
    if not isinstance(path, str | Path):
        raise ValueError(f"image: must be the path of an image, is {path}")
    try:
        with Image.open(path, formats=("PPM", "PNG")) as image:
            # Grey of 16 bits comes in modes of their own, and would be cut off at 255.
            deep = image.mode.startswith("I")
            grey = np.asarray(image if deep else image.convert("L")) / (65535 if deep else 255)
    except (OSError, SyntaxError, ValueError, EOFError, Image.DecompressionBombError) as error:
        why = getattr(error, "strerror", None) or "it is no PGM or PNG image"
        raise ValueError(f"image: {path} cannot be read ({why})") from None
    return np.asarray(1 - grey[::-1])


def _labelled(free: Bools, cell: int, min_share: float) -> tuple[Ints, int]:
    """The cell of each pixel, from 0, or -1 where there is none; how many cells were too small."""
    try:
        from scipy import ndimage
    except ModuleNotFoundError:
        raise ModuleNotFoundError(_NEEDS.format("SciPy"), name="scipy") from None
    # Blocked lines between blocks keep what is free in one apart from what is free in the next.
    y, x = (np.arange(count) + np.arange(count) // cell for count in free.shape)
    apart = np.zeros((y[-1] + 1, x[-1] + 1), dtype=bool)
    apart[np.ix_(y, x)] = free
    labels = ndimage.label(apart)[0][np.ix_(y, x)]
    large = np.bincount(labels.ravel()) >= min_share * cell * cell
    large[0] = False  # what is not free
    numbers = np.where(large, np.cumsum(large) - 1, -1)
    return numbers[labels], len(large) - 1 - int(np.count_nonzero(large))


def _largest_part(labels: Ints, cell: int) -> tuple[Graph, int]:
    """Vertices from the lower left, along x first; and how many cells no way leads to."""
    pixels = _vertex_pixels(labels)
    pairs, lengths = _contacts(labels, pixels)
    part = _parts(len(pixels), pairs)
    kept = part == np.bincount(part).argmax()
    order = np.flatnonzero(kept)[np.lexsort(pixels[kept].T[::-1])]
    number = np.full(len(pixels), -1)
    number[order] = np.arange(len(order))
    ends = np.sort(number[pairs], axis=1)
    edges = [(a, b, length / cell) for (a, b), length in zip(ends.tolist(), lengths.tolist(), strict=True)]
    places = ((pixels[order, ::-1] + 0.5) / cell).tolist()
    graph = Graph(tuple((x, y) for x, y in places), tuple(sorted(edge for edge in edges if edge[0] >= 0)))
    return graph, len(pixels) - len(order)


def _vertex_pixels(labels: Ints) -> Ints:
    """Row and column (C, 2) of the pixel of every cell nearest to its centroid, the first of several."""
    places = np.argwhere(labels >= 0)
    of = labels[labels >= 0]
    sizes = np.bincount(of)
    squared = np.zeros(len(of))
    for axis in range(2):
        squared += (places[:, axis] - (np.bincount(of, weights=places[:, axis]) / sizes)[of]) ** 2
    order = np.lexsort((squared, of))
    return np.asarray(places[order[np.cumsum(sizes) - sizes]])


def _contacts(labels: Ints, pixels: Ints) -> tuple[Ints, Floats]:
    """Pairs of cells that touch (E, 2), and how far it is between their vertices, in pixels (E,)."""
    beside, above = (labels[:, :-1], labels[:, 1:]), (labels[:-1], labels[1:])
    both, middles = [], []
    for (one, other), middle in ((beside, (0.0, 0.5)), (above, (0.5, 0.0))):
        touch = (one >= 0) & (other >= 0) & (one != other)
        both.append(np.stack([one[touch], other[touch]], axis=1))
        middles.append(np.argwhere(touch) + middle)
    through = np.concatenate(middles)
    ends = np.sort(np.concatenate(both), axis=1)
    lengths = sum(np.sqrt(((pixels[ends[:, i]] - through) ** 2).sum(axis=1)) for i in range(2))
    pairs, which = np.unique(ends, axis=0, return_inverse=True)
    shortest = np.full(len(pairs), np.inf)
    np.minimum.at(shortest, which.ravel(), lengths)
    return pairs, shortest


def _parts(count: int, pairs: Ints) -> Ints:
    """To which part each of so many vertices belongs: (C,), parts numbered by their first vertex."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    joined = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(connected_components(joined, directed=False)[1])


def _obstacles(blocked: Bools, cell: int) -> tuple[Rectangle, ...]:
    """Rectangles that cover these pixels: runs along rows, or along columns if they are fewer."""
    level, upright = _runs(blocked), _runs(blocked.T)[:, [1, 0, 3, 2]]
    corners = (level if len(level) <= len(upright) else upright).reshape(-1, 2, 2)
    larger = np.add(corners, [[-_OVERLAP], [_OVERLAP]])
    rectangles = (larger.clip(0, blocked.shape[::-1]) / cell).reshape(-1, 4)
    return tuple((x0, y0, x1, y1) for x0, y0, x1, y1 in sorted(map(tuple, rectangles.tolist())))


def _runs(blocked: Bools) -> Ints:
    """x0, y0, x1, y1 of runs along rows; one above another of the same extent are one: (R, 4)."""
    turns = np.diff(np.pad(blocked.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    rows, starts = np.nonzero(turns == 1)
    ends = np.nonzero(turns == -1)[1]
    order = np.lexsort((rows, ends, starts))
    y, x0, x1 = rows[order], starts[order], ends[order]
    same = (np.diff(x0) == 0) & (np.diff(x1) == 0) & (np.diff(y) == 1)
    first = np.flatnonzero(np.concatenate([[True], ~same])[: len(y)])
    last = np.append(first[1:], len(y)) - 1 if len(y) else first
    return np.stack([x0[first], y[first], x1[first], y[last] + 1], axis=1)


def _check_count(path: str | Path, cell: int, count: int) -> None:
    if count < 2:
        raise ValueError(
            f"cell: blocks of {cell} pixels leave no two cells of {path} that touch; choose less"
        )
    if count > MOST_VERTICES:
        why = f"cut {path} into {count} cells, more than {MOST_VERTICES}"
        raise ValueError(f"cell: blocks of {cell} pixels {why}; choose more")
