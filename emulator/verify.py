"""Run again what a log says was run, and compare the two logs byte by byte."""

from __future__ import annotations

import tempfile
from pathlib import Path

from emulator.errors import UserError
from emulator.run import FleetName, Options, run, version
from emulator.scenario import Scenario
from emulator.scenario_file import from_resolved
from logs.compare import first_difference
from logs.reader import LogReader


def verify(log: Path, fleet: FleetName, source: Path | None) -> str | None:
    """None where the log comes out the same; else what differs first, in words.

    Everything is taken from the log itself: the resolved scenario, the seed, and the user's Python
    files attached to it, unless `source` names a folder to take those from.
    Raises UserError for a log that cannot be run again, RunFailed where the run fails.
    """
    with tempfile.TemporaryDirectory(prefix="heliograph-verify-") as folder:
        scenario = _scenario_of(log, source or Path(folder), unpack=source is None)
        again = Path(folder) / "again.mcap"
        run(scenario, Options(out=again, fleet=fleet, echo=None))
        difference = first_difference(log, again)
        return None if difference is None else str(difference)


def _scenario_of(log: Path, folder: Path, *, unpack: bool) -> Scenario:
    with LogReader(log) as reader:
        resolved = reader.run.get("resolved")
        if resolved is None:
            raise UserError(
                f"{log}: carries no scenario; only logs written by `heliograph run` can be verified"
            )
        written_by = reader.run.get("heliograph")
        if written_by != version():
            raise UserError(
                f"{log}: was written by Heliograph {written_by}, this is {version()}; verify it with that one"
            )
        if not reader.complete:
            raise UserError(f"{log}: the run was aborted, so there is no whole log to compare; run it again")
        text = b""
        for attachment in reader.attachments():
            if attachment.name == "scenario.toml":
                text = attachment.data
            elif attachment.name.endswith(".py") and unpack:
                _unpack(folder, attachment.name, attachment.data)
    return from_resolved(resolved, folder, text=text)


def _unpack(folder: Path, name: str, data: bytes) -> None:
    target = (folder / name).resolve()
    if not target.is_relative_to(folder.resolve()):
        raise UserError(
            f"attachment {name}: lies outside the scenario's folder; give --source FOLDER instead"
        )
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(data)
