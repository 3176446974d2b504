"""Cameras and trackers: what must hold for every scene, and what visual ids must not tell."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from channels.settings import CameraSettings
from channels.visual import Capture, VisualChannel

PLACE = st.tuples(st.integers(-6, 6), st.integers(-6, 6), st.integers(-8, 8))
Steps = list[tuple[list[tuple[int, int, int]], list[int]]]


@st.composite
def walks(draw: st.DrawFn) -> tuple[int, Steps]:
    """A team, and for a few instants everybody's pose and who looks."""
    number = draw(st.integers(1, 5))
    poses = st.lists(PLACE, min_size=number, max_size=number)
    observers = st.lists(st.integers(0, number - 1), unique=True).map(sorted)
    return number, draw(st.lists(st.tuples(poses, observers), min_size=1, max_size=6))


def run(number: int, steps: Steps, **settings: Any) -> list[Capture]:
    camera = CameraSettings(range_m=5.0, **settings)
    eyes = VisualChannel(camera, [f"r{index}" for index in range(number)], seed=11)
    lamps = np.arange(number, dtype=np.uint8)
    return [
        eyes.capture(frame, np.array(poses, dtype=np.float64), lamps, np.array(observers, dtype=np.int64))
        for frame, (poses, observers) in enumerate(steps)
    ]


def in_view(poses: list[tuple[int, int, int]], observer: int, field_deg: float) -> set[int]:
    """Who a camera has in view, robot by robot; no pose of `PLACE` lies on the edge of the field."""
    x, y, heading = poses[observer]
    seen = set()
    for target, (other_x, other_y, _) in enumerate(poses):
        bearing = math.remainder(math.atan2(other_y - y, other_x - x) - heading, 2 * math.pi)
        near = (other_x - x) ** 2 + (other_y - y) ** 2 <= 25
        if target != observer and near and abs(bearing) <= math.radians(field_deg) / 2:
            seen.add(target)
    return seen


@given(walks(), st.sampled_from([360.0, 123.4]), st.sampled_from([0.0, 0.5]))
def test_tracks_are_exactly_what_is_in_view(walk: tuple[int, Steps], field_deg: float, miss: float) -> None:
    number, steps = walk
    tracks: dict[int, dict[int, int]] = {observer: {} for observer in range(number)}
    captures = run(number, steps, field_of_view_deg=field_deg, miss=miss)
    for (poses, observers), capture in zip(steps, captures, strict=True):
        for observer, visual, target in capture.left:
            assert tracks[observer].pop(target) == visual
        for observer, visual, target in capture.entered:
            assert target not in tracks[observer]
            assert visual not in tracks[observer].values()
            tracks[observer][target] = visual
        for place, observer in enumerate(observers):
            assert set(tracks[observer]) == in_view(poses, observer, field_deg)
            start, end = capture.offsets[place : place + 2]
            shown = capture.visual[start:end].tolist()
            expected = sorted(tracks[observer].values())
            assert shown == (expected if miss == 0 else [visual for visual in expected if visual in shown])
            robot = {visual: target for target, visual in tracks[observer].items()}
            assert capture.lamp[start:end].tolist() == [robot[visual] for visual in shown]


@given(walks())
def test_a_scene_looks_the_same_whether_or_not_its_array_is_known(walk: tuple[int, Steps]) -> None:
    number, steps = walk
    robots = [f"r{index}" for index in range(number)]
    lamps = np.ones(number, dtype=np.uint8)
    caching, fresh = (VisualChannel(CameraSettings(range_m=5.0), robots, 11) for _ in range(2))
    for poses, observers in steps:
        scene = np.array(poses, dtype=np.float64)
        for frame in range(2):
            known = caching.capture(frame, scene, lamps, np.array(observers, dtype=np.int64))
            anew = fresh.capture(frame, scene.copy(), lamps, np.array(observers, dtype=np.int64))
            for field in ("observers", "offsets", "visual", "range_m", "bearing_rad", "lamp"):
                assert np.array_equal(getattr(known, field), getattr(anew, field)), field
            assert (known.entered, known.left) == (anew.entered, anew.left)


@given(walks())
def test_two_that_look_all_round_see_each_other_at_one_range(walk: tuple[int, Steps]) -> None:
    number, steps = walk
    everyone = list(range(number))
    capture = run(number, [(steps[0][0], everyone)])[0]
    robot = {(observer, visual): target for observer, visual, target in capture.entered}
    ranges = {}
    for observer in everyone:
        for k in range(capture.offsets[observer], capture.offsets[observer + 1]):
            ranges[observer, robot[observer, int(capture.visual[k])]] = float(capture.range_m[k])
    assert all(ranges[target, observer] == range_m for (observer, target), range_m in ranges.items())


def crowd(number: int, seed: int) -> NDArray[np.int64]:
    """(number, number) visual ids by observer and target where everybody sees everybody; 0: itself."""
    eyes = VisualChannel(CameraSettings(range_m=1.0), [f"r{index:02}" for index in range(number)], seed)
    scene, lamps = np.zeros((number, 3)), np.zeros(number, dtype=np.uint8)
    ids = np.zeros((number, number), dtype=np.int64)
    for observer, visual, target in eyes.capture(0, scene, lamps, np.arange(number)).entered:
        ids[observer, target] = visual
    return ids


def ranks(values: NDArray[np.int64]) -> NDArray[np.int64]:
    return values.argsort().argsort()


def test_visual_ids_tell_nothing_of_robot_order() -> None:
    number, seeds = 30, 20
    correlations = []
    for seed in range(seeds):
        for observer, row in enumerate(crowd(number, seed)):
            others = np.delete(row, observer)
            correlations.append(np.corrcoef(ranks(others), np.arange(number - 1))[0, 1])
    # Spearman's coefficient of n unrelated pairs has the variance 1 / (n - 1).
    sigma = 1 / math.sqrt((number - 2) * len(correlations))
    assert abs(np.mean(correlations)) < 5 * sigma
    assert abs(np.var(correlations) * (number - 2) - 1) < 5 * math.sqrt(2 / len(correlations))


def test_visual_ids_of_one_observer_tell_nothing_of_anothers() -> None:
    number, seeds = 30, 20
    correlations = []
    for seed in range(seeds):
        ids = crowd(number, seed)
        for observer in range(0, number, 2):
            both = np.delete(ids[[observer, observer + 1]], [observer, observer + 1], axis=1)
            correlations.append(np.corrcoef(ranks(both[0]), ranks(both[1]))[0, 1])
    assert abs(np.mean(correlations)) < 5 / math.sqrt((number - 3) * len(correlations))


def test_visual_ids_are_unique_and_use_31_bits() -> None:
    ids = crowd(100, seed=4711)
    for observer, row in enumerate(ids):
        others = np.delete(row, observer)
        assert len(set(others.tolist())) == 99
        assert others.min() > 0
    used = ids[ids > 0]
    assert used.max() < 2**31
    assert abs(used.mean() / 2**31 - 0.5) < 5 / math.sqrt(12 * used.size)
    assert abs((used % 2).mean() - 0.5) < 5 * 0.5 / math.sqrt(used.size)


def test_misses_and_lamp_errors_have_their_frequencies() -> None:
    number, frames = 30, 100
    camera = CameraSettings(range_m=1.0, miss=0.2, lamp_miss=0.1, lamp_false=0.3)
    eyes = VisualChannel(camera, [f"r{index}" for index in range(number)], seed=4711)
    scene, half_lit = np.zeros((number, 3)), (np.arange(number) % 2 * 2).astype(np.uint8)
    captures = [eyes.capture(frame, scene, half_lit, np.arange(number)) for frame in range(frames)]
    robot = {(observer, visual): target for observer, visual, target in captures[0].entered}
    lit = [0, 0, 0, 0]  # dark as dark, dark as lit, lit as dark, lit as lit
    for capture in captures:
        observers = np.repeat(capture.observers, np.diff(capture.offsets)).tolist()
        for observer, visual, lamp in zip(
            observers, capture.visual.tolist(), capture.lamp.tolist(), strict=True
        ):
            lit[robot[observer, visual] % 2 * 2 + (lamp > 0)] += 1
    pairs = number * (number - 1) * frames
    for count, total, chance in (
        (sum(lit), pairs, 0.8),
        (lit[1], sum(lit[:2]), 0.3),
        (lit[2], sum(lit[2:]), 0.1),
    ):
        assert abs(count / total - chance) < 5 * math.sqrt(chance * (1 - chance) / total)
