"""One run: put the parts together, run them, and tell what came out."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any, Literal, TextIO

from msgspec.structs import replace

from agent.loading import BehaviourError, load_behaviour, load_function
from channels.clocks import LocalClock, draw_clocks
from channels.medium import Medium
from channels.messages import Hello, RadioPlan
from channels.randomness import Draws, stable_key
from channels.units import MAX_TIME_NS, to_ns, to_s
from emulator.airwaves import Airwaves
from emulator.engine import Engine, Parts, Progress, StopRule
from emulator.errors import RunFailed, UserError
from emulator.eyes import Eyes
from emulator.fleet import Fleet, RobotFailure
from emulator.fleet.in_process import InProcessFleet
from emulator.lamps import Lamps
from emulator.pacing import Pacer
from emulator.scenario import RobotSpec, RunSettings, Scenario, area_m, resolved_json, team
from emulator.stopwatch import Stopwatch
from emulator.world import World
from logs.reader import LogReader
from logs.recorder import Attachment, Recorder, sha256_of

FleetName = Literal["zenoh", "in_process"]
DEFAULT_SCORE = "logs.score:score"


@dataclass(frozen=True)
class Options:
    """How to run a scenario; nothing here can change what its log holds."""

    out: Path
    fleet: FleetName = "zenoh"
    force: bool = False
    rate: float | None = None
    """Virtual seconds per wall-clock second; None: as fast as possible."""
    listen: str | None = None
    """Zenoh endpoint of the broker; None: a Unix socket of its own."""
    echo: TextIO | None = field(default_factory=lambda: sys.stderr)
    """Where robots' output goes."""
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
    score: dict[str, Any]

    def summary(self) -> dict[str, Any]:
        """The object that `heliograph run --json` prints."""
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
            "score": self.score,
        }


def run(scenario: Scenario, options: Options) -> Outcome:
    """Run a scenario to its end and score its log.

    Raises UserError for what the user can mend, RunFailed where a robot failed; the log is then
    whole up to that instant, and marked as aborted by the absence of a result.
    """
    begun = time.perf_counter()
    specs = team(scenario)
    fleet = _fleet(scenario, specs, options)
    try:
        recorder = _recorder(scenario, specs, options)
        try:
            progress, timing = _run(scenario, specs, options, fleet, recorder, begun)
        finally:
            recorder.abort()  # does nothing to a finished log
    finally:
        fleet.close()
    return Outcome(
        scenario=scenario,
        robots=len(specs),
        fleet=options.fleet,
        log=options.out,
        digest=sha256_of(options.out),
        progress=progress,
        wall_s=timing.wall_s,
        startup_s=timing.startup_s,
        overruns=timing.overruns,
        recording_s=timing.recording_s,
        recording_cpu_s=timing.recording_cpu_s,
        score=score(options.out, scenario.folder),
    )


def score(log: Path, folder: Path | None) -> dict[str, Any]:
    """Score a log by the function its scenario names; `folder` is where the user's files are."""
    with LogReader(log) as reader:
        name = reader.run.get("score") or DEFAULT_SCORE
        try:
            function = load_function(name, folder)
        except BehaviourError as error:
            raise UserError(f"score: {error}; mend it, or name another function in the scenario") from None
        result = function(reader)
    if not isinstance(result, dict):
        raise UserError(f"score: {name} returns a {type(result).__name__} instead of a dict of results")
    return result


def check_functions(scenario: Scenario) -> None:
    """Import what a scenario names, without running it. Raises UserError where something is wrong."""
    try:
        for name in dict.fromkeys(spec.behaviour for spec in team(scenario)):
            load_behaviour(name, scenario.folder)
        load_function(scenario.score or DEFAULT_SCORE, scenario.folder)
    except BehaviourError as error:
        raise UserError(f"{scenario.name}: {error}; mend it, or name another function") from None


def with_duration(scenario: Scenario, duration_s: float) -> Scenario:
    """The same scenario, run for exactly so long. Raises UserError for a duration that is none."""
    if not 0 < duration_s <= to_s(MAX_TIME_NS):
        raise UserError(
            f"--duration {duration_s:g}: is a number of seconds greater than 0, at most {to_s(MAX_TIME_NS):g}"
        )
    return replace(scenario, run=RunSettings(duration_s))


def version() -> str:
    """Version of Heliograph; logs of different versions may differ."""
    return metadata.version("heliograph")


@dataclass(frozen=True)
class _Timing:
    wall_s: float
    startup_s: float
    overruns: int
    recording_s: float
    recording_cpu_s: float


def _run(
    scenario: Scenario,
    specs: Sequence[RobotSpec],
    options: Options,
    fleet: Fleet,
    recorder: Recorder,
    begun: float,
) -> tuple[Progress, _Timing]:
    robots = [spec.id for spec in specs]
    clocks = _clocks(scenario, robots)
    medium = Medium(scenario.radio, robots, scenario.seed)
    pacer = Pacer(options.rate)
    watch = Stopwatch()
    parts = Parts(
        robots=robots,
        fleet=fleet,
        world=_world(scenario, specs),
        airwaves=Airwaves(medium, robots, scenario.radio.overhead_bits),
        eyes=Eyes(scenario.camera, robots, scenario.seed) if scenario.camera is not None else None,
        lamps=Lamps(len(robots), to_ns(scenario.lamp.latency_s)),
        clocks=clocks,
        recorder=recorder,
        duration_ns=to_ns(scenario.run.duration_s),
        stop=StopRule(scenario.run.stop.entry, scenario.run.stop.field) if scenario.run.stop else None,
        scene_rate_hz=scenario.record.scene_rate_hz,
        watch=watch,
    )

    def before_instant(now_ns: int) -> None:
        pacer.wait_for(now_ns)
        options.on_progress(now_ns)

    engine = Engine(parts, before_instant)
    try:
        fleet.start(_hellos(scenario, specs, medium, clocks))
        ready = time.perf_counter()
        progress = engine.run()
    except RobotFailure as failure:
        fleet.close()  # first: the robot's last words come with its end
        raise _failed(failure, fleet, engine.progress, options, recorder) from None
    with watch.section("recording"):
        recorder.finish(_result(progress))
    wall_s = time.perf_counter() - ready
    recording = watch.wall_s["recording"], watch.cpu_s["recording"]
    return progress, _Timing(wall_s, ready - begun, pacer.overruns, *recording)


def _failed(
    failure: RobotFailure, fleet: Fleet, progress: Progress, options: Options, recorder: Recorder
) -> RunFailed:
    now = progress.now_ns
    recorder.fault(now, {"kind": "robot failed", "robot": failure.robot, "error": failure.cause})
    recorder.note(now, "error", failure.robot, failure.cause)
    recorder.abort()
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


def _recorder(scenario: Scenario, specs: Sequence[RobotSpec], options: Options) -> Recorder:
    about = {
        "heliograph": version(),
        "scenario": scenario.name,
        "seed": str(scenario.seed),
        "score": scenario.score or "",
        "resolved": resolved_json(scenario),
    }
    recorder = Recorder(
        options.out,
        [spec.id for spec in specs],
        force=options.force,
        run=about,
        attachments=_attachments(scenario, specs),
        arena_m=area_m(scenario),
    )
    start = {
        "kind": "start",
        "area_m": list(area_m(scenario)),
        "robots": [
            {
                "robot": spec.id,
                "position_m": list(spec.position_m),
                "heading_rad": spec.heading_rad,
                "velocity_mps": list(spec.velocity_mps),
            }
            for spec in specs
        ],
    }
    recorder.truth(0, start)
    return recorder


def _attachments(scenario: Scenario, specs: Sequence[RobotSpec]) -> list[Attachment]:
    """The scenario as it was written, a layout for viewers, and the user's own Python files."""
    layout = Path(__file__).parent.parent / "logs" / "layout.json"
    attached = [
        Attachment("scenario.toml", "application/toml", scenario.text),
        Attachment("layout.json", "application/json", layout.read_bytes()),
    ]
    for name in user_files(scenario, specs):
        assert scenario.folder is not None
        attached.append(Attachment(name, "text/x-python", (scenario.folder / name).read_bytes()))
    return attached


def user_files(scenario: Scenario, specs: Sequence[RobotSpec]) -> list[str]:
    """Python files beside the scenario that it names, relative to its folder."""
    named = [scenario.score or "", *(spec.behaviour for spec in specs)]
    places = (name.rpartition(":")[0] for name in named)
    return sorted({place for place in places if place.endswith(".py")})


def _world(scenario: Scenario, specs: Sequence[RobotSpec]) -> World:
    return World(area_m(scenario), specs, scenario.world.motion)


def _clocks(scenario: Scenario, robots: Sequence[str]) -> list[LocalClock] | None:
    if scenario.clock.drift_ppm == 0 and scenario.clock.offset_s == 0:
        return None
    return draw_clocks(scenario.clock, robots, scenario.seed)


def _hellos(
    scenario: Scenario, specs: Sequence[RobotSpec], medium: Medium, clocks: Sequence[LocalClock] | None
) -> list[Hello]:
    seeds = Draws(scenario.seed, "robot generator")
    return [
        Hello(
            robot=spec.id,
            behaviour=spec.behaviour,
            params=spec.params,
            rng_seed=int(seeds.bits(stable_key(spec.id))),
            clock_ns=0 if clocks is None else clocks[index].local(0),
            pose=(*spec.position_m, spec.heading_rad),
            radio=_radio_plan(scenario, medium, index),
            colours=scenario.lamp.colours,
        )
        for index, spec in enumerate(specs)
    ]


def _radio_plan(scenario: Scenario, medium: Medium, robot: int) -> RadioPlan:
    radio, schedule = scenario.radio, medium.schedule
    plan = RadioPlan(radio.max_payload_bytes, radio.overhead_bits, radio.bit_rate_bps, radio.queue)
    if schedule is None:
        return plan
    return RadioPlan(
        radio.max_payload_bytes,
        radio.overhead_bits,
        radio.bit_rate_bps,
        radio.queue,
        schedule.slot_ns,
        schedule.guard_ns,
        medium.slots[robot],
        schedule.slots,
    )


def _result(progress: Progress) -> dict[str, str]:
    return {
        "ended_by": progress.ended_by,
        "virtual_ns": str(progress.now_ns),
        "activations": str(progress.activations),
        "sent": str(progress.sent),
        "delivered": str(progress.delivered),
        **{f"dropped:{reason}": str(count) for reason, count in progress.dropped.items()},
    }
