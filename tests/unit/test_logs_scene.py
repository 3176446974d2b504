"""The scene: what is put together from bytes says what the Foxglove schemas understand."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from logs.reader import LogReader
from logs.recorder import Recorder
from logs.scene import SceneEncoder

S = 1_000_000_000
# One name long enough to make its transform longer than one length byte can say.
ROBOTS = ["r00", "a-robot-with-the-longest-name-xx", "r2"]
POSES = np.array([[0.0, 0.0, 0.0], [1.5, -2.25, math.pi / 2], [3.0, 4.0, math.pi]])


def scene() -> SceneEncoder:
    return SceneEncoder(ROBOTS, (10.0, 20.0))


def test_transforms_place_every_robot_in_the_world() -> None:
    message = FrameTransforms.FromString(scene().transforms(3 * S + 7, POSES))
    assert [transform.child_frame_id for transform in message.transforms] == ROBOTS
    assert {transform.parent_frame_id for transform in message.transforms} == {"world"}
    assert {(t.timestamp.seconds, t.timestamp.nanos) for t in message.transforms} == {(3, 7)}
    found = [(t.translation.x, t.translation.y, t.translation.z) for t in message.transforms]
    assert found == [(0, 0, 0), (1.5, -2.25, 0), (3, 4, 0)]
    turned = [(t.rotation.x, t.rotation.y, t.rotation.z, t.rotation.w) for t in message.transforms]
    half = math.sqrt(0.5)
    assert np.allclose(turned, [(0, 0, 0, 1), (0, 0, half, half), (0, 0, 1, 0)], atol=1e-7)


def test_robots_with_altitudes_are_shown_at_them() -> None:
    heights = [0.0, 12.5, -3.0]
    encoder = SceneEncoder(ROBOTS, (10.0, 20.0), heights)
    flat = FrameTransforms.FromString(scene().transforms(S, POSES))
    high = FrameTransforms.FromString(encoder.transforms(S, POSES))
    assert [transform.translation.z for transform in high.transforms] == heights
    for one, other in zip(flat.transforms, high.transforms, strict=True):
        assert one.translation.z == 0.0
        other.translation.z = 0.0  # and nothing else is different
        assert one == other
    cloud = PointCloud.FromString(encoder.lights(S, POSES, np.array([0, 1, 2], dtype=np.uint8)))
    on_ground = PointCloud.FromString(scene().lights(S, POSES, np.array([0, 1, 2], dtype=np.uint8)))
    layout = [("xyz", "<f4", 3), ("rgba", "u1", 4)]
    above = [np.frombuffer(message.data, dtype=layout)["xyz"] for message in (cloud, on_ground)]
    assert np.allclose(above[0] - above[1], [[0, 0, height] for height in heights], atol=1e-5)
    links = np.zeros((3, 3), dtype=bool)
    links[0, 1] = True
    (entity,) = SceneUpdate.FromString(encoder.links(S, POSES, links)).entities
    points = [(point.x, point.y, point.z) for point in entity.lines[0].points]
    assert points == [(0, 0, 0.0), (1.5, -2.25, 12.5), (3, 4, -3.0)]


def test_altitudes_reach_the_log(tmp_path: Path) -> None:
    with Recorder(tmp_path / "a.mcap", ROBOTS, altitudes_m=[1.0, 2.0, 3.0]) as recorder:
        recorder.scene(0, POSES, np.zeros(3, dtype=np.uint8))
    with LogReader(tmp_path / "a.mcap") as log:
        ((_, _, _, data),) = log.raw({"/tf"})
    heights = [transform.translation.z for transform in FrameTransforms.FromString(data).transforms]
    assert heights == [1.0, 2.0, 3.0]


def test_transforms_notice_a_pose_written_in_place() -> None:
    encoder, poses = scene(), POSES.copy()
    first = encoder.transforms(0, poses)
    assert encoder.transforms(0, poses) == first
    poses[0, 0] = 8.0
    message = FrameTransforms.FromString(encoder.transforms(0, poses))
    assert message.transforms[0].translation.x == 8.0


def test_lights_are_coloured_points_above_the_robots() -> None:
    cloud = PointCloud.FromString(scene().lights(S, POSES, np.array([0, 1, 2], dtype=np.uint8)))
    assert (cloud.frame_id, cloud.timestamp.seconds, cloud.point_stride) == ("world", 1, 16)
    offsets = [(field.name, field.offset) for field in cloud.fields]
    assert offsets == [("x", 0), ("y", 4), ("z", 8), ("red", 12), ("green", 13), ("blue", 14), ("alpha", 15)]
    points = np.frombuffer(cloud.data, dtype=[("xyz", "<f4", 3), ("rgba", "u1", 4)])
    assert points["xyz"][:, :2].tolist() == POSES[:, :2].tolist()
    assert (points["xyz"][:, 2] > 0).all()
    assert len({tuple(colour) for colour in points["rgba"].tolist()}) == 3


def test_links_are_one_line_per_pair_in_either_direction() -> None:
    links = np.zeros((3, 3), dtype=bool)
    links[0, 1] = links[1, 0] = links[2, 0] = True
    update = SceneUpdate.FromString(scene().links(2 * S, POSES, links))
    (entity,) = update.entities
    assert (entity.id, entity.frame_id, entity.timestamp.seconds) == ("links", "world", 2)
    (line,) = entity.lines
    assert line.type == LinePrimitive.LINE_LIST
    assert (line.pose.orientation.w, line.color.a) == (1.0, 0.5)
    assert list(line.indices) == [0, 1, 0, 2]
    assert [(point.x, point.y, point.z) for point in line.points] == [(0, 0, 0), (1.5, -2.25, 0), (3, 4, 0)]


def test_no_links_replace_the_former_ones_by_nothing() -> None:
    update = SceneUpdate.FromString(scene().links(0, POSES, np.zeros((3, 3), dtype=bool)))
    assert [(entity.id, len(entity.lines)) for entity in update.entities] == [("links", 0)]


def test_bodies_and_labels_follow_the_robots_frames() -> None:
    encoder = scene()
    bodies = SceneUpdate.FromString(encoder.bodies(S))
    labels = SceneUpdate.FromString(encoder.labels(S))
    for update in (bodies, labels):
        assert [(entity.id, entity.frame_id) for entity in update.entities] == [(r, r) for r in ROBOTS]
        assert all(entity.frame_locked and entity.timestamp.seconds == 1 for entity in update.entities)
    assert all(len(entity.cylinders) == len(entity.arrows) == 1 for entity in bodies.entities)
    assert [entity.texts[0].text for entity in labels.entities] == ROBOTS


@pytest.mark.parametrize("robots", [1, 40])
def test_messages_of_any_team_parse(robots: int) -> None:
    encoder = SceneEncoder([f"r{i}" for i in range(robots)], (0.0, 0.0))
    poses = np.arange(3.0 * robots).reshape(robots, 3)
    update = SceneUpdate.FromString(encoder.links(0, poses, np.ones((robots, robots), dtype=bool)))
    pairs = [pair for entity in update.entities for line in entity.lines for pair in line.indices]
    assert len(pairs) == robots * (robots - 1)
    assert len(FrameTransforms.FromString(encoder.transforms(0, poses)).transforms) == robots


def test_a_recorded_scene_shows_deliveries_since_the_last_and_repeats_what_is_constant(
    tmp_path: Path,
) -> None:
    lamps = np.zeros(3, dtype=np.uint8)
    with Recorder(tmp_path / "a.mcap", ROBOTS) as recorder:
        reasons = np.array([[0, 5, 255]], np.uint8)
        recorder.radio_batch(0, [2], [1], [b"\xc0"], [8], [None], [0], reasons, [([0], [1])])
        for second in range(12):
            recorder.scene(second * S, POSES, lamps)
    with LogReader(tmp_path / "a.mcap") as log:
        links = [SceneUpdate.FromString(data) for _, _, _, data in log.raw({"/viz/links"})]
        assert [list(line.indices) for line in links[0].entities[0].lines] == [[0, 2]]
        assert [len(update.entities[0].lines) for update in links[1:]] == [0] * 11
        assert [time_ns for _, _, time_ns, _ in log.raw({"/viz/robots"})] == [0, 10 * S]
        assert [time_ns for _, _, time_ns, _ in log.raw({"/viz/labels"})] == [0, 10 * S]
        assert log.topics["/tf"].messages == log.topics["/viz/lights"].messages == 12


def test_notes_are_foxglove_log_lines(tmp_path: Path) -> None:
    with Recorder(tmp_path / "a.mcap", ROBOTS) as recorder:
        recorder.note(2 * S + 5, "error", "r2", "a wheel came off")
    with LogReader(tmp_path / "a.mcap") as log:
        _, (_, _, time_ns, data) = log.raw({"/log"})
    line = Log.FromString(data)
    assert time_ns == 2 * S + 5
    assert (line.timestamp.seconds, line.timestamp.nanos, line.level) == (2, 5, Log.ERROR)
    assert (line.name, line.message) == ("r2", "a wheel came off")
