"""Find a behaviour by the name a scenario gives it."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import sys
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

from agent.robot import Robot

Behaviour = Callable[[Robot], Coroutine[Any, Any, None]]


class BehaviourError(Exception):
    """A behaviour that cannot be used; one plain sentence says why."""


def load_function(name: str, folder: Path | None) -> Callable[..., Any]:
    """The function `module:function` or `file.py:function` (relative to `folder`) stands for.

    Raises BehaviourError where there is no such file, module or function, or it fails to import.
    """
    place, _, function = name.rpartition(":")
    if not place or not function:
        raise BehaviourError(f"{name!r} names no function; write module:function or file.py:function")
    try:
        module = _module_of_file(place, folder) if place.endswith(".py") else importlib.import_module(place)
    except BehaviourError:
        raise
    except Exception as error:
        raise BehaviourError(f"{place} fails to import: {type(error).__name__}: {error}") from error
    found = getattr(module, function, None)
    if not callable(found):
        raise BehaviourError(f"{place} has no function {function!r}")
    return found  # type: ignore[no-any-return]


def load_behaviour(name: str, folder: Path | None) -> Behaviour:
    """As load_function; what it finds must be an `async def` that takes the robot."""
    found = load_function(name, folder)
    if not inspect.iscoroutinefunction(found):
        raise BehaviourError(f"{name} is not an `async def` function taking the robot")
    return found


def _module_of_file(place: str, folder: Path | None) -> Any:
    path = ((folder or Path()) / place).resolve()
    if not path.is_file():
        raise BehaviourError(f"there is no file {place} beside the scenario")
    name = "behaviour_" + "".join(c if c.isalnum() else "_" for c in str(path))
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise BehaviourError(f"{place} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    if str(path.parent) not in sys.path:  # a behaviour may import its neighbours
        sys.path.insert(0, str(path.parent))
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module
