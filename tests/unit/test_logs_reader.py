"""Reading, summarising, recovering and comparing logs."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

import pytest
from mcap.writer import CompressionType, Writer

from logs import LogError
from logs.compare import first_difference, first_path
from logs.info import format_info, info
from logs.reader import LogReader
from logs.recorder import Recorder
from logs.recover import recover
from tests.unit.test_logs_recorder import FILES, ROBOTS, RUN, S, doctor, write, write_everything


def torn(tmp_path: Path, cut: int = 10) -> Path:
    path = write(tmp_path / "torn.mcap")
    path.write_bytes(path.read_bytes()[:-cut])
    return path


def test_records_and_raw_agree(tmp_path: Path) -> None:
    with LogReader(write(tmp_path / "a.mcap")) as log:
        assert (log.complete, log.torn, log.start_ns, log.end_ns) == (True, False, 0, 2 * S + S // 2)
        for topic, about in log.topics.items():
            raw = list(log.raw({topic}))
            assert len(raw) == about.messages > 0
            if about.encoding == "json":
                parsed = [(time_ns, json.loads(data)) for _, _, time_ns, data in raw]
                assert list(log.records(topic)) == parsed


def test_topics_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    with LogReader(write(tmp_path / "a.mcap")) as log:
        with pytest.raises(LogError, match=r"no topic /wrong; choose from /radio, /camera"):
            next(log.records("/wrong"))
        with pytest.raises(LogError, match=r"/tf in .* is protobuf, not json"):
            next(log.records("/tf"))


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"cannot read .*: No such file or directory; check the name"):
        LogReader(tmp_path / "missing.mcap")
    with pytest.raises(LogError, match="Is a directory"):
        LogReader(tmp_path)
    for content in (b"", b"\x89MCAP", b"# a scenario\n"):
        (tmp_path / "other").write_bytes(content)
        with pytest.raises(LogError, match="is not an MCAP file"):
            LogReader(tmp_path / "other")


@pytest.mark.parametrize(
    ("chunking", "compression", "match"),
    [(False, CompressionType.NONE, "outside chunks"), (True, CompressionType.LZ4, "packed with 'lz4'")],
)
def test_other_kinds_of_mcap_are_refused(
    tmp_path: Path, chunking: bool, compression: CompressionType, match: str
) -> None:
    foreign(tmp_path / "a.mcap", chunking=chunking, compression=compression)
    with pytest.raises(LogError, match=match):
        LogReader(tmp_path / "a.mcap")


@pytest.mark.parametrize("crcs", [False, True])
@pytest.mark.parametrize("statistics", [False, True])
def test_a_file_by_the_mcap_library_is_read(tmp_path: Path, crcs: bool, statistics: bool) -> None:
    path = foreign(
        tmp_path / "a.mcap", enable_data_crcs=crcs, use_statistics=statistics, repeat_channels=crcs
    )
    with LogReader(path) as log:
        assert (log.library, log.torn, log.run, log.complete) == ("other", False, {}, False)
        assert list(log.raw()) == [("/a", 9, 5, b'{"x":1}'), ("/a", 3, 7, b"{}")]
        assert list(log.records("/a")) == [(5, {"x": 1}), (7, {})]
        assert (log.topics["/a"].messages, log.start_ns, log.end_ns) == (2, 5, 7)


def foreign(
    path: Path,
    *,
    chunking: bool = True,
    compression: CompressionType = CompressionType.NONE,
    enable_data_crcs: bool = False,
    use_statistics: bool = True,
    repeat_channels: bool = True,
    records: Iterable[tuple[int, bytes, int]] = ((5, b'{"x":1}', 9), (7, b"{}", 3)),
) -> Path:
    """A log that this project did not write; `records`: log time [ns], data and sequence number."""
    with path.open("wb") as file:
        writer = Writer(
            file,
            use_chunking=chunking,
            compression=compression,
            enable_data_crcs=enable_data_crcs,
            use_statistics=use_statistics,
            repeat_channels=repeat_channels,
        )
        writer.start(library="other")
        channel = writer.register_channel("/a", "json", writer.register_schema("A", "jsonschema", b"{}"))
        for log_time_ns, data, sequence in records:
            writer.add_message(channel, log_time_ns, data, log_time_ns, sequence)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def test_a_file_without_its_end_is_torn_and_still_read(tmp_path: Path) -> None:
    with LogReader(write(tmp_path / "whole.mcap")) as whole, LogReader(torn(tmp_path)) as log:
        assert (log.torn, log.complete) == (True, False)
        assert log.result == whole.result
        assert list(log.raw()) == list(whole.raw())
        assert log.topics == whole.topics
        assert log.end_ns == whole.end_ns


def test_a_damaged_chunk_ends_the_log_like_a_torn_tail(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap")
    with LogReader(path) as log:
        whole = list(log.raw())
        assert len(log.chunks) == 4
    content = bytearray(path.read_bytes())
    chunk = -1
    for _ in range(3):  # the chunk of the second 1
        chunk = content.index(b"zstd", chunk + 1)
    content[chunk + 40] ^= 1
    path.write_bytes(content)
    with LogReader(path) as log:
        assert log.torn
        assert log.result is None
        assert list(log.raw()) == [record for record in whole if record[2] < S]
        assert sum(topic.messages for topic in log.topics.values()) == len(list(log.raw()))
    recover(path, tmp_path / "b.mcap")
    assert doctor(tmp_path / "b.mcap") == ""


def test_a_damaged_attachment_costs_only_itself(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap")
    path.write_bytes(path.read_bytes().replace(FILES[0].data, b"seed = 8\n"))
    with LogReader(path) as log:
        assert log.torn
        assert log.attachments() == FILES[1:]
        assert len(list(log.records("/radio"))) == 3


def test_info_tells_what_is_inside(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap")
    summary = info(path)
    assert json.loads(json.dumps(summary)) == summary
    assert (summary["scenario"], summary["seed"], summary["version"]) == ("two words", "7", None)
    assert (summary["complete"], summary["torn"], summary["lost_bytes"]) == (True, False, 0)
    assert (summary["duration_s"], summary["end_s"]) == (2.5, 2.5)
    assert (summary["chunks"], summary["compression"], summary["library"]) == (4, "zstd", "heliograph")
    assert summary["size_bytes"] == path.stat().st_size
    assert summary["topics"][0] == {
        "topic": "/radio",
        "messages": 3,
        "hz": 1.2,
        "encoding": "json",
        "schema": "heliograph.Radio",
        "schema_encoding": "jsonschema",
    }
    assert summary["attachments"][1] == {"name": "empty", "media_type": "text/plain", "size_bytes": 0}
    text = format_info(summary)
    assert "state:       complete\n" in text
    assert "  (1)   /radio       3 msgs (1.20 Hz)  : heliograph.Radio [jsonschema]\n" in text
    assert "    seed: 7\n" in text


def test_info_tells_torn_aborted_and_empty_logs(tmp_path: Path) -> None:
    assert "torn: " in format_info(info(torn(tmp_path)))
    assert "aborted" in format_info(info(write(tmp_path / "aborted.mcap", finish=False)))
    Recorder(tmp_path / "fresh.mcap", ROBOTS).abort()
    fresh = info(tmp_path / "fresh.mcap")
    assert (fresh["messages"], fresh["chunks"], fresh["duration_s"]) == (1, 1, 0)
    empty = info(foreign(tmp_path / "empty.mcap", records=()))
    assert (empty["messages"], empty["chunks"], empty["compression_ratio"]) == (0, 0, None)
    for summary in (fresh, empty):
        assert "0 msgs" in format_info(summary)


def test_recovery_keeps_everything_that_is_left(tmp_path: Path) -> None:
    src, dst = torn(tmp_path, cut=2000), tmp_path / "new" / "whole.mcap"
    saved = recover(src, dst)
    assert doctor(dst) == ""
    with LogReader(src) as before, LogReader(dst) as after:
        assert list(after.raw()) == list(before.raw())
        assert after.metadata == before.metadata
        assert after.attachments() == before.attachments() == FILES
        assert after.topics == before.topics
        assert (after.torn, after.library) == (False, "heliograph")
        assert saved.messages == {name: topic.messages for name, topic in after.topics.items()}
    assert saved.lost_bytes > 0
    assert (saved.metadata, saved.attachments) == (2, 2)
    assert recover(dst, tmp_path / "again.mcap").lost_bytes == 0
    assert (tmp_path / "again.mcap").read_bytes() == dst.read_bytes()


def test_recovery_never_touches_what_is_there(tmp_path: Path) -> None:
    src = torn(tmp_path)
    content = src.read_bytes()
    link = tmp_path / "link.mcap"
    link.symlink_to(src)
    for dst in (src, link):
        with pytest.raises(LogError, match="is the log to recover"):
            recover(src, dst, force=True)
    other = tmp_path / "other.mcap"
    other.write_text("precious")
    with pytest.raises(LogError, match="exists; choose another place or add --force"):
        recover(src, other)
    assert (src.read_bytes(), other.read_text()) == (content, "precious")
    with pytest.raises(LogError, match="not an MCAP file"):
        recover(other, tmp_path / "never.mcap")
    with pytest.raises(LogError, match="cannot write"):
        recover(src, other / "inside.mcap")
    recover(src, other, force=True)
    assert doctor(other) == ""
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link.mcap", "other.mcap", "torn.mcap"]


def test_equal_logs_do_not_differ(tmp_path: Path) -> None:
    assert first_difference(write(tmp_path / "a.mcap"), write(tmp_path / "b.mcap")) is None


def test_the_first_differing_field_is_named(tmp_path: Path) -> None:
    def steps(size: int) -> Path:
        def entries(recorder: Recorder) -> None:
            recorder.note(0, "info", "r00", "ready")
            recorder.entry(S, 1, "guess", b'{"sizes":[1,2]}')
            recorder.entry(2 * S, 1, "guess", b'{"sizes":[1,%d],"more":%d}' % (size, size))

        return write(tmp_path / f"{size}.mcap", entries)

    difference = first_difference(steps(4), steps(5))
    assert difference is not None
    assert (difference.what, difference.index, difference.sequence) == ("/robot", 1, 3)
    assert (difference.log_time_ns, difference.field) == (2 * S, "$.data.sizes[1]")
    assert difference.left == {"robot": "r01", "entry": "guess", "data": {"sizes": [1, 4], "more": 4}}
    assert difference.format() == (
        "first difference: /robot record 1 (sequence 3, at 2.000000000 s), field $.data.sizes[1]\n"
        "  left:  4\n"
        "  right: 5"
    )


def test_protobuf_records_are_shown_decoded(tmp_path: Path) -> None:
    a = write(tmp_path / "a.mcap", lambda recorder: recorder.note(0, "info", "r00", "ready"))
    b = write(tmp_path / "b.mcap", lambda recorder: recorder.note(0, "info", "r00", "steady"))
    difference = first_difference(a, b)
    assert difference is not None
    assert (difference.what, difference.index, difference.field) == ("/log", 1, "$.message")
    assert difference.format().endswith("left:  ready\n  right: steady")


def test_a_log_that_ends_earlier_is_a_prefix(tmp_path: Path) -> None:
    a = write(tmp_path / "a.mcap", lambda recorder: write_everything(recorder, 2))
    b = write(tmp_path / "b.mcap", lambda recorder: write_everything(recorder, 3))
    difference = first_difference(a, b)
    assert difference is not None
    assert (difference.what, difference.index, difference.log_time_ns) == ("/radio", 2, 2 * S)
    assert difference.left is None
    assert "left:  nothing, the log ends here\n" in difference.format()
    swapped = first_difference(b, a)
    assert swapped is not None
    assert swapped.right is None


def test_records_of_different_topics_are_told_apart(tmp_path: Path) -> None:
    a = write(tmp_path / "a.mcap", lambda recorder: recorder.fault(0, {"kind": "x"}))
    b = write(tmp_path / "b.mcap", lambda recorder: recorder.truth(0, {"kind": "x"}))
    difference = first_difference(a, b)
    assert difference is not None
    assert difference.format() == (
        "first difference: /faults record 0 (sequence 1, at 0.000000000 s)\n"
        '  left:  {"topic":"/faults","sequence":1,"log_time_ns":0,"record":{"kind":"x"}}\n'
        '  right: {"topic":"/truth","sequence":1,"log_time_ns":0,"record":{"kind":"x"}}'
    )


def test_differences_outside_the_records_come_last(tmp_path: Path) -> None:
    paths = [tmp_path / name for name in ("a.mcap", "b.mcap", "c.mcap")]
    for path, seed, files in zip(paths, "778", (FILES, FILES[:1], FILES), strict=True):
        Recorder(path, ROBOTS, run={**RUN, "seed": seed}, attachments=files).finish({})
    other_file = first_difference(paths[0], paths[1])
    assert other_file is not None
    assert (other_file.what, other_file.right) == ("attachment empty", None)
    other_seed = first_difference(paths[0], paths[2])
    assert other_seed is not None
    assert (other_seed.what, other_seed.field) == ("metadata heliograph.run", "$.seed")
    assert other_seed.format().endswith("field $.seed\n  left:  7\n  right: 8")


def test_a_difference_in_layout_alone_is_told(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap")
    recover(path, tmp_path / "b.mcap")
    difference = first_difference(path, tmp_path / "b.mcap")
    assert difference is not None
    assert difference.what == "file layout"
    assert "left:" in difference.format()


def test_comparing_needs_two_logs(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap")
    with pytest.raises(LogError, match=r"cannot read .*missing"):
        first_difference(path, tmp_path / "missing.mcap")
    (tmp_path / "other").write_text("x")
    with pytest.raises(LogError, match="not an MCAP file"):
        first_difference(path, tmp_path / "other")


@pytest.mark.parametrize(
    ("left", "right", "path"),
    [
        ({"a": 1}, {"a": 1}, None),
        ({"a": 1}, {"a": 1.0}, "$.a"),
        ({"a": True}, {"a": 1}, "$.a"),
        ({"a": [1, {"b": None}]}, {"a": [1, {"b": 0}]}, "$.a[1].b"),
        ({"a": [1]}, {"a": [1, 2]}, "$.a[1]"),
        ({"a": 1, "b": 2}, {"b": 2}, "$.a"),
        ({"b": 2}, {"a": 1, "b": 2}, "$.a"),
        ([], {}, "$"),
    ],
)
def test_paths_of_first_differences(left: object, right: object, path: str | None) -> None:
    assert first_path(left, right) == path
