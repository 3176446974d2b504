"""The visual channel: which lamps each robot's camera sees, and under which names.

A camera cannot read who it looks at. Every observer's tracker names what is in view by visual ids of its
own, drawn so that they tell nothing of robots, radio names or other observers' ids. A robot keeps its
visual id as long as it is in view at each of the observer's captures, whether or not the frame shows it
(`miss`); when it comes back after leaving, it is a stranger.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from channels.randomness import Draws, UInts, stable_keys
from channels.settings import CameraSettings

Bools: TypeAlias = NDArray[np.bool_]
Floats: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.intp]
Change: TypeAlias = tuple[int, int, int]
"""Observer index, visual id, target index."""

# Ranges and bearings are recorded in whole steps: `atan2`, `log` and `cos` may differ in their last bit
# between CPUs and libraries, and a log must not. (A square root may not: IEEE 754 rounds it correctly.)
_STEPS_PER_METRE = 1000
_STEPS_PER_RADIAN = 10_000
_HALF_TURN_STEPS = round(math.pi * _STEPS_PER_RADIAN)

_VISUAL_ID_BITS = 31


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
        self._trackers = _Trackers(self._keys, Draws(seed, "visual_id"))
        self._optics = _Optics(camera)
        self._errors = _Errors(camera, self._keys, seed) if _errs(camera) else None
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
        if self._errors is not None:
            return self._errors.spoil(frame, view, lamp, entered, left)
        return Capture(
            view.observers, view.offsets, view.visual, view.range_m, view.bearing_rad, lamp, entered, left
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
    order = np.argsort(_sort_keys(seen.rows, visual))
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


def _pairs(matrix: Bools) -> tuple[Indices, Indices]:
    """Rows and columns of what is true, row by row; `numpy.nonzero` is several times slower in 2-D."""
    flat = np.flatnonzero(matrix)
    rows = flat // matrix.shape[1]
    return rows, flat - rows * matrix.shape[1]


def _sort_keys(rows: Indices, visual: NDArray[np.int32]) -> NDArray[np.int64]:
    return rows.astype(np.int64) << _VISUAL_ID_BITS | visual


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
        rows, targets = _pairs(in_view)
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


class _Trackers:
    """Which visual id each observer has given to each robot in its view."""

    def __init__(self, keys: UInts, draws: Draws, id_bits: int = _VISUAL_ID_BITS) -> None:
        self._keys = keys
        self._draws = draws
        self._shift = 64 - id_bits
        self.ids = np.zeros((len(keys), len(keys)), dtype=np.int32)
        """(N, N) by observer and target; 0: not in view."""
        self._entries = np.zeros_like(self.ids)

    def update(self, observers: Indices, in_view: Bools) -> tuple[list[Change], list[Change]]:
        """Begin and end the tracks of these observers; tells which."""
        tracked = self.ids.take(observers, axis=0) != 0
        new_rows, new_targets = _pairs(in_view & ~tracked)
        gone_rows, gone_targets = _pairs(tracked & ~in_view)
        if len(new_rows):
            # Before the old ones end: an id that is free only now would be taken for its last owner.
            self._name(observers, observers[new_rows], new_targets)
        entered = self._changes(observers, new_rows, new_targets)
        left = self._changes(observers, gone_rows, gone_targets)
        self.ids[observers[gone_rows], gone_targets] = 0
        return entered, left

    def _changes(self, observers: Indices, rows: Indices, targets: Indices) -> list[Change]:
        visual = self.ids[observers[rows], targets]
        order = np.argsort(_sort_keys(rows, visual))
        columns = observers[rows[order]], visual[order], targets[order]
        return list(zip(*(column.tolist() for column in columns), strict=True))

    def _name(self, observers: Indices, who: Indices, whom: Indices) -> None:
        self._entries[who, whom] += 1
        self.ids[who, whom] = self._drawn(who, whom, 0)
        if self._clash(observers, who, whom):
            self.ids[who, whom] = 0
            for observer, target in zip(who.tolist(), whom.tolist(), strict=True):
                self._name_one(observer, target)

    def _drawn(self, who: Indices | int, whom: Indices | int, attempt: int) -> NDArray[np.int32]:
        entries = self._entries[who, whom] - 1
        bits = self._draws.bits(self._keys[who], self._keys[whom], entries, attempt)
        return np.asarray(bits >> np.uint64(self._shift)).astype(np.int32)

    def _clash(self, observers: Indices, who: Indices, whom: Indices) -> bool:
        if not self.ids[who, whom].all():
            return True
        rows, targets = _pairs(self.ids.take(observers, axis=0) != 0)
        keys = np.sort(_sort_keys(rows, self.ids[observers[rows], targets]))
        return bool((keys[1:] == keys[:-1]).any())

    def _name_one(self, observer: int, target: int) -> None:
        # 0 is no id, and stands in every row: nobody tracks itself.
        taken = set(self.ids[observer].tolist())
        attempt = 0
        while (visual := int(self._drawn(observer, target, attempt))) in taken:
            attempt += 1
        self.ids[observer, target] = visual


def _errs(camera: CameraSettings) -> bool:
    chances = camera.miss, camera.lamp_miss, camera.lamp_false
    return any(chances) or camera.range_noise_m > 0 or camera.bearing_noise_deg > 0


class _Errors:
    """What cameras get wrong, drawn anew for every observer, target and frame."""

    def __init__(self, camera: CameraSettings, keys: UInts, seed: int) -> None:
        self._camera = camera
        self._keys = keys
        self._bearing_noise_rad = math.radians(camera.bearing_noise_deg)
        self._draws = {
            stream: Draws(seed, stream)
            for stream in ("miss", "lamp_miss", "lamp_false", "range_noise", "bearing_noise")
        }

    def spoil(
        self,
        frame: int,
        view: _View,
        lamp: NDArray[np.uint8],
        entered: list[Change],
        left: list[Change],
    ) -> Capture:
        """The capture that imperfect cameras make of what is in view."""
        words = self._keys[view.observers[view.rows]], self._keys[view.targets], frame
        shown = ~self._happens("miss", self._camera.miss, *words)
        return Capture(
            observers=view.observers,
            offsets=_offsets(view.rows[shown], len(view.observers)),
            visual=view.visual[shown],
            range_m=self._range_m(view, *words)[shown],
            bearing_rad=self._bearing_rad(view, *words)[shown],
            lamp=self._lamp(lamp, *words)[shown],
            entered=entered,
            left=left,
        )

    def _happens(self, stream: str, probability: float, who: UInts, whom: UInts, frame: int) -> Bools:
        if probability == 0:
            return np.zeros(len(who), dtype=np.bool_)
        happens: Bools = self._draws[stream].uniform(who, whom, frame) < probability
        return happens

    def _lamp(self, lamp: NDArray[np.uint8], who: UInts, whom: UInts, frame: int) -> NDArray[np.uint8]:
        missed = self._happens("lamp_miss", self._camera.lamp_miss, who, whom, frame)
        imagined = (lamp == 0) & self._happens("lamp_false", self._camera.lamp_false, who, whom, frame)
        return np.where(imagined, np.uint8(1), np.where(missed, np.uint8(0), lamp))

    def _range_m(self, view: _View, who: UInts, whom: UInts, frame: int) -> NDArray[np.float32]:
        if self._camera.range_noise_m == 0:
            return view.range_m
        noise_m = self._camera.range_noise_m * self._draws["range_noise"].normal(who, whom, frame)
        return _quantised_range(np.maximum(view.exact_range_m + noise_m, 0.0))

    def _bearing_rad(self, view: _View, who: UInts, whom: UInts, frame: int) -> NDArray[np.float32]:
        if self._bearing_noise_rad == 0:
            return view.bearing_rad
        noise_rad = self._bearing_noise_rad * self._draws["bearing_noise"].normal(who, whom, frame)
        return _quantised_bearing(view.exact_bearing_rad + noise_rad)
