"""What files of graphs may leave out: an edge [a, b] is as long as its ends are apart.

Otherwise they hold a `channels.graphs.Graph` as JSON.
"""

from __future__ import annotations

import math
from typing import Any


def measured(raw: dict[Any, Any]) -> dict[Any, Any]:
    """The same document, decoded, with a length for every edge that is only [a, b].

    Whatever does not look like an edge, or has an end that is no proper vertex, stays as it is: those who
    read the document know better how to tell what is wrong with it.
    """
    vertices, edges = raw.get("vertices"), raw.get("edges")
    if not isinstance(vertices, list) or not isinstance(edges, list):
        return raw
    return raw | {"edges": [_measured(edge, vertices) for edge in edges]}


def _measured(edge: Any, vertices: list[Any]) -> Any:
    if not isinstance(edge, list) or len(edge) != 2 or not all(type(vertex) is int for vertex in edge):
        return edge
    a, b = edge
    if not (0 <= a < len(vertices) and 0 <= b < len(vertices)):
        return [a, b, 1.0]  # of any length: that there is no such vertex is what is wrong with it
    ends = vertices[a], vertices[b]
    if not all(_is_point(end) for end in ends):
        return edge
    return [a, b, math.dist(*ends)]


def _is_point(raw: Any) -> bool:
    """Whether these are two numbers; whole ones may be too long to compute with."""
    return (
        isinstance(raw, list)
        and len(raw) == 2
        and all(type(number) in (int, float) and abs(number) <= 1e300 for number in raw)
    )
