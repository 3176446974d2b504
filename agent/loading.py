"""Find a behaviour by the name a scenario gives it."""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import importlib.util
import inspect
import sys
import sysconfig
from collections.abc import Callable, Coroutine, Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from agent.endings import sentence
from agent.robot import Robot

Behaviour = Callable[[Robot], Coroutine[Any, Any, None]]

_HOME = Path(__file__).resolve().parent.parent
_NOT_USERS = (
    *(_HOME / package for package in ("agent", "channels", "emulator", "logs", "scenarios")),
    *(Path(sysconfig.get_path(kind)).resolve() for kind in ("stdlib", "platstdlib", "purelib", "platlib")),
)
_added_to_path: list[str] = []


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
    except SystemExit as error:
        raise BehaviourError(f"importing the behaviour ended with {sentence(error)}") from error
    except Exception as error:
        raise BehaviourError(f"{place} fails to import: {sentence(error)}") from error
    found = getattr(module, function, None)
    if not callable(found):
        raise BehaviourError(f"{place} has no function {function!r}")
    return found  # type: ignore[no-any-return]


def load_behaviour(name: str, folder: Path | None) -> Behaviour:
    """As load_function; what it finds must be an `async def` that takes the robot."""
    found = load_function(name, folder)
    if not inspect.iscoroutinefunction(found):
        raise BehaviourError(f"{name} is not an `async def` function taking the robot")
    try:
        inspect.signature(found).bind(None)
    except TypeError as error:
        raise BehaviourError(f"{name} cannot be called with the robot alone: {error}") from None
    return found


def is_file(name: str) -> bool:
    """Whether a function is named by the file it is in, and not by a module."""
    return name.rpartition(":")[0].endswith(".py")


def files_used(names: Sequence[str], folder: Path) -> list[str]:
    """Python files under `folder` that functions of these names are made of, relative to it, sorted.

    Loads what is not loaded yet; what a function imports only when it is called is not known then.
    Raises BehaviourError as load_function.
    """
    for name in filter(None, names):
        load_function(name, folder)
    root = folder.resolve()
    files = {file for module in list(sys.modules.values()) if (file := _file_of(module)) is not None}
    return sorted(file.relative_to(root).as_posix() for file in files if _is_users(file, [root]))


def forget_user_modules(folder: Path | None) -> None:
    """Have everything that comes from `folder` loaded anew when it is next named.

    A run after another one in the same process then sees files as they are now, and nothing of what
    the other run left in their globals. Installed packages and our own stay, wherever they are.
    """
    places = [*_added_to_path] if folder is None else [*_added_to_path, str(folder)]
    roots = [Path(place).resolve() for place in places]
    for name, module in list(sys.modules.items()):
        if name != "__main__" and any(_is_users(place, roots) for place in _places(module)):
            del sys.modules[name]
    for place in _added_to_path:
        with contextlib.suppress(ValueError):
            sys.path.remove(place)
    _added_to_path.clear()
    importlib.invalidate_caches()


def _places(module: ModuleType) -> list[Path]:
    """Its file, or the folders of a package that has no file."""
    file = _file_of(module)
    if file is not None:
        return [file]
    with contextlib.suppress(Exception):
        return [Path(place).resolve() for place in module.__path__]
    return []


def _file_of(module: ModuleType) -> Path | None:
    file = getattr(module, "__file__", None)
    return Path(file).resolve() if isinstance(file, str) else None


def _is_users(place: Path, roots: Sequence[Path]) -> bool:
    """Whether a module from here is the user's own, and neither installed nor a part of ours."""
    if not any(place.is_relative_to(root) for root in roots):
        return False
    if "site-packages" in place.parts:
        return False
    return not any(map(place.is_relative_to, _NOT_USERS))


@contextlib.contextmanager
def _no_bytecode() -> Iterator[None]:
    """Bytecode counts as fresh for a second after its source has changed: do not keep any."""
    before, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        yield
    finally:
        sys.dont_write_bytecode = before


def _module_of_file(place: str, folder: Path | None) -> Any:
    path = ((folder or Path()) / place).resolve()
    if not path.is_file():
        raise BehaviourError(f"there is no file {place} beside the scenario")
    digest = hashlib.blake2b(bytes(path), digest_size=8).hexdigest()
    name = f"behaviour_{path.stem}_{digest}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise BehaviourError(f"{place} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    if str(path.parent) not in sys.path:  # a behaviour may import its neighbours
        sys.path.insert(0, str(path.parent))
        _added_to_path.append(str(path.parent))
    sys.modules[name] = module
    try:
        with _no_bytecode():
            spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module
