"""Score association among moving robots (Ivanov & Shell 2016, sec. 5.3-5.5) from a log.

Near the walls there are fewer neighbours, and robots turn; what the paper's models describe is the middle of
the area. So everything is told of all observers, and of those deeper than three ranges from the walls.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from channels.units import to_ns
from logs.reader import LogReader
from scenarios.association import score_metrics as metrics
from scenarios.association.score import Entry, History, costs, read
from scenarios.association.score_metrics import Truth, judge
from scenarios.places import positions
from scenarios.runs import start_of

RANGES_FROM_WALLS = 3.0


def score(log: LogReader) -> dict[str, Any]:
    """Score of one log; see `score_history` for what it holds."""
    history = read(log)
    deep = list(_deep(history))
    return score_history(history.entries, deep, history.owners, history.sent, history.steady_from_step)


def score_history(
    entries: Iterable[Entry],
    deep: Iterable[bool],
    truth: Truth,
    sent: Mapping[str, int],
    steady_from_step: int | None = None,
) -> dict[str, Any]:
    """Score of what robots logged, against the truth.

    `deep`: for each entry, whether its robot was deeper than three visual ranges from the walls when the
    step began; `sent` counts transmissions of all robots of the team.

    - `observers`: how many robots log.
    - `from_step`: where the steady state begins (default: the second half of the run); `all`, `deep`: in it,
      fraction matched, fraction right and ratio as `mean`, `sd`, `se`, `ratio_of_sums`, `visual_ids_in_list`.
    - `per_step`: the mean over all observers after t = 0, 1, ... steps; None where nobody has any ids.
    - `false_matches`: matches, over all robots and steps, that the truth contradicts.
    - messages and flashes as in `score.score_history`.
    """
    judged = [judge(robot, data, truth) for robot, data in entries]
    inside = [one for one, is_deep in zip(judged, deep, strict=True) if is_deep]
    from_step = metrics.second_half(judged) if steady_from_step is None else steady_from_step
    return {
        "observers": len({one.robot for one in judged}),
        "from_step": from_step,
        "all": metrics.steady_state(judged, from_step),
        "deep": metrics.steady_state(inside, from_step),
        "per_step": {
            "fraction_matched": metrics.per_step(judged, metrics.fraction_matched),
            "fraction_right": metrics.per_step(judged, metrics.fraction_right),
            "ratio": metrics.per_step(judged, metrics.ratio),
            "ratio_of_sums": metrics.ratio_of_sums_per_step(judged),
            "visual_ids_in_list": metrics.per_step(judged, metrics.visual_ids),
        },
        "false_matches": sum(one.matched - one.right for one in judged),
        **costs(judged, sent),
    }


def _deep(history: History) -> Iterator[bool]:
    """For each entry, whether its robot was far from the walls when the step began."""
    if not history.entries:
        return
    start = start_of(history.truth)
    width, height = start["area_m"]
    depth_m = RANGES_FROM_WALLS * history.settings["camera"]["range_m"]
    step_ns = to_ns(history.settings["params"]["step_s"])
    index = {robot["robot"]: number for number, robot in enumerate(start["robots"])}
    begun_ns = [max(0, time_ns - step_ns) for time_ns in history.times_ns]
    places = positions(history.truth, history.settings["world"]["motion"], begun_ns)
    for (robot, _), positions_m in zip(history.entries, places, strict=True):
        x, y = positions_m[index[robot]].tolist()
        yield min(x, width - x, y, height - y) > depth_m
