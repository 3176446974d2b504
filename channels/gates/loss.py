"""Loss and jitter: what chance does to a transmission on its way to each receiver."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from channels.fates import Batch, Bools, Reason
from channels.randomness import Draws, Floats, UInts


class LossGate:
    """Bernoulli loss, independent for every transmission and receiver."""

    reason = Reason.loss

    def __init__(self, probability: float, keys: UInts, seed: int) -> None:
        self._probability = probability
        self._keys = keys
        self._draws = Draws(seed, "loss")

    def refuses(self, batch: Batch) -> Bools:
        """(T, N)."""
        lost: Bools = _per_receiver(self._draws, self._keys, batch) < self._probability
        return lost


class Jitter:
    """Extra delay, uniform over the whole nanoseconds in [0, bound_ns)."""

    def __init__(self, bound_ns: int, keys: UInts, seed: int) -> None:
        self._bound_ns = bound_ns
        self._keys = keys
        self._draws = Draws(seed, "jitter")

    def delays_ns(self, batch: Batch) -> NDArray[np.int64]:
        """(T, N)."""
        return (_per_receiver(self._draws, self._keys, batch) * self._bound_ns).astype(np.int64)


def _per_receiver(draws: Draws, keys: UInts, batch: Batch) -> Floats:
    # The receiver comes last: what precedes it is hashed once for a whole row.
    return draws.uniform(keys[batch.senders, None], batch.seqs[:, None], keys[None, :])
