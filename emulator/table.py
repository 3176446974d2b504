"""Results as a short table for the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import islice
from typing import Any

from channels.units import to_s
from emulator.run import Outcome

MAX_ITEMS = 8
"""Longer lists and tables are cut; the whole is in --json."""


def outcome_table(outcome: Outcome, score: Mapping[str, Any]) -> str:
    """What a run was, how it went, its score, and where its log is."""
    progress = outcome.progress
    virtual_s = to_s(progress.now_ns)
    speed = virtual_s / outcome.wall_s if outcome.wall_s else float("inf")
    rows = {
        "scenario": f"{outcome.scenario.name}, {outcome.robots} robots, seed {outcome.scenario.seed}",
        "fleet": f"{outcome.fleet} (ready in {outcome.startup_s:.2f} s)",
        "time": f"{virtual_s:g} s virtual in {outcome.wall_s:.2f} s, {speed:.0f} x real time",
        "ended by": progress.ended_by,
        "activations": str(progress.activations),
        "messages": _messages(outcome),
        **_flat(score),
        "log": str(outcome.log),
        "sha256": outcome.digest,
    }
    return _table(rows)


def score_table(score: Mapping[str, Any]) -> str:
    """One line per result."""
    return _table(_flat(score))


def _messages(outcome: Outcome) -> str:
    progress = outcome.progress
    dropped = ", ".join(f"{count} {reason}" for reason, count in progress.dropped.items())
    return f"{progress.sent} sent, {progress.delivered} delivered" + (
        f"; dropped: {dropped}" if dropped else ""
    )


def _flat(score: Mapping[str, Any], prefix: str = "") -> dict[str, str]:
    """A row for every value; a table's plain values share one, what is nested in it gets rows of its own."""
    rows: dict[str, str] = {}
    for key, value in score.items():
        name = f"{prefix}{key}"
        if isinstance(value, list) and value and all(isinstance(item, Mapping) for item in value):
            value = dict(enumerate(value, 1))
        if not isinstance(value, Mapping):
            rows[name] = _shown(value)
            continue
        plain = [f"{inner} {_shown(item)}" for inner, item in value.items() if not _nested(item)]
        if plain or not value:
            rows[name] = _cut(plain)
        nested = {inner: item for inner, item in value.items() if _nested(item)}
        rows |= _flat(dict(islice(nested.items(), MAX_ITEMS)), f"{name}.")
        if len(nested) > MAX_ITEMS:
            rows[f"{name}. ..."] = f"({len(nested)})"
    return rows


def _nested(value: Any) -> bool:
    return isinstance(value, Mapping | list)


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, Mapping):
        return "(" + ", ".join(f"{key} {_shown(item)}" for key, item in value.items()) + ")"
    if isinstance(value, list):
        return _cut([f"({_shown(item)})" if isinstance(item, list) else _shown(item) for item in value])
    return "-" if value is None else str(value)


def _cut(items: list[str]) -> str:
    kept = ", ".join(items[:MAX_ITEMS])
    return f"{kept}, ... ({len(items)})" if len(items) > MAX_ITEMS else kept


def _table(rows: Mapping[str, str]) -> str:
    width = max(map(len, rows), default=0)
    return "\n".join(f"{name:{width}}  {value}" for name, value in rows.items())
