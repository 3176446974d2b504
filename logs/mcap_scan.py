"""Finds what an MCAP file holds, whole or torn.

A whole file is trusted after one checksum over all its bytes. Any other is examined chunk by chunk, each
against its own checksum, up to the first that is damaged or cut off: what precedes it is what it still
holds. Layout: https://mcap.dev/spec
"""

from __future__ import annotations

import io
import struct
import zlib
from collections import Counter
from collections.abc import Container, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment as AttachmentRecord
from mcap.records import Channel, DataEnd, Footer, Header, Metadata, Schema, Statistics
from mcap.writer import MCAP0_MAGIC

from logs import Attachment, LogError
from logs.mcap_writer import LIBRARY

_RECORD = struct.Struct("<BQ")
_CHUNK = struct.Struct("<QQQII")
_MESSAGE = struct.Struct("<BQHIQQ")
_MAX_CHUNK_BYTES = 1 << 30
_ATTACHMENT_CRC_BYTES = 4

_DAMAGE = (McapError, struct.error, UnicodeDecodeError, zstandard.ZstdError, EOFError)


class _ForeignError(Exception):
    """MCAP, but not as it is written here."""


@dataclass(frozen=True)
class Chunk:
    """Where a chunk of messages lies in the file."""

    record_offset: int
    data_offset: int
    packed_bytes: int
    size: int
    crc: int
    compression: str


@dataclass(frozen=True)
class Placed:
    """A metadata record, or an attachment, and where its record begins."""

    offset: int
    content: tuple[str, dict[str, str]] | Attachment


def messages(data: bytes, channels: Container[int]) -> Iterator[tuple[int, int, int, bytes]]:
    """(channel, sequence, log time [ns], data) of the messages in an unpacked chunk, on these channels."""
    position, end, unpack, head = 0, len(data), _MESSAGE.unpack_from, _MESSAGE.size
    while position < end:
        if data[position] != Opcode.MESSAGE:
            position += _RECORD.size + _RECORD.unpack_from(data, position)[1]
            continue
        _, length, channel, sequence, log_time_ns, _ = unpack(data, position)
        start = position + head
        position += _RECORD.size + length
        if channel in channels:
            yield channel, sequence, log_time_ns, data[start:position]


class McapScan:
    """The contents of one MCAP file, which stays open. Raises LogError when it cannot be read as one."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.library = ""
        self.profile = ""
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}
        self.chunks: list[Chunk] = []
        self.placed: list[Placed] = []
        """Metadata and attachments, in file order."""
        self.counts: dict[int, int] = {}
        """Messages by channel id."""
        self.start_ns = 0
        self.end_ns = 0
        self.torn = True
        """The file does not end as it should, or is damaged."""
        self.whole_bytes = len(MCAP0_MAGIC)
        """How much of the file, from its start, consists of undamaged records."""
        self._damaged = False
        self._summary: list[tuple[int, bytes]] = []
        self._statistics: Statistics | None = None
        self._unpacker = zstandard.ZstdDecompressor()
        try:
            self._file: BinaryIO = path.open("rb")
            self.size_bytes = self._file.seek(0, io.SEEK_END)
        except OSError as error:
            raise LogError(f"cannot read {path}: {error.strerror}; check the name") from None
        try:
            self._open()
        except LogError:
            self._file.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def unpack(self, chunk: Chunk) -> bytes:
        """The records of a chunk. Raises EOFError or ZstdError for a damaged one that was not examined."""
        self._file.seek(chunk.data_offset)
        packed = self._file.read(chunk.packed_bytes)
        if not chunk.compression:
            return packed
        limit = min(chunk.size, _MAX_CHUNK_BYTES)
        if zstandard.frame_content_size(packed) > limit:
            raise EOFError
        return self._unpacker.decompress(packed, max_output_size=limit)

    def _open(self) -> None:
        self._file.seek(0)
        if self._file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
            raise LogError(f"{self.path} is not an MCAP file; give a log that heliograph recorded")
        trusted = False
        try:
            trusted = self._scan()
        except _ForeignError as foreign:
            if not self.chunks and self.library != LIBRARY:
                raise LogError(f"{self.path} {foreign}; give a log that heliograph recorded") from None
            self.torn = True
        except _DAMAGE:
            self.torn = True
        if trusted and self._statistics is not None and self.channels:
            self.counts = dict(self._statistics.channel_message_counts)
            self.start_ns = self._statistics.message_start_time
            self.end_ns = self._statistics.message_end_time
        else:
            self._examine()

    def _scan(self) -> bool:
        """Note where everything is. Returns whether checksums have proved all of it undamaged."""
        crc, stated, summary_crc = zlib.crc32(MCAP0_MAGIC), None, 0
        while True:
            head = self._file.read(_RECORD.size)
            opcode, length = _RECORD.unpack(head)  # a head cut short raises, as damage does
            if length > self.size_bytes - self.whole_bytes - _RECORD.size:
                return False
            content = self._file.read(length)
            if opcode == Opcode.FOOTER:
                summary_crc = zlib.crc32(content[:16], zlib.crc32(head, summary_crc))
                summary = Footer.read(_stream(content)).summary_crc in (0, summary_crc)
                ends = summary and stated in (0, crc) and self._file.read() == MCAP0_MAGIC
                self.torn = self._damaged or not ends
                if summary:
                    self._trust_summary()
                return not self.torn and stated == crc
            if stated is not None:
                summary_crc = zlib.crc32(content, zlib.crc32(head, summary_crc))
                self._summary.append((opcode, content))
            elif opcode == Opcode.DATA_END:
                stated = DataEnd.read(_stream(content)).data_section_crc
            else:
                crc = zlib.crc32(content, zlib.crc32(head, crc))
                self._note(opcode, self.whole_bytes, content)
            self.whole_bytes += _RECORD.size + length

    def _trust_summary(self) -> None:
        for opcode, content in self._summary:
            if opcode == Opcode.STATISTICS:
                self._statistics = Statistics.read(_stream(content))
            else:
                self._define(opcode, content)

    def _note(self, opcode: int, offset: int, content: bytes) -> None:
        if opcode == Opcode.CHUNK:
            self.chunks.append(self._chunk(offset, content))
        elif opcode == Opcode.MESSAGE:
            raise _ForeignError("has messages outside chunks")
        else:
            try:
                self._note_single(opcode, offset, content)
            except _DAMAGE:
                self._damaged = True

    def _note_single(self, opcode: int, offset: int, content: bytes) -> None:
        if opcode == Opcode.METADATA:
            metadata = Metadata.read(_stream(content))
            self.placed.append(Placed(offset, (metadata.name, metadata.metadata)))
        elif opcode == Opcode.ATTACHMENT:
            self.placed.append(Placed(offset, _attachment(content)))
        elif opcode == Opcode.HEADER:
            header = Header.read(_stream(content))
            self.library, self.profile = header.library, header.profile
        else:
            self._define(opcode, content)

    def _define(self, opcode: int, content: bytes) -> None:
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(_stream(content))
            self.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(_stream(content))
            self.channels[channel.id] = channel

    def _chunk(self, offset: int, content: bytes) -> Chunk:
        _, _, size, crc, name_bytes = _CHUNK.unpack_from(content)
        data = _CHUNK.size + name_bytes + 8
        compression = content[_CHUNK.size : data - 8].decode()
        if compression not in ("", "zstd"):
            raise _ForeignError(f"is packed with {compression!r}")
        start = offset + _RECORD.size + data
        return Chunk(offset, start, len(content) - data, size, crc, compression)

    def _examine(self) -> None:
        """Check every chunk and count its messages, up to the first that is damaged or missing."""
        counts: Counter[int] = Counter()
        starts_ns: list[int] = []
        following = 0
        for number, chunk in enumerate(self.chunks):
            try:
                data = self.unpack(chunk)
                if chunk.crc not in (0, zlib.crc32(data)):
                    raise EOFError
                self._define_all(data)
                found = [message[:3] for message in messages(data, self.channels)]
                # Our sequence numbers have no gaps: one betrays a chunk that is no longer seen as such.
                if self.library == LIBRARY and found and found[0][1] != following:
                    raise EOFError
            except _DAMAGE:
                self._cut(number)
                break
            counts.update(channel for channel, _, _ in found)
            following += len(found)
            if found:
                starts_ns.append(min(time_ns for _, _, time_ns in found))
                self.end_ns = max(self.end_ns, *(time_ns for _, _, time_ns in found))
        self.start_ns = min(starts_ns, default=0)
        self.counts = dict(counts)

    def _define_all(self, data: bytes) -> None:
        position = 0
        while position < len(data):
            opcode, length = _RECORD.unpack_from(data, position)
            start = position + _RECORD.size
            position = start + length
            if opcode != Opcode.MESSAGE:
                self._define(opcode, data[start:position])

    def _cut(self, number: int) -> None:
        self.torn = True
        self.whole_bytes = self.chunks[number].record_offset
        del self.chunks[number:]
        self.placed = [place for place in self.placed if place.offset < self.whole_bytes]


def _stream(content: bytes) -> ReadDataStream:
    return ReadDataStream(io.BytesIO(content))


def _attachment(content: bytes) -> Attachment:
    (stated,) = struct.unpack("<I", content[-_ATTACHMENT_CRC_BYTES:])
    if stated not in (0, zlib.crc32(content[:-_ATTACHMENT_CRC_BYTES])):
        raise EOFError
    record = AttachmentRecord.read(_stream(content))
    return Attachment(record.name, record.media_type, record.data)
