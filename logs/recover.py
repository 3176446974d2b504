"""Makes a torn log whole: everything up to its first damage, with the indexes that viewers insist on."""

from __future__ import annotations

import contextlib
import os
from dataclasses import dataclass
from pathlib import Path

from logs import RESULT_METADATA, LogError
from logs.mcap_writer import FileSink, McapWriter
from logs.reader import LogReader


@dataclass(frozen=True)
class Recovered:
    """What a recovery saved."""

    messages: dict[str, int]
    """By topic."""
    metadata: int
    attachments: int
    lost_bytes: int
    """Size of what was cut off or damaged; 0 for a whole log."""


def recover(src: Path, dst: Path, force: bool = False) -> Recovered:
    """Write a whole log to `dst` from what `src` still holds, with its times and sequence numbers.

    `dst` appears only once it is complete. Raises LogError when `src` is no log, when `dst` is `src` or,
    without `force`, exists, and when it cannot be written.
    """
    with LogReader(src) as log:
        _refuse(src, dst, force)
        part = dst.with_name(dst.name + ".part")
        try:
            dst.parent.mkdir(parents=True, exist_ok=True)
            with part.open("wb", buffering=0) as file:
                _copy(log, McapWriter(FileSink(file)))
            os.replace(part, dst)
        except OSError as error:
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)
            raise LogError(f"cannot write {dst}: {error.strerror}; choose another place") from None
        return Recovered(
            messages={name: topic.messages for name, topic in log.topics.items()},
            metadata=len(log.metadata),
            attachments=len(log.attachments()),
            lost_bytes=log.size_bytes - log.whole_bytes if log.torn else 0,
        )


def _refuse(src: Path, dst: Path, force: bool) -> None:
    if not dst.exists():
        return
    if dst.samefile(src):
        raise LogError(f"{dst} is the log to recover; choose another place for the whole one")
    if not force:
        raise LogError(f"{dst} exists; choose another place or add --force")


def _copy(log: LogReader, writer: McapWriter) -> None:
    writer.start()
    before, after = _split(log)
    for name, content in before:
        writer.add_metadata(name, content)
    channels = {}
    for name, topic in log.topics.items():
        schema = writer.register_schema(topic.schema_name, topic.schema_encoding, topic.schema)
        channels[name] = writer.register_channel(name, topic.encoding, schema, {})
    for file in log.attachments():
        writer.add_attachment(file.name, file.media_type, file.data)
    for name, sequence, log_time_ns, data in log.raw():
        writer.add_message(channels[name], log_time_ns, data, sequence)
    writer.flush()
    for name, content in after:
        writer.add_metadata(name, content)
    writer.finish()


Texts = list[tuple[str, dict[str, str]]]


def _split(log: LogReader) -> tuple[Texts, Texts]:
    """Metadata that belongs before the messages, and what was written of them at the end."""
    late = [record for record in log.metadata if record[0] == RESULT_METADATA]
    return [record for record in log.metadata if record not in late], late
