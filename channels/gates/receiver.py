"""Receivers whose radio is off."""

from __future__ import annotations

import numpy as np

from channels.fates import Batch, Bools, Reason


class ReceiverGate:
    """Refuses receivers that do not listen."""

    reason = Reason.receiver_down

    def refuses(self, batch: Batch) -> Bools | None:
        """(1, N)."""
        if np.count_nonzero(batch.listening) == len(batch.listening):
            return None
        return ~batch.listening[None, :]
