"""MCAP files as Heliograph writes them: the `mcap` library's Writer, on a file that stays readable.

What is added to the library: a write that fails leaves none of its bytes behind, and the messages of
each channel are digested as they pass. The library keeps schemas and channels back until the first
chunk is closed: a file tells its topics only from there on, or by its summary.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import io
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any, Protocol, cast

from mcap.writer import CompressionType, Writer

from logs import LogError

CHUNK_BYTES = 256 * 1024
"""Uncompressed size at which a chunk is closed: bounds both the loss of a crash and a stall."""

LIBRARY = "heliograph"
"""Writer named in the file header: no version, so that equal runs give equal bytes."""


class Output(Protocol):
    """What a sink needs of a binary file opened without buffering."""

    def write(self, data: memoryview, /) -> int | None:
        """Write some of it; returns how much. Raises OSError."""

    def truncate(self, size: int, /) -> int:
        """Cut the file to that many bytes."""

    def close(self) -> None:
        """Close the file."""


def open_log(path: Path, *, force: bool) -> Output:
    """A new, unbuffered file; its directory is made. Raises LogError where that is not possible."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = f"{path.parent} is no directory and cannot be made one ({error.strerror})"
        raise LogError(f"cannot write {path}: {reason}; choose another --out") from None
    try:
        # Not truncated yet: it may be the log of another run that is still being written.
        file = path.open("ab" if force else "xb", buffering=0)
    except FileExistsError:
        raise LogError(f"{path} exists; choose another --out or add --force") from None
    except OSError as error:
        raise LogError(f"cannot write {path}: {error.strerror}; choose another --out") from None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        file.close()
        raise LogError(f"{path} is being written by another run; choose another --out") from None
    if file.seekable():
        file.truncate(0)
    return file


class FileSink:
    """Whole records to an unbuffered file: a write that fails leaves none of its bytes behind."""

    def __init__(self, output: Output) -> None:
        self._output = output
        self._position = 0

    def write(self, data: bytes) -> int:
        """Append all of `data`, or nothing and raise OSError."""
        view = memoryview(data)
        try:
            while view:
                view = view[self._output.write(view) or 0 :]
        except OSError:
            with contextlib.suppress(OSError, io.UnsupportedOperation):
                self._output.truncate(self._position)
            raise
        self._position += len(data)
        return len(data)

    def tell(self) -> int:
        """How many bytes have been written."""
        return self._position

    def flush(self) -> None:
        """Nothing to do: what is written is with the operating system."""

    def close(self) -> None:
        """Close the file. Raises OSError where the system only now tells that data was lost."""
        self._output.close()


class _Digest:
    """Count and SHA-256 of one channel's messages."""

    def __init__(self) -> None:
        self._count = 0
        self._sha256 = hashlib.sha256()
        self._waiting: list[bytes] = []

    def add(self, log_time: int, data: bytes) -> None:
        self._count += 1
        self._waiting += (log_time.to_bytes(8, "little"), data)

    def absorb(self) -> None:
        """One update for many messages: the call costs more than the hashing."""
        self._sha256.update(b"".join(self._waiting))
        self._waiting.clear()

    def result(self) -> tuple[int, str]:
        self.absorb()
        return self._count, self._sha256.hexdigest()


class McapWriter:
    """Writes one MCAP file: zstd chunks, every index, every CRC. Any method may raise OSError.

    Log times must not decrease; schemas and channels are registered before the first message.
    """

    def __init__(self, sink: FileSink) -> None:
        self._sink = sink
        self._digests: dict[int, _Digest] = {}
        self._writer = Writer(
            cast(IO[Any], sink),
            chunk_size=CHUNK_BYTES,
            compression=CompressionType.ZSTD,
            enable_data_crcs=True,
        )

    def start(self) -> None:
        """Write magic and header."""
        self._writer.start(profile="", library=LIBRARY)

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Add a schema; returns its id."""
        number: int = self._writer.register_schema(name, encoding, data)  # the library states no type
        return number

    def register_channel(self, topic: str, encoding: str, schema_id: int, metadata: Mapping[str, str]) -> int:
        """Add a channel; returns its id."""
        number = self._writer.register_channel(topic, encoding, schema_id, dict(metadata))
        self._digests[number] = _Digest()
        return number

    def add_message(self, channel_id: int, log_time: int, data: bytes, sequence: int) -> None:
        """Append one message; its publish time is its log time [ns]."""
        self._digests[channel_id].add(log_time, data)
        self._writer.add_message(channel_id, log_time, data, log_time, sequence)

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Write a metadata record, ahead of the messages still in the open chunk."""
        self._writer.add_metadata(name, dict(data))

    def add_attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Write an attachment; it carries no times, for there is no meaningful one."""
        self._writer.add_attachment(0, 0, name, media_type, data)

    def digest(self, channel_id: int) -> tuple[int, str]:
        """Count and hex SHA-256 of a channel's messages so far, over (log time u64 LE, data) of each."""
        return self._digests[channel_id].result()

    def flush(self) -> None:
        """Close the open chunk, if it holds anything, and hand it to the operating system."""
        for digest in self._digests.values():
            digest.absorb()
        self._writer.flush()  # type: ignore[no-untyped-call] # the library states no types

    def finish(self) -> None:
        """Write the open chunk, the summary with all indexes, and the footer."""
        self._writer.finish()  # type: ignore[no-untyped-call] # the library states no types

    def close(self) -> None:
        """Close the file as it stands."""
        self._sink.close()
