"""The visual channel on a scene small enough to judge by eye.

Robots a, b, c, d stand at (0, 0), (3, 0), (0, 4) and (-5, 0), all looking along x; cameras reach 5 m.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from channels.randomness import Draws, stable_key, stable_keys
from channels.settings import CameraSettings
from channels.trackers import Trackers
from channels.visual import Capture, VisualChannel

ROBOTS = ["a", "b", "c", "d"]
SCENE = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 4.0, 0.0], [-5.0, 0.0, 0.0]])
DARK = np.zeros(4, dtype=np.uint8)
EVERYONE = np.arange(4)


def channel(seed: int = 1, **settings: Any) -> VisualChannel:
    return VisualChannel(CameraSettings(**{"range_m": 5.0, **settings}), ROBOTS, seed)


def moved(robot: int, x: float, y: float, heading: float = 0.0, scene: Any = SCENE) -> Any:
    poses = scene.copy()
    poses[robot] = x, y, heading
    return poses


class Names:
    """Follows who is behind each visual id, as the log does."""

    def __init__(self) -> None:
        self.robot: dict[tuple[int, int], int] = {}

    def sightings(self, capture: Capture) -> dict[str, list[tuple[str, float, float, int]]]:
        """By observer: who, range, bearing and lamp, in robot order."""
        for observer, visual, target in capture.entered:
            assert (observer, visual) not in self.robot
            self.robot[observer, visual] = target
        for observer, visual, target in capture.left:
            assert self.robot.pop((observer, visual)) == target
        seen = {}
        for place, observer in enumerate(capture.observers.tolist()):
            frame = range(capture.offsets[place], capture.offsets[place + 1])
            seen[ROBOTS[observer]] = sorted(
                (
                    ROBOTS[self.robot[observer, int(capture.visual[k])]],
                    round(float(capture.range_m[k]), 6),
                    round(float(capture.bearing_rad[k]), 6),
                    int(capture.lamp[k]),
                )
                for k in frame
            )
        return seen


def test_everybody_in_range_is_seen_with_range_bearing_and_lamp() -> None:
    lamps = np.array([0, 1, 2, 0], dtype=np.uint8)
    capture = channel().capture(0, SCENE, lamps, EVERYONE)
    assert Names().sightings(capture) == {
        "a": [("b", 3.0, 0.0, 1), ("c", 4.0, 1.5708, 2), ("d", 5.0, 3.1415, 0)],
        "b": [("a", 3.0, 3.1415, 0), ("c", 5.0, 2.2143, 2)],
        "c": [("a", 4.0, -1.5708, 0), ("b", 5.0, -0.9273, 1)],
        "d": [("a", 5.0, 0.0, 0)],
    }
    assert capture.offsets.tolist() == [0, 3, 5, 7, 8]
    dtypes = [array.dtype for array in (capture.visual, capture.range_m, capture.bearing_rad, capture.lamp)]
    assert dtypes == [np.int32, np.float32, np.float32, np.uint8]


def test_beyond_range_nobody_is_seen() -> None:
    capture = channel().capture(0, moved(1, 5.001, 0), DARK, np.array([0]))
    assert [name for name, *_ in Names().sightings(capture)["a"]] == ["c", "d"]


@pytest.mark.parametrize(
    ("heading", "bearing"),
    [
        (0.0, 0.0),
        (1.0, -1.0),
        (-3.0, 3.0),
        (3.5, 2.7832),  # 2 pi - 3.5
        (7.0, -0.7168),  # 2 pi - 7
        (-100.0, -0.531),  # 100 - 32 pi
        (math.pi, 3.1415),  # straight behind is + half a turn, rounded down to stay within it
        (-math.pi, 3.1415),
        (3 * math.pi, 3.1415),
        (math.pi - 2e-5, 3.1415),
        (math.pi + 2e-5, 3.1415),
        (math.pi + 1e-4, 3.1415),
        (math.pi - 1e-4, -3.1415),
        (0.00006, -0.0001),
        (0.00004, 0.0),
    ],
)
def test_bearing_is_relative_to_heading(heading: float, bearing: float) -> None:
    capture = channel().capture(0, moved(0, 0, 0, heading), DARK, np.array([0]))
    assert Names().sightings(capture)["a"][0] == ("b", 3.0, bearing, 0)
    assert (abs(capture.bearing_rad.astype(np.float64)) < math.pi).all()
    assert not np.signbit(capture.bearing_rad[capture.bearing_rad == 0]).any()


def test_range_is_given_to_the_millimetre() -> None:
    for x, range_m in ((3.0004, 3.0), (3.0006, 3.001), (0.0, 0.0)):
        capture = channel().capture(0, moved(1, x, 0), DARK, np.array([0]))
        assert Names().sightings(capture)["a"][0][1] == range_m


@pytest.mark.parametrize(
    ("field_deg", "heading_deg", "in_view"),
    [
        (90, 45, ["b", "c"]),  # both edges of the field count
        (89.9, 45, []),
        (90, 0, ["b"]),
        (180, 0, ["b", "c"]),
        (180, 90, ["b", "c", "d"]),
        (180, 180, ["c", "d"]),
        (90, 180, ["d"]),
        (90, -180, ["d"]),
        (90, 540, ["d"]),
        (10, -90, []),
        (360, 77, ["b", "c", "d"]),
    ],
)
def test_field_of_view_lies_around_the_heading(
    field_deg: float, heading_deg: float, in_view: list[str]
) -> None:
    eyes = channel(field_of_view_deg=field_deg)
    capture = eyes.capture(0, moved(0, 0, 0, math.radians(heading_deg)), DARK, np.array([0]))
    assert [name for name, *_ in Names().sightings(capture)["a"]] == in_view


def test_tracks_begin_persist_and_end() -> None:
    eyes, a = channel(), np.array([0])
    far = moved(1, 30, 0)
    first = eyes.capture(0, SCENE, DARK, a)
    assert [target for _, _, target in first.entered] == sorted([1, 2, 3], key=lambda t: ids(first)[t])
    b_first = ids(first)[1]

    nearer = eyes.capture(1, moved(1, 2, 0), DARK, a)
    assert (nearer.entered, nearer.left) == ([], [])
    assert nearer.visual.tolist() == first.visual.tolist()

    gone = eyes.capture(2, far, DARK, a)
    assert (gone.entered, gone.left) == ([], [(0, b_first, 1)])
    assert b_first not in gone.visual.tolist()

    back = eyes.capture(3, SCENE.copy(), DARK, a)
    assert [(observer, target) for observer, _, target in back.entered] == [(0, 1)]
    assert back.left == []
    assert ids(back)[1] != b_first


def test_visual_ids_are_drawn_for_observer_target_and_entry() -> None:
    draws, eyes, a = Draws(1, "visual_id"), channel(), np.array([0])
    for entry in range(3):
        capture = eyes.capture(0, moved(1, 3, 0), DARK, a)
        assert ids(capture)[1] == int(draws.bits(stable_key("a"), stable_key("b"), entry, 0)) >> 33
        eyes.capture(1, moved(1, 30, 0), DARK, a)


def test_sightings_and_changes_are_ordered_by_visual_id() -> None:
    eyes = channel()
    capture = eyes.capture(0, SCENE, DARK, EVERYONE)
    for start, end in zip(capture.offsets[:-1], capture.offsets[1:], strict=True):
        visual = capture.visual[start:end].tolist()
        assert visual == sorted(visual)
        assert all(number > 0 for number in visual)
    assert capture.entered == sorted(capture.entered)
    assert [visual for _, visual, _ in capture.entered] == capture.visual.tolist()
    apart = SCENE * 100
    left = eyes.capture(1, apart, DARK, EVERYONE).left
    assert left == capture.entered


def test_other_observers_trackers_stay_untouched() -> None:
    eyes = channel()
    before = eyes.capture(0, SCENE, DARK, EVERYONE)
    away = moved(1, 30, 0)
    only_a = eyes.capture(1, away, DARK, np.array([0]))
    assert [(observer, target) for observer, _, target in only_a.left] == [(0, 1)]
    # b was away while c did not look: for c it never left, for a it is new.
    again = eyes.capture(2, SCENE.copy(), DARK, np.array([0, 2]))
    assert [(observer, target) for observer, _, target in again.entered] == [(0, 1)]
    assert again.left == []
    assert frame(again, 1) == frame(before, 2)


def test_cameras_that_take_turns_see_what_they_would_see_together() -> None:
    together, turns = channel(), channel()
    at_once = together.capture(0, SCENE, DARK, EVERYONE)
    for _ in range(2):
        for first, second in ((0, 2), (1, 3)):
            lamps = np.array([0, 3, 0, 4], dtype=np.uint8)
            pair = turns.capture(0, SCENE, lamps, np.array([first, second]))
            assert pair.observers.tolist() == [first, second]
            assert frame(pair, 0) == frame(at_once, first)
            assert frame(pair, 1) == frame(at_once, second)


def test_a_standing_scene_is_seen_anew_only_by_its_lamps() -> None:
    eyes = channel()
    first = eyes.capture(0, SCENE, DARK, EVERYONE)
    lit = eyes.capture(1, SCENE, np.full(4, 7, dtype=np.uint8), EVERYONE)
    assert first.lamp.tolist() == [0] * 8
    assert lit.lamp.tolist() == [7] * 8
    assert lit.visual.tolist() == first.visual.tolist()
    assert (lit.entered, lit.left) == ([], [])


def test_nobody_looks_and_nobody_is_there() -> None:
    nobody = channel().capture(0, SCENE, DARK, np.array([], dtype=np.int64))
    assert nobody.offsets.tolist() == [0]
    assert len(nobody.visual) == 0
    alone = VisualChannel(CameraSettings(range_m=1.0), ["a"], 1).capture(
        0, SCENE[:1], DARK[:1], np.array([0])
    )
    assert alone.offsets.tolist() == [0, 0]


def test_a_miss_hides_a_robot_and_keeps_its_track() -> None:
    eyes, draws = channel(miss=0.5, seed=9), Draws(9, "miss")
    known: dict[tuple[int, int], int] = {}
    hidden = 0
    for number in range(40):
        capture = eyes.capture(number, SCENE, DARK, EVERYONE)
        known.update({(observer, target): visual for observer, visual, target in capture.entered})
        assert capture.left == []
        for (observer, target), visual in known.items():
            keys = stable_key(ROBOTS[observer]), stable_key(ROBOTS[target])
            missed = draws.uniform(*keys, number) < 0.5
            hidden += int(missed)
            assert (visual in frame(capture, observer)["visual"]) != missed
    assert len(known) == 8
    assert 0 < hidden < 320


def test_lamps_are_missed_and_imagined() -> None:
    lamps = np.array([0, 5, 0, 5], dtype=np.uint8)
    blind = channel(lamp_miss=1.0).capture(0, SCENE, lamps, EVERYONE)
    assert blind.lamp.tolist() == [0] * 8
    dreamer = channel(lamp_false=1.0).capture(0, SCENE, lamps, np.array([0]))
    assert Names().sightings(dreamer)["a"] == [
        ("b", 3.0, 0.0, 5),
        ("c", 4.0, 1.5708, 1),
        ("d", 5.0, 3.1415, 5),
    ]
    inverted = channel(lamp_miss=1.0, lamp_false=1.0).capture(0, SCENE, lamps, np.array([0]))
    assert [lamp for *_, lamp in Names().sightings(inverted)["a"]] == [0, 1, 0]
    assert lamps.tolist() == [0, 5, 0, 5]


def test_noise_is_drawn_for_observer_target_and_frame() -> None:
    eyes = channel(range_noise_m=0.5, bearing_noise_deg=10.0, seed=3)
    names = Names()
    words = stable_key("a"), stable_key("b")
    for number in range(20):
        _, range_m, bearing_rad, _ = names.sightings(eyes.capture(number, SCENE, DARK, np.array([0])))["a"][0]
        range_error_m = 0.5 * float(Draws(3, "range_noise").normal(*words, number))
        bearing_error_rad = math.radians(10.0) * float(Draws(3, "bearing_noise").normal(*words, number))
        assert abs(range_m - (3.0 + range_error_m)) < 0.0006
        assert abs(bearing_rad - bearing_error_rad) < 0.00006


def test_each_kind_of_noise_comes_alone() -> None:
    exact = channel().capture(0, SCENE, DARK, EVERYONE)
    far = channel(range_noise_m=1.0).capture(0, SCENE, DARK, EVERYONE)
    turned = channel(bearing_noise_deg=10.0).capture(0, SCENE, DARK, EVERYONE)
    assert (far.range_m != exact.range_m).all()
    assert far.bearing_rad.tolist() == exact.bearing_rad.tolist()
    assert (turned.bearing_rad != exact.bearing_rad).all()
    assert turned.range_m.tolist() == exact.range_m.tolist()


def test_noisy_range_is_never_negative_and_noisy_bearing_never_beyond_half_a_turn() -> None:
    eyes = channel(range_noise_m=10.0, bearing_noise_deg=180.0)
    captures = [eyes.capture(number, SCENE, DARK, EVERYONE) for number in range(50)]
    ranges = np.concatenate([capture.range_m for capture in captures])
    bearings = np.concatenate([capture.bearing_rad for capture in captures]).astype(np.float64)
    assert ranges.min() == 0
    assert ranges.max() > 5
    assert -math.pi < bearings.min() < -3
    assert 3 < bearings.max() <= math.pi


def test_noise_does_not_change_who_is_in_view() -> None:
    eyes = channel(range_noise_m=10.0, bearing_noise_deg=180.0, field_of_view_deg=90.0)
    for number in range(20):
        assert len(eyes.capture(number, SCENE, DARK, np.array([0])).visual) == 1


def test_visual_ids_that_collide_are_drawn_again() -> None:
    # With ids of 3 bits, 1 .. 7, six neighbours collide all the time.
    keys = stable_keys([f"r{index}" for index in range(7)])
    observers, strangers = np.arange(7), ~np.eye(7, dtype=bool)
    collisions = 0
    for seed in range(20):
        draws = Draws(seed, "visual_id")
        trackers = Trackers(keys, draws, id_bits=3)
        entered, _ = trackers.update(observers, strangers)
        for observer in range(7):
            named = trackers.ids[observer][strangers[observer]].tolist()
            assert sorted({*named}) == sorted(named)
            assert set(named) <= set(range(1, 8))
            first = (draws.bits(keys[observer], keys, 0, 0) >> np.uint64(61))[strangers[observer]].tolist()
            collisions += first != named
        assert len(entered) == 42
    assert collisions > 20


def test_a_new_track_does_not_take_the_id_of_one_that_ends() -> None:
    keys = stable_keys(["a", "b", "c"])
    sees_b, sees_c = np.array([[False, True, False]]), np.array([[False, False, True]])
    for seed in range(30):
        trackers = Trackers(keys, Draws(seed, "visual_id"), id_bits=2)
        for in_view in (sees_b, sees_c, sees_b):
            entered, left = trackers.update(np.array([0]), in_view)
            assert len(entered) == 1
            assert entered[0][1] > 0
            assert not left or left[0][1] != entered[0][1]


def ids(capture: Capture) -> dict[int, int]:
    """Visual id by target, of tracks that began in this capture."""
    return {target: visual for _, visual, target in capture.entered}


def frame(capture: Capture, place: int) -> dict[str, list[float]]:
    """One observer's columns, without the lamps."""
    part = slice(int(capture.offsets[place]), int(capture.offsets[place + 1]))
    return {name: getattr(capture, name)[part].tolist() for name in ("visual", "range_m", "bearing_rad")}
