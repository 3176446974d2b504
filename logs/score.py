"""The score of a scenario that names none: what its radio did, by robot."""

from __future__ import annotations

from collections import Counter
from typing import Any

from logs.reader import LogReader


def score(log: LogReader) -> dict[str, Any]:
    """Messages sent and received by every robot, and what became of them in range.

    `delivered_fraction` is deliveries over all fates at receivers in range; None if there were none.
    """
    sent: Counter[str] = Counter()
    received: Counter[str] = Counter()
    dropped: Counter[str] = Counter()
    for _, record in log.records("/radio"):
        sent[record["from"]] += 1
        received.update(record["delivered"])
        for reason, robots in record["dropped"].items():
            dropped[reason] += len(robots)
    delivered = received.total()
    fates = delivered + dropped.total()
    return {
        "messages_sent": sent.total(),
        "messages_received": delivered,
        "delivered_fraction": delivered / fates if fates else None,
        "dropped_in_range": dict(sorted(dropped.items())),
        "sent_by_robot": dict(sorted(sent.items())),
        "received_by_robot": dict(sorted(received.items())),
    }
