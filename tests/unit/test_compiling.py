"""Who waits for a compiler is told so, once; who reads output by program is not bothered."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from agent.compiling import SENTENCE

SCRIPT = """
import sys
from agent.compiling import announce
from numba import njit
announce()
announce()

@njit(cache=True)
def twice(x):
    return 2 * x

twice(1)
twice(1.5)
"""


def on_a_terminal(script: Path) -> str:
    """What it says there; the folder of `script` keeps what it compiles."""
    master, terminal = os.openpty()
    with open(master, "rb", buffering=0) as screen:
        try:
            subprocess.run([sys.executable, str(script)], stderr=terminal, check=True, timeout=120)
        finally:
            os.close(terminal)
        try:
            return screen.read(65536).decode()
        except OSError:  # Linux's way to say that nothing more can come
            return ""


def test_a_compiler_is_announced_once_and_only_to_who_watches(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    assert on_a_terminal(script) == SENTENCE + "\r\n"
    assert on_a_terminal(script) == ""  # what was compiled is there
    script.write_text(SCRIPT + "\n")  # which numba compiles again
    piped = subprocess.run([sys.executable, str(script)], capture_output=True, check=True, timeout=120)
    assert piped.stderr == b""
