"""The engine: keeps virtual time, grants it to robots, and applies what they report.

A conservative parallel discrete-event simulation. The engine takes the earliest instant at which
anything happens, applies it, sends every robot that is due one grant, and waits until each has run
until idle. Every medium takes more than no time, so nothing a robot does at t reaches another
robot at t, and no order among the robots of one instant matters to them.

Within one instant the order is fixed: transmissions that end now (in the order they began), camera
exposures, the scene for viewers, then the robots, whose reports are handled in robot order; last the
transmissions of theirs that take no time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import orjson
from msgspec import Raw
from numpy.typing import NDArray

from channels.clocks import LocalClock
from channels.messages import (
    AWAITS_CAMERA,
    AWAITS_RADIO,
    LogEntry,
    MotionCommand,
    RawGrant,
    Report,
    encode,
)
from channels.units import to_ns
from emulator.agenda import Agenda, Event
from emulator.airwaves import Ending
from emulator.fleet import RobotFailure
from emulator.interrupts import check, held
from emulator.mail import Mail
from emulator.parts import Parts, Progress

Poses = NDArray[np.float64]


class Engine:
    """Runs one scenario to its end."""

    def __init__(self, parts: Parts, before_instant: Callable[[int], None] = lambda _now: None) -> None:
        """`before_instant(now_ns)` is called ahead of every instant: pacing and progress live there."""
        count = len(parts.robots)
        self.progress = Progress()
        self._parts = parts
        self._before_instant = before_instant
        self._agenda = Agenda(count)
        self._awaits = [0] * count
        self._numbers = [0] * count
        self._running = set(range(count))
        self._fulfilled: set[int] = set()
        self._messages = Mail(count)
        self._frames = Mail(count)
        self._poses_sent: list[Poses | None] = [None] * count
        self._later: list[tuple[Callable[..., None], tuple[Any, ...]]] = []
        self._scenes = 0

    def run(self) -> Progress:
        """Run to the end. Raises RobotFailure; whatever happens, all that was applied is recorded."""
        try:
            self._begin()
            self._loop()
        finally:
            self._write_backlog()
        self._count()
        return self.progress

    # --- time ------------------------------------------------------------------------------------

    def _begin(self) -> None:
        for robot in range(len(self._parts.robots)):
            self._agenda.wake(robot, 0)
        if self._parts.eyes is not None:
            self._agenda.add(self._parts.eyes.exposure_ns(0), Event.EXPOSURE)
        self._agenda.add(0, Event.SCENE)

    def _loop(self) -> None:
        duration = self._parts.duration_ns
        while self._running:
            now = self._agenda.next_instant()
            if now is None or now > duration:
                self.progress.now_ns = duration
                self._before_instant(duration)
                return
            self._before_instant(now)
            check()
            self.progress.now_ns = now
            self._instant(now)
            if self._is_over():
                return
        self.progress.ended_by = "all robots ended"

    def _is_over(self) -> bool:
        stop = self._parts.stop
        if stop is None:
            return False
        needed = self._running if stop.running_only else range(len(self._parts.robots))
        if not needed or not self._fulfilled.issuperset(needed):
            return False
        self.progress.ended_by = "stop rule"
        return True

    def _instant(self, now: int) -> None:
        tickets, exposing, scene, due = self._agenda.take(now)
        for ticket in tickets:
            self._parts.airwaves.proceed(now, ticket, self._schedule_transmission)
        if tickets:
            self._transmit(now)
        if exposing:
            self._expose(now)
        if scene:
            self._draw_scene(now)
        if due:
            self._activate(now, due)

    def _schedule_transmission(self, at_ns: int, ticket: int) -> None:
        self._agenda.add(at_ns, Event.TRANSMISSION, ticket)

    # --- robots ----------------------------------------------------------------------------------

    def _activate(self, now: int, due: list[int]) -> None:
        poses = self._parts.world.poses(now)
        grants = ((robot, self._grant(robot, now, poses)) for robot in due)
        reports = self._parts.fleet.exchange(grants, self._write_backlog)
        try:
            for robot, report in zip(due, reports, strict=True):
                self._apply(robot, now, report)
        finally:
            self._record_refused(now)
        self.progress.activations += len(due)
        self._transmit(now)

    def _grant(self, robot: int, now: int, poses: Poses) -> bytes:
        self._numbers[robot] += 1
        pose = None
        if self._poses_sent[robot] is not poses:  # the world hands out the same array while all stands
            self._poses_sent[robot] = poses
            pose = tuple(poses[robot].tolist())
        clocks = self._parts.clocks
        return encode(
            RawGrant(
                self._numbers[robot],
                now if clocks is None else clocks[robot].local(now),
                self._messages.take(robot, now),
                self._frames.take(robot, now),
                pose,
            )
        )

    def _apply(self, robot: int, now: int, report: Report) -> None:
        clock = None if self._parts.clocks is None else self._parts.clocks[robot]
        for transmission in report.transmissions:
            self._check_payload(robot, len(transmission.payload))
            start = transmission.start_ns if clock is None else clock.true(transmission.start_ns)
            self._parts.airwaves.submit(
                robot, start, transmission.payload, transmission.refused, now, self._schedule_transmission
            )
        for command in report.lamp:
            self._check_colour(robot, command.colour)
            at = command.at_ns if clock is None else clock.true(command.at_ns)
            self._parts.lamps.command(robot, now, at, command.colour)
        for motion in report.motion:
            self._move(robot, now, motion)
        for entry in report.entries:
            self._take_entry(robot, now, entry)
        self._awaits[robot] = report.awaits
        if report.ended is not None:
            self._end(robot, now, report.ended, report.mistaken)
        else:
            self._arrange_wake(robot, now, report, clock)

    def _check_payload(self, robot: int, size: int) -> None:
        """The robot's own radio refuses this already; one that goes round it gets no further."""
        limit = self._parts.max_payload_bytes
        if size > limit:
            raise RobotFailure(
                self._parts.robots[robot],
                f"sent a payload of {size} bytes, past radio.max_payload_bytes = {limit}",
            )

    def _check_colour(self, robot: int, colour: int) -> None:
        """As with payloads."""
        if colour > self._parts.colours:
            raise RobotFailure(
                self._parts.robots[robot],
                f"showed colour {colour}, past lamp.colours = {self._parts.colours}",
            )

    def _arrange_wake(self, robot: int, now: int, report: Report, clock: LocalClock | None) -> None:
        if report.wake_ns is not None:
            at = report.wake_ns if clock is None else clock.true(report.wake_ns)
            self._agenda.wake(robot, max(at, now + 1))
        if report.awaits & AWAITS_RADIO:
            self._wake_at_arrival(robot, self._messages.next_arrival(robot))
        if report.awaits & AWAITS_CAMERA:
            self._wake_at_arrival(robot, self._frames.next_arrival(robot))

    def _wake_at_arrival(self, robot: int, arrival_ns: int | None) -> None:
        if arrival_ns is not None:
            self._agenda.wake(robot, arrival_ns)

    def _move(self, robot: int, now: int, command: MotionCommand) -> None:
        name = self._parts.robots[robot]
        try:
            self._parts.world.command(robot, now, command)
        except ValueError as error:
            raise RobotFailure(name, f"gave a motion command that cannot be followed: {error}") from None
        record = {
            "kind": "motion",
            "robot": name,
            "velocity_mps": command.velocity_mps,
            "towards_m": command.towards_m,
            "speed_mps": command.speed_mps,
        }
        self._record(self._parts.recorder.truth, now, record)

    def _take_entry(self, robot: int, now: int, entry: LogEntry) -> None:
        data = self._entry_data(robot, entry.text)
        self._record(self._parts.recorder.entry, now, robot, entry.name, entry.text)
        stop = self._parts.stop
        if stop is not None and entry.name == stop.entry and data.get(stop.field) is True:
            self._fulfilled.add(robot)

    def _entry_data(self, robot: int, text: bytes) -> dict[str, Any]:
        """What a robot logged. The text goes into the log as it is, so it must be one JSON object."""
        name = self._parts.robots[robot]
        try:
            # In brackets: as deep as readers will find it (parsers have a limit), and nothing beside it.
            ((data,),) = orjson.loads(b"[[%b]]" % text)
        except ValueError as error:
            raise RobotFailure(name, f"logged what is no JSON: {error}") from None
        if not isinstance(data, dict):
            raise RobotFailure(name, f"logged a {type(data).__name__} instead of an object")
        return data

    def _end(self, robot: int, now: int, why: str, mistaken: bool) -> None:
        name = self._parts.robots[robot]
        if mistaken:
            raise RobotFailure(name, why, mistaken=True)
        if why:
            raise RobotFailure(name, f"failed: {why}")
        self._running.discard(robot)
        self._agenda.forget(robot)
        self._parts.airwaves.switch_off(robot)
        self._record(self._parts.recorder.note, now, "info", name, "behaviour returned")

    # --- media -----------------------------------------------------------------------------------

    def _transmit(self, now: int) -> None:
        """Decide the fates of what ends now, post what is delivered, record all of it."""
        airwaves = self._parts.airwaves
        batch = airwaves.take_batch()
        if batch is None:
            return
        world = self._parts.world
        fates = airwaves.decide(now, batch, world.positions(now), world.places(now))
        deliveries = fates.deliveries()
        self._record(self._parts.recorder.radio_batch, now, *batch.for_record(), fates.reason, deliveries)
        for row, (receivers, delays_ns) in enumerate(deliveries):
            self._post(batch, row, now, receivers, delays_ns)

    def _post(self, batch: Ending, row: int, now: int, receivers: list[int], delays_ns: list[int]) -> None:
        """Send one transmission on its way, encoded once for all whose clocks read the same."""
        clocks, awaits = self._parts.clocks, self._awaits
        encoded: dict[int, Raw] = {}
        for receiver, delay_ns in zip(receivers, delays_ns, strict=True):
            arrival = now + delay_ns
            reads = arrival if clocks is None else clocks[receiver].local(arrival)
            raw = encoded.get(reads)
            if raw is None:
                raw = encoded[reads] = batch.message(row, reads)
            self._messages.post(receiver, arrival, raw)
            if awaits[receiver] & AWAITS_RADIO:
                self._agenda.wake(receiver, arrival)

    def _expose(self, now: int) -> None:
        eyes = self._parts.eyes
        assert eyes is not None
        self._agenda.add(eyes.next_exposure_ns(), Event.EXPOSURE)
        lamps = self._parts.lamps.colours(now).copy()
        poses = self._parts.world.poses(now)
        capture = eyes.expose(now, poses, lamps, sorted(self._running))
        if capture.entered or capture.left:
            self._record(self._parts.recorder.truth, now, eyes.identities(capture))
        self._record(self._parts.recorder.camera, now, capture)
        self._record(self._parts.recorder.lights, now, poses, lamps)
        available = now + eyes.latency_ns
        for robot, frame in eyes.frames(now, capture, self._parts.clocks):
            self._frames.post(robot, available, frame)
            if self._awaits[robot] & AWAITS_CAMERA:
                self._agenda.wake(robot, available)

    def _draw_scene(self, now: int) -> None:
        self._scenes += 1
        self._agenda.add(to_ns(self._scenes / self._parts.scene_rate_hz), Event.SCENE)
        poses = self._parts.world.poses(now)
        self._record(self._parts.recorder.scene, now, poses, self._parts.lamps.colours(now).copy())

    # --- the log ---------------------------------------------------------------------------------

    def _record(self, write: Callable[..., None], *what: Any) -> None:
        """Have something written while the robots compute; nothing in `what` may change afterwards."""
        self._later.append((write, what))

    def _write_backlog(self) -> None:
        backlog, self._later = self._later, []
        with self._parts.watch.section("recording"), held():
            for write, what in backlog:
                write(*what)

    def _record_refused(self, now: int) -> None:
        refused = self._parts.fleet.refused
        for robot, why in refused:
            record = {"kind": "refused message", "robot": self._parts.robots[robot], "error": why}
            self._record(self._parts.recorder.fault, now, record)
        refused.clear()

    def _count(self) -> None:
        airwaves = self._parts.airwaves
        self.progress.sent, self.progress.delivered, self.progress.dropped = airwaves.totals()
        self.progress.unsent = airwaves.waiting
