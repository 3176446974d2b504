"""The stationary i-state, on the paper's own example and against a plain matrix; and the score."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agent.behaviours.association.istate import StationaryIState
from scenarios.association.score import score_history, truth_of


def test_by_hand() -> None:
    istate = StationaryIState(["a", "b", "c"], [7, 9])
    assert istate.edges() == {7: ["a", "b", "c"], 9: ["a", "b", "c"]}
    assert istate.matches() == {}
    istate.update({"a", "c"}, {7})
    assert istate.edges() == {7: ["a", "c"], 9: ["b"]}
    assert istate.matches() == {9: "b"}
    assert not istate.is_final()
    istate.update({"c"}, {7})
    assert istate.edges() == {7: ["c"], 9: ["b"]}
    assert istate.matches() == {7: "c", 9: "b"}
    assert istate.is_final()


def test_nobody_in_sight_is_final_at_once() -> None:
    assert StationaryIState(["a"], []).is_final()
    assert StationaryIState([], []).edges() == {}


def test_one_of_each_is_final_at_once() -> None:
    istate = StationaryIState(["a"], [1])
    assert istate.is_final()
    assert istate.matches() == {1: "a"}


def test_unknown_ids_are_ignored() -> None:
    istate = StationaryIState(["a", "b"], [1])
    istate.update({"a", "stranger"}, {1, 99})
    assert istate.edges() == {1: ["a"]}


@given(st.data())
def test_equals_element_wise_multiplication(data: st.DataObject) -> None:
    """Alg. 1 with matrices of ones and zeros, as printed."""
    w = data.draw(st.integers(0, 12))
    v = data.draw(st.integers(0, 12))
    istate = StationaryIState([f"{h:02d}" for h in range(w)], range(v))
    matrix = np.ones((w, v), dtype=int)
    for _ in range(data.draw(st.integers(0, 6))):
        active_w = data.draw(st.lists(st.booleans(), min_size=w, max_size=w))
        active_v = data.draw(st.lists(st.booleans(), min_size=v, max_size=v))
        observed = np.equal.outer(np.array(active_w, dtype=bool), np.array(active_v, dtype=bool)).astype(int)
        matrix = matrix * observed
        istate.update({f"{h:02d}" for h in range(w) if active_w[h]}, {s for s in range(v) if active_v[s]})
        assert istate.edges() == {s: [f"{h:02d}" for h in range(w) if matrix[h, s]] for s in range(v)}
        columns = matrix.sum(axis=0)
        assert istate.is_final() == bool((columns == 1).all())
        if istate.is_final():
            assert matrix.sum() == v  # "contains only v 1's"


# --- the score, on made-up histories -------------------------------------------------------------

TRUTH = {("a", 1): "b", ("a", 2): "c", ("b", 5): "a"}


def entry(
    robot: str, step: int, matches: Mapping[int, str], visual: int, complete: bool
) -> tuple[str, dict[str, Any]]:
    edges: dict[str, list[str]] = {str(visual_id): [] for visual_id in range(visual)}
    return robot, {
        "step": step,
        "edges": edges,
        "matches": {str(visual_id): name for visual_id, name in matches.items()},
        "complete": complete,
    }


def test_score_by_hand() -> None:
    history = [
        entry("a", 0, {}, 2, False),
        entry("b", 0, {}, 1, False),
        entry("a", 1, {1: "b"}, 2, False),
        entry("b", 1, {}, 1, False),
        entry("a", 2, {1: "b", 2: "c"}, 2, True),
        entry("b", 2, {5: "c"}, 1, True),
        entry("a", 3, {1: "b", 2: "c"}, 2, True),
        entry("b", 3, {5: "a"}, 1, True),
    ]
    result = score_history(history, TRUTH, {"a": 4, "b": 2})
    assert result == {
        "robots": 2,
        "steps_to_completion": {
            "completed": 2, "mean": 2.0, "sd": 0.0, "min": 2, "max": 2, "per_robot": {"a": 2, "b": 2},
        },
        "fraction_matched": [0.25, 0.5, 1.0],
        "false_matches": 1,
        "messages_sent": 6,
        "messages_per_robot": 3.0,
    }  # fmt: skip


def test_a_robot_that_is_never_done() -> None:
    result = score_history([entry("a", 1, {}, 2, False)], TRUTH, {})
    assert result["steps_to_completion"] == {
        "completed": 0, "mean": None, "sd": None, "min": None, "max": None, "per_robot": {"a": None},
    }  # fmt: skip
    assert result["fraction_matched"] == [0.0]


def test_an_empty_history() -> None:
    assert score_history([], {}, {})["robots"] == 0


def test_truth_is_read_from_the_records() -> None:
    records = [
        {"kind": "start", "robots": []},
        {"kind": "visual ids", "entered": [{"observer": "a", "visual": 1, "robot": "b"}], "left": []},
        {"kind": "visual ids", "entered": [], "left": [{"observer": "a", "visual": 1, "robot": "b"}]},
    ]
    assert truth_of(records) == {("a", 1): "b"}


@pytest.mark.parametrize(("wireless", "visual"), [(8, 8), (12, 8), (13, 3)])
def test_completion_follows_its_exact_law(wireless: int, visual: int) -> None:
    """P(done by t) = prod_{i<v} (1 - i/M) (1 - v/M)^(w-v) with M = 2^t: all ids' strings must tell apart."""
    rng = np.random.default_rng(wireless)
    runs, horizon = 4000, 14
    names = [f"{h:02d}" for h in range(wireless)]
    done_by = np.zeros(horizon)
    for _ in range(runs):
        istate = StationaryIState(names, range(visual))
        for step in range(horizon):
            if istate.is_final():
                done_by[step:] += 1
                break
            active = rng.random(wireless) < 0.5
            istate.update(
                [name for name, on in zip(names, active, strict=True) if on], np.flatnonzero(active[:visual])
            )
    cells = 2.0 ** np.arange(horizon)
    spread = np.prod([np.maximum(0.0, 1 - i / cells) for i in range(visual)], axis=0)
    law = spread * np.maximum(0.0, 1 - visual / cells) ** (wireless - visual)
    error = np.sqrt(np.maximum(law * (1 - law), 1e-9) / runs)
    assert np.abs(done_by / runs - law).max() < 5 * error.max()
    assert (np.abs(done_by / runs - law) <= 5 * error + 1e-9).all()
