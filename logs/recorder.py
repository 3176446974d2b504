"""Writes what happens in a run into one MCAP file.

The same calls give the same bytes: no wall clock, no names of machines, and the file is flushed by
virtual time and by size alone. Log times never decrease, publish time equals log time, and sequence
numbers count the records of all topics from 0, which puts them in one total order.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log
from numpy.typing import NDArray

from channels.graphs import Graph, Rectangle
from channels.units import NS_PER_S
from channels.visual import Capture
from logs import RESULT_METADATA, RUN_METADATA, Attachment, LogError, sha256_of
from logs import schemas as topic
from logs.encoding import embed_entry, encode_camera, encode_record, encode_transmissions
from logs.mcap_writer import FileSink, McapWriter, open_log
from logs.scene import SceneEncoder, stamped
from logs.world_scene import world_scene

__all__ = ["Attachment", "LogError", "Recorder", "sha256_of"]

FLUSH_NS = NS_PER_S
"""At most this much virtual time is lost when the process is killed."""
REPEAT_NS = 10 * NS_PER_S
"""How often what never changes is drawn again, for viewers that enter in the middle."""

_LEVELS = {
    "debug": Log.DEBUG,
    "info": Log.INFO,
    "warning": Log.WARNING,
    "error": Log.ERROR,
    "fatal": Log.FATAL,
}
_CHANNEL = {entry.name: number for number, entry in enumerate(topic.TOPICS, start=1)}
_RADIO = _CHANNEL[topic.RADIO]
_CAMERA = _CHANNEL[topic.CAMERA]
_ROBOT = _CHANNEL[topic.ROBOT]
_LOG = _CHANNEL[topic.LOG]


class Recorder:
    """One run's log. Robots are indexed in the order of `robots`; instants are virtual, in integer ns.

    Every recording method raises ValueError when time goes back or the log is closed, and LogError once,
    when the file can no longer be written; from then on the calls do nothing, and the file stays readable up
    to its last whole chunk. As a context manager it aborts where it was not finished.
    """

    def __init__(
        self,
        path: Path,
        robots: Sequence[str],
        *,
        force: bool = False,
        run: Mapping[str, str] | None = None,
        attachments: Sequence[Attachment] = (),
        arena_m: tuple[float, float] = (10.0, 10.0),
        altitudes_m: Sequence[float] | None = None,
        graph: Graph | None = None,
        obstacles: Sequence[Rectangle] = (),
    ) -> None:
        """Create the file and write what is known at the start: `run`, the attachments, all schemas.

        A first record, on /log at 0, says that recording begins: with it all of this is on the disk.

        `force` replaces an existing file; `arena_m` scales the drawn robots; `altitudes_m`: how high each
        is drawn (None: all on the ground); `graph` and `obstacles`, in metres, are drawn where there are
        any. Raises LogError when the file exists or cannot be written, TypeError when `run` holds anything
        but text.
        """
        _check_texts(run or {})
        self.path = path
        self._robots = list(robots)
        self._scene = SceneEncoder(self._robots, arena_m, altitudes_m)
        self._world = world_scene(graph, obstacles, arena_m)
        self._heard: list[tuple[int, list[int]]] = []
        self._repeat_at_ns = 0
        self._now_ns = 0
        self._flush_at_ns = 0
        self._sequence = 0
        self._closed = False
        self._failed = False
        self._writer = McapWriter(FileSink(open_log(path, force=force)))
        try:
            self._begin(run or {}, attachments)
        except OSError as error:
            if not force:
                path.unlink(missing_ok=True)
            self._fail(error)

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *_: object) -> None:
        self.abort()

    def radio_batch(
        self,
        now_ns: int,
        senders: Sequence[int],
        seqs: Sequence[int],
        payloads: Sequence[bytes],
        bits: Sequence[int],
        slots: Sequence[int | None],
        airtimes_ns: Sequence[int],
        reasons: NDArray[np.uint8],
        deliveries: Sequence[tuple[list[int], list[int]]],
    ) -> None:
        """Record the T transmissions that end now, on /radio.

        `senders` are robot indices; `reasons` (T, N) codes of `Reason`, of which `out_of_range` and the
        sender itself are left out; `deliveries` as `Fates.deliveries` gives them.
        """
        if not self._ready(now_ns):
            return
        self._heard += zip(senders, (receivers for receivers, _ in deliveries), strict=True)
        encoded = encode_transmissions(
            self._robots, senders, seqs, payloads, bits, slots, airtimes_ns, reasons, deliveries
        )
        for record in encoded:
            self._put(_RADIO, now_ns, record)

    def camera(self, capture_ns: int, capture: Capture) -> None:
        """Record the frames of one exposure as one message on /camera."""
        if self._ready(capture_ns):
            self._put(_CAMERA, capture_ns, encode_camera(capture, self._robots))

    def entry(self, now_ns: int, robot: int, name: str, text: bytes) -> None:
        """Record what a behaviour logs, on /robot; `text` is a JSON object, and taken as it is."""
        if self._ready(now_ns):
            self._put(_ROBOT, now_ns, embed_entry(self._robots[robot], name, text))

    def truth(self, now_ns: int, record: Mapping[str, Any]) -> None:
        """Record what no robot is told, on /truth. Raises ValueError for what JSON cannot carry."""
        self._record(topic.TRUTH, now_ns, record)

    def fault(self, now_ns: int, record: Mapping[str, Any]) -> None:
        """Record a fault, on /faults. Raises ValueError for what JSON cannot carry."""
        self._record(topic.FAULTS, now_ns, record)

    def note(self, now_ns: int, level: str, source: str, text: str) -> None:
        """Record a line for people, on /log: debug, info, warning, error or fatal; from a robot or part."""
        if level not in _LEVELS:
            raise ValueError(f"no log level {level!r}; there are {', '.join(_LEVELS)}")
        if self._ready(now_ns):
            self._put(_LOG, now_ns, _line(now_ns, level, source, text))

    def scene(self, now_ns: int, poses: NDArray[np.float64], lamps: NDArray[np.uint8]) -> None:
        """Record how things look now, with a line for every delivery since the last call.

        `poses` (N, 3): x, y [m], heading [rad]; `lamps` (N,): colour numbers, 0: dark.
        """
        if not self._ready(now_ns):
            return
        scene = self._scene
        if now_ns >= self._repeat_at_ns:
            self._repeat_at_ns = now_ns + REPEAT_NS
            self._put(_CHANNEL[topic.ROBOTS], now_ns, scene.bodies(now_ns))
            self._put(_CHANNEL[topic.LABELS], now_ns, scene.labels(now_ns))
            if self._world is not None:
                self._put(_CHANNEL[topic.WORLD], now_ns, stamped(self._world, now_ns))
        self._put(_CHANNEL[topic.TF], now_ns, scene.transforms(now_ns, poses))
        self.lights(now_ns, poses, lamps)
        self._put(_CHANNEL[topic.LINKS], now_ns, scene.links(now_ns, poses, self._links()))
        self._heard.clear()

    def lights(self, now_ns: int, poses: NDArray[np.float64], lamps: NDArray[np.uint8]) -> None:
        """Record which lamps are lit now; arguments as in `scene`."""
        if self._ready(now_ns):
            self._put(_CHANNEL[topic.LIGHTS], now_ns, self._scene.lights(now_ns, poses, lamps))

    def _links(self) -> NDArray[np.bool_]:
        """(N, N): who was heard by whom since the last scene."""
        links = np.zeros((len(self._robots), len(self._robots)), dtype=bool)
        for sender, receivers in self._heard:
            links[sender, receivers] = True
        return links

    def finish(self, result: Mapping[str, str]) -> None:
        """Write how the run ended, with count and digest of every topic, and close. Idempotent.

        The digest of a topic is SHA-256 over (log time as 8 bytes little-endian, data) of its records.
        """
        _check_texts(result)
        if self._closed:
            return
        self._closed = True
        try:
            self._writer.flush()
            self._writer.add_metadata(RESULT_METADATA, {**result, **self._digests()})
            self._writer.finish()
            self._writer.close()
        except OSError as error:
            self._fail(error)

    def abort(self) -> None:
        """Close the file whole, but without a result: its absence marks an aborted run. Idempotent."""
        if self._closed:
            return
        self._closed = True
        try:
            self._writer.finish()
            self._writer.close()
        except OSError as error:
            self._fail(error)

    def _begin(self, run: Mapping[str, str], attachments: Sequence[Attachment]) -> None:
        self._writer.start()
        self._writer.add_metadata(RUN_METADATA, run)
        for entry in topic.TOPICS:
            schema = self._writer.register_schema(entry.schema_name, entry.schema_encoding, entry.schema)
            self._writer.register_channel(entry.name, entry.encoding, schema, {})
        for attachment in attachments:
            self._writer.add_attachment(attachment.name, attachment.media_type, attachment.data)
        # Schemas and channels reach the file with the first message: there is to be one at once.
        self._writer.add_message(_LOG, 0, _line(0, "info", "heliograph", "recording begins"), self._sequence)
        self._sequence += 1
        self._writer.flush()

    def _ready(self, now_ns: int) -> bool:
        """Whether there is a file to write to; flushes what an earlier second has left."""
        if self._failed:
            return False
        if self._closed:
            raise ValueError(f"{self.path} is closed")
        if now_ns < self._now_ns:
            raise ValueError(f"log time goes back from {self._now_ns} ns to {now_ns} ns")
        self._now_ns = now_ns
        if now_ns >= self._flush_at_ns:
            self._flush_at_ns = (now_ns // FLUSH_NS + 1) * FLUSH_NS
            try:
                self._writer.flush()
            except OSError as error:
                self._fail(error)
        return True

    def _put(self, channel: int, now_ns: int, data: bytes) -> None:
        try:
            self._writer.add_message(channel, now_ns, data, self._sequence)
        except OSError as error:
            self._fail(error)
        self._sequence += 1

    def _record(self, name: str, now_ns: int, record: Mapping[str, Any]) -> None:
        if not self._ready(now_ns):
            return
        try:
            encoded = encode_record(record)
        except ValueError as error:
            raise ValueError(f"record for {name}: {error}") from None
        self._put(_CHANNEL[name], now_ns, encoded)

    def _digests(self) -> dict[str, str]:
        digests = {}
        for name, channel in _CHANNEL.items():
            count, digest = self._writer.digest(channel)
            digests[f"messages:{name}"] = str(count)
            digests[f"sha256:{name}"] = digest
        return digests

    def _fail(self, error: OSError) -> NoReturn:
        """Give the file up: what a full disk has cut off cannot be mended by writing more."""
        self._failed = self._closed = True
        with contextlib.suppress(OSError):
            self._writer.close()
        remedy = "free some space or choose another --out"
        raise LogError(f"cannot write {self.path}: {error.strerror}; {remedy}") from None


def _check_texts(texts: Mapping[str, str]) -> None:
    for key, value in texts.items():
        if not (isinstance(key, str) and isinstance(value, str)):
            raise TypeError(f"metadata is text, but {key!r} is {value!r}")


def _line(now_ns: int, level: str, source: str, text: str) -> bytes:
    line = Log(level=_LEVELS[level], name=source, message=text)
    line.timestamp.seconds, line.timestamp.nanos = divmod(now_ns, NS_PER_S)
    return line.SerializeToString()
