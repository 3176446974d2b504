"""Predictions: what theory says of an experiment, without running it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from msgspec import Struct


class Prediction(Struct, frozen=True):
    """The theory of one experiment as one function of its parameters."""

    name: str
    title: str
    parameters: type[Struct]
    """A struct whose fields become options of the command; its `Meta` gives ranges and descriptions."""
    predict: Callable[[Any], dict[str, Any]]
    """The result, which JSON has a form for."""
    check: Callable[[Any], None]
    """Raises ValueError, "key: what is wrong and what helps", for parameters that do not go together."""
