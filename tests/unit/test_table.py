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


def test_tables_in_lists_are_numbered_from_one() -> None:
    score = {"bins": [{"from": 0.5, "right": 3, "age": {"mean": 1}}, {}]}
    assert score_table(score).splitlines() == [
        "bins.1      from 0.5, right 3",
        "bins.1.age  mean 1",
        "bins.2      ",
    ]


def test_lists_in_lists_are_one_line() -> None:
    assert score_table({"means": [[0.5, 0.1], [1.0, 0.0]]}) == "means  (0.5, 0.1), (1, 0)"


def test_of_many_tables_the_first_are_shown() -> None:
    shown = score_table({"hops": {str(n): {"mean": n} for n in range(1, 12)}}).splitlines()
    assert [line.split()[0] for line in shown] == [f"hops.{n}" for n in range(1, 9)] + ["hops."]
    assert shown[-1].split() == ["hops.", "...", "(11)"]


def test_long_lists_are_cut() -> None:
    assert score_table({"x": list(range(9))}) == "x  0, 1, 2, 3, 4, 5, 6, 7, ... (9)"
    assert score_table({"x": {str(n): n for n in range(9)}}).endswith("7 7, ... (9)")
