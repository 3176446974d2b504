"""How the end of a behaviour is told: in the same words wherever the robot runs."""

from __future__ import annotations

import re
import sys

MAX_SENTENCE = 1000
_ADDRESS = re.compile(r"\b0x[0-9a-fA-F]{6,}")


def unwrapped(error: BaseException) -> BaseException:
    """The error in a group of one, which says nothing but that there was a task group."""
    while isinstance(error, BaseExceptionGroup) and len(error.exceptions) == 1:
        error = error.exceptions[0]
    return error


def sentence(error: BaseException) -> str:
    """Type and text of an error on one line of limited length, the same in every run.

    Addresses in memory, which differ from run to run, are left out; half characters, which no
    message can carry, are escaped.
    """
    try:
        text = str(error)
    except Exception:
        text = "(its text cannot be had)"
    return one_line(f"{type(error).__name__}: {text}")


def one_line(text: str, limit: int = MAX_SENTENCE) -> str:
    """Text without line breaks, half characters and addresses in memory, cut to `limit` characters."""
    line = _ADDRESS.sub("0x...", " ".join(text[: 8 * limit].split()))
    return line.encode(errors="backslashreplace").decode()[:limit]


def exit_code(error: SystemExit) -> int:
    """The exit code of a process that `error` ends; a text instead of a code is printed, as Python does."""
    code = error.code
    if code is None:
        return 0
    if isinstance(code, int):
        return code & 0xFF
    print(code, file=sys.stderr)
    return 1
