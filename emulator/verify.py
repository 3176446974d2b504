"""Run again what a log says was run, and compare the two logs byte by byte."""

from __future__ import annotations

import contextlib
import tempfile
from pathlib import Path

from emulator.assemble import version
from emulator.attached import SCENARIO, python_files, unpacked
from emulator.errors import UserError
from emulator.run import FleetName, Options, run
from emulator.scenario_file import from_resolved
from logs.compare import first_difference
from logs.reader import LogReader


def verify(log: Path, fleet: FleetName, source: Path | None) -> str | None:
    """None where the log comes out the same; else what differs first, in words.

    Everything is taken from the log itself: the resolved scenario, the seed, and the user's Python
    files attached to it, unless `source` names a folder to take those from. Nothing is scored.
    Raises UserError for a log that cannot be run again, RunFailed where the run fails.
    """
    with contextlib.ExitStack() as stack:
        again = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="heliograph-"))) / "again.mcap"
        with LogReader(log) as reader:
            resolved = _resolved(reader)
            text = next((file.data for file in reader.attachments() if file.name == SCENARIO), b"")
            files = python_files(reader) if source is None else None
            folder = source or stack.enter_context(unpacked(reader))
        scenario = from_resolved(resolved, folder, text=text)
        run(scenario, Options(out=again, fleet=fleet, echo=None, files=files))
        difference = first_difference(log, again)
        return None if difference is None else difference.format()


def _resolved(log: LogReader) -> str:
    """The scenario a log carries. Raises UserError where it cannot be run again here."""
    resolved = log.run.get("resolved")
    if resolved is None:
        raise UserError(
            f"{log.path}: carries no scenario; only logs written by `heliograph run` can be verified"
        )
    written_by = log.run.get("heliograph")
    if written_by != version():
        raise UserError(
            f"{log.path}: was written by Heliograph {written_by}, this is {version()}; "
            "verify it with that one"
        )
    if log.torn:
        raise UserError(f"{log.path}: is torn or damaged; `heliograph recover` saves what can be read")
    if not log.complete:
        raise UserError(f"{log.path}: the run was aborted, so there is no whole log to compare; run it again")
    return resolved
