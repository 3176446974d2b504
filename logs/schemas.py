"""Every topic of a log: its encoding and the schema that tells a stranger what the fields mean."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import orjson
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import Message

from channels.fates import Reason

RADIO = "/radio"
CAMERA = "/camera"
ROBOT = "/robot"
TRUTH = "/truth"
FAULTS = "/faults"
LOG = "/log"
TF = "/tf"
LIGHTS = "/viz/lights"
LINKS = "/viz/links"
ROBOTS = "/viz/robots"
LABELS = "/viz/labels"
WORLD = "/viz/world"

LOSSES = {int(reason): reason.name for reason in Reason if Reason.out_of_range < reason < 255}
"""Why a receiver in range did not get a transmission: codes of `Reason` and their names in the log."""


@dataclass(frozen=True)
class Topic:
    """One channel of the log."""

    name: str
    encoding: str
    schema_name: str
    schema_encoding: str
    schema: bytes


def message_class(schema_name: str) -> type[Message] | None:
    """The protobuf class of a schema used here, or None."""
    return _FOXGLOVE.get(schema_name)


def _object(description: str, properties: Mapping[str, Any], *, closed: bool = True) -> dict[str, Any]:
    schema: dict[str, Any] = {"type": "object", "description": description, "properties": dict(properties)}
    if closed:
        schema |= {"required": list(properties), "additionalProperties": False}
    return schema


def _is(kind: str | list[str], description: str, **more: Any) -> dict[str, Any]:
    return {"type": kind, "description": description, **more}


def _list(items: str, description: str) -> dict[str, Any]:
    return _is("array", description, items={"type": items})


_DROPPED = {
    name: _list("string", f"Ids of the receivers that did not get it because of {name}.")
    for name in LOSSES.values()
}

_RADIO = _object(
    "One radio transmission and its fate at every receiver in range. Log time: when it ends, and is decided.",
    {
        "from": _is("string", "Id of the sender."),
        "seq": _is("integer", "Sequence number, counted by the sender."),
        "payload": {
            "description": "What was sent. Bytes, and payloads that are not JSON, as {'base64': text}.",
            "contentEncoding": "base64",
        },
        "bits": _is("integer", "Size on air, overhead included [bit]."),
        "slot": _is(["integer", "null"], "Place of the sender's slot in the frame, null without slots."),
        "airtime_ns": _is("integer", "How long the transmission lasts [ns]."),
        "delivered": _list("string", "Ids of the robots that received it, in robot order."),
        "delay_ns": _list("integer", "From log time to reception by each of `delivered` [ns]."),
        "dropped": {
            **_object("Ids of robots in range that did not receive it, by reason.", _DROPPED, closed=False),
            "additionalProperties": {"type": "array", "items": {"type": "string"}},
        },
    },
)

_FRAME = _object(
    "What one camera saw: parallel lists, ordered by visual id.",
    {
        "robot": _is("string", "Id of the observer."),
        "visual": _list("integer", "Visual ids, the observer's own names for what it sees."),
        "range_m": _list("number", "Distances [m]."),
        "bearing_rad": _list("number", "Bearings relative to the observer's heading, anticlockwise [rad]."),
        "lamp": _list("integer", "Colours of the lamps, 0: dark."),
    },
)

_CAMERA = _object(
    "The frames of all cameras that exposed at one instant. Log time: the exposure.",
    {"frames": _is("array", "One frame per observer.", items=_FRAME)},
)

_ROBOT = _object(
    "One entry a behaviour logged. Log time: when it did.",
    {
        "robot": _is("string", "Id of the robot."),
        "entry": _is("string", "Name of the entry, chosen by the behaviour."),
        "data": _is("object", "What the behaviour said. Units are in the names of its fields."),
    },
)

_TRUTH = _object(
    "What the emulator knows and no robot is told. Log time: when it became true.",
    {"kind": _is("string", "What the record is about; the other fields depend on it.")},
    closed=False,
)

_FAULT = _object(
    "A fault that was injected, or that happened. Log time: when it took effect.",
    {
        "kind": _is("string", "What went wrong; the other fields depend on it."),
        "robot": _is("string", "Id of the robot concerned, absent where none is."),
    },
    closed=False,
)

_FOXGLOVE: dict[str, type[Message]] = {
    "foxglove.Log": Log,
    "foxglove.FrameTransforms": FrameTransforms,
    "foxglove.PointCloud": PointCloud,
    "foxglove.SceneUpdate": SceneUpdate,
}


def _json_topic(name: str, schema: dict[str, Any]) -> Topic:
    title = "heliograph." + name.strip("/").capitalize()
    body = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": title, **schema}
    return Topic(name, "json", title, "jsonschema", orjson.dumps(body))


def _protobuf_topic(name: str, schema_name: str) -> Topic:
    files = FileDescriptorSet()
    _add_file(files, _FOXGLOVE[schema_name].DESCRIPTOR.file, set())
    return Topic(name, "protobuf", schema_name, "protobuf", files.SerializeToString(deterministic=True))


def _add_file(files: FileDescriptorSet, file: Any, seen: set[str]) -> None:
    """Add a file descriptor after everything it imports, each once."""
    if file.name in seen:
        return
    seen.add(file.name)
    for dependency in file.dependencies:
        _add_file(files, dependency, seen)
    file.CopyToProto(files.file.add())


TOPICS = (
    _json_topic(RADIO, _RADIO),
    _json_topic(CAMERA, _CAMERA),
    _json_topic(ROBOT, _ROBOT),
    _json_topic(TRUTH, _TRUTH),
    _json_topic(FAULTS, _FAULT),
    _protobuf_topic(LOG, "foxglove.Log"),
    _protobuf_topic(TF, "foxglove.FrameTransforms"),
    _protobuf_topic(LIGHTS, "foxglove.PointCloud"),
    _protobuf_topic(LINKS, "foxglove.SceneUpdate"),
    _protobuf_topic(ROBOTS, "foxglove.SceneUpdate"),
    _protobuf_topic(LABELS, "foxglove.SceneUpdate"),
    _protobuf_topic(WORLD, "foxglove.SceneUpdate"),
)
"""In the order of their channel ids, counted from 1."""
