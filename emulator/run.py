"""One run: put the parts together, run them, and tell what came out."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TextIO

from msgspec.structs import replace

from channels.units import MAX_TIME_NS, to_s
from emulator.assemble import make_hellos, make_medium, make_parts, make_recorder
from emulator.engine import Engine
from emulator.errors import RunFailed, UserError
from emulator.fleet import Fleet, RobotFailure
from emulator.fleet.in_process import InProcessFleet
from emulator.interrupts import held, noted
from emulator.pacing import Pacer
from emulator.parts import Progress
from emulator.scenario import RobotSpec, RunSettings, Scenario, team
from logs.recorder import Recorder, sha256_of

FleetName = Literal["zenoh", "in_process"]


@dataclass(frozen=True)
class Options:
    """How to run a scenario; nothing here can change what its log holds of the run."""

    out: Path
    fleet: FleetName = "zenoh"
    force: bool = False
    rate: float | None = None
    """Virtual seconds per wall-clock second; None: as fast as possible."""
    listen: str | None = None
    """Zenoh endpoint of the broker; None: a Unix socket of its own."""
    echo: TextIO | None = field(default_factory=lambda: sys.stderr)
    """Where robots' output goes."""
    files: Sequence[str] | None = None
    """The user's Python files to attach; None: those that the scenario names, and what they import."""
    on_progress: Callable[[int], None] = lambda _now_ns: None


@dataclass(frozen=True)
class Outcome:
    """What a run was and how it went."""

    scenario: Scenario
    robots: int
    fleet: FleetName
    log: Path
    digest: str
    progress: Progress
    wall_s: float
    """From the first instant to the last."""
    startup_s: float
    """From nothing to all robots ready."""
    overruns: int
    recording_s: float
    """Wall-clock time the broker spent recording, much of it while robots computed."""
    recording_cpu_s: float
    """Processor time it took."""

    def summary(self, score: dict[str, Any] | None) -> dict[str, Any]:
        """The object that `heliograph run --json` prints; `score` is None where scoring failed."""
        progress = self.progress
        return {
            "scenario": self.scenario.name,
            "seed": self.scenario.seed,
            "robots": self.robots,
            "fleet": self.fleet,
            "log": str(self.log),
            "digest": self.digest,
            "virtual_s": to_s(progress.now_ns),
            "wall_s": round(self.wall_s, 6),
            "startup_s": round(self.startup_s, 6),
            "activations": progress.activations,
            "messages": {
                "sent": progress.sent,
                "delivered": progress.delivered,
                "dropped": progress.dropped,
            },
            "score": score,
        }

    def stats(self) -> dict[str, Any]:
        """The object that `heliograph run --stats` writes."""
        progress = self.progress
        return {
            "kind": "wall-clock statistics; they differ from run to run",
            "wall_s": self.wall_s,
            "startup_s": self.startup_s,
            "activations": progress.activations,
            "us_per_activation": 1e6 * self.wall_s / max(1, progress.activations),
            "real_time_factor": progress.now_ns / 1e9 / self.wall_s,
            "overruns": self.overruns,
            "recording_s": self.recording_s,
            "recording_cpu_s": self.recording_cpu_s,
        }


def run(scenario: Scenario, options: Options) -> Outcome:
    """Run a scenario to its end and write its log; `scoring.score` scores that.

    Raises UserError for what the user can mend, RunFailed where a robot failed; the log is then
    whole up to that instant, and marked as aborted by the absence of a result.
    """
    begun = time.perf_counter()
    specs = team(scenario)
    fleet = _fleet(scenario, specs, options)
    try:
        recorder = make_recorder(scenario, specs, options.out, force=options.force, files=options.files)
        with noted(), _recording(recorder):
            return _run(scenario, specs, options, fleet, recorder, begun)
    finally:
        fleet.close()


def with_duration(scenario: Scenario, duration_s: float) -> Scenario:
    """The same scenario, run for exactly so long. Raises UserError for a duration that is none."""
    if not 0 < duration_s <= to_s(MAX_TIME_NS):
        raise UserError(
            f"--duration {duration_s:g}: is a number of seconds greater than 0, at most {to_s(MAX_TIME_NS):g}"
        )
    return replace(scenario, run=RunSettings(duration_s))


@contextmanager
def _recording(recorder: Recorder) -> Iterator[None]:
    """However this ends, the log is whole."""
    try:
        try:
            yield
        finally:
            with held():
                recorder.abort()  # does nothing to a finished log
    except KeyboardInterrupt as interrupt:
        interrupt.add_note("the log is whole up to this instant")
        raise


def _run(
    scenario: Scenario,
    specs: Sequence[RobotSpec],
    options: Options,
    fleet: Fleet,
    recorder: Recorder,
    begun: float,
) -> Outcome:
    medium = make_medium(scenario, specs)
    parts = make_parts(scenario, specs, medium, fleet, recorder)
    pacer = Pacer(options.rate)

    def before_instant(now_ns: int) -> None:
        pacer.wait_for(now_ns)
        options.on_progress(now_ns)

    engine = Engine(parts, before_instant)
    try:
        fleet.start(make_hellos(scenario, specs, medium, parts.clocks))
        ready = time.perf_counter()
        progress = engine.run()
    except RobotFailure as failure:
        fleet.close()  # first: the robot's last words come with its end
        raise _failed(scenario, failure, fleet, engine.progress, options, recorder) from None
    with parts.watch.section("recording"), held():
        recorder.finish(_result(progress))
    ended = time.perf_counter()
    return Outcome(
        scenario=scenario,
        robots=len(specs),
        fleet=options.fleet,
        log=options.out,
        digest=sha256_of(options.out),
        progress=progress,
        wall_s=ended - ready,
        startup_s=ready - begun,
        overruns=pacer.overruns,
        recording_s=parts.watch.wall_s["recording"],
        recording_cpu_s=parts.watch.cpu_s["recording"],
    )


def _failed(
    scenario: Scenario,
    failure: RobotFailure,
    fleet: Fleet,
    progress: Progress,
    options: Options,
    recorder: Recorder,
) -> RunFailed | UserError:
    now = progress.now_ns
    with held():
        recorder.fault(now, {"kind": "robot failed", "robot": failure.robot, "error": failure.cause})
        recorder.note(now, "error", failure.robot, failure.cause)
    if failure.mistaken:
        return UserError(f"{scenario.name}: {failure.cause} (as robot {failure.robot} found)")
    return RunFailed(
        f"robot {failure.robot} {failure.cause} (at {to_s(now):g} s; the log up to then is {options.out})",
        robot=failure.robot,
        cause=failure.cause,
        output=fleet.last_output(failure.robot),
    )


def _fleet(scenario: Scenario, specs: Sequence[RobotSpec], options: Options) -> Fleet:
    timeout_s = scenario.limits.answer_timeout_s
    if options.fleet == "in_process":
        return InProcessFleet(scenario.folder, timeout_s)
    from emulator.fleet.zenoh import ZenohFleet  # loads Zenoh, which the other fleet can do without

    behaviours = list(dict.fromkeys(spec.behaviour for spec in specs))
    return ZenohFleet(behaviours, scenario.folder, timeout_s, options.listen, options.echo)


def _result(progress: Progress) -> dict[str, str]:
    return {
        "ended_by": progress.ended_by,
        "virtual_ns": str(progress.now_ns),
        "activations": str(progress.activations),
        "sent": str(progress.sent),
        "delivered": str(progress.delivered),
        "unsent": str(progress.unsent),
        **{f"dropped:{reason}": str(count) for reason, count in progress.dropped.items()},
    }
