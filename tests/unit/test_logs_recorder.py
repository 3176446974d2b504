"""The recorder: what it writes, what it refuses, and that the same calls give the same bytes."""

from __future__ import annotations

import errno
import hashlib
import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import databeam_mcap_reader
import msgspec
import numpy as np
import pytest
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.reader import make_reader

import logs.recorder
from channels.fates import Fates, Reason
from channels.visual import Capture
from logs import Attachment, LogError, sha256_of
from logs.reader import LogReader
from logs.recorder import Recorder
from logs.recover import recover
from logs.schemas import TOPICS

ROBOTS = ["r00", "r01", "r02", "r03"]
WALLS = [(0.0, 0.0, 1.0, 1.0)]
RUN = {"scenario": "two words", "seed": "7"}
FILES = [
    Attachment("scenario.toml", "application/toml", b"seed = 7\n"),
    Attachment("empty", "text/plain", b""),
]
S = 1_000_000_000

Write = Callable[[Recorder], None]


def doctor(path: Path) -> str:
    """Complaints of the official validator."""
    tool = Path(databeam_mcap_reader.__file__).parent / "mcap_cli"
    done = subprocess.run([tool, "doctor", path], capture_output=True, text=True, check=False)
    return done.stdout + done.stderr if done.stdout + done.stderr or not done.returncode else "failed"


def capture(
    observers: list[int], offsets: list[int], sightings: list[tuple[int, float, float, int]]
) -> Capture:
    visual, range_m, bearing_rad, lamp = zip(*sightings, strict=True) if sightings else ((), (), (), ())
    return Capture(
        observers=np.array(observers, dtype=np.intp),
        offsets=np.array(offsets, dtype=np.intp),
        visual=np.array(visual, dtype=np.int32),
        range_m=np.array(range_m, dtype=np.float32),
        bearing_rad=np.array(bearing_rad, dtype=np.float32),
        lamp=np.array(lamp, dtype=np.uint8),
        entered=[],
        left=[],
    )


def send(recorder: Recorder, now_ns: int, payload: bytes, sender: int = 0) -> None:
    reason = np.zeros(4, dtype=np.uint8)
    reason[sender] = 255
    fates = Fates(reason[None], np.full((1, 4), 1000, np.int64))
    recorder.radio_batch(
        now_ns, [sender], [1], [payload], [8 * len(payload)], [None], [0], fates.reason, fates.deliveries()
    )


def write_everything(recorder: Recorder, seconds: int = 3) -> None:
    poses = np.array([[i, 2.0 * i, 0.5 * i] for i in range(4)])
    for second in range(seconds):
        now_ns = second * S
        send(recorder, now_ns, msgspec.msgpack.encode({"step": second}), sender=second % 4)
        recorder.camera(now_ns, capture([0, 2], [0, 1, 2], [(11, 1.5, -0.25, 1), (12, 2.0, 3.0, 0)]))
        recorder.entry(now_ns, second % 4, "guess", b'{"size":%d,"sure":null}' % second)
        recorder.truth(now_ns, {"kind": "visual ids", "entered": [[0, 11, 1]]})
        recorder.fault(now_ns, {"kind": "switched off", "robot": "r03"})
        recorder.note(now_ns, "warning", "r01", "a lamp is dark")
        recorder.scene(now_ns + S // 2, poses, np.array([0, 1, 2, 0], dtype=np.uint8))


def write(path: Path, steps: Write = write_everything, *, finish: bool = True) -> Path:
    with Recorder(path, ROBOTS, run=RUN, attachments=FILES, obstacles=WALLS) as recorder:
        steps(recorder)
        if finish:
            recorder.finish({"ended": "time"})
    return path


def records(path: Path, steps: Write, topic: str) -> list[dict[str, Any]]:
    with LogReader(write(path, steps)) as log:
        return [record for _, record in log.records(topic)]


def test_the_same_calls_give_the_same_bytes(tmp_path: Path) -> None:
    first, second = write(tmp_path / "a.mcap"), write(tmp_path / "elsewhere" / "b.mcap")
    assert first.read_bytes() == second.read_bytes()
    assert sha256_of(first) == hashlib.sha256(first.read_bytes()).hexdigest()


@pytest.mark.parametrize("finish", [True, False])
def test_the_official_validator_finds_nothing(tmp_path: Path, finish: bool) -> None:
    assert doctor(write(tmp_path / "a.mcap", finish=finish)) == ""


def test_a_run_in_which_nothing_happens_has_a_log_that_says_it_began(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", lambda recorder: None)
    assert doctor(path) == ""
    with LogReader(path) as log:
        assert log.complete
        ((topic, sequence, log_time_ns, data),) = log.raw()
    assert (topic, sequence, log_time_ns) == ("/log", 0, 0)
    line = Log.FromString(data)
    assert (line.level, line.name, line.message) == (Log.INFO, "heliograph", "recording begins")
    assert (line.timestamp.seconds, line.timestamp.nanos) == (0, 0)


def test_the_official_validator_can_complain(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap")
    path.write_bytes(path.read_bytes()[:-20])
    assert doctor(path) != ""


def test_the_library_reads_what_our_reader_reads(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap")
    with path.open("rb") as file, LogReader(path) as log:
        reader = make_reader(file, validate_crcs=True)
        theirs = [
            (channel.topic, message.sequence, message.log_time, message.data)
            for _, channel, message in reader.iter_messages(log_time_order=False)
        ]
        assert theirs == list(log.raw())
        assert [sequence for _, sequence, _, _ in theirs] == list(range(len(theirs)))
        assert [(record.name, record.metadata) for record in reader.iter_metadata()] == log.metadata
        attached = [
            (file.log_time, file.create_time, file.name, file.data) for file in reader.iter_attachments()
        ]
        assert attached == [(0, 0, file.name, file.data) for file in FILES]
        assert log.attachments() == FILES
        summary = reader.get_summary()
        assert summary is not None
        assert {schema.name for schema in summary.schemas.values()} >= {"heliograph.Radio", "foxglove.Log"}


def test_publish_time_is_log_time(tmp_path: Path) -> None:
    with write(tmp_path / "a.mcap").open("rb") as file:
        times = [(m.log_time, m.publish_time) for _, _, m in make_reader(file).iter_messages()]
    assert times
    assert all(log_time == publish_time for log_time, publish_time in times)


def test_a_transmission_is_recorded_with_its_fate_at_every_receiver_in_range(tmp_path: Path) -> None:
    def steps(recorder: Recorder) -> None:
        fates = Fates(
            np.array([[0, 255, 5, 0], [1, 6, 5, 255]], dtype=np.uint8),
            np.array([[7, 0, 0, 9], [0, 0, 0, 0]], dtype=np.int64),
        )
        payloads = [msgspec.msgpack.encode({"id": "r01"}), msgspec.msgpack.encode([1.5, None])]
        recorder.radio_batch(
            5, [1, 3], [17, 4], payloads, [80, 96], [2, None], [1000, 0], fates.reason, fates.deliveries()
        )

    assert records(tmp_path / "a.mcap", steps, "/radio") == [
        {
            "from": "r01",
            "seq": 17,
            "payload": {"id": "r01"},
            "bits": 80,
            "slot": 2,
            "airtime_ns": 1000,
            "delivered": ["r00", "r03"],
            "delay_ns": [7, 9],
            "dropped": {"loss": ["r02"]},
        },
        {
            "from": "r03",
            "seq": 4,
            "payload": [1.5, None],
            "bits": 96,
            "slot": None,
            "airtime_ns": 0,
            "delivered": [],
            "delay_ns": [],
            "dropped": {"receiver_down": ["r01"], "loss": ["r02"]},
        },
    ]


def test_every_reason_has_its_name_in_the_record_and_in_its_schema(tmp_path: Path) -> None:
    lost = [reason for reason in Reason if reason not in UNRECORDED]
    robots = [f"r{index:02}" for index in range(len(lost) + 1)]
    reasons = np.array([[*lost, 255]], dtype=np.uint8)
    with Recorder(tmp_path / "a.mcap", robots) as recorder:
        recorder.radio_batch(0, [len(lost)], [0], [b"\xc0"], [8], [0], [9], reasons, [([], [])])
    with LogReader(tmp_path / "a.mcap") as log:
        ((_, record),) = log.records("/radio")
    assert record["dropped"] == {reason.name: [robots[index]] for index, reason in enumerate(lost)}
    assert {"half_duplex", "collision", "burst"} <= set(record["dropped"])
    (schema,) = (json.loads(topic.schema) for topic in TOPICS if topic.name == "/radio")
    assert list(schema["properties"]["dropped"]["properties"]) == list(record["dropped"])


UNRECORDED = (Reason.delivered, Reason.out_of_range, Reason.not_a_candidate)


@pytest.mark.parametrize(
    ("payload", "shown"),
    [
        (msgspec.msgpack.encode({"a": [1, 2.5, "b", None, True]}), {"a": [1, 2.5, "b", None, True]}),
        (msgspec.msgpack.encode(2**64 - 1), 2**64 - 1),
        (msgspec.msgpack.encode({"raw": b"\x00\xff"}), {"raw": {"base64": "AP8="}}),
        (b"\xc1", {"base64": "wQ=="}),
        (b"", {"base64": ""}),
        (msgspec.msgpack.encode({1: "a"}), {"base64": "gQGhYQ=="}),
        (b"\xcb\x7f\xf0" + bytes(6), {"base64": "y3/wAAAAAAAA"}),
        (b"\xca\x7f\xc0\x00\x00", {"base64": "yn/AAAA="}),
        (msgspec.msgpack.encode("\xcb\x7f\xf0"), "\xcb\x7f\xf0"),
    ],
)
def test_payloads_are_shown_or_carried_as_base64(tmp_path: Path, payload: bytes, shown: object) -> None:
    (record,) = records(tmp_path / "a.mcap", lambda recorder: send(recorder, 0, payload), "/radio")
    assert record["payload"] == shown


def test_camera_frames_are_printed_short(tmp_path: Path) -> None:
    def steps(recorder: Recorder) -> None:
        recorder.camera(
            3, capture([0, 1, 3], [0, 2, 2, 3], [(5, 1.234, -0.0, 1), (9, 2, 3.1416, 0), (7, 0.1, -1, 2)])
        )

    with LogReader(write(tmp_path / "a.mcap", steps)) as log:
        ((_, sequence, log_time_ns, data),) = log.raw({"/camera"})
    assert sequence == 1
    assert log_time_ns == 3
    assert data == (
        b'{"frames":['
        b'{"robot":"r00","visual":[5,9],"range_m":[1.234,2.0],"bearing_rad":[0.0,3.1416],"lamp":[1,0]},'
        b'{"robot":"r01","visual":[],"range_m":[],"bearing_rad":[],"lamp":[]},'
        b'{"robot":"r03","visual":[7],"range_m":[0.1],"bearing_rad":[-1.0],"lamp":[2]}]}'
    )


@pytest.mark.parametrize(
    "data", [{"a": b"b"}, {"a": {1: 2}}, {"a": [float("nan")]}, {"a": float("inf"), "b": None}]
)
def test_records_that_json_cannot_carry_are_refused_by_name(tmp_path: Path, data: dict[str, Any]) -> None:
    with Recorder(tmp_path / "a.mcap", ROBOTS) as recorder:
        with pytest.raises(ValueError, match="/truth"):
            recorder.truth(0, data)
        with pytest.raises(ValueError, match="/faults"):
            recorder.fault(0, data)
        recorder.truth(0, {"a": None, "b": "null"})
        recorder.fault(0, {"a": None, "b": "null"})
    with LogReader(tmp_path / "a.mcap") as log:
        # A record that was refused leaves no gap in the sequence.
        assert [sequence for _, sequence, _, _ in log.raw()] == [0, 1, 2]
        for topic in ("/truth", "/faults"):
            assert list(log.records(topic)) == [(0, {"a": None, "b": "null"})]


@pytest.mark.parametrize(
    "text",
    [
        b"{}",
        b'{"guess":{"r01":7},"sure":null}',
        b'{ "b" : 1e2,\n\t"a":[0.10, -0, 1.0] }',
        b'{"same":1,"same":2}',
        '{"name":"caf\\u00e9 \u00e9 \\"quoted\\" \\/"}'.encode(),
        b'{"large":18446744073709551615}',
    ],
)
def test_the_text_of_an_entry_is_embedded_verbatim(tmp_path: Path, text: bytes) -> None:
    def steps(recorder: Recorder) -> None:
        recorder.entry(7, 2, "guess", text)
        recorder.entry(8, 3, 'a "name", \u00e9', text)
        recorder.entry(9, 3, "guess", text)

    with LogReader(write(tmp_path / "a.mcap", steps)) as log:
        raw = [(log_time_ns, data) for _, _, log_time_ns, data in log.raw({"/robot"})]
        records = list(log.records("/robot"))
    assert raw == [
        (7, b'{"robot":"r02","entry":"guess","data":' + text + b"}"),
        (8, '{"robot":"r03","entry":"a \\"name\\", \u00e9","data":'.encode() + text + b"}"),
        (9, b'{"robot":"r03","entry":"guess","data":' + text + b"}"),
    ]
    assert [(record["robot"], record["entry"]) for _, record in records] == [
        ("r02", "guess"),
        ("r03", 'a "name", \u00e9'),
        ("r03", "guess"),
    ]
    assert all(record["data"] == json.loads(text) for _, record in records)


def test_time_does_not_go_back_and_levels_are_known(tmp_path: Path) -> None:
    with Recorder(tmp_path / "a.mcap", ROBOTS) as recorder:
        recorder.fault(5, {"kind": "x"})
        recorder.fault(5, {"kind": "y"})
        with pytest.raises(ValueError, match="goes back from 5 ns to 4 ns"):
            recorder.fault(4, {"kind": "z"})
        with pytest.raises(ValueError, match="no log level 'loud'"):
            recorder.note(5, "loud", "r00", "hello")


def test_an_existing_file_is_refused_and_untouched(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_text("precious")
    with pytest.raises(LogError, match=r"a\.mcap exists; choose another --out or add --force"):
        Recorder(path, ROBOTS)
    assert path.read_text() == "precious"
    Recorder(path, ROBOTS, force=True).abort()
    assert doctor(path) == ""


def test_impossible_places_are_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(LogError, match=r"^cannot write .*choose another --out$"):
        Recorder(tmp_path / "file" / "a.mcap", ROBOTS)
    with pytest.raises(LogError, match="Is a directory"):
        Recorder(tmp_path, ROBOTS, force=True)


def test_refusing_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="'seed' is 7"):
        Recorder(tmp_path / "a.mcap", ROBOTS, run={"seed": 7})  # type: ignore[dict-item]
    assert list(tmp_path.iterdir()) == []


def test_the_result_carries_count_and_digest_of_every_topic(tmp_path: Path) -> None:
    with LogReader(write(tmp_path / "a.mcap")) as log:
        result, raw = log.result, list(log.raw())
    assert result is not None
    assert result["ended"] == "time"
    for topic in (entry.name for entry in TOPICS):
        of_topic = [(time_ns, data) for name, _, time_ns, data in raw if name == topic]
        joined = b"".join(time_ns.to_bytes(8, "little") + data for time_ns, data in of_topic)
        assert of_topic
        assert result[f"messages:{topic}"] == str(len(of_topic))
        assert result[f"sha256:{topic}"] == hashlib.sha256(joined).hexdigest()


def test_an_aborted_log_is_whole_but_has_no_result(tmp_path: Path) -> None:
    with LogReader(write(tmp_path / "a.mcap", finish=False)) as log:
        assert (log.run, log.result, log.torn, log.complete) == (RUN, None, False, False)


def test_closing_again_changes_nothing_and_recording_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    recorder = Recorder(path, ROBOTS)
    recorder.finish({})
    content = path.read_bytes()
    recorder.finish({"other": "result"})
    recorder.abort()
    assert path.read_bytes() == content
    with pytest.raises(ValueError, match="closed"):
        recorder.fault(0, {"kind": "x"})


def test_schemas_reach_the_disk_at_once_and_messages_with_the_next_second(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with Recorder(path, ROBOTS, run=RUN) as recorder:
        with LogReader(path) as log:
            assert (log.torn, log.run, list(log.topics)) == (True, RUN, [entry.name for entry in TOPICS])
            assert [(topic, sequence) for topic, sequence, _, _ in log.raw()] == [("/log", 0)]
        recorder.fault(S - 1, {"kind": "first"})
        with LogReader(path) as log:
            assert list(log.records("/faults")) == []
        recorder.fault(S, {"kind": "second"})
        with LogReader(path) as log:
            assert list(log.records("/faults")) == [(S - 1, {"kind": "first"})]


class FullDisk:
    """A file on a disk with little room left."""

    def __init__(self, path: Path, room: int) -> None:
        self._file = path.open("xb", buffering=0)
        self._room = room

    def write(self, data: memoryview, /) -> int:
        written = self._file.write(data[: self._room])
        self._room -= written
        if not written:
            raise OSError(errno.ENOSPC, "No space left on device")
        return written

    def truncate(self, size: int, /) -> int:
        return self._file.truncate(size)

    def close(self) -> None:
        self._file.close()


def test_a_full_disk_is_told_once_and_leaves_a_readable_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, whole = tmp_path / "a.mcap", write(tmp_path / "whole.mcap", lambda log: write_everything(log, 60))
    with LogReader(whole) as log:
        expected = list(log.raw())
        room = log.size_bytes // 2
    monkeypatch.setattr(logs.recorder, "open_log", lambda path, force: FullDisk(path, room))
    recorder = Recorder(path, ROBOTS, run=RUN, attachments=FILES, obstacles=WALLS)
    with pytest.raises(
        LogError, match=r"a\.mcap: No space left on device; free some space or choose another --out"
    ):
        write_everything(recorder, 60)
    before = path.read_bytes()
    write_everything(recorder)
    recorder.finish({"ended": "time"})
    recorder.abort()
    assert path.read_bytes() == before
    with LogReader(path) as log:
        raw = list(log.raw())
        assert log.torn
    assert raw == expected[: len(raw)]
    assert raw
    recover(path, tmp_path / "recovered.mcap")
    assert doctor(tmp_path / "recovered.mcap") == ""


@pytest.mark.parametrize("missing_bytes", [1, 1000, None])
def test_a_disk_that_is_full_at_the_start_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, missing_bytes: int | None
) -> None:
    path = tmp_path / "a.mcap"
    with Recorder(path, ROBOTS):
        needed_bytes = path.stat().st_size
    path.unlink()
    room = 0 if missing_bytes is None else needed_bytes - missing_bytes
    monkeypatch.setattr(logs.recorder, "open_log", lambda path, force: FullDisk(path, room))
    with pytest.raises(LogError, match="No space left"):
        Recorder(path, ROBOTS)
    assert list(tmp_path.iterdir()) == []


def test_chunks_close_by_size_within_a_second(tmp_path: Path) -> None:
    def steps(recorder: Recorder) -> None:
        for number in range(300):
            recorder.entry(number, 0, "big", b'{"text":"%s"}' % (b"x" * 1000))

    with LogReader(write(tmp_path / "a.mcap", steps)) as log:
        # The first holds the schemas and the news that recording begins.
        assert [size > 256 * 1024 for _, _, size in log.chunks] == [False, True, False]
        assert len(list(log.records("/robot"))) == 300


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.name)
def test_schemas_describe_every_field(topic: Any) -> None:
    if topic.encoding == "json":
        schema = msgspec.json.decode(topic.schema)
        assert schema["type"] == "object"
        assert schema["description"]
        assert all(field["description"] for field in schema["properties"].values())
    else:
        files = FileDescriptorSet.FromString(topic.schema)
        names = {f"{file.package}.{kind.name}" for file in files.file for kind in file.message_type}
        assert topic.schema_name in names
        seen: set[str] = set()
        for file in files.file:
            assert seen.issuperset(file.dependency)
            seen.add(file.name)


def test_a_log_that_is_being_written_is_not_replaced(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with Recorder(path, ROBOTS) as recorder:
        before = path.read_bytes()
        with pytest.raises(LogError, match=r"a\.mcap is being written by another run; choose another --out"):
            Recorder(path, ROBOTS, force=True)
        assert path.read_bytes() == before
        recorder.finish({})
    Recorder(path, ROBOTS, force=True).finish({})
    assert doctor(path) == ""
