"""What behaviours take from [params]: the ends of what is allowed, and what is beyond them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from agent import parameters
from agent.parameters import ParameterError


def _listed(value: Any) -> Any:
    return [_listed(each) for each in value] if isinstance(value, list | tuple) else value


@pytest.mark.parametrize(
    ("read", "allowed", "refused"),
    [
        (
            lambda p: parameters.positive(p, "k"),
            [5e-324, 1, 1e308],
            [0, -1.0, math.inf, math.nan, True, "1", None],
        ),
        (lambda p: parameters.not_negative(p, "k", 1.0), [0, 0.5], [-1e-9, math.inf, math.nan, False, [1]]),
        (lambda p: parameters.probability(p, "k"), [0, 0.5, 1], [-1e-9, 1.001, math.nan, True, None]),
        (lambda p: parameters.whole_number(p, "k", least=2), [2, 3], [1, 2.0, True, None]),
        (lambda p: parameters.flag(p, "k", True), [True, False], [0, 1, "true"]),
        (lambda p: parameters.choice(p, "k", ("a", "b"), "a"), ["a", "b"], ["c", "", 1]),
        (
            lambda p: parameters.pair(p, "k"),
            [[0, 1.5], (-1, 2)],
            [[1], [1, 2, 3], [math.nan, 0], [0, math.inf], [True, 1], "ab", 1, None],
        ),
        (
            lambda p: parameters.pairs(p, "k", 2),
            [[[0, 1], [2, 3]]],
            [[], [[0, 1]], [[0, 1]] * 3, [[0, 1], [2, math.nan]], [[0, 1], 2], None],
        ),
    ],
    ids=["positive", "not_negative", "probability", "whole_number", "flag", "choice", "pair", "pairs"],
)
def test_the_ends_of_what_is_allowed(
    read: Callable[[dict[str, Any]], object], allowed: list[Any], refused: list[Any]
) -> None:
    for value in allowed:
        assert _listed(read({"k": value})) == _listed(value)
    for value in refused:
        with pytest.raises(ParameterError, match=r"^params\.k: (must be|is missing)"):
            read({"k": value})


@pytest.mark.parametrize(
    ("read", "value", "sentence"),
    [
        (
            lambda p: parameters.positive(p, "k", most=5.0),
            5.1,
            "a number greater than 0, 5 at most, is 5.1",
        ),
        (
            lambda p: parameters.not_negative(p, "k", 1.0, most=5.0),
            6,
            "a number, 0 or more, 5 at most, is 6.0",
        ),
        (
            lambda p: parameters.whole_number(p, "k", most=9000),
            9001,
            "a whole number, 1 or more, 9,000 at most, is 9001",
        ),
    ],
)
def test_what_is_too_much(read: Callable[[dict[str, Any]], object], value: float, sentence: str) -> None:
    with pytest.raises(ParameterError, match=rf"^params\.k: must be {sentence}$"):
        read({"k": value})
    for allowed in (1, 5):
        assert read({"k": allowed}) == allowed
