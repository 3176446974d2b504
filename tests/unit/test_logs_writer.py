"""The writer below the recorder: the library's bytes, digests on the way, and a file that stays readable."""

from __future__ import annotations

import errno
import hashlib
import io
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from logs.mcap_writer import CHUNK_BYTES, LIBRARY, FileSink, McapWriter

Message = tuple[int, int, bytes]
"""Channel number, log time [ns], data."""

TOPICS = ("/a", "/b", "/silent")
# Data and times that run together where a digest forgets to tell them apart, and more than one chunk.
MESSAGES: list[Message] = [
    (1, 0, b""),
    (2, 0, b"\x01"),
    (1, 1, b""),
    (1, 2**32, b"x" * CHUNK_BYTES),
    (2, 2**32, b"second chunk"),
    (1, 2**63 - 1, b"last"),
]


class Device:
    """A file that takes at most `step` bytes a write, and nothing beyond `room`."""

    def __init__(self, step: int, room: int) -> None:
        self.content = bytearray()
        self.room = room
        self._step = step

    def write(self, data: memoryview, /) -> int:
        part = data[: min(self._step, self.room - len(self.content))]
        if not part:
            raise OSError(errno.ENOSPC, "No space left on device")
        self.content += part
        return len(part)

    def truncate(self, size: int, /) -> int:
        del self.content[size:]
        return size

    def close(self) -> None:
        """A device holds nothing back."""


def write(path: Path, messages: list[Message] = MESSAGES) -> dict[str, tuple[int, str]]:
    """A file with everything in it; count and digest by topic."""
    with path.open("wb", buffering=0) as file:
        writer = McapWriter(FileSink(file))
        writer.start()
        writer.add_metadata("before", {"key": "value"})
        channels = {}
        for topic in TOPICS:
            schema = writer.register_schema(topic.upper(), "jsonschema", b"{}")
            channels[topic] = writer.register_channel(topic, "json", schema, {"about": topic})
        writer.add_attachment("file", "text/plain", b"content")
        for sequence, (channel, log_time_ns, data) in enumerate(messages):
            writer.add_message(channel, log_time_ns, data, sequence)
        writer.flush()
        digests = {topic: writer.digest(channel) for topic, channel in channels.items()}
        writer.finish()
        writer.close()
    return digests


def written_by_the_library(messages: list[Message]) -> bytes:
    file = io.BytesIO()
    writer = Writer(file, CHUNK_BYTES, CompressionType.ZSTD, enable_data_crcs=True)
    writer.start("", LIBRARY)
    writer.add_metadata("before", {"key": "value"})
    for topic in TOPICS:
        schema = writer.register_schema(topic.upper(), "jsonschema", b"{}")
        writer.register_channel(topic, "json", schema, {"about": topic})
    writer.add_attachment(0, 0, "file", "text/plain", b"content")
    for sequence, (channel, log_time_ns, data) in enumerate(messages):
        writer.add_message(channel, log_time_ns, data, log_time_ns, sequence)
    writer.flush()  # type: ignore[no-untyped-call]
    writer.finish()  # type: ignore[no-untyped-call]
    return file.getvalue()


def test_the_bytes_are_those_of_the_library(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap")
    assert (tmp_path / "a.mcap").read_bytes() == written_by_the_library(MESSAGES)


def test_digests_are_those_of_what_the_library_reads_back(tmp_path: Path) -> None:
    digests = write(tmp_path / "a.mcap")
    counts = dict.fromkeys(TOPICS, 0)
    hashes = {topic: hashlib.sha256() for topic in TOPICS}
    with (tmp_path / "a.mcap").open("rb") as file:
        for _, channel, message in make_reader(file, validate_crcs=True).iter_messages(log_time_order=False):
            counts[channel.topic] += 1
            hashes[channel.topic].update(message.log_time.to_bytes(8, "little") + message.data)
    assert counts == {"/a": 4, "/b": 2, "/silent": 0}
    assert digests == {topic: (counts[topic], hashes[topic].hexdigest()) for topic in TOPICS}


@pytest.mark.parametrize(
    "changed",
    [
        [*MESSAGES[:-1], (1, 2**63 - 1, b"Last")],
        [*MESSAGES[:-1], (1, 2**63 - 2, b"last")],
        MESSAGES[:-1],
        [(1, 1, b""), *MESSAGES[1:2], (1, 0, b""), *MESSAGES[3:]],
    ],
    ids=["data", "time", "missing", "order"],
)
def test_a_digest_notices_any_change_on_its_topic_and_none_elsewhere(
    tmp_path: Path, changed: list[Message]
) -> None:
    before, after = write(tmp_path / "a.mcap"), write(tmp_path / "b.mcap", changed)
    assert before["/a"][1] != after["/a"][1]
    assert before["/b"] == after["/b"]


def test_a_digest_asked_for_in_between_does_not_change_what_follows(tmp_path: Path) -> None:
    writer = McapWriter(FileSink(Device(step=CHUNK_BYTES, room=CHUNK_BYTES)))
    writer.start()
    channel = writer.register_channel("/a", "json", 0, {})
    for number, data in enumerate((b"one", b"two")):
        writer.add_message(channel, number, data, number)
        joined = bytes(8) + b"one" + (b"" if number == 0 else (1).to_bytes(8, "little") + b"two")
        for _ in range(2):
            assert writer.digest(channel) == (number + 1, hashlib.sha256(joined).hexdigest())


def test_a_device_that_takes_little_at_a_time_gets_everything() -> None:
    device = Device(step=3, room=100)
    sink = FileSink(device)
    assert [sink.write(b"0123456789"), sink.write(b""), sink.write(b"ab")] == [10, 0, 2]
    assert (bytes(device.content), sink.tell()) == (b"0123456789ab", 12)


def test_a_write_that_fails_half_way_leaves_nothing_behind() -> None:
    device = Device(step=3, room=8)
    sink = FileSink(device)
    sink.write(b"01234")
    with pytest.raises(OSError, match="No space left"):
        sink.write(b"56789")
    assert (bytes(device.content), sink.tell()) == (b"01234", 5)
    sink.write(b"567")
    assert (bytes(device.content), sink.tell()) == (b"01234567", 8)
