"""The visual channel: which lamps each robot's camera sees, and under which names.

A camera cannot read who it looks at. Every observer's tracker names what is in view by visual ids of its
own, drawn so that they tell nothing of robots, radio names or other observers' ids. A robot keeps its
visual id as long as it is in view at each of the observer's captures, whether or not the frame shows it
(`miss`); when it comes back after leaving, it is a stranger.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from channels.camera_errors import CameraErrors
from channels.fates import Bools, Floats
from channels.randomness import Draws, stable_keys
from channels.settings import CameraSettings
from channels.trackers import Change, Indices, Trackers, pairs, sort_keys

# Ranges and bearings are recorded in whole steps: `atan2`, `log` and `cos` may differ in their last bit
# between CPUs and libraries, and a log must not. (A square root may not: IEEE 754 rounds it correctly.)
_STEPS_PER_METRE = 1000
_STEPS_PER_RADIAN = 10_000
_HALF_TURN_STEPS = round(math.pi * _STEPS_PER_RADIAN)


class Capture(Struct, frozen=True, gc=False):
    """The frames several cameras took at one instant, one after the other in flat arrays.

    Sightings k of the frame of `observers[i]` are those with offsets[i] <= k < offsets[i + 1], ordered by
    visual id. Arrays may be shared between captures: read only.
    """

    observers: Indices
    """(M,) robot indices."""
    offsets: Indices
    """(M + 1,)"""
    visual: NDArray[np.int32]
    """Positive, unique within a frame."""
    range_m: NDArray[np.float32]
    """In steps of 1 mm."""
    bearing_rad: NDArray[np.float32]
    """Relative to the observer's heading, anticlockwise, in (-pi, pi], in steps of 1e-4 rad."""
    lamp: NDArray[np.uint8]
    """Colour that was seen, 0: dark."""
    entered: list[Change]
    """Tracks that began, in order of (observer's place in `observers`, visual id)."""
    left: list[Change]
    """Tracks that ended, in the same order."""


class VisualChannel:
    """Cameras and their trackers, one per robot. Robots are indexed in the order of `robots`."""

    def __init__(self, camera: CameraSettings, robots: Sequence[str], seed: int) -> None:
        self._keys = stable_keys(robots)
        self._trackers = Trackers(self._keys, Draws(seed, "visual_id"))
        self._optics = _Optics(camera)
        self._errors = CameraErrors(camera, seed)
        self._poses: Floats | None = None
        self._views: dict[bytes, _View] = {}

    def capture(
        self, frame: int, poses: Floats, lamps: NDArray[np.uint8], observers: NDArray[np.integer[Any]]
    ) -> Capture:
        """What the cameras of `observers` see now.

        `frame` is the number all per-frame chance depends on; `poses` (N, 3): x, y [m], heading [rad];
        `lamps` (N,) colours; `observers` (M,) distinct robot indices, usually ascending. Trackers of other
        robots stay as they are. `poses` must not be written to afterwards: what follows from it is
        kept as long as the same array object comes back.
        """
        view, entered, left = self._look(poses, np.asarray(observers, dtype=np.intp))
        lamp = lamps[view.targets]
        if self._errors.possible:
            return self._spoiled(frame, view, lamp, entered, left)
        return Capture(
            view.observers, view.offsets, view.visual, view.range_m, view.bearing_rad, lamp, entered, left
        )

    def _spoiled(
        self, frame: int, view: _View, lamp: NDArray[np.uint8], entered: list[Change], left: list[Change]
    ) -> Capture:
        """The capture that imperfect cameras make of what is in view."""
        errors = self._errors
        words = self._keys[view.observers[view.rows]], self._keys[view.targets], frame
        shown = errors.shown(*words)
        return Capture(
            observers=view.observers,
            offsets=_offsets(view.rows[shown], len(view.observers)),
            visual=view.visual[shown],
            range_m=_quantised_range(errors.range_m(view.exact_range_m, *words)[shown]),
            bearing_rad=_quantised_bearing(errors.bearing_rad(view.exact_bearing_rad, *words)[shown]),
            lamp=errors.lamp(lamp, *words)[shown],
            entered=entered,
            left=left,
        )

    def _look(self, poses: Floats, observers: Indices) -> tuple[_View, list[Change], list[Change]]:
        if poses is not self._poses:
            self._poses = poses
            self._views = {}
        which = observers.tobytes()
        known = self._views.get(which)
        if known is not None:
            return known, [], []
        seen = self._optics.seen(poses, observers)
        entered, left = self._trackers.update(observers, seen.in_view)
        view = self._views[which] = _ordered(seen, observers, self._trackers.ids)
        return view, entered, left


class _Seen(Struct, frozen=True, gc=False):
    """Pairs in view, by (row, target); `rows` count within the observers of the capture."""

    in_view: Bools  # (M, N)
    rows: Indices
    targets: Indices
    range_m: Floats
    bearing_rad: Floats


class _View(Struct, frozen=True, gc=False):
    """Pairs in view, in the order of sightings: exact geometry, and what a perfect camera reports."""

    observers: Indices
    offsets: Indices
    rows: Indices
    targets: Indices
    visual: NDArray[np.int32]
    exact_range_m: Floats
    exact_bearing_rad: Floats
    range_m: NDArray[np.float32]
    bearing_rad: NDArray[np.float32]


def _ordered(seen: _Seen, observers: Indices, ids: NDArray[np.int32]) -> _View:
    visual = ids[observers[seen.rows], seen.targets]
    order = np.argsort(sort_keys(seen.rows, visual))
    range_m, bearing_rad = seen.range_m[order], seen.bearing_rad[order]
    return _View(
        observers=observers.copy(),
        offsets=_offsets(seen.rows, len(observers)),
        rows=seen.rows[order],
        targets=seen.targets[order],
        visual=visual[order],
        exact_range_m=range_m,
        exact_bearing_rad=bearing_rad,
        range_m=_quantised_range(range_m),
        bearing_rad=_quantised_bearing(bearing_rad),
    )


def _offsets(rows: Indices, frames: int) -> Indices:
    offsets = np.zeros(frames + 1, dtype=np.intp)
    np.cumsum(np.bincount(rows, minlength=frames), out=offsets[1:])
    return offsets


def _quantised_range(range_m: Floats) -> NDArray[np.float32]:
    return (np.rint(range_m * _STEPS_PER_METRE) / _STEPS_PER_METRE).astype(np.float32)


def _quantised_bearing(bearing_rad: Floats) -> NDArray[np.float32]:
    # Half a turn lies between two steps: the one below keeps the bearing within (-pi, pi].
    steps = np.minimum(_bearing_steps(bearing_rad), _HALF_TURN_STEPS - 1)
    return (steps / _STEPS_PER_RADIAN).astype(np.float32)


def _bearing_steps(bearing_rad: Floats) -> NDArray[np.int64]:
    """Any angle as the nearest step of one turn; straight behind is + half a turn, from both sides."""
    turn = 2.0 * math.pi
    wrapped = bearing_rad - turn * np.ceil((bearing_rad - math.pi) / turn)
    steps = np.rint(wrapped * _STEPS_PER_RADIAN).astype(np.int64)
    steps[steps <= -_HALF_TURN_STEPS] = _HALF_TURN_STEPS
    return steps


class _Optics:
    """Range and field of view: a disc or a sector around each camera, its edges included."""

    def __init__(self, camera: CameraSettings) -> None:
        self._range_squared = camera.range_m * camera.range_m
        half_field_rad = math.radians(camera.field_of_view_deg) / 2.0
        self._half_field_steps = round(half_field_rad * _STEPS_PER_RADIAN)
        self._all_round = camera.field_of_view_deg >= 360.0

    def seen(self, poses: Floats, observers: Indices) -> _Seen:
        """Pairs in view from `poses` (N, 3) for the cameras of `observers` (M,)."""
        in_view = self._within_range(poses, observers)
        rows, targets = pairs(in_view)
        x, y, heading = poses[observers.take(rows)].T
        offset_x, offset_y = poses[targets, 0] - x, poses[targets, 1] - y
        bearing_rad = np.arctan2(offset_y, offset_x) - heading
        range_m = np.sqrt(offset_x * offset_x + offset_y * offset_y)
        if not self._all_round:
            # Judged in steps, so that a robot placed exactly on the edge is seen on every CPU.
            inside = np.abs(_bearing_steps(bearing_rad)) <= self._half_field_steps
            in_view[rows[~inside], targets[~inside]] = False
            rows, targets = rows[inside], targets[inside]
            range_m, bearing_rad = range_m[inside], bearing_rad[inside]
        return _Seen(in_view, rows, targets, range_m, bearing_rad)

    def _within_range(self, poses: Floats, observers: Indices) -> Bools:
        squared = poses[observers, 0, None] - poses[:, 0]
        squared *= squared
        squared_y = poses[observers, 1, None] - poses[:, 1]
        squared_y *= squared_y
        squared += squared_y
        within: Bools = squared <= self._range_squared
        within[np.arange(len(observers)), observers] = False
        return within
