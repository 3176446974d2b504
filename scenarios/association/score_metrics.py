"""The metrics of channel association (Ivanov & Shell 2016, sec. 4.2 and 5.3), of what robots logged.

Pure functions of plain data. Means are taken with `fsum`, so that no order of summation shows.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

Truth = Mapping[tuple[str, int], str]
"""(observer, visual id) -> the robot behind it"""


class Judged(NamedTuple):
    """What one observer knew after one step, judged by the truth."""

    robot: str
    step: int
    """0: before the first step."""
    visual: int
    """Visual ids in its list."""
    matched: int
    """Of these, with a match: without noise, those with exactly one candidate."""
    right: int
    """Of these, with the right one."""
    edges: int
    true_edges: int
    complete: bool
    sent: bool


Measure = Callable[[Judged], float | None]
"""A number per observer and step; None where it is not defined."""


def judge(robot: str, data: Mapping[str, Any], truth: Truth) -> Judged:
    """Judge one `association` entry; visual ids may be numbers, or text as in JSON."""
    edges, matches = data["edges"], data["matches"]
    owner = {visual: truth.get((robot, int(visual))) for visual in edges | matches}
    return Judged(
        robot=robot,
        step=data["step"],
        visual=len(edges),
        matched=len(matches),
        right=sum(owner[visual] == wireless for visual, wireless in matches.items()),
        edges=sum(map(len, edges.values())),
        true_edges=sum(owner[visual] in candidates for visual, candidates in edges.items()),
        complete=data["complete"],
        sent=data.get("sent", False),
    )


def fraction_matched(judged: Judged) -> float | None:
    """Matched visual ids over visual ids in the list; None for an empty list."""
    return judged.matched / judged.visual if judged.visual else None


def fraction_right(judged: Judged) -> float | None:
    """Rightly matched visual ids over visual ids in the list; None for an empty list."""
    return judged.right / judged.visual if judged.visual else None


def ratio(judged: Judged) -> float | None:
    """Ratio of total to true edges; None where there is no true edge."""
    return judged.edges / judged.true_edges if judged.true_edges else None


def visual_ids(judged: Judged) -> float:
    """Visual ids in the list."""
    return float(judged.visual)


def per_step(judged: Sequence[Judged], measure: Measure) -> list[float | None]:
    """Mean over observers after t = 0, 1, ... steps; None where it is defined for none."""
    values: dict[int, list[float]] = defaultdict(list)
    for one in judged:
        value = measure(one)
        if value is not None:
            values[one.step].append(value)
    return [mean(values.get(step, ())) for step in range(last_step(judged) + 1)]


def ratio_of_sums_per_step(judged: Sequence[Judged]) -> list[float | None]:
    """All edges over all true edges of all observers after t = 0, 1, ... steps."""
    at: dict[int, list[Judged]] = defaultdict(list)
    for one in judged:
        at[one.step].append(one)
    return [ratio_of_sums(at.get(step, ())) for step in range(last_step(judged) + 1)]


def ratio_of_sums(judged: Iterable[Judged]) -> float | None:
    """All edges over all true edges; None where there are no true ones."""
    pairs = [(one.edges, one.true_edges) for one in judged]
    true = sum(true for _, true in pairs)
    return sum(edges for edges, _ in pairs) / true if true else None


def last_step(judged: Iterable[Judged]) -> int:
    """The largest number of steps taken; -1 for no entries."""
    return max((one.step for one in judged), default=-1)


def second_half(judged: Iterable[Judged]) -> int:
    """The first step of the second half of a run."""
    return last_step(judged) // 2 + 1


def steady_state(judged: Iterable[Judged], from_step: int) -> dict[str, Any]:
    """Over all observers and steps from `from_step` on: each metric as `spread`, and plain means.

    `visual_ids_in_list` is the mean number of visual ids an observer has in its list.
    """
    steady = [one for one in judged if one.step >= from_step]
    return {
        "observers": len({one.robot for one in steady}),
        "fraction_matched": spread(steady, fraction_matched),
        "fraction_right": spread(steady, fraction_right),
        "ratio": spread(steady, ratio),
        "ratio_of_sums": ratio_of_sums(steady),
        "visual_ids_in_list": mean(map(visual_ids, steady)),
    }


def spread(judged: Iterable[Judged], measure: Measure) -> dict[str, float | None]:
    """`mean` and sample `sd` over observers and steps; `se` of the mean.

    An observer's steps hang together, so the standard error comes from the observers' own means.
    """
    by_observer: dict[str, list[float]] = defaultdict(list)
    for one in judged:
        value = measure(one)
        if value is not None:
            by_observer[one.robot].append(value)
    everything = [value for values in by_observer.values() for value in values]
    between = sample_deviation([math.fsum(values) / len(values) for values in by_observer.values()])
    return {
        "mean": mean(everything),
        "sd": sample_deviation(everything),
        "se": None if between is None else between / math.sqrt(len(by_observer)),
    }


def mean(values: Iterable[float]) -> float | None:
    """Mean; None of nothing."""
    listed = list(values)
    return math.fsum(listed) / len(listed) if listed else None


def sample_deviation(values: Sequence[float]) -> float | None:
    """Standard deviation of a sample; None below two values."""
    if len(values) < 2:
        return None
    middle = math.fsum(values) / len(values)
    return math.sqrt(math.fsum((value - middle) ** 2 for value in values) / (len(values) - 1))
