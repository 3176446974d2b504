"""Score a log by the function its scenario names, and check that function's work."""

from __future__ import annotations

import contextlib
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import orjson

from agent.loading import BehaviourError, load_behaviour, load_function
from emulator.attached import unpacked
from emulator.errors import UserError
from emulator.scenario import Scenario, team
from emulator.scenario_checks import file_of
from logs.reader import LogReader

DEFAULT_SCORE = "logs.score:score"
REMEDY = "mend it, and score the log with --source FOLDER"


def score(log: Path, folder: Path | None = None) -> dict[str, Any]:
    """What the scoring function of a log makes of it, as it would come back from JSON.

    `folder`: where the user's Python files are; None: they are taken from the log.
    Raises UserError where the function cannot be used, fails, or returns what JSON has no form for.
    """
    with contextlib.ExitStack() as stack:
        reader = stack.enter_context(LogReader(log))
        name = reader.run.get("score") or DEFAULT_SCORE
        if folder is None and file_of(name) is not None:
            folder = stack.enter_context(unpacked(reader))
        # Standard output is for results alone, whatever the user's code prints.
        stack.enter_context(contextlib.redirect_stdout(sys.stderr))
        return _plain(name, reader, _call(name, reader, folder))


def check_functions(scenario: Scenario) -> None:
    """Import what a scenario names, without running it. Raises UserError where something is wrong."""
    try:
        for name in dict.fromkeys(spec.behaviour for spec in team(scenario)):
            load_behaviour(name, scenario.folder)
        load_function(scenario.score or DEFAULT_SCORE, scenario.folder)
    except BehaviourError as error:
        raise UserError(f"{scenario.name}: {error}; mend it, or name another function") from None


def _call(name: str, log: LogReader, folder: Path | None) -> object:
    try:
        function = load_function(name, folder)
    except BehaviourError as error:
        raise UserError(f"score: {error}; {REMEDY}") from None
    try:
        return function(log)
    except (Exception, SystemExit) as error:
        what = f"{type(error).__name__}: {error}{_place(error, function)}"
        raise UserError(f"score: {name} fails on {log.path} with {what}; {REMEDY}") from error


def _plain(name: str, log: LogReader, result: object) -> dict[str, Any]:
    if not isinstance(result, dict):
        what = f"{type(result).__name__} instead of a dict of results"
        raise UserError(f"score: {name} returns {what} for {log.path}; {REMEDY}")
    try:
        plain: dict[str, Any] = orjson.loads(orjson.dumps(result))
    except (TypeError, ValueError) as error:
        what = f"what JSON has no form for ({error})"
        raise UserError(f"score: {name} returns {what} for {log.path}; {REMEDY}") from None
    return plain


def _place(error: BaseException, function: Callable[..., Any]) -> str:
    """The line of the function's own file where it went wrong."""
    code = getattr(function, "__code__", None)
    frames = traceback.extract_tb(error.__traceback__)
    lines = [frame.lineno for frame in frames if code is not None and frame.filename == code.co_filename]
    return f" (line {lines[-1]} of {Path(code.co_filename).name})" if lines and code is not None else ""
