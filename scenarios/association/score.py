"""Score channel association from a log and the truth recorded in it.

Metrics of Ivanov & Shell 2016, sec. 4.2 and 5.3: expected time to completion, fraction matched, ratio of
total to true edges; and what it cost in messages and flashes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import orjson

from logs.reader import LogReader
from scenarios.association import score_metrics as metrics
from scenarios.association.score_metrics import Judged, Truth, judge

Entry = tuple[str, Mapping[str, Any]]
"""(robot, what it logged after one step)"""


class History(NamedTuple):
    """What scoring takes from a log."""

    times_ns: list[int]
    """When each entry was logged."""
    entries: list[Entry]
    truth: Sequence[tuple[int, Mapping[str, Any]]]
    """(log time [ns], record) of all /truth."""
    sent: dict[str, int]
    """Transmissions of every robot of the team."""
    settings: Mapping[str, Any]
    """The scenario as it was run."""

    @property
    def owners(self) -> Truth:
        """Who is behind which visual id."""
        return truth_of(record for _, record in self.truth)

    @property
    def steady_from_step(self) -> int | None:
        """What `params.steady_from_step` says."""
        step = self.settings.get("params", {}).get("steady_from_step")
        if step is not None and type(step) is not int:
            raise ValueError(f"params.steady_from_step: must be a whole number, is {step!r}")
        return step


def score(log: LogReader) -> dict[str, Any]:
    """Score of one log; see `score_history` for what it holds."""
    history = read(log)
    return score_history(history.entries, history.owners, history.sent, history.steady_from_step)


def read(log: LogReader) -> History:
    """Everything scoring needs, read once."""
    times_ns: list[int] = []
    entries: list[Entry] = []
    for time_ns, record in log.records("/robot"):
        if record["entry"] == "association":
            times_ns.append(time_ns)
            entries.append((record["robot"], record["data"]))
    truth = list(log.records("/truth"))
    sent = {robot["robot"]: 0 for _, start in truth if start["kind"] == "start" for robot in start["robots"]}
    for _, record in log.records("/radio"):
        sent[record["from"]] = sent.get(record["from"], 0) + 1
    return History(times_ns, entries, truth, sent, orjson.loads(log.run.get("resolved", "{}")))


def truth_of(records: Iterable[Mapping[str, Any]]) -> Truth:
    """Who is behind which visual id. An id is never used again by the same observer."""
    return {
        (seen["observer"], seen["visual"]): seen["robot"]
        for record in records
        if record["kind"] == "visual ids"
        for seen in record["entered"]
    }


def score_history(
    entries: Iterable[Entry], truth: Truth, sent: Mapping[str, int], steady_from_step: int | None = None
) -> dict[str, Any]:
    """Score of what robots logged, against the truth; `sent` counts transmissions of all robots of the team.

    - `robots`: how many log; robots that only send do not.
    - `steps_to_completion`: `per_robot` (None: not complete), `completed` (how many), and over those
      `mean`, `sd` (of the sample; None below two), `min`, `max`. The initial step does not count.
    - `fraction_matched`, `fraction_right`: after t = 0, 1, ... steps: matched visual ids (with one candidate
      left), and rightly matched ones, over all visual ids in the list; mean over robots that see any.
    - `ratio`, `ratio_of_sums`: after t steps: total over true edges, as the mean over robots that have true
      ones, and of all edges of all robots together. None where nobody has any.
    - `steady_state`: the same from step `from_step` on (default: the second half), see `metrics`.
    - `false_matches`: matches, over all robots and steps, that the truth contradicts;
      `false_matches_at_completion`: those in the entry with which a robot was first complete.
    - `messages_sent`, `messages_per_robot`: transmissions in the whole run, and their mean over the team;
      `flashes_sent`, `flashes_per_robot`: the same of flashes of the robots that log; the roll call counts.
    """
    judged = [judge(robot, data, truth) for robot, data in entries]
    from_step = metrics.second_half(judged) if steady_from_step is None else steady_from_step
    completed = first_complete(judged)
    robots = dict.fromkeys(one.robot for one in judged)
    return {
        "robots": len(robots),
        "steps_to_completion": _summary({name: completed.get(name) for name in robots}),
        "fraction_matched": metrics.per_step(judged, metrics.fraction_matched),
        "fraction_right": metrics.per_step(judged, metrics.fraction_right),
        "ratio": metrics.per_step(judged, metrics.ratio),
        "ratio_of_sums": metrics.ratio_of_sums_per_step(judged),
        "steady_state": {"from_step": from_step} | metrics.steady_state(judged, from_step),
        "false_matches": sum(one.matched - one.right for one in judged),
        "false_matches_at_completion": sum(one.matched - one.right for one in completed.values()),
        **costs(judged, sent),
    }


def costs(judged: Sequence[Judged], sent: Mapping[str, int]) -> dict[str, Any]:
    """Messages of the team, and flashes of the robots that log: in all, and per robot."""
    observers = len({one.robot for one in judged})
    messages, flashes = sum(sent.values()), sum(one.sent for one in judged)
    return {
        "messages_sent": messages,
        "messages_per_robot": messages / len(sent) if sent else 0.0,
        "flashes_sent": flashes,
        "flashes_per_robot": flashes / observers if observers else 0.0,
    }


def first_complete(judged: Iterable[Judged]) -> dict[str, Judged]:
    """The entry with which each robot was first complete; robots that never were are left out."""
    first: dict[str, Judged] = {}
    for one in judged:
        if one.complete:
            first.setdefault(one.robot, one)
    return first


def _summary(completion: Mapping[str, Judged | None]) -> dict[str, Any]:
    steps = [one.step for one in completion.values() if one is not None]
    per_robot = {name: None if one is None else one.step for name, one in sorted(completion.items())}
    return {
        "completed": len(steps),
        "mean": metrics.mean(steps),
        "sd": metrics.sample_deviation(steps),
        "min": min(steps, default=None),
        "max": max(steps, default=None),
        "per_robot": per_robot,
    }
