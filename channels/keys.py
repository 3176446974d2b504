"""Zenoh key expressions. The only place where they are built or taken apart."""

from __future__ import annotations

import re

ROOT = "heliograph"
ROBOT_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}")
"""What a robot may be called: such a name is one chunk of a key expression and nothing more."""


def to_broker(run: str, robot: str) -> str:
    """Where one robot publishes what it did."""
    return f"{ROOT}/{run}/tx/{robot}"


def to_robot(run: str, robot: str) -> str:
    """Where the broker publishes what one robot may know."""
    return f"{ROOT}/{run}/rx/{robot}"


def from_all_robots(run: str) -> str:
    """What the broker subscribes to."""
    return f"{ROOT}/{run}/tx/*"


def robot_of(key: str) -> str:
    """The robot a key belongs to: its last chunk."""
    return key[key.rindex("/") + 1 :]
