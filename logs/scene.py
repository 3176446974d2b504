"""The topics that make a log visible in Foxglove, Lichtblick and Rerun.

Each message replaces the one before it on its topic: viewers fetch only the last one after a seek.
What changes at every instant is put together from numpy bytes, for an object per point costs ten times
as much; field numbers are those of the Foxglove schemas, and tests parse every message back.
Encoding of messages: https://protobuf.dev/programming-guides/encoding
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

from channels.units import NS_PER_S

WORLD = "world"
"""Frame that robots move in."""

_DARK = (110, 110, 125, 255)
_LIT = (
    (255, 240, 140, 255),
    (255, 80, 70, 255),
    (90, 220, 110, 255),
    (90, 150, 255, 255),
    (235, 110, 235, 255),
    (80, 220, 230, 255),
    (255, 160, 60, 255),
)
_COLOURS = np.array([_DARK, *(_LIT[i % len(_LIT)] for i in range(255))], dtype=np.uint8)

# A vector whose zeros are left out: x and y, and where robots have altitudes z as well.
_FLAT = [("head", "S3"), ("x", "<f8"), ("y_tag", "u1"), ("y", "<f8")]
_HIGH = [*_FLAT, ("z_tag", "u1"), ("z", "<f8")]
# One robot's rotation (field 5: z, w), which follows its translation (field 4).
_ROTATION = [("rotation", "S3"), ("sine", "<f8"), ("w_tag", "u1"), ("w", "<f8")]
_LIGHT = np.dtype([("xyz", "<f4", 3), ("rgba", "u1", 4)])
_FLAT_BYTES = 18
_HIGH_BYTES = 27


def size_of_robots(arena_m: tuple[float, float]) -> float:
    """Radius in which robots are drawn [m]: a hundredth of the arena's longer side."""
    return max(arena_m) / 100 or 0.01


class SceneEncoder:
    """Encodes the scene of one team."""

    def __init__(
        self,
        robots: Sequence[str],
        arena_m: tuple[float, float],
        altitudes_m: Sequence[float] | None = None,
    ) -> None:
        """`altitudes_m`: how high each robot is; None: all on the ground."""
        self._size_m = size_of_robots(arena_m)
        self._robots = list(robots)
        self._children = [_field(2, WORLD.encode()) + _field(3, robot.encode()) for robot in robots]
        self._motion = _motion_rows(len(robots), altitudes_m)
        self._moved: NDArray[np.float64] | None = None
        self._motions: list[bytes] = []
        self._lights = np.zeros(len(robots), _LIGHT)
        self._lights["xyz"][:, 2] = self._size_m + np.array(altitudes_m or 0.0)
        self._cloud = _cloud_fields()
        self._line_head, self._line_tail = _line_parts(self._size_m / 20)
        self._corners = _vectors(len(robots), 5, altitudes_m)
        one, other = np.triu_indices(len(robots), 1)
        self._forth, self._back = one * len(robots) + other, other * len(robots) + one
        self._pairs = np.stack((one, other), axis=1).astype("<u4")
        self._bodies = SceneUpdate(entities=[self._body(robot) for robot in robots])
        self._names = SceneUpdate(entities=[self._label(robot) for robot in robots])

    def transforms(self, now_ns: int, poses: NDArray[np.float64]) -> bytes:
        """FrameTransforms of all robots. `poses` (N, 3): x, y [m], heading [rad]."""
        if self._moved is None or not np.array_equal(self._moved, poses):
            self._moved = np.array(poses)
            self._motions = self._encode_motion(poses)
        stamp = _stamp(1, now_ns)
        fixed, parts = len(stamp) + self._motion.itemsize, list[bytes]()
        for child, motion in zip(self._children, self._motions, strict=True):
            parts += (_head(1, fixed + len(child)), stamp, child, motion)
        return b"".join(parts)

    def lights(self, now_ns: int, poses: NDArray[np.float64], lamps: NDArray[np.uint8]) -> bytes:
        """PointCloud of all lamps. `lamps` (N,): colour numbers, 0: dark."""
        self._lights["xyz"][:, :2] = poses[:, :2]
        self._lights["rgba"] = _COLOURS[lamps]
        return _stamp(1, now_ns) + self._cloud + _field(6, self._lights.tobytes())

    def links(self, now_ns: int, poses: NDArray[np.float64], links: NDArray[np.bool_]) -> bytes:
        """SceneUpdate with a line wherever `links` (N, N) is set in either direction."""
        entity = _stamp(1, now_ns) + _field(2, WORLD.encode()) + _field(3, b"links")
        either = links.ravel()
        linked = np.flatnonzero(either.take(self._forth) | either.take(self._back))
        ends = self._pairs.take(linked, axis=0)
        if len(ends):
            self._corners["x"] = poses[:, 0].astype(np.float32)
            self._corners["y"] = poses[:, 1].astype(np.float32)
            line = self._line_head + self._corners.tobytes() + self._line_tail + _field(8, ends.tobytes())
            entity += _field(11, line)
        return _field(2, entity)

    def bodies(self, now_ns: int) -> bytes:
        """SceneUpdate with every robot's body and heading, in the robot's own frame."""
        return stamped(self._bodies, now_ns)

    def labels(self, now_ns: int) -> bytes:
        """SceneUpdate with every robot's name."""
        return stamped(self._names, now_ns)

    def _encode_motion(self, poses: NDArray[np.float64]) -> list[bytes]:
        # Single precision: finer digits only cost space, and differ between CPUs for sine and cosine.
        rows, half = self._motion, poses[:, 2] / 2
        rows["x"] = poses[:, 0].astype(np.float32)
        rows["y"] = poses[:, 1].astype(np.float32)
        rows["sine"] = np.sin(half).astype(np.float32)
        rows["w"] = np.cos(half).astype(np.float32)
        data, size = rows.tobytes(), rows.itemsize
        return [data[start : start + size] for start in range(0, len(data), size)]

    def _body(self, robot: str) -> SceneEntity:
        entity = SceneEntity(frame_id=robot, id=robot, frame_locked=True)
        size = self._size_m
        body = entity.cylinders.add(bottom_scale=1.0, top_scale=1.0)
        body.pose.CopyFrom(_pose(size / 2))
        body.size.CopyFrom(Vector3(x=2 * size, y=2 * size, z=size))
        body.color.CopyFrom(Color(r=0.35, g=0.45, b=0.6, a=1.0))
        heading = entity.arrows.add(
            shaft_length=size, shaft_diameter=size / 4, head_length=size / 2, head_diameter=size / 2
        )
        heading.pose.CopyFrom(_pose(size))
        heading.color.CopyFrom(Color(r=0.9, g=0.9, b=0.9, a=1.0))
        return entity

    def _label(self, robot: str) -> SceneEntity:
        entity = SceneEntity(frame_id=robot, id=robot, frame_locked=True)
        label = entity.texts.add(billboard=True, font_size=12.0, scale_invariant=True, text=robot)
        label.pose.CopyFrom(_pose(3 * self._size_m))
        label.color.CopyFrom(Color(r=1.0, g=1.0, b=1.0, a=1.0))
        return entity


def _stamp(number: int, now_ns: int) -> bytes:
    seconds, nanos = divmod(now_ns, NS_PER_S)
    return _field(number, Timestamp(seconds=seconds, nanos=nanos).SerializeToString())


def stamped(update: SceneUpdate, now_ns: int) -> bytes:
    """The encoded update, all of it of this instant."""
    for entity in update.entities:
        entity.timestamp.seconds, entity.timestamp.nanos = divmod(now_ns, NS_PER_S)
    return update.SerializeToString()


def _field(number: int, content: bytes) -> bytes:
    """A length-delimited field of number below 16."""
    return _head(number, len(content)) + content


@lru_cache(maxsize=256)
def _head(number: int, size: int) -> bytes:
    """Tag and length of a field, the length in groups of seven bits, lowest first."""
    length = b""
    while size > 0x7F:
        length += bytes((size & 0x7F | 0x80,))
        size >>= 7
    return bytes((number << 3 | 2,)) + length + bytes((size,))


def _vectors(
    robots: int, field: int, altitudes_m: Sequence[float] | None, more: Sequence[tuple[str, str]] = ()
) -> NDArray[np.void]:
    """Rows of vectors under a field number, x and y still to be filled in."""
    layout, size = (_FLAT, _FLAT_BYTES) if altitudes_m is None else (_HIGH, _HIGH_BYTES)
    rows = np.zeros(robots, np.dtype([*layout, *more]))
    rows["head"] = bytes([field << 3 | 2, size, 0x09])
    rows["y_tag"] = 0x11
    if altitudes_m is not None:
        rows["z_tag"] = 0x19
        rows["z"] = altitudes_m
    return rows


def _motion_rows(robots: int, altitudes_m: Sequence[float] | None) -> NDArray[np.void]:
    rows = _vectors(robots, 4, altitudes_m, _ROTATION)
    rows["rotation"] = bytes([5 << 3 | 2, _FLAT_BYTES, 0x19])
    rows["w_tag"] = 0x21
    return rows


def _cloud_fields() -> bytes:
    kinds = PackedElementField
    fields = [
        PackedElementField(name=name, offset=4 * i, type=kinds.FLOAT32) for i, name in enumerate("xyz")
    ] + [
        PackedElementField(name=name, offset=12 + i, type=kinds.UINT8)
        for i, name in enumerate(("red", "green", "blue", "alpha"))
    ]
    cloud = PointCloud(frame_id=WORLD, pose=_pose(0.0), point_stride=_LIGHT.itemsize, fields=fields)
    return cloud.SerializeToString()


def _line_parts(thickness_m: float) -> tuple[bytes, bytes]:
    head = LinePrimitive(type=LinePrimitive.LINE_LIST, pose=_pose(0.0), thickness=thickness_m)
    tail = LinePrimitive(color=Color(r=0.4, g=0.8, b=1.0, a=0.5))
    return head.SerializeToString(), tail.SerializeToString()


def _pose(height_m: float) -> Pose:
    return Pose(position=Vector3(z=height_m), orientation=Quaternion(w=1.0))
