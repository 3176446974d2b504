"""Robots on a lattice with unit spacing: who hears whom, how far apart they are, which are in the middle."""

from __future__ import annotations

import re
from typing import Literal

import networkx as nx
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from emulator.slots import colouring

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

Neighbours = Literal[4, 8, 6]
ALL = "all"


class Lattice(Struct, frozen=True):
    """`rows` x `columns` robots, numbered along the rows.

    `neighbours`: 4 or 8 on a square lattice; 6 on a triangular one, whose rows are sqrt(3)/2 apart and
    every other of them shifted by a half.
    """

    rows: int
    columns: int
    neighbours: Neighbours

    @property
    def robots(self) -> int:
        """How many there are."""
        return self.rows * self.columns

    def places(self) -> Floats:
        """(n, 2): x along the rows, y across, with unit spacing."""
        twice_x, y = self._counted()
        return np.stack([twice_x / 2, y * (np.sqrt(3) / 2 if self.neighbours == 6 else 1.0)], axis=1)

    def squared_distances(self) -> Ints:
        """(n, n): four times the squared distance of each two robots: whole numbers on either lattice."""
        twice_x, y = self._counted()
        along, across = twice_x[:, np.newaxis] - twice_x, y[:, np.newaxis] - y
        return along**2 + across**2 * (3 if self.neighbours == 6 else 4)

    def euclidean(self) -> Floats:
        """(n, n): distances, equal where they are equal by geometry."""
        return np.sqrt(self.squared_distances()) / 2

    def links(self) -> NDArray[np.bool_]:
        """(n, n): who hears whom; nobody itself."""
        squared = self.squared_distances()
        return (squared > 0) & (squared <= (8 if self.neighbours == 8 else 4))

    def graph(self) -> nx.Graph[int]:
        """The connectivity graph, nodes by number."""
        graph: nx.Graph[int] = nx.Graph()
        graph.add_nodes_from(range(self.robots))
        graph.add_edges_from(np.argwhere(np.triu(self.links())).tolist())
        return graph

    def hops(self) -> Floats:
        """(n, n): hops of the shortest path between each two robots."""
        found = np.zeros((self.robots, self.robots))
        for start, lengths in nx.all_pairs_shortest_path_length(self.graph()):
            found[start, list(lengths)] = list(lengths.values())
        return found

    def slots(self, reuse: str) -> list[Ints]:
        """Who transmits in each slot of a frame: one robot, or all of a colour ("distance_two").

        Two robots of one colour are more than two hops apart, so that nobody hears both.
        """
        if reuse == "none":
            return [np.array([number]) for number in range(self.robots)]
        colours = np.array(colouring(self.graph(), "distance_two"))
        return [np.flatnonzero(colours == colour) for colour in range(colours.max() + 1)]

    def parts(self, text: str) -> dict[str, Ints]:
        """Numbers of the robots of centred parts, by name.

        `text`: rows x columns of each, as "2x2,4x6"; "all": every centred square smaller than the grid, or
        the whole grid where it has none. Raises ValueError for what is none of these.
        """
        shapes = self._squares() if text == ALL else subgraphs(text)
        return {name: self.middle(*shape) for name, shape in shapes.items()}

    def _squares(self) -> dict[str, tuple[int, int]]:
        shortest = min(self.rows, self.columns)
        sides = range(2 + shortest % 2, shortest + 1, 2) if (self.rows - self.columns) % 2 == 0 else ()
        smaller = {f"{side}x{side}": (side, side) for side in sides if side * side < self.robots}
        return smaller or subgraphs(f"{self.rows}x{self.columns}")

    def middle(self, rows: int, columns: int) -> Ints:
        """Numbers of a centred part of so many rows and columns. Raises ValueError where there is none."""
        shape = f"{rows}x{columns}"
        if rows > self.rows or columns > self.columns:
            raise ValueError(
                f"subgraphs: {shape} is larger than the grid of {self.rows}x{self.columns}; leave it out"
            )
        if (self.rows - rows) % 2 or (self.columns - columns) % 2:
            raise ValueError(
                f"subgraphs: {shape} cannot be centred on {self.rows}x{self.columns}; "
                "let rows and columns differ from the grid's by even numbers"
            )
        numbers = np.arange(self.robots).reshape(self.rows, self.columns)
        top, left = (self.rows - rows) // 2, (self.columns - columns) // 2
        return numbers[top : top + rows, left : left + columns].ravel()

    def _counted(self) -> tuple[Ints, Ints]:
        """Twice x, and the row, of each robot."""
        row, column = np.divmod(np.arange(self.robots), self.columns)
        return 2 * column + (row % 2 if self.neighbours == 6 else 0), row


def subgraphs(text: str) -> dict[str, tuple[int, int]]:
    """Rows and columns of each of "2x2,4x6", by its name. Raises ValueError for what is none of that form."""
    found: dict[str, tuple[int, int]] = {}
    for name in (word.strip() for word in text.split(",")):
        match = re.fullmatch(r"([1-9][0-9]{0,3})x([1-9][0-9]{0,3})", name)
        if match is None:
            raise ValueError(
                f'subgraphs: {name!r} is no part of a grid; write rows x columns, as "2x2,4x4", or all'
            )
        if name in found:
            raise ValueError(f"subgraphs: {name} is listed twice; list it once")
        if name == "1x1":
            raise ValueError("subgraphs: 1x1 is one robot, which has nobody to hear of; leave it out")
        found[name] = int(match[1]), int(match[2])
    return found
