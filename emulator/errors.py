"""The two ways in which a command ends badly, each with its exit code."""

from __future__ import annotations

from collections.abc import Sequence


class UserError(Exception):
    """A mistake in what the user gave: one plain sentence naming file, key and remedy."""

    exit_code = 2


class RunFailed(Exception):
    """A run that started and ended badly: one plain sentence.

    `robot` is the robot it failed at, or None; `cause` says why in a few words (by default the whole
    sentence); `output` holds the last lines that robot's process wrote.
    """

    exit_code = 1

    def __init__(
        self, sentence: str, *, robot: str | None = None, cause: str | None = None, output: Sequence[str] = ()
    ) -> None:
        super().__init__(sentence)
        self.robot = robot
        self.cause = sentence if cause is None else cause
        self.output = list(output)
