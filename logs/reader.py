"""Reads logs, whole or torn: a torn one up to its last undamaged chunk.

Messages come in file order, which the recorder makes the order of time.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import orjson
from mcap.records import Channel, Schema

from logs import RESULT_METADATA, RUN_METADATA, Attachment, LogError
from logs.mcap_scan import McapScan, messages

__all__ = ["LogError", "LogReader", "TopicInfo"]


@dataclass(frozen=True)
class TopicInfo:
    """What a log says of one topic."""

    messages: int
    encoding: str
    schema_name: str
    schema_encoding: str
    schema: bytes


class LogReader:
    """One log, open for reading. A context manager.

    Raises LogError when the file is missing, no MCAP file, or not of the chunked kind written here.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = path
        self._scan = McapScan(Path(path))
        self.torn: bool = self._scan.torn
        """The file does not end as it should, or is damaged: `recover` makes it whole."""
        self.start_ns: int = self._scan.start_ns
        """Log time of the first message; 0 when there is none."""
        self.end_ns: int = self._scan.end_ns
        self.size_bytes: int = self._scan.size_bytes
        self.whole_bytes: int = self._scan.whole_bytes
        """How much of the file, from its start, consists of undamaged records."""

    def __enter__(self) -> LogReader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._scan.close()

    @property
    def run(self) -> dict[str, str]:
        """What was run; empty when the log does not say."""
        return self._named(RUN_METADATA) or {}

    @property
    def result(self) -> dict[str, str] | None:
        """How the run ended; None: it was aborted."""
        return self._named(RESULT_METADATA)

    @property
    def complete(self) -> bool:
        """The run came to its end and nothing of its log is missing."""
        return not self.torn and self.result is not None

    @property
    def library(self) -> str:
        """Who wrote the file."""
        return self._scan.library

    @property
    def profile(self) -> str:
        """MCAP profile, empty for logs recorded here."""
        return self._scan.profile

    @property
    def topics(self) -> dict[str, TopicInfo]:
        """Every topic by name, in channel order."""
        return {channel.topic: self._info(channel) for channel in self._scan.channels.values()}

    @property
    def metadata(self) -> list[tuple[str, dict[str, str]]]:
        """Name and content of every metadata record, in file order."""
        contents = [placed.content for placed in self._scan.placed]
        return [content for content in contents if not isinstance(content, Attachment)]

    @property
    def chunks(self) -> list[tuple[str, int, int]]:
        """(compression, packed bytes, unpacked bytes) of every chunk."""
        return [(chunk.compression, chunk.packed_bytes, chunk.size) for chunk in self._scan.chunks]

    def attachments(self) -> list[Attachment]:
        """The attached files, in file order."""
        contents = [placed.content for placed in self._scan.placed]
        return [content for content in contents if isinstance(content, Attachment)]

    def raw(self, topics: Collection[str] | None = None) -> Iterator[tuple[str, int, int, bytes]]:
        """(topic, sequence, log time [ns], data) of all messages, or those of `topics`, in file order."""
        names = {
            number: channel.topic
            for number, channel in self._scan.channels.items()
            if topics is None or channel.topic in topics
        }
        for chunk in self._scan.chunks:
            for channel, sequence, log_time_ns, data in messages(self._scan.unpack(chunk), names):
                yield names[channel], sequence, log_time_ns, data

    def records(self, topic: str) -> Iterator[tuple[int, dict[str, Any]]]:
        """(log time [ns], record) of every message on a JSON topic, in file order.

        A chunk's messages are parsed in one step. Raises LogError when there is no such topic, when it is
        not JSON, and on a message that is none.
        """
        channels = self._json_channels(topic)
        for chunk in self._scan.chunks:
            times_ns: list[int] = []
            texts: list[bytes] = []
            for _, _, log_time_ns, data in messages(self._scan.unpack(chunk), channels):
                times_ns.append(log_time_ns)
                texts.append(data)
            try:
                yield from zip(times_ns, orjson.loads(b"[" + b",".join(texts) + b"]"), strict=True)
            except ValueError:
                raise LogError(f"{self.path} holds what is not JSON on {topic}; record it again") from None

    def _json_channels(self, topic: str) -> set[int]:
        """Ids of the channels with that topic; none at all where a torn file has lost all channels."""
        channels = self._scan.channels
        found = {number for number, channel in channels.items() if channel.topic == topic}
        if channels and not found:
            names = ", ".join(channel.topic for channel in channels.values())
            raise LogError(f"{self.path} has no topic {topic}; choose from {names}")
        for number in found:
            encoding = channels[number].message_encoding
            if encoding != "json":
                raise LogError(f"{topic} in {self.path} is {encoding}, not json; read it with raw()")
        return found

    def _named(self, name: str) -> dict[str, str] | None:
        return next((content for found, content in self.metadata if found == name), None)

    def _info(self, channel: Channel) -> TopicInfo:
        schema = self._scan.schemas.get(channel.schema_id) or Schema(id=0, data=b"", encoding="", name="")
        count = self._scan.counts.get(channel.id, 0)
        return TopicInfo(count, channel.message_encoding, schema.name, schema.encoding, schema.data)
