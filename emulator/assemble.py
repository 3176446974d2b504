"""From a scenario to the parts of a run."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

import msgspec

from channels.clocks import LocalClock, draw_clocks
from channels.medium import Medium
from channels.messages import Hello, RadioPlan
from channels.randomness import Draws, stable_keys
from channels.settings import payload_limit
from channels.units import to_ns
from emulator.airwaves import Airwaves
from emulator.attached import attachments, user_files
from emulator.eyes import Eyes
from emulator.fleet import Fleet
from emulator.lamps import Lamps
from emulator.parts import Parts, StopRule
from emulator.scenario import RobotSpec, Scenario, area_m, obstacles, resolved_json, world_graph
from emulator.slots import shared_slots
from emulator.world import World
from logs.recorder import Recorder


def version() -> str:
    """Version of Heliograph; logs of different versions may differ."""
    return metadata.version("heliograph")


def make_recorder(
    scenario: Scenario, specs: Sequence[RobotSpec], out: Path, *, force: bool, files: Sequence[str] | None
) -> Recorder:
    """Begin the log with all that is known at the start; `files` as in `run.Options`."""
    about = {
        "heliograph": version(),
        "scenario": scenario.name,
        "seed": str(scenario.seed),
        "score": scenario.score or "",
        "resolved": resolved_json(scenario),
    }
    recorder = Recorder(
        out,
        [spec.id for spec in specs],
        force=force,
        run=about,
        attachments=attachments(scenario, user_files(scenario, specs) if files is None else files),
        arena_m=area_m(scenario),
        altitudes_m=_altitudes(specs),
        graph=world_graph(scenario),
        obstacles=obstacles(scenario),
    )
    recorder.truth(0, _start(scenario, specs))
    return recorder


def make_medium(scenario: Scenario, specs: Sequence[RobotSpec]) -> Medium:
    """The radio channel the robots share."""
    return Medium(
        scenario.radio,
        [spec.id for spec in specs],
        scenario.seed,
        slots=shared_slots(scenario.radio, specs, scenario.seed, world_graph(scenario), obstacles(scenario)),
        altitudes_m=_altitudes(specs),
        graph=world_graph(scenario),
        obstacles=obstacles(scenario),
    )


def make_parts(
    scenario: Scenario, specs: Sequence[RobotSpec], medium: Medium, fleet: Fleet, recorder: Recorder
) -> Parts:
    """Everything the engine needs."""
    robots = [spec.id for spec in specs]
    stop = scenario.run.stop
    graph = world_graph(scenario) if scenario.radio.link == "graph" else None
    return Parts(
        robots=robots,
        fleet=fleet,
        world=World(area_m(scenario), specs, scenario.world.motion, graph),
        airwaves=Airwaves(medium, robots, scenario.radio.overhead_bits),
        eyes=Eyes(scenario.camera, robots, scenario.seed) if scenario.camera is not None else None,
        lamps=Lamps(len(robots), to_ns(scenario.lamp.latency_s)),
        clocks=_clocks(scenario, robots),
        recorder=recorder,
        duration_ns=to_ns(scenario.run.duration_s),
        stop=StopRule(stop.entry, stop.field, stop.of == "running") if stop is not None else None,
        scene_rate_hz=scenario.record.scene_rate_hz,
        max_payload_bytes=payload_limit(scenario.radio),
        colours=scenario.lamp.colours,
    )


def make_hellos(
    scenario: Scenario, specs: Sequence[RobotSpec], medium: Medium, clocks: Sequence[LocalClock] | None
) -> list[Hello]:
    """What each robot is told at its start."""
    seeds = rng_seeds(scenario.seed, [spec.id for spec in specs])
    graph = world_graph(scenario)
    return [
        Hello(
            robot=spec.id,
            behaviour=spec.behaviour,
            params=spec.params,
            rng_seed=seeds[index],
            clock_ns=0 if clocks is None else clocks[index].local(0),
            pose=(*spec.position_m, spec.heading_rad),
            radio=_radio_plan(scenario, medium, index),
            colours=scenario.lamp.colours,
            number=index,
            team=len(specs),
            altitude_m=spec.altitude_m,
            graph=graph,
        )
        for index, spec in enumerate(specs)
    ]


def rng_seeds(seed: int, ids: Sequence[str]) -> list[int]:
    """The seed of each robot's own generator, a function of the scenario's seed and the robot's id alone."""
    draws = Draws(seed, "robot generator")
    return [int(draws.bits(key)) for key in stable_keys(ids)]


def _start(scenario: Scenario, specs: Sequence[RobotSpec]) -> dict[str, object]:
    return {
        "kind": "start",
        "area_m": list(area_m(scenario)),
        "robots": [
            {
                "robot": spec.id,
                "position_m": list(spec.position_m),
                "heading_rad": spec.heading_rad,
                "velocity_mps": list(spec.velocity_mps),
                **({"altitude_m": spec.altitude_m} if spec.altitude_m else {}),
            }
            for spec in specs
        ],
    }


def _clocks(scenario: Scenario, robots: Sequence[str]) -> list[LocalClock] | None:
    if scenario.clock.drift_ppm == 0 and scenario.clock.offset_s == 0:
        return None
    return draw_clocks(scenario.clock, robots, scenario.seed)


def _radio_plan(scenario: Scenario, medium: Medium, robot: int) -> RadioPlan:
    radio, schedule = scenario.radio, medium.schedule
    plan = RadioPlan(payload_limit(radio), radio.overhead_bits, radio.bit_rate_bps, radio.queue)
    if schedule is None:
        return plan
    return msgspec.structs.replace(
        plan,
        slot_ns=schedule.slot_ns,
        guard_ns=schedule.guard_ns,
        slot=medium.slots[robot],
        slots=schedule.slots,
        order_key=schedule.order_key,
    )


def _altitudes(specs: Sequence[RobotSpec]) -> list[float] | None:
    altitudes = [spec.altitude_m for spec in specs]
    return altitudes if any(altitudes) else None
