"""The two ways in which a command ends badly, each with its exit code; and what is wrong with a scenario."""

from __future__ import annotations

from collections.abc import Sequence


class UserError(Exception):
    """A mistake in what the user gave: one plain sentence naming file, key and remedy."""

    exit_code = 2


class InvalidError(Exception):
    """A scenario that cannot be: `key` is at fault, the message says why.

    `names_key`: the message already names the key.
    """

    def __init__(self, key: str, why: str, *, names_key: bool = False) -> None:
        super().__init__(why)
        self.key = key
        self.names_key = names_key


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
