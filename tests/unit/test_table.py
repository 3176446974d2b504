"""Results as text: nothing of a score is hidden, long lists are cut."""

from __future__ import annotations

from emulator.table import score_table


def test_plain_values_share_a_row_and_nested_ones_get_their_own() -> None:
    score = {
        "deep": {"ratio": {"mean": 1.25, "se": None}, "count": 3, "list": [1, 2]},
        "empty": {},
        "flag": True,
    }
    assert score_table(score).splitlines() == [
        "deep        count 3",
        "deep.ratio  mean 1.25, se -",
        "deep.list   1, 2",
        "empty       ",
        "flag        True",
    ]


def test_tables_in_lists_are_one_line() -> None:
    assert score_table({"bins": [{"from": 0.5, "right": 3}, {}]}) == "bins  (from 0.5, right 3), ()"
    assert score_table({"means": [[0.5, 0.1], [1.0, 0.0]]}) == "means  (0.5, 0.1), (1, 0)"


def test_long_lists_are_cut() -> None:
    assert score_table({"x": list(range(9))}) == "x  0, 1, 2, 3, 4, 5, 6, 7, ... (9)"
    assert score_table({"x": {str(n): n for n in range(9)}}).endswith("7 7, ... (9)")
