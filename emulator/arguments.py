"""What all commands' arguments and outputs have in common."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import orjson

Commands = Any
"""Where commands are added; argparse names no type for it."""


def add_command(
    commands: Commands, name: str, command: Callable[[argparse.Namespace], int], text: str, more: str = ""
) -> argparse.ArgumentParser:
    """A parser for the command `name`, which `command` carries out.

    `text` describes it in one line; `more`: sentences that its own help adds.
    """
    parser: argparse.ArgumentParser = commands.add_parser(
        name, help=text, description=f"{text[0].upper()}{text[1:]}. {more}".rstrip()
    )
    parser.set_defaults(command=command)
    return parser


def add_json(parser: argparse.ArgumentParser) -> None:
    """The option --json."""
    parser.add_argument("--json", action="store_true", help="print one JSON value and nothing else")


def print_json(value: Any) -> None:
    """One JSON value on standard output, indented."""
    print(orjson.dumps(value, option=orjson.OPT_INDENT_2).decode())
