"""The world for viewers: where robots can go, and what stands in the way of their radio."""

from __future__ import annotations

from collections.abc import Sequence

from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3

from channels.graphs import Graph, Rectangle
from logs.scene import WORLD, size_of_robots

_EDGE = (0.55, 0.55, 0.6, 0.8)
_OBSTACLE = (0.35, 0.3, 0.3, 0.9)


def world_scene(
    graph: Graph | None, obstacles: Sequence[Rectangle], arena_m: tuple[float, float]
) -> SceneUpdate | None:
    """A line for every edge of the graph, a block for every obstacle, all in metres; None without any."""
    if graph is None and not obstacles:
        return None
    size_m = size_of_robots(arena_m)
    entity = SceneEntity(frame_id=WORLD, id="world")
    if graph is not None:
        entity.lines.append(_edges(graph, size_m / 10))
    for x0, y0, x1, y1 in obstacles:
        block = entity.cubes.add()
        block.pose.CopyFrom(_pose((x0 + x1) / 2, (y0 + y1) / 2, size_m))
        block.size.CopyFrom(Vector3(x=x1 - x0, y=y1 - y0, z=2 * size_m))
        block.color.CopyFrom(_colour(_OBSTACLE))
    return SceneUpdate(entities=[entity])


def _edges(graph: Graph, thickness_m: float) -> LinePrimitive:
    return LinePrimitive(
        type=LinePrimitive.LINE_LIST,
        pose=_pose(0.0, 0.0, 0.0),
        thickness=thickness_m,
        points=[Point3(x=x, y=y) for x, y in graph.vertices],
        color=_colour(_EDGE),
        indices=[end for a, b, _ in graph.edges for end in (a, b)],
    )


def _pose(x: float, y: float, z: float) -> Pose:
    return Pose(position=Vector3(x=x, y=y, z=z), orientation=Quaternion(w=1.0))


def _colour(rgba: tuple[float, float, float, float]) -> Color:
    r, g, b, a = rgba
    return Color(r=r, g=g, b=b, a=a)
