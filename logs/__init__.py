"""One run, one MCAP file: recording it, reading it back, repairing it, comparing two of them."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

RUN_METADATA = "heliograph.run"
"""Metadata record written first: what was run."""
RESULT_METADATA = "heliograph.result"
"""Metadata record written last: how it ended. Its absence marks an aborted run."""


class LogError(Exception):
    """A log that cannot be written or read: one plain sentence naming the file and the remedy."""


@dataclass(frozen=True)
class Attachment:
    """A file carried inside the log, such as the scenario or a viewer layout."""

    name: str
    media_type: str
    data: bytes


def sha256_of(path: Path) -> str:
    """Hex SHA-256 of a file's bytes. Raises LogError when it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror}; check the name") from None
