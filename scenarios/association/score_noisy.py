"""Score association under noise: what every association is scored by, and whether claims keep their word."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from logs.reader import LogReader
from scenarios.association.score import Entry, read, score_history
from scenarios.association.score_metrics import Truth

BINS = (0.5, 0.9, 0.95, 0.99, 0.999, 0.9999, 1.0)
"""Edges of the ranges of posteriors in which claims are counted; each but the last one's end is left out."""


def score(log: LogReader) -> dict[str, Any]:
    """As `score.score`, with `calibration`, `first_claims` (see there) and `rates` (see `last_rates`)."""
    history = read(log)
    truth = history.owners
    common = score_history(history.entries, truth, history.sent, history.steady_from_step)
    return {
        **common,
        "calibration": calibration(history.entries, truth),
        "first_claims": calibration(first_claims(history.entries), truth),
        "rates": last_rates(history.entries),
    }


def calibration(entries: Iterable[Entry], truth: Truth) -> list[dict[str, Any]]:
    """Claims by their posterior, in ranges that hold any: `from`, `to`, `claims`, `right`, `expected_right`.

    `expected_right` is the sum of the posteriors: if they are calibrated, `right` differs from it by chance
    only. Claims of one pair in several steps stand or fall together; `first_claims` has each once.
    """
    tallies = [[0, 0, 0.0] for _ in BINS[1:]]
    for robot, data in entries:
        for visual, posterior in data["posteriors"].items():
            tally = tallies[_bin(posterior)]
            tally[0] += 1
            tally[1] += truth.get((robot, int(visual))) == data["matches"][visual]
            tally[2] += posterior
    return [
        {"from": low, "to": high, "claims": claims, "right": right, "expected_right": expected}
        for low, high, (claims, right, expected) in zip(BINS, BINS[1:], tallies, strict=False)
        if claims
    ]


def first_claims(entries: Iterable[Entry]) -> list[Entry]:
    """The same entries with only the first claim that each robot makes about each visual id."""
    made: set[tuple[str, str]] = set()
    kept: list[Entry] = []
    for robot, data in entries:
        new = [visual for visual in data["posteriors"] if (robot, visual) not in made]
        made.update((robot, visual) for visual in new)
        kept.append((robot, {key: _only(data[key], new) for key in ("matches", "posteriors")}))
    return kept


def last_rates(entries: Iterable[Entry]) -> dict[str, float]:
    """Each error rate as the robots had it at the end (given or estimated), as the mean over them."""
    last = {robot: data["rates"] for robot, data in entries}
    names = list(next(iter(last.values()))) if last else []
    return {name: math.fsum(rates[name] for rates in last.values()) / len(last) for name in names}


def _bin(posterior: float) -> int:
    return max(0, sum(posterior >= edge for edge in BINS[:-1]) - 1)


def _only(values: Mapping[str, Any], keys: list[str]) -> dict[str, Any]:
    return {key: values[key] for key in keys}
