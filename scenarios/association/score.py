"""Score channel association from a log and the truth recorded in it.

Metrics of Ivanov & Shell 2016, sec. 4.2: expected time to completion, fraction matched.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Any

from logs.reader import LogReader

Entry = tuple[str, Mapping[str, Any]]
"""(robot, what it logged after one step)"""
Truth = Mapping[tuple[str, int], str]
"""(observer, visual id) -> the robot behind it"""


def score(log: LogReader) -> dict[str, Any]:
    """Score of one log; see `score_history` for what it holds."""
    entries = [
        (record["robot"], record["data"])
        for _, record in log.records("/robot")
        if record["entry"] == "association"
    ]
    sent: dict[str, int] = defaultdict(int)
    for _, record in log.records("/radio"):
        sent[record["from"]] += 1
    return score_history(entries, truth_of(record for _, record in log.records("/truth")), sent)


def truth_of(records: Iterable[Mapping[str, Any]]) -> Truth:
    """Who is behind which visual id. An id is never used again by the same observer."""
    return {
        (seen["observer"], seen["visual"]): seen["robot"]
        for record in records
        if record["kind"] == "visual ids"
        for seen in record["entered"]
    }


def score_history(entries: Iterable[Entry], truth: Truth, sent: Mapping[str, int]) -> dict[str, Any]:
    """Score of what robots logged, against the truth; `sent` counts transmissions by robot.

    - `steps_to_completion`: `per_robot` (None: not complete), `completed` (how many), and over those
      `mean`, `sd` (of the sample; None below two), `min`, `max`. The initial step does not count.
    - `fraction_matched`: for steps 1, 2, ...: visual ids correctly matched by a single candidate
      over all visual ids, as the mean over robots that see any.
    - `false_matches`: claims, over all robots and steps, that the truth contradicts.
    - `messages_sent`, `messages_per_robot`: transmissions in the whole run, and their mean.
    """
    completion: dict[str, int | None] = {}
    fractions: dict[int, list[float]] = defaultdict(list)
    false_matches = 0
    for robot, data in entries:
        right, wrong = _judge(robot, data["matches"], truth)
        false_matches += wrong
        if data["edges"]:
            fractions[data["step"]].append(right / len(data["edges"]))
        if completion.get(robot) is None:
            completion[robot] = data["step"] if data["complete"] else None
    total = sum(sent.values())
    return {
        "robots": len(completion),
        "steps_to_completion": _summary(completion),
        "fraction_matched": [_mean(fractions[step]) for step in sorted(fractions) if step > 0],
        "false_matches": false_matches,
        "messages_sent": total,
        "messages_per_robot": total / len(completion) if completion else 0.0,
    }


def _judge(robot: str, matches: Mapping[str, str], truth: Truth) -> tuple[int, int]:
    """How many of a robot's claims are right, and how many are wrong."""
    right = sum(truth.get((robot, int(visual))) == wireless for visual, wireless in matches.items())
    return right, len(matches) - right


def _summary(completion: Mapping[str, int | None]) -> dict[str, Any]:
    steps = [steps for steps in completion.values() if steps is not None]
    return {
        "completed": len(steps),
        "mean": _mean(steps) if steps else None,
        "sd": _sample_deviation(steps),
        "min": min(steps, default=None),
        "max": max(steps, default=None),
        "per_robot": dict(sorted(completion.items())),
    }


def _mean(values: Iterable[float]) -> float:
    listed = list(values)
    return math.fsum(listed) / len(listed)


def _sample_deviation(values: Iterable[float]) -> float | None:
    listed = list(values)
    if len(listed) < 2:
        return None
    mean = _mean(listed)
    return math.sqrt(math.fsum((value - mean) ** 2 for value in listed) / (len(listed) - 1))
