"""Runs of the emulator as samples of a study: scenario in, what its log says out."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from emulator.run import Options, run
from emulator.scenario_file import load
from logs.reader import LogReader

T = TypeVar("T")


def emulated(
    scenario: str,
    read: Callable[[LogReader], T],
    *,
    seed: int,
    robots: int | None = None,
    overrides: Sequence[str] = (),
) -> T:
    """What `read` makes of the log of one run by robot processes; the log itself is not kept.

    `scenario`: a shipped name or a file; the others as `heliograph run` takes them. Raises UserError and
    RunFailed as that does.
    """
    loaded = load(scenario, robots=robots, seed=seed, overrides=list(overrides))
    with tempfile.TemporaryDirectory(prefix="heliograph-") as folder:
        outcome = run(loaded, Options(out=Path(folder) / "run.mcap", echo=None))
        with LogReader(outcome.log) as log:
            return read(log)
