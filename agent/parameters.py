"""What behaviours read from the scenario's [params], with plain words for what is wrong.

Every function raises ParameterError with one sentence that names the parameter and what it must be.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

Params = Mapping[str, Any]
Option = TypeVar("Option", bound=str)


class ParameterError(ValueError):
    """A scenario that a behaviour cannot work with: "key: what is wrong and what helps".

    A behaviour that raises it ends the run as a mistake in the scenario, told without a traceback.
    """


def positive(
    params: Params, key: str, default: float | None = None, *, most: float = sys.float_info.max
) -> float:
    """A number greater than 0, and `most` at most; without a default it must be given."""
    what = "a number greater than 0" + _at_most(most, sys.float_info.max)
    value = _number(params, key, default, what)
    if not 0 < value <= most:
        raise _misfit(key, what, value)
    return value


def not_negative(params: Params, key: str, default: float, *, most: float = sys.float_info.max) -> float:
    """A number of 0 or more, and `most` at most."""
    what = "a number, 0 or more" + _at_most(most, sys.float_info.max)
    value = _number(params, key, default, what)
    if not 0 <= value <= most:
        raise _misfit(key, what, value)
    return value


def probability(params: Params, key: str, default: float | None = None) -> float:
    """A number from 0 to 1; without a default it must be given."""
    value = _number(params, key, default, "a number from 0 to 1")
    if not 0 <= value <= 1:
        raise _misfit(key, "a number from 0 to 1", value)
    return value


def whole_number(
    params: Params, key: str, default: int | None = None, *, least: int = 1, most: int | None = None
) -> int:
    """A whole number of `least` or more, and `most` at most; without a default it must be given."""
    value = params.get(key, default)
    what = f"a whole number, {least} or more" + _at_most(most, None)
    if value is None:
        raise _missing(key, what)
    if type(value) is not int or value < least or (most is not None and value > most):
        raise _misfit(key, what, value)
    return value


def flag(params: Params, key: str, default: bool) -> bool:
    """True or false."""
    value = params.get(key, default)
    if type(value) is not bool:
        raise _misfit(key, "true or false", value)
    return value


def choice(params: Params, key: str, options: Sequence[Option], default: Option) -> Option:
    """One of these texts."""
    value = params.get(key, default)
    for option in options:  # returned as it is there: of its type
        if option == value:
            return option
    raise _misfit(key, f"one of {', '.join(options)}", value)


def pair(params: Params, key: str, default: tuple[float, float] | None = None) -> tuple[float, float]:
    """Two finite numbers; without a default they must be given."""
    value = params.get(key, default)
    if value is None:
        raise _missing(key, "two numbers, as [1.0, 2.0]")
    return _pair(key, value, "two numbers, as [1.0, 2.0]")


def pairs(params: Params, key: str, count: int) -> list[tuple[float, float]]:
    """As many pairs of finite numbers as `count`, which must be given."""
    what = f"{count} pairs of numbers, as [[1.0, 2.0], ...]"
    value = params.get(key)
    if value is None:
        raise _missing(key, what)
    if not isinstance(value, list | tuple) or len(value) != count:
        raise _misfit(key, what, value)
    return [_pair(key, one, what) for one in value]


def _pair(key: str, value: object, what: str) -> tuple[float, float]:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise _misfit(key, what, value)
    for one in value:
        if isinstance(one, bool) or not isinstance(one, int | float) or not math.isfinite(one):
            raise _misfit(key, what, value)
    return float(value[0]), float(value[1])


def _number(params: Params, key: str, default: float | None, what: str) -> float:
    value = params.get(key, default)
    if value is None:
        raise _missing(key, what)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _misfit(key, what, value)
    return float(value)


def _at_most(most: float | None, any_number: float | None) -> str:
    if most is None or most == any_number:
        return ""
    return f", {int(most) if most == int(most) else most:,} at most"


def _missing(key: str, what: str) -> ParameterError:
    return ParameterError(f"params.{key}: is missing; write {what}")


def _misfit(key: str, what: str, value: object) -> ParameterError:
    return ParameterError(f"params.{key}: must be {what}, is {value!r}")
