"""Losses that come in bursts: the model of Gilbert (1960) and Elliott (1963), one chain per link.

The chain of the link from a to b makes a step with every transmission of a. It is built so that any step
can be asked for: with probability enter + leave the state is drawn anew from the long-run distribution,
else it stays. That is the same law as to enter a burst with probability `enter` and to leave it with
probability `leave`: enter = (enter + leave) * (long-run probability of a burst).
"""

from __future__ import annotations

import numpy as np

from channels.fates import Batch, Bools, Reason
from channels.randomness import Draws, UInts
from channels.settings import BurstSettings


class BurstGate:
    """Refuses, with a probability of its own, receivers whose link to the sender is in a burst.

    A function of (seed, sender, sequence number, receiver) alone: what it remembers only spares it the
    way through all the steps before.
    """

    reason = Reason.burst

    def __init__(self, settings: BurstSettings, keys: UInts, seed: int) -> None:
        self._settings = settings
        self._keys = keys
        self._changes = Draws(seed, "burst_change")
        self._states = Draws(seed, "burst_state")
        self._losses = Draws(seed, "burst_loss")
        self._step = [-1] * len(keys)
        self._bursting = np.zeros((len(keys), len(keys)), dtype=bool)

    def refuses(self, batch: Batch) -> Bools:
        """(T, N)."""
        lost = np.zeros((len(batch.senders), len(self._keys)), dtype=bool)
        rows = zip(batch.senders.tolist(), batch.seqs.tolist(), batch.refused.tolist(), strict=True)
        for row, (sender, seq, refused) in enumerate(rows):
            if not refused:  # what never went on the air has a fate already
                lost[row] = self._in_burst(sender, seq)
        if self._settings.loss < 1:
            keys = self._keys
            drawn = self._losses.uniform(keys[batch.senders, None], batch.seqs[:, None], keys[None, :])
            lost &= drawn < self._settings.loss
        return lost

    def _in_burst(self, sender: int, seq: int) -> Bools:
        """(N,) the state of every link of a sender at its transmission `seq`."""
        if seq < self._step[sender]:
            self._step[sender] = -1
        for step in range(self._step[sender] + 1, seq + 1):
            self._advance(sender, step)
        self._step[sender] = seq
        bursting: Bools = self._bursting[sender]
        return bursting

    def _advance(self, sender: int, step: int) -> None:
        enter, leave = self._settings.enter, self._settings.leave
        words = self._keys[sender], step, self._keys
        anew = self._states.uniform(*words) * (enter + leave) < enter
        if step == 0:
            self._bursting[sender] = anew
            return
        changing = self._changes.uniform(*words) < enter + leave
        self._bursting[sender] = np.where(changing, anew, self._bursting[sender])
