"""What association behaviours read from the scenario's [params], with plain words for what is wrong.

Every function raises ValueError with one sentence that names the parameter and what it must be.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

Params = Mapping[str, Any]


def positive(params: Params, key: str) -> float:
    """A number greater than 0, which must be given."""
    value = _number(params, key, None, "a number greater than 0")
    if not value > 0 or math.isinf(value):
        raise _misfit(key, "a number greater than 0", value)
    return value


def probability(params: Params, key: str, default: float | None = None) -> float:
    """A number from 0 to 1; without a default it must be given."""
    value = _number(params, key, default, "a number from 0 to 1")
    if not 0 <= value <= 1:
        raise _misfit(key, "a number from 0 to 1", value)
    return value


def whole_number(params: Params, key: str, default: int | None = None, *, least: int = 1) -> int:
    """A whole number of `least` or more; without a default it must be given."""
    value = params.get(key, default)
    what = f"a whole number, {least} or more"
    if value is None:
        raise _missing(key, what)
    if type(value) is not int or value < least:
        raise _misfit(key, what, value)
    return value


def flag(params: Params, key: str, default: bool) -> bool:
    """True or false."""
    value = params.get(key, default)
    if type(value) is not bool:
        raise _misfit(key, "true or false", value)
    return value


def _number(params: Params, key: str, default: float | None, what: str) -> float:
    value = params.get(key, default)
    if value is None:
        raise _missing(key, what)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _misfit(key, what, value)
    return float(value)


def _missing(key: str, what: str) -> ValueError:
    return ValueError(f"params.{key}: is missing; write {what}")


def _misfit(key: str, what: str, value: object) -> ValueError:
    return ValueError(f"params.{key}: must be {what}, is {value!r}")
