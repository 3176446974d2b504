"""Random environments: grids with holes, graphs of random points, mazes.

Vandermeulen et al. (sec. V) draw environments of 150 vertices and do not say how. Each kind here is one
guess; an environment is a pure function of its kind, its size, its seed and its options:

- `gridholes`: a square grid of which disjoint rectangular holes are cut out. `holes`: their share of the
  square's cells, at least (the square is the smallest that leaves enough); `side`: longest side of a hole, in
  cells; `rim`: how many cells holes keep off the square's sides. Holes are obstacles.
- `gabriel`: Gabriel graph of random points in a square. `gap`: least distance between points, as a multiple
  of the side of the square that each of them has on average; 0: independent points.
- `delaunay`: Delaunay triangulation of such points, without edges longer than `longest` times the median:
  along the hull there are some that join what is not near. Those of the Gabriel graph stay whatever their
  length, and with them, since they contain a minimum spanning tree, the graph stays in one piece.
- `delaunay-thinned`: of these, edges are taken away at random, but none that would cut the graph in two,
  until a vertex has `degree` of them on average.
- `maze`: a grid, of whose edges a random spanning tree is left; then `loops`, a share of the others, are
  put back at random. Walls between cells are obstacles.

Edges of equal length conserve parity: robots that never wait, and start an even number of edges apart, meet
at one vertex or not at all; those that start an odd number apart hear each other from neighbouring vertices.
In a square with sides of an even number of cells, opposite corners are an even number apart, others an odd
one.

For one seed, `gabriel` and both kinds of `delaunay` have the same points, but for the scale.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from agent.behaviours.reconnection.environment_cells import gridholes, maze
from agent.behaviours.reconnection.environment_parts import MARGIN
from agent.behaviours.reconnection.environment_points import delaunay, delaunay_thinned, gabriel
from channels.graphs import MOST_VERTICES, Graph

__all__ = ["KINDS", "MARGIN", "OPTIONS", "Option", "environment"]


class Option(NamedTuple):
    """A number that a kind of environment depends on; a whole one where the default is one."""

    default: float
    least: float
    most: float


_GAP = Option(0.0, 0.0, 0.7)
_LONGEST = Option(3.0, 1.0, math.inf)
OPTIONS: dict[str, dict[str, Option]] = {
    "gridholes": {"holes": Option(0.2, 0.0, 0.5), "side": Option(3, 1, 100), "rim": Option(1, 0, 100)},
    "gabriel": {"gap": _GAP},
    "delaunay": {"gap": _GAP, "longest": _LONGEST},
    "delaunay-thinned": {"gap": _GAP, "longest": _LONGEST, "degree": Option(3.4, 2.0, 6.0)},
    "maze": {"loops": Option(0.1, 0.0, 1.0)},
}
"""What can be set for each kind."""
KINDS = tuple(OPTIONS)


def environment(kind: str, vertices: int = 150, seed: int = 1, **options: float) -> Graph:
    """A random environment in one piece, of exactly so many vertices, its edges 1 unit long on average.

    Vertices are numbered from the lower left, along x first; none is nearer than `MARGIN` to the axes. Raises
    ValueError, "key: what is wrong", for what is out of range or no option of the kind.
    """
    if kind not in KINDS:
        raise ValueError(f"kind: must be {', '.join(KINDS[:-1])} or {KINDS[-1]}, is {kind}")
    _check_whole("vertices", vertices, 2, MOST_VERTICES)
    _check_whole("seed", seed, -math.inf, math.inf)
    known = OPTIONS[kind]
    for name, value in options.items():
        if name not in known:
            raise ValueError(f"{name}: {kind} has no such option; possible are {', '.join(known)}")
        _check_option(name, value, known[name])
    return _MAKERS[kind](vertices, seed, **{name: option.default for name, option in known.items()} | options)


def _check_option(name: str, value: Any, option: Option) -> None:
    if isinstance(option.default, int):
        _check_whole(name, value, option.least, option.most)
    elif isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{name}: must be a number, is {value}")
    elif not option.least <= value <= option.most:
        raise ValueError(f"{name}: must be {_between(option.least, option.most)}, is {value}")


def _check_whole(name: str, value: Any, least: float, most: float) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise ValueError(f"{name}: must be a whole number{_between(least, most, ' ')}, is {value}")


def _between(least: float, most: float, before: str = "") -> str:
    if math.isinf(most):
        return "" if math.isinf(least) else f"{before}{least:g} or more"
    return f"{before}{least:g} to {most:g}"


_MAKERS: dict[str, Callable[..., Graph]] = {
    "gridholes": gridholes,
    "gabriel": gabriel,
    "delaunay": delaunay,
    "delaunay-thinned": delaunay_thinned,
    "maze": maze,
}
