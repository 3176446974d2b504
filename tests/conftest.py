"""What holds for all tests."""

from __future__ import annotations

import signal
import tempfile
from collections.abc import Iterator

import pytest

# A shell starts what runs in its background with interrupts ignored, and so would be the commands that tests
# start and interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def _temporary_folder() -> Iterator[None]:
    """One for each process that runs tests: they look for what runs have left there, side by side."""
    with tempfile.TemporaryDirectory(prefix="test-") as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("TMPDIR", folder)
        patch.setattr(tempfile, "tempdir", None)  # what it has found before
        yield
