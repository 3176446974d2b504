"""The files a log carries: what is attached to it, and how that is unpacked again."""

from __future__ import annotations

import contextlib
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from agent.loading import BehaviourError, files_used, forget_user_modules
from emulator.errors import UserError
from emulator.scenario import RobotSpec, Scenario
from emulator.scenario_checks import file_of
from logs.reader import LogReader
from logs.recorder import Attachment

SCENARIO = "scenario.toml"
_PYTHON = "text/x-python"


def attachments(scenario: Scenario, files: Sequence[str]) -> list[Attachment]:
    """The scenario as it was written, a layout for viewers, and the user's own Python files."""
    layout = Path(__file__).parent.parent / "logs" / "layout.json"
    attached = [
        Attachment(SCENARIO, "application/toml", scenario.text),
        Attachment("layout.json", "application/json", layout.read_bytes()),
    ]
    for name in files:
        assert scenario.folder is not None
        try:
            attached.append(Attachment(name, _PYTHON, (scenario.folder / name).read_bytes()))
        except OSError as error:
            raise UserError(f"{name}: cannot be read ({error.strerror}); the log is to carry it") from None
    return attached


def user_files(scenario: Scenario, specs: Sequence[RobotSpec]) -> list[str]:
    """Python files that the scenario names or that these import, relative to its folder.

    Imports them. Raises UserError where one cannot be used.
    """
    named = dict.fromkeys([scenario.score or "", *(spec.behaviour for spec in specs)])
    places = {name: file for name in named if (file := file_of(name)) is not None}
    if not places:
        return []
    assert scenario.folder is not None
    try:
        with contextlib.redirect_stdout(sys.stderr):  # standard output is for results alone
            forget_user_modules(scenario.folder)  # what another run has imported is no part of this one
            used = files_used(list(places), scenario.folder)
    except BehaviourError as error:
        raise UserError(f"{scenario.name}: {error}; mend it, or name another function") from None
    return sorted({*places.values(), *used})


def python_files(log: LogReader) -> list[str]:
    """Names of the user's Python files that a log carries, in its order."""
    return [attachment.name for attachment in log.attachments() if attachment.media_type == _PYTHON]


@contextlib.contextmanager
def unpacked(log: LogReader) -> Iterator[Path]:
    """A temporary folder with the Python files of a log, which are forgotten with it.

    Raises UserError where one would lie outside that folder.
    """
    with tempfile.TemporaryDirectory(prefix="heliograph-") as name:
        folder = Path(name).resolve()
        for attachment in log.attachments():
            if attachment.media_type == _PYTHON:
                _unpack(folder, attachment)
        try:
            yield folder
        finally:
            forget_user_modules(folder)


def _unpack(folder: Path, attachment: Attachment) -> None:
    target = (folder / attachment.name).resolve()
    if not target.is_relative_to(folder):
        raise UserError(
            f"attachment {attachment.name}: lies outside the scenario's folder; give --source FOLDER instead"
        )
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(attachment.data)
