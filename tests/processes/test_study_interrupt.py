"""A study that is stopped in the middle leaves nobody at work, however it is stopped."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.support import TIMEOUT_S

pytestmark = pytest.mark.processes

COMMAND = [
    sys.executable,
    "-m",
    "emulator",
    "study",
    "association-mobile",
    "--samples",
    "500",
    "--jobs",
    "2",
    "--set",
    "steps=50000",
]
"""Takes hours, and many minutes for one world, if nobody stops it."""
WHEN = [pytest.param(0, id="while workers start"), pytest.param(3, id="while they compute")]
"""Seconds of processor time that workers have used; to import everything takes them one or two."""


@pytest.fixture
def study() -> Iterator[subprocess.Popen[str]]:
    """The command, in a session of its own: what is sent to it alone is not sent to its workers."""
    with subprocess.Popen(
        COMMAND, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        try:
            yield process
        finally:
            with contextlib.suppress(ProcessLookupError):  # whoever of the session is left
                os.killpg(process.pid, signal.SIGKILL)


def stat(pid: int) -> list[str]:
    """Fields of a process's state, from its state letter on; empty: there is no such process."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return []
    return text.rpartition(")")[2].split()


def is_alive(pid: int, since: str) -> bool:
    """Whether this very process, by its time of birth, runs: a zombie does not."""
    fields = stat(pid)
    return bool(fields) and fields[0] not in "ZX" and fields[19] == since


def children(pid: int) -> dict[int, str]:
    """All children of a process, and when each was born."""
    found: dict[int, str] = {}
    with contextlib.suppress(FileNotFoundError, ProcessLookupError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            for child in (task / "children").read_text().split():
                if fields := stat(int(child)):
                    found[int(child)] = fields[19]
    return found


def workers(pid: int) -> dict[int, str]:
    """Those of them that multiprocessing has spawned to do chunks."""

    def is_worker(child: int) -> bool:
        try:
            return b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()
        except (FileNotFoundError, ProcessLookupError):
            return False

    return {child: since for child, since in children(pid).items() if is_worker(child)}


def wait_until(happened: Callable[[], bool]) -> bool:
    """Whether it happens before patience ends."""
    deadline = time.monotonic() + TIMEOUT_S / 2
    while not happened():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


def at_work(study: subprocess.Popen[str], seconds: int) -> dict[int, str]:
    """The study's processes, once two workers are there that have used more processor time than that."""

    def busy(pid: int) -> bool:
        fields = stat(pid)
        return bool(fields) and int(fields[11]) + int(fields[12]) >= seconds * os.sysconf("SC_CLK_TCK")

    assert wait_until(lambda: sum(map(busy, workers(study.pid))) == 2 or study.poll() is not None)
    assert study.poll() is None, study.communicate()
    return children(study.pid)


def nobody_is_left(processes: dict[int, str]) -> bool:
    return wait_until(lambda: not any(is_alive(pid, since) for pid, since in processes.items()))


def told(err: str) -> list[str]:
    """What the command said, without its progress bar."""
    return [line for line in err.replace("\r", "\n").split("\n") if line.strip() and "worlds" not in line]


@pytest.mark.parametrize("seconds", WHEN)
@pytest.mark.parametrize(
    ("number", "code", "word"),
    [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")],
)
def test_a_signal_to_the_command_alone(
    study: subprocess.Popen[str], number: signal.Signals, code: int, word: str, seconds: int
) -> None:
    processes = at_work(study, seconds)
    study.send_signal(number)
    out, err = study.communicate(timeout=TIMEOUT_S)
    assert study.returncode == code, err
    assert out == ""
    assert told(err) == [f"heliograph: {word}"]
    assert nobody_is_left(processes)


@pytest.mark.parametrize("seconds", WHEN)
def test_an_interrupt_from_a_terminal(study: subprocess.Popen[str], seconds: int) -> None:
    """Ctrl-C reaches the workers as well, wherever they are; they leave it to the command."""
    processes = at_work(study, seconds)
    os.killpg(study.pid, signal.SIGINT)
    out, err = study.communicate(timeout=TIMEOUT_S)
    assert (study.returncode, out) == (130, ""), err
    assert told(err) == ["heliograph: interrupted"]
    assert nobody_is_left(processes)


@pytest.mark.parametrize("seconds", WHEN)
def test_workers_do_not_outlive_a_command_that_is_killed(study: subprocess.Popen[str], seconds: int) -> None:
    processes = at_work(study, seconds)
    study.kill()
    study.communicate(timeout=TIMEOUT_S)  # ends when the last one that holds its pipes does
    assert study.returncode == -signal.SIGKILL
    assert nobody_is_left(processes)
