"""The product as a user runs it, with meters at its fleet."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Literal
from unittest.mock import patch

from msgspec.structs import replace

import emulator.run as product
from channels.messages import Hello, Report, encode
from channels.units import to_ns, to_s
from emulator.engine import Engine
from emulator.fleet import Fleet
from emulator.parts import Parts
from emulator.run import FleetName, Options, Outcome, with_duration
from emulator.scenario import RobotSpec, Scenario
from emulator.scenario_file import load
from tests.bench.floor import Sizes
from tests.bench.measure import Figures, Meter, parent_of, pss_mib

Workload = Literal["association", "turns", "dissemination", "dissemination-mixed"]
"""All robots due at every instant; one, by turns made for this; one, the owner of a slot (the last two)."""
Grants = Iterable[tuple[int, bytes]]
WARM_UP_S: dict[Workload, float] = {
    "association": 2.0,
    "turns": 2.0,
    "dissemination": 90.0,
    "dissemination-mixed": 4.0,
}
"""Virtual seconds before the meters run: generators are made, copied pages copied. Two frames of slots."""
MEMORY_AT_S = 10.0
"""Virtual time at which memory is read."""


def measure_product(workload: Workload, robots: int, duration_s: float, fleet: FleetName) -> Figures:
    """Cost per activation, and what whole runs are judged by."""
    probe = _CostProbe(WARM_UP_S[workload])
    outcome, log_bytes = _run(scenario_of(workload, robots, duration_s), fleet, probe)
    activations = outcome.progress.activations
    return {
        **probe.figures(),
        "realtime": to_s(outcome.progress.now_ns) / outcome.wall_s,
        "recording_share": outcome.recording_s / outcome.wall_s,
        "recording_cpu_share": outcome.recording_cpu_s / outcome.wall_s,
        "startup_s": outcome.startup_s,
        "log_bytes": log_bytes / activations,
    }


def measure_startup(robots: int) -> Figures:
    """Seconds until all robots are ready, and memory once they have run for a while."""
    probe = _StartupProbe()
    outcome, _ = _run(scenario_of("association", robots, MEMORY_AT_S), "zenoh", probe)
    return {**probe.figures, "startup_s": outcome.startup_s}


def measure_sizes(workload: Workload, robots: int, duration_s: float) -> Figures:
    """Mean lengths of grants and reports; the fleet makes no difference to them."""
    probe = _SizeProbe()
    _run(scenario_of(workload, robots, duration_s), "in_process", probe)
    return {"grant_bytes": probe.grant_bytes / probe.count, "report_bytes": probe.report_bytes / probe.count}


def sizes_of(figures: Figures) -> Sizes:
    """What `measure_sizes` found, for the floor."""
    return Sizes(round(figures["grant_bytes"]), round(figures["report_bytes"]))


class _Probe:
    """Looks on at a run; each method does nothing unless somebody wants to know."""

    fleet: Fleet
    engine: Engine

    def attach(self, fleet: Fleet) -> None:
        """The fleet exists, and is about to start."""
        self.fleet = fleet

    def started(self, began_s: float) -> None:
        """All robots are ready; `began_s`: when the fleet was told to start."""

    def instant(self, now_ns: int) -> None:
        """Virtual time has come to `now_ns`; nobody has been granted it."""

    def exchange(self, grants: Grants, meanwhile: Callable[[], None]) -> Iterator[Report]:
        """The fleet's own, so that looking on costs nothing."""
        return self.fleet.exchange(grants, meanwhile)

    def ending(self) -> None:
        """The log is finished, the robots still live."""


class _CostProbe(_Probe):
    def __init__(self, warm_up_s: float) -> None:
        self._warm_up_ns = to_ns(warm_up_s)
        self._meter: Meter | None = None
        self._before = 0

    def instant(self, now_ns: int) -> None:
        if self._meter is None and now_ns >= self._warm_up_ns:
            self._before = self.engine.progress.activations
            self._meter = Meter(_pids(self.fleet))
            self._meter.begin()

    def ending(self) -> None:
        if self._meter is not None:
            self._meter.end()

    def figures(self) -> Figures:
        activations = self.engine.progress.activations - self._before
        return (self._meter or Meter([])).per_activation(activations)


class _StartupProbe(_Probe):
    def __init__(self) -> None:
        self.figures: Figures = {}
        self._spawned_s = 0.0

    def attach(self, fleet: Fleet) -> None:
        super().attach(fleet)
        supervisor = fleet._supervisor  # type: ignore[attr-defined]
        spawn: Callable[..., list[int]] = supervisor.spawn

        def timed(*arguments: object) -> list[int]:
            self._spawned_s = time.perf_counter()
            return spawn(*arguments)

        supervisor.spawn = timed

    def started(self, began_s: float) -> None:
        now_s = time.perf_counter()
        self.figures |= {"spawn_s": now_s - self._spawned_s, "start_s": now_s - began_s}

    def instant(self, now_ns: int) -> None:
        if now_ns >= to_ns(MEMORY_AT_S) and "pss_mib" not in self.figures:
            pids = _pids(self.fleet)
            self.figures["pss_mib"] = sum(map(pss_mib, pids)) / len(pids)
            self.figures["zygote_pss_mib"] = pss_mib(parent_of(pids[0]))


class _SizeProbe(_Probe):
    def __init__(self) -> None:
        self.count = self.grant_bytes = self.report_bytes = 0

    def exchange(self, grants: Grants, meanwhile: Callable[[], None]) -> Iterator[Report]:
        for report in self.fleet.exchange(map(self._weighed, grants), meanwhile):
            self.report_bytes += len(encode(report))
            yield report

    def _weighed(self, grant: tuple[int, bytes]) -> tuple[int, bytes]:
        self.count += 1
        self.grant_bytes += len(grant[1])
        return grant


class _ProbedFleet:
    """A fleet that tells a probe what happens to it."""

    def __init__(self, fleet: Fleet, probe: _Probe) -> None:
        probe.attach(fleet)
        self._fleet = fleet
        self._probe = probe
        self._started = False
        self.exchange = probe.exchange
        self.last_output = fleet.last_output

    @property
    def refused(self) -> list[tuple[int, str]]:
        return self._fleet.refused

    def start(self, hellos: Sequence[Hello]) -> None:
        began_s = time.perf_counter()
        self._fleet.start(hellos)
        self._started = True
        self._probe.started(began_s)

    def close(self) -> None:
        if self._started:
            self._started = False
            self._probe.ending()
        self._fleet.close()


def _run(scenario: Scenario, fleet: FleetName, probe: _Probe) -> tuple[Outcome, int]:
    """The outcome of a run that a probe looks on at, and the length of its log [bytes]."""
    with tempfile.TemporaryDirectory(prefix="heliograph-bench-") as folder, _probed(probe):
        log = Path(folder) / "bench.mcap"
        outcome = product.run(scenario, Options(out=log, fleet=fleet, echo=None, on_progress=probe.instant))
        return outcome, log.stat().st_size


@contextmanager
def _probed(probe: _Probe) -> Iterator[None]:
    """Runs make their fleet and their engine themselves; let a probe see both."""
    make_fleet = product._fleet

    def probed_fleet(scenario: Scenario, specs: Sequence[RobotSpec], options: Options) -> Fleet:
        return _ProbedFleet(make_fleet(scenario, specs, options), probe)

    def probed_engine(parts: Parts, before_instant: Callable[[int], None]) -> Engine:
        probe.engine = Engine(parts, before_instant)
        return probe.engine

    with patch.object(product, "_fleet", probed_fleet), patch.object(product, "Engine", probed_engine):
        yield


def scenario_of(workload: Workload, robots: int, duration_s: float) -> Scenario:
    """What runs for exactly so long; stop rules do not count."""
    overrides = ["score=tests.bench.behaviours:no_score"]
    if workload in ("dissemination", "dissemination-mixed"):
        return with_duration(load(workload, robots=robots, overrides=overrides), duration_s)
    if workload == "turns":
        overrides.append("behaviour=tests.bench.behaviours:take_turns")
    scenario = with_duration(load("association", robots=robots, overrides=overrides), duration_s)
    return replace(scenario, params={**scenario.params, "team": robots})


def _pids(fleet: Fleet) -> list[int]:
    """Process ids of the robots; none where they have no processes of their own."""
    return list(getattr(fleet, "pids", ()))
