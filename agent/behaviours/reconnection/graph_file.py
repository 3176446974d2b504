"""Environments in files: JSON of what `channels.graphs.Graph` holds.

    {"vertices": [[x, y], ...], "edges": [[a, b, length], ...]}

Optional keys are links, starts and obstacles. An edge without a length, [a, b], is as long as its ends are
apart.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any

import msgspec

from channels.graph_text import measured
from channels.graphs import Graph, Point, Rectangle, check

_HELD = {
    "vertices": "must be a list of [x, y], each a number",
    "edges": "must be a list of [vertex, vertex, length], the length may be left out",
    "links": "must be a list of [vertex, vertex]",
    "starts": "must be a list of vertices",
    "obstacles": "must be a list of [x0, y0, x1, y1], each a number",
}


_Vertex = Annotated[int, msgspec.Meta(ge=-(10**9), le=10**9)]
"""Whether there is such a vertex is said better elsewhere, but not of numbers of a thousand digits."""


class _Document(msgspec.Struct, forbid_unknown_fields=True):
    vertices: tuple[Point, ...]
    edges: tuple[tuple[_Vertex | float, ...], ...]
    links: tuple[tuple[_Vertex, _Vertex], ...] | None = None
    starts: tuple[_Vertex, ...] | None = None
    obstacles: tuple[Rectangle, ...] = ()


def read_graph(path: str | Path) -> Graph:
    """The environment in a file. Raises ValueError, "file: key: what is wrong"."""
    try:
        raw = msgspec.json.decode(Path(path).read_bytes())
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror})") from None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"{path}: is not a graph in JSON ({error})") from None
    except ValueError as error:  # of the name itself, such as a null byte
        raise ValueError(f"{str(path)!r}: is no name of a file ({error})") from None
    try:
        graph = _graph(raw)
        check(graph)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return graph


def write_graph(path: str | Path, graph: Graph) -> None:
    """Write an environment to a new file. Raises ValueError where it is none, or the file exists."""
    check(graph)
    try:
        with Path(path).open("xb") as file:
            file.write(msgspec.json.encode(graph) + b"\n")
    except FileExistsError:
        raise ValueError(f"{path}: exists already; choose another name, or remove it") from None
    except OSError as error:
        raise ValueError(f"{path}: cannot be written ({error.strerror})") from None


def _graph(raw: Any) -> Graph:
    if not isinstance(raw, dict):
        raise ValueError('must be a table {"vertices": [[x, y], ...], "edges": [[a, b, length], ...]}')
    try:
        document = msgspec.convert(measured(raw), _Document)
    except msgspec.ValidationError as error:
        raise ValueError(_translated(str(error), raw)) from None
    edges = tuple(_edge(i, edge) for i, edge in enumerate(document.edges))
    return Graph(document.vertices, edges, document.links, document.starts, document.obstacles)


def _edge(number: int, edge: tuple[int | float, ...]) -> tuple[int, int, float]:
    if len(edge) != 3 or not all(isinstance(vertex, int) for vertex in edge[:2]):
        raise ValueError(f"edges: {_HELD['edges']}; edges[{number}] is not")
    return int(edge[0]), int(edge[1]), float(edge[2])


def _translated(message: str, raw: dict[Any, Any]) -> str:
    """What msgspec found, in words of the file."""
    unknown = sorted(str(key) for key in raw if key not in _HELD)
    if unknown:
        key = unknown[0][:60]
        return f"unknown key {key if key.isprintable() else ascii(key)}; possible are {', '.join(_HELD)}"
    missing = [key for key in ("vertices", "edges") if key not in raw]
    if missing:
        return f"{missing[0]}: is missing; it {_HELD[missing[0]]}"
    place = re.search(r"at `\$\.(\w+)(\[\d+\])?", message)
    key, entry = (place[1], place[2]) if place else ("edges", None)
    return f"{key}: {_HELD[key]}" + (f"; {key}{entry} is not" if entry else "")
