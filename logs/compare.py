"""Where two logs part: the first record that differs, shown so that a person can start looking there."""

from __future__ import annotations

import filecmp
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

import orjson
from google.protobuf.json_format import MessageToDict
from google.protobuf.message import DecodeError

from channels.units import to_s
from logs import LogError
from logs.reader import LogReader
from logs.schemas import message_class

_WIDTH = 200
_Raw = tuple[str, int, int, bytes]


@dataclass(frozen=True)
class Difference:
    """The first thing in which two logs, left and right, differ."""

    what: str
    """The topic of the record, or "metadata NAME", "attachment NAME", "file layout"."""
    index: int | None = None
    """How many records of that topic came before, in both logs alike."""
    sequence: int | None = None
    log_time_ns: int | None = None
    """Of the left record, or of the right one where the left log has ended."""
    field: str | None = None
    """Path of the first field that differs, like $.delivered[2]; None: all of it, or none of it."""
    left: object = None
    """What the left log says, decoded: the record; None where it has ended."""
    right: object = None

    def format(self) -> str:
        """A few lines for people."""
        place = self.what
        if self.index is not None and self.log_time_ns is not None:
            place += f" record {self.index} (sequence {self.sequence}, at {to_s(self.log_time_ns):.9f} s)"
        lines = [f"first difference: {place}" + (f", field {self.field}" if self.field else "")]
        for name, value in (("left", self.left), ("right", self.right)):
            shown = _at(value, self.field) if self.field else value
            lines.append(
                f"  {name + ':':7}" + ("nothing, the log ends here" if value is None else _shown(shown))
            )
        return "\n".join(lines)


def first_difference(a: Path, b: Path) -> Difference | None:
    """The first record in which log `a` (left) and log `b` (right) differ; None: the files are equal.

    Records come first; where all are equal, metadata, attachments, and at last the layout of the bytes.
    Raises LogError when either is no log.
    """
    try:
        if filecmp.cmp(a, b, shallow=False):
            return None
    except OSError as error:
        raise LogError(f"cannot read {error.filename}: {error.strerror}; check the name") from None
    with LogReader(a) as left, LogReader(b) as right:
        return (
            _record_difference(left, right)
            or _contents_difference("metadata", dict(left.metadata), dict(right.metadata))
            or _contents_difference("attachment", _files(left), _files(right))
            or Difference("file layout", left=_layout(left), right=_layout(right))
        )


def first_path(left: object, right: object, path: str = "$") -> str | None:
    """Path of the first place where two JSON values differ, in the order of the left one; None: equal."""
    if isinstance(left, dict) and isinstance(right, dict):
        steps: Iterator[tuple[str, Any, Any]] = (
            (f"{path}.{key}", left.get(key, _MISSING), right.get(key, _MISSING)) for key in {**left, **right}
        )
    elif isinstance(left, list) and isinstance(right, list):
        pairs = zip_longest(left, right, fillvalue=_MISSING)
        steps = ((f"{path}[{number}]", *pair) for number, pair in enumerate(pairs))
    else:
        # 1, 1.0 and True are equal to Python, and three different things in a log.
        return None if left == right and type(left) is type(right) else path
    return next((found for place, x, y in steps if (found := first_path(x, y, place))), None)


_MISSING: Any = object()


def _record_difference(left: LogReader, right: LogReader) -> Difference | None:
    seen: Counter[str] = Counter()
    for x, y in zip_longest(left.raw(), right.raw()):
        if x != y:
            return _between(left, x, right, y, seen)
        seen[x[0]] += 1
    return None


def _between(
    left: LogReader, x: _Raw | None, right: LogReader, y: _Raw | None, seen: Counter[str]
) -> Difference:
    topic, sequence, log_time_ns, _ = x or y or ("", 0, 0, b"")
    shown_x, shown_y = _decoded(left, x), _decoded(right, y)
    same_place = x is not None and y is not None and x[:3] == y[:3]
    if not same_place:
        shown_x, shown_y = _with_place(x, shown_x), _with_place(y, shown_y)
    field = first_path(shown_x, shown_y) if same_place else None
    return Difference(topic, seen[topic], sequence, log_time_ns, field, shown_x, shown_y)


def _decoded(log: LogReader, record: _Raw | None) -> object:
    if record is None:
        return None
    info, data = log.topics[record[0]], record[3]
    try:
        if info.encoding == "json":
            return orjson.loads(data)
        kind = message_class(info.schema_name)
        if info.encoding == "protobuf" and kind is not None:
            return MessageToDict(kind.FromString(data), preserving_proto_field_name=True)
    except (ValueError, DecodeError):
        pass
    return data.hex()


def _with_place(record: _Raw | None, decoded: object) -> object:
    """Where the record stands, before what it says: that is what differs."""
    if record is None:
        return None
    return {"topic": record[0], "sequence": record[1], "log_time_ns": record[2], "record": decoded}


def _contents_difference(
    kind: str, left: dict[str, dict[str, str]], right: dict[str, dict[str, str]]
) -> Difference | None:
    for name in {**left, **right}:
        x, y = left.get(name), right.get(name)
        if x != y:
            field = first_path(x, y) if x is not None and y is not None else None
            return Difference(f"{kind} {name}", field=field, left=x, right=y)
    return None


def _files(log: LogReader) -> dict[str, dict[str, str]]:
    return {
        file.name: {"media_type": file.media_type, "data": file.data.decode(errors="backslashreplace")}
        for file in log.attachments()
    }


def _layout(log: LogReader) -> dict[str, object]:
    return {"library": log.library, "torn": log.torn, "chunks": log.chunks, "size_bytes": log.size_bytes}


def _at(value: object, path: str) -> object:
    """The part of a decoded record that `first_path` named."""
    for other in _steps(value, "$"):
        if other[0] == path:
            return other[1]
    return "nothing"


def _steps(value: object, path: str) -> Iterator[tuple[str, object]]:
    yield path, value
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _steps(item, f"{path}.{key}")
    elif isinstance(value, list):
        for number, item in enumerate(value):
            yield from _steps(item, f"{path}[{number}]")


def _shown(value: object) -> str:
    text = value if isinstance(value, str) else orjson.dumps(value).decode()
    return text if len(text) <= _WIDTH else f"{text[:_WIDTH]}... ({len(text)} characters)"
