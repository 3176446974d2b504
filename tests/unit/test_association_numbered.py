"""The naive and the logarithmic algorithm (Ivanov & Shell 2014, Alg. 1 and 2), by hand; robots' numbers."""

from __future__ import annotations

from typing import Any

import pytest

from agent.behaviours.association.logarithmic import LogarithmicTable
from agent.behaviours.association.naive import NaiveTable
from agent.behaviours.association.numbered import announced, own_number
from agent.robot import Observation
from channels.messages import Message, encode_payload

NUMBERS = {"a": 0, "c": 2, "d": 3}


def test_naive_by_hand() -> None:
    table = NaiveTable(NUMBERS, [7, 8], ids=4)
    assert NaiveTable.steps(4) == 4
    assert table.edges() == {7: ["a", "c", "d"], 8: ["a", "c", "d"]}
    table.update(1, {8})  # number 0 has its turn
    assert table.edges() == {7: ["c", "d"], 8: ["a"]}
    table.update(2, set())  # number 1 is not in sight
    table.update(3, set())  # number 2 is heard, and not in sight
    assert table.edges() == {7: ["d"], 8: ["a"]}
    assert not table.is_final(3)
    table.update(4, {7})
    assert table.matches() == {7: "d", 8: "a"}
    assert table.is_final(4)


def test_logarithmic_by_hand() -> None:
    table = LogarithmicTable(NUMBERS, [7, 8], ids=4)
    assert LogarithmicTable.steps(4) == 2
    table.update(1, {7})  # odd numbers: 3
    assert table.edges() == {7: ["d"], 8: ["a", "c"]}
    table.update(2, {7})  # 2 and 3: so 8 is 0, which never flashes
    assert table.matches() == {7: "d", 8: "a"}
    assert table.is_final(2)


def test_who_flashes_when() -> None:
    assert [[LogarithmicTable.flashes(n, t) for t in (1, 2, 3)] for n in (0, 1, 6)] == [
        [False, False, False], [True, False, False], [False, True, True],
    ]  # fmt: skip
    assert [[NaiveTable.flashes(n, t) for t in (1, 2, 3)] for n in (0, 2)] == [
        [True, False, False], [False, False, True],
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("ids", "steps"), [(1, 0), (2, 1), (3, 2), (4, 2), (5, 3), (8, 3), (9, 4), (1000, 10), (2**40 + 1, 41)]
)
def test_logarithmic_steps(ids: int, steps: int) -> None:
    assert LogarithmicTable.steps(ids) == steps


@pytest.mark.parametrize("table_type", [NaiveTable, LogarithmicTable])
def test_a_light_whose_number_nobody_has_announced_matches_nobody(table_type: Any) -> None:
    table = table_type({"a": 0, "b": 1}, [7], ids=4)
    for step in range(1, table_type.steps(4) + 1):
        table.update(step, {7} if table_type.flashes(3, step) else set())
    assert table.edges() == {7: []}
    assert table.matches() == {}
    assert table.is_final(table_type.steps(4))


def test_a_step_left_out_leaves_more_open_and_nothing_wrong() -> None:
    table = LogarithmicTable({"a": 0, "b": 1, "c": 2, "d": 3}, [7], ids=4)
    table.update(2, {7})
    assert table.edges() == {7: ["c", "d"]}


@pytest.mark.parametrize("table_type", [NaiveTable, LogarithmicTable])
def test_nobody_there(table_type: Any) -> None:
    table = table_type({}, [], ids=2)
    assert (table.edges(), table.matches()) == ({}, {})


# --- numbers -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("robot", "params", "number"),
    [("r00", {}, 0), ("r07", {}, 7), ("unit-3-12", {}, 12), ("alice", {"number": 5}, 5), ("r9", {"number": 0}, 0)],
)  # fmt: skip
def test_own_number(robot: str, params: dict[str, int], number: int) -> None:
    assert own_number(robot, params, 20) == number


@pytest.mark.parametrize(
    ("robot", "params", "sentence"),
    [
        ("alice", {}, "params.number: is missing, and the id alice ends in no digits; give the robot one: "
                      r'\[\[robot\]\] with id = "alice" and params = \{ number = ... \}'),
        ("r20", {}, "params.number: r20 has number 20, but params.ids = 20 allows 0 to 19; raise ids, or give"),
        ("r01", {"number": 20}, "params.number: r01 has number 20, but"),
        ("r01", {"number": -1}, "params.number: must be a whole number, 0 or more, is -1"),
        ("r01", {"number": "7"}, "params.number: must be a whole number, 0 or more, is '7'"),
        ("r01", {"number": True}, "params.number: must be a whole number, 0 or more, is True"),
    ],
)  # fmt: skip
def test_numbers_that_are_none(robot: str, params: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=f"^{sentence}"):
        own_number(robot, params, 20)


def heard(*messages: tuple[str, object]) -> Observation:
    return Observation([Message(0, sender, encode_payload(payload)) for sender, payload in messages], [])


def test_announced() -> None:
    observed = heard(("b", {"id": "b", "number": 1}), ("a", {"number": 0}), ("b", {"number": 1}))
    assert list(announced(observed, "c", 2, 3).items()) == [("b", 1), ("a", 0)]


@pytest.mark.parametrize(
    ("messages", "sentence"),
    [
        (
            [("a", {"number": 4}), ("b", {"number": 4})],
            "params.number: a and b both have number 4; give each",
        ),
        ([("a", {"number": 2})], "params.number: me and a both have number 2; give each"),
        ([("a", {"number": 8})], "params.ids: is 8, but a announced no number from 0 to 7; let all robots"),
        ([("a", {"id": "a"})], "params.ids: is 8, but a announced no number"),
        ([("a", "hello")], "params.ids: is 8, but a announced no number"),
        ([("a", {"number": True})], "params.ids: is 8, but a announced no number"),
    ],
)
def test_announcements_that_do_not_do(messages: list[tuple[str, object]], sentence: str) -> None:
    with pytest.raises(ValueError, match=f"^{sentence}"):
        announced(heard(*messages), "me", 2, 8)


def test_a_message_that_is_no_msgpack_announces_nothing() -> None:
    with pytest.raises(ValueError, match="a announced no number"):
        announced(Observation([Message(0, "a", b"\xc1")], []), "me", 2, 8)
