"""Vandermeulen et al., Eqs. 1 to 7, written down as they stand: (2, 2)-tensors, with every product in full.

For small graphs only. Indices are [b, k, a, l]: from l steps at augmented vertex a to k steps at b, steps
counted from 1. Entries are of whatever kind the probabilities are, floats or Fractions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agent.behaviours.reconnection.model import Model
from channels.graphs import Graph

Array = NDArray[Any]
Augmented = int | tuple[int, int]


def augmented(graph: Graph) -> list[Augmented]:
    """Vertices, then the directions (u, w) of all edges by u, then w."""
    both = [(a, b) for a, b, _ in graph.edges] + [(b, a) for a, b, _ in graph.edges]
    return [*range(len(graph.vertices)), *sorted(both)]


def next_probabilities(vertices: Sequence[Augmented], mu: Mapping[tuple[int, int], Any]) -> Array:
    """M: column a is mu_a."""
    tensor = np.zeros((len(vertices), len(vertices)), dtype=np.asarray(list(mu.values())).dtype)
    for i, at in enumerate(vertices):
        if isinstance(at, tuple):
            tensor[vertices.index(at[1]), i] += 1
            continue
        for j, way in enumerate(vertices):
            if isinstance(way, tuple) and way[0] == at:
                tensor[j, i] += mu[way]
    return tensor


def holding_matrix(gamma: Sequence[Any], longest: int) -> Array:
    """D(v), Eq. 5, with the hazards of Eq. 2; 1 where nothing is left."""
    gamma = [*gamma, *[0] * (longest - len(gamma))]
    hazard = [each / sum(gamma[k:]) if sum(gamma[k:]) > 0 else 1 for k, each in enumerate(gamma)]
    matrix = np.zeros((longest, longest), dtype=np.asarray(gamma).dtype)
    for k in range(longest):
        matrix[0, k] += hazard[k]
        if k + 1 < longest:
            matrix[k + 1, k] += 1 - hazard[k]
    return matrix


def product(first: Array, second: Array) -> Array:
    """The tensor product of (1, 1)-tensors [b, a] and [k, l]: [b, k, a, l]."""
    return np.asarray(np.multiply.outer(first, second)).transpose(0, 2, 1, 3)


def transition(m: Array, holding: Sequence[Array]) -> Array:
    """F = F_t + F_h."""
    count, longest = len(m), len(holding[0])
    moves = np.zeros((longest, longest), dtype=int)
    moves[0, 0] = 1
    stays = np.eye(longest, dtype=int) - moves
    f_t = f_h = np.zeros((), dtype=int)
    for v in range(count):
        only = np.zeros((count, count), dtype=int)
        only[v, v] = 1
        f_t = f_t + product(m @ only, moves @ holding[v])
        f_h = f_h + product(np.eye(count, dtype=int) @ only, stays @ holding[v])
    return f_t + f_h


def observation(vertices: Sequence[Augmented], heard: Array, longest: int, miss: Any = 0) -> Array:
    """R: robots are not heard at places `heard`; on the way from u they are heard as at u."""
    places = [at[0] if isinstance(at, tuple) else at for at in vertices]
    seen = np.diag([miss if heard[place] else 1 for place in places])
    return product(seen, np.eye(longest, dtype=int))


def applied(tensor: Array, belief: Array) -> Array:
    return np.tensordot(tensor, belief, axes=2)


def merged(beliefs: Sequence[Array]) -> Array:
    """The element-wise geometric mean; all 0 for beliefs that have nothing in common."""
    mean = np.prod(np.stack(beliefs), axis=0) ** (1 / len(beliefs))
    return np.asarray(mean / mean.sum()) if mean.sum() > 0 else mean


def states_of(model: Model) -> tuple[Array, Array]:
    """For every state of a model its augmented vertex, and its number of steps less 1."""
    lengths = np.diff(model.first)
    return np.repeat(np.arange(len(lengths)), lengths), np.concatenate([np.arange(n) for n in lengths])


def by_vertex(model: Model, belief: Array) -> Array:
    """How likely the robot is at each augmented vertex."""
    return np.bincount(states_of(model)[0], weights=belief)
