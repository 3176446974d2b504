"""Which robots share a slot: colourings of the connectivity graph where the robots start.

The future work of Julian et al. 2009 (sec. 5): robots several hops apart may speak at once. Two that are
more than two hops apart have no neighbour in common, so nobody hears both ("distance-two colouring", as
in broadcast scheduling: Ramanathan 1999, "A unified framework and algorithm for channel assignment in
wireless networks"). The least number of colours is NP-hard to find; DSATUR comes near it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import networkx as nx
import numpy as np

from channels.graphs import Graph, Rectangle, vertices_at
from channels.medium import reach_of
from channels.randomness import Draws
from channels.settings import RadioSettings
from emulator.scenario import RobotSpec

Reuse = Literal["none", "distance_two", "distance_one"]


def shared_slots(
    radio: RadioSettings,
    specs: Sequence[RobotSpec],
    seed: int,
    graph: Graph | None = None,
    obstacles: Sequence[Rectangle] = (),
) -> list[int] | None:
    """The slot of each robot, in robot order, numbered from 0; None where each is to have one of its own."""
    tdma = radio.tdma
    if radio.access != "tdma" or tdma is None or tdma.reuse == "none":
        return None
    slots = colouring(connectivity(radio, specs, graph, obstacles), tdma.reuse)
    if tdma.order != "drawn":
        return slots
    draws = Draws(seed, "slot_order").bits(np.arange(max(slots) + 1))
    place = np.argsort(np.argsort(draws, kind="stable"), kind="stable").tolist()
    return [place[slot] for slot in slots]


def connectivity(
    radio: RadioSettings,
    specs: Sequence[RobotSpec],
    graph: Graph | None = None,
    obstacles: Sequence[Rectangle] = (),
) -> nx.Graph[int]:
    """Robots by their index, joined where they hear each other at the start, by the radio's link model.

    `graph`, `obstacles`: of the world, in metres, for link models that ask for them.
    """
    positions = np.array([spec.position_m for spec in specs], dtype=np.float64).reshape(-1, 2)
    places = None if graph is None else vertices_at(graph.vertices, positions)
    reach = reach_of(radio, [spec.altitude_m for spec in specs], graph, obstacles)
    beyond = reach.beyond(positions, places, np.arange(len(specs)))
    joined: nx.Graph[int] = nx.Graph()
    joined.add_nodes_from(range(len(specs)))
    rows, columns = np.nonzero(np.triu(~beyond, 1))
    joined.add_edges_from(zip(rows.tolist(), columns.tolist(), strict=True))
    return joined


def colouring(graph: nx.Graph[int], reuse: Reuse) -> list[int]:
    """A colour of each node 0 .. n-1, from 0: different within one hop, or within two."""
    apart = nx.power(graph, 2) if reuse == "distance_two" else graph
    colours: dict[int, int] = nx.greedy_color(apart, strategy="DSATUR")
    return [colours[node] for node in range(graph.number_of_nodes())]
