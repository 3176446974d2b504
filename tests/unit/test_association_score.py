"""Scores of made-up histories of a few lines, each worked out by hand."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import pytest

from scenarios.association import score_metrics as metrics
from scenarios.association.score import Entry, History, score_history, truth_of
from scenarios.association.score_metrics import Judged, judge

TRUTH = {("a", 1): "b", ("a", 2): "c", ("b", 5): "a"}


def entry(
    robot: str, step: int, edges: Mapping[int, Sequence[str]], complete: bool = False, sent: bool = False
) -> Entry:
    """As it comes from a log, with matches wherever one candidate is left."""
    return robot, {
        "step": step,
        "edges": {str(visual): list(names) for visual, names in edges.items()},
        "matches": {str(visual): names[0] for visual, names in edges.items() if len(names) == 1},
        "complete": complete,
        "sent": sent,
    }


HISTORY = [
    entry("a", 0, {1: "bcd", 2: "bcd"}, sent=True),
    entry("b", 0, {5: "ac"}, sent=True),
    entry("a", 1, {1: "b", 2: "bcd"}),
    entry("b", 1, {5: "ac"}, sent=True),
    entry("a", 2, {1: "b", 2: "c"}, complete=True, sent=True),
    entry("b", 2, {5: "c"}, complete=True),
    entry("a", 3, {1: "b", 2: "c"}, complete=True),
    entry("b", 3, {5: "a"}, complete=True, sent=True),
]


def test_by_hand() -> None:
    result = score_history(HISTORY, TRUTH, {"a": 4, "b": 2, "only sends": 0})
    assert result == {
        "robots": 2,
        "steps_to_completion": {
            "completed": 2, "mean": 2.0, "sd": 0.0, "min": 2, "max": 2, "per_robot": {"a": 2, "b": 2},
        },
        "fraction_matched": [0.0, 0.25, 1.0, 1.0],
        "fraction_right": [0.0, 0.25, 0.5, 1.0],
        "ratio": [2.5, 2.0, 1.0, 1.0],  # (6/2 + 2/1) / 2, (4/2 + 2/1) / 2; b has no true edge after 2 steps
        "ratio_of_sums": [8 / 3, 2.0, 1.5, 1.0],
        "steady_state": {
            "from_step": 2,
            "observers": 2,
            "fraction_matched": {"mean": 1.0, "sd": 0.0, "se": 0.0},
            "fraction_right": {"mean": 0.75, "sd": 0.5, "se": 0.25},  # means of observers: 1 and 1/2
            "ratio": {"mean": 1.0, "sd": 0.0, "se": 0.0},
            "ratio_of_sums": 6 / 5,
            "visual_ids_in_list": 1.5,
        },
        "false_matches": 1,
        "false_matches_at_completion": 1,
        "messages_sent": 6,
        "messages_per_robot": 2.0,
        "flashes_sent": 5,
        "flashes_per_robot": 2.5,
    }  # fmt: skip


def test_steady_state_from_a_step_of_ones_own() -> None:
    result = score_history(HISTORY, TRUTH, {}, steady_from_step=1)["steady_state"]
    assert result["from_step"] == 1
    assert result["fraction_matched"]["mean"] == pytest.approx((0.5 + 1 + 1 + 0 + 1 + 1) / 6)
    assert result["ratio_of_sums"] == (4 + 2 + 2 + 2 + 1 + 1) / (2 + 2 + 2 + 1 + 0 + 1)


def test_beyond_the_end_there_is_no_steady_state() -> None:
    result = score_history(HISTORY, TRUTH, {}, steady_from_step=4)["steady_state"]
    nothing = {"mean": None, "sd": None, "se": None}
    assert result == {
        "from_step": 4, "observers": 0, "fraction_matched": nothing, "fraction_right": nothing,
        "ratio": nothing, "ratio_of_sums": None, "visual_ids_in_list": None,
    }  # fmt: skip


def test_a_robot_that_is_never_done() -> None:
    result = score_history([entry("a", 1, {1: "bc", 2: "bc"})], TRUTH, {})
    assert result["steps_to_completion"] == {
        "completed": 0, "mean": None, "sd": None, "min": None, "max": None, "per_robot": {"a": None},
    }  # fmt: skip
    assert result["fraction_matched"] == [None, 0.0]  # nobody has logged before the first step
    assert result["ratio"] == [None, 2.0]


def test_the_first_completion_counts() -> None:
    steps = [entry("a", step, {1: "b"}, complete=step in (1, 3)) for step in range(4)]
    assert score_history(steps, TRUTH, {})["steps_to_completion"]["per_robot"] == {"a": 1}


def test_completion_at_once_is_zero_steps() -> None:
    result = score_history([entry("a", 0, {}, complete=True)], TRUTH, {})
    assert result["steps_to_completion"]["per_robot"] == {"a": 0}
    assert result["fraction_matched"] == [None]
    assert result["ratio"] == [None]


def test_robots_that_see_nobody_are_left_out_of_means() -> None:
    result = score_history([entry("a", 0, {1: "b", 2: "bc"}), entry("z", 0, {})], TRUTH, {})
    assert result["fraction_matched"] == [0.5]
    assert result["ratio"] == [1.5]


def test_an_empty_history() -> None:
    result = score_history([], {}, {})
    assert result["robots"] == 0
    assert result["fraction_matched"] == []
    assert result["messages_per_robot"] == result["flashes_per_robot"] == 0.0


def test_a_light_that_is_nobodys_has_no_true_edge_and_no_right_match() -> None:
    one = judge(*entry("a", 3, {9: "b"}), {})
    assert one == Judged(
        "a", 3, visual=1, matched=1, right=0, edges=1, true_edges=0, complete=False, sent=False
    )
    assert metrics.ratio(one) is None


def test_claims_count_where_they_differ_from_lone_candidates() -> None:
    """Under noise edges are never struck out; what is matched is what is claimed."""
    data = {"step": 1, "edges": {1: ["b", "c"], 2: ["b", "c"]}, "matches": {1: "b"}, "complete": False}
    one = judge("a", data, TRUTH)
    assert (one.visual, one.matched, one.right, one.edges, one.true_edges) == (2, 1, 1, 4, 2)


def judged(robot: str, step: int, matched: int, visual: int) -> Judged:
    return Judged(robot, step, visual, matched, 0, 0, 0, False, False)


def test_the_standard_error_is_that_of_observers() -> None:
    """Ten steps of an observer are not ten observations."""
    history = [
        judged(robot, step, matched, 4)
        for step in range(10)
        for robot, matched in zip("abc", (1, 2, 3), strict=True)
    ]
    assert metrics.spread(history, metrics.fraction_matched) == {
        "mean": 0.5,
        "sd": pytest.approx(math.sqrt(20 * 0.25**2 / 29)),
        "se": pytest.approx(0.25 / math.sqrt(3)),
    }


def test_one_observer_has_no_standard_error() -> None:
    history = [judged("a", step, step, 2) for step in range(3)]
    assert metrics.spread(history, metrics.fraction_matched) == {"mean": 0.5, "sd": 0.5, "se": None}


def test_truth_is_read_from_the_records() -> None:
    records = [
        {"kind": "start", "robots": []},
        {"kind": "visual ids", "entered": [{"observer": "a", "visual": 1, "robot": "b"}], "left": []},
        {"kind": "visual ids", "entered": [], "left": [{"observer": "a", "visual": 1, "robot": "b"}]},
    ]
    assert truth_of(records) == {("a", 1): "b"}


def history_with(params: dict[str, Any]) -> History:
    return History([], [], [], {}, {"params": params})


def test_steady_state_as_the_scenario_says() -> None:
    assert history_with({"steady_from_step": 7}).steady_from_step == 7
    assert history_with({}).steady_from_step is None
    with pytest.raises(ValueError, match=r"^params\.steady_from_step: must be a whole number, is 'late'$"):
        _ = history_with({"steady_from_step": "late"}).steady_from_step
