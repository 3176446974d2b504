"""What several tests need: running Heliograph as a user does, and from Python."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from emulator.run import FleetName, Options, Outcome, run
from emulator.scenario_file import load

TIMEOUT_S = 120


def heliograph(
    *arguments: object, cwd: Path | None = None, prefix: Sequence[str] = ()
) -> subprocess.CompletedProcess[str]:
    """The command, as typed; its exit code is for the caller to look at."""
    command = [*prefix, sys.executable, "-m", "emulator", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, cwd=cwd, check=False)


def run_scenario(
    scenario: str | Path, out: Path, fleet: FleetName, *, overrides: Sequence[str] = (), **changes: int
) -> Outcome:
    """One quiet run of a scenario file or shipped name."""
    return run(load(str(scenario), overrides=overrides, **changes), Options(out=out, fleet=fleet, echo=None))


def write_scenario(folder: Path, behaviour: str, toml: str, name: str = "mine") -> Path:
    """A scenario file with a behaviour file beside it; returns the path of the former."""
    (folder / "my_robot.py").write_text(behaviour)
    path = folder / f"{name}.toml"
    path.write_text(toml)
    return path
