"""MCAP files, written as the `mcap` library's Writer writes them, at a third of its cost a message.

Record layouts come from the library; only the message record, of which there are millions, is
packed here. Two things differ from the library's Writer: schemas and channels stand before the
first chunk, so that they reach the disk before the first message does, and the messages of each
channel are digested as they pass. Layout: https://mcap.dev/spec
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import struct
import zlib
from collections.abc import Iterable, Mapping
from typing import Protocol

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

CHUNK_BYTES = 256 * 1024
"""Uncompressed size at which a chunk is closed: bounds both the loss of a crash and a stall."""

LIBRARY = "heliograph"
"""Writer named in the file header: no version, so that equal runs give equal bytes."""

_MESSAGE = struct.Struct("<BQHIQQ")
_LOG_TIME = slice(15, 23)
_MESSAGE_HEAD_BYTES = 22
_INDEX_HEAD = struct.Struct("<BQHI")
_FOOTER_HEAD = struct.Struct("<BQQQ")


class Output(Protocol):
    """What a sink needs of a binary file opened without buffering."""

    def write(self, data: memoryview, /) -> int | None:
        """Write some of it; returns how much. Raises OSError."""

    def truncate(self, size: int, /) -> int:
        """Cut the file to that many bytes."""

    def close(self) -> None:
        """Close the file."""


class FileSink:
    """Whole records to an unbuffered file: a write that fails leaves none of its bytes behind."""

    def __init__(self, output: Output) -> None:
        self._output = output
        self.position = 0

    def write(self, data: bytes) -> None:
        """Append all of `data`, or nothing and raise OSError."""
        view = memoryview(data)
        try:
            while view:
                view = view[self._output.write(view) or 0 :]
        except OSError:
            with contextlib.suppress(OSError, io.UnsupportedOperation):
                self._output.truncate(self.position)
            raise
        self.position += len(data)

    def close(self) -> None:
        """Close the file. Raises OSError where the system only now tells that data was lost."""
        self._output.close()


class _ChannelState:
    """What is kept of one channel while its messages pass."""

    def __init__(self) -> None:
        self.count = 0
        self.digest = hashlib.sha256()
        self.index: list[int] = []
        self.undigested: list[bytes] = []

    def take_index(self, channel_id: int) -> bytes:
        entries, self.index = self.index, []
        size = 8 * len(entries)
        head = _INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + size, channel_id, size)
        return head + struct.pack(f"<{len(entries)}Q", *entries)

    def absorb(self) -> None:
        self.digest.update(b"".join(self.undigested))
        self.undigested.clear()


class McapWriter:
    """Writes one MCAP file: zstd chunks, every index, every CRC. Any method may raise OSError.

    Log times must not decrease; schemas and channels are registered before the first message.
    """

    def __init__(self, sink: FileSink, chunk_bytes: int = CHUNK_BYTES) -> None:
        self._sink = sink
        self._chunk_bytes = chunk_bytes
        self._crc = 0
        self._zstd = zstandard.ZstdCompressor(level=3)
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._states: dict[int, _ChannelState] = {}
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._parts: list[bytes] = []
        self._size = 0
        self._chunk_start_ns = 0
        self._start_ns: int | None = None
        self._end_ns = 0

    def start(self) -> None:
        """Write magic and header."""
        self._emit(MCAP0_MAGIC + _encoded(Header(profile="", library=LIBRARY)))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Write a schema; returns its id."""
        schema = Schema(id=len(self._schemas) + 1, data=data, encoding=encoding, name=name)
        self._schemas.append(schema)
        self._emit(_encoded(schema))
        return schema.id

    def register_channel(self, topic: str, encoding: str, schema_id: int, metadata: Mapping[str, str]) -> int:
        """Write a channel; returns its id."""
        number = len(self._channels) + 1
        channel = Channel(number, topic, encoding, dict(metadata), schema_id)
        self._channels.append(channel)
        self._states[number] = _ChannelState()
        self._emit(_encoded(channel))
        return number

    def add_message(self, channel_id: int, log_time: int, data: bytes, sequence: int) -> None:
        """Append one message; its publish time is its log time [ns]."""
        head = _MESSAGE.pack(5, len(data) + _MESSAGE_HEAD_BYTES, channel_id, sequence, log_time, log_time)
        parts = self._parts
        if not parts:
            self._chunk_start_ns = log_time
        state = self._states[channel_id]
        state.count += 1
        state.index += (log_time, self._size)
        state.undigested += (head[_LOG_TIME], data)
        parts += (head, data)
        self._end_ns = log_time
        self._size += _MESSAGE.size + len(data)
        if self._size > self._chunk_bytes:
            self.flush()

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Write a metadata record, ahead of the messages still in the open chunk."""
        offset = self._sink.position
        length = self._emit(_encoded(Metadata(name=name, metadata=dict(data))))
        self._metadata.append(MetadataIndex(offset=offset, length=length, name=name))

    def add_attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Write an attachment; it carries no times, for there is no meaningful one."""
        offset = self._sink.position
        length = self._emit(_encoded(Attachment(0, 0, name, media_type, data)))
        self._attachments.append(AttachmentIndex(offset, length, 0, 0, len(data), name, media_type))

    def digest(self, channel_id: int) -> tuple[int, str]:
        """Count and hex SHA-256 of a channel's messages so far, over (log time u64 LE, data) of each."""
        state = self._states[channel_id]
        state.absorb()
        return state.count, state.digest.hexdigest()

    def flush(self) -> None:
        """Close the open chunk, if it holds anything, and hand it to the operating system."""
        if not self._parts:
            return
        data = b"".join(self._parts)
        packed = self._zstd.compress(data)
        start_ns, end_ns = self._chunk_start_ns, self._end_ns
        chunk = _encoded(Chunk("zstd", packed, end_ns, start_ns, zlib.crc32(data), len(data)))
        offset = self._sink.position
        place = offset + len(chunk)
        indexes: list[bytes] = []
        offsets: dict[int, int] = {}
        for number, state in self._states.items():
            if state.index:
                offsets[number] = place
                indexes.append(state.take_index(number))
                place += len(indexes[-1])
                state.absorb()
        self._parts.clear()
        self._size = 0
        self._emit(b"".join([chunk, *indexes]))
        if self._start_ns is None:
            self._start_ns = start_ns
        index_bytes = place - offset - len(chunk)
        self._chunks.append(
            ChunkIndex(
                chunk_length=len(chunk),
                chunk_start_offset=offset,
                compression="zstd",
                compressed_size=len(packed),
                message_end_time=end_ns,
                message_index_length=index_bytes,
                message_index_offsets=offsets,
                message_start_time=start_ns,
                uncompressed_size=len(data),
            )
        )

    def finish(self) -> None:
        """Write the open chunk, the summary with all indexes, and the footer."""
        self.flush()
        self._emit(_encoded(DataEnd(self._crc)))
        start = self._sink.position
        summary, offsets = self._summary(start)
        offset_start = start + len(summary)
        summary += offsets
        crc = zlib.crc32(_FOOTER_HEAD.pack(Opcode.FOOTER, 20, start, offset_start), zlib.crc32(summary))
        self._emit(summary + _encoded(Footer(start, offset_start, crc)) + MCAP0_MAGIC)

    def close(self) -> None:
        """Close the file as it stands."""
        self._sink.close()

    def _summary(self, start: int) -> tuple[bytes, bytes]:
        groups: list[tuple[Opcode, Iterable[McapRecord]]] = [
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, self._attachments),
            (Opcode.METADATA_INDEX, self._metadata),
        ]
        body, offsets = b"", b""
        for opcode, records in groups:
            group = b"".join(map(_encoded, records))
            if group:
                offsets += _encoded(SummaryOffset(opcode, start + len(body), len(group)))
            body += group
        return body, offsets

    def _statistics(self) -> Statistics:
        counts = {number: state.count for number, state in self._states.items() if state.count}
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=counts,
            chunk_count=len(self._chunks),
            message_count=sum(counts.values()),
            message_end_time=self._end_ns,
            message_start_time=self._start_ns or 0,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )

    def _emit(self, data: bytes) -> int:
        self._sink.write(data)
        self._crc = zlib.crc32(data, self._crc)
        return len(data)


def _encoded(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data
