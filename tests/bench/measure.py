"""Meters: CPU time, context switches and memory of processes, as the kernel counts them."""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import os
import platform
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

Figures = dict[str, float]
"""What one sample of one cell measured, by name."""

SAMPLE_TIMEOUT_S = 120.0
SPEED_PASSES = 1_000_000
PACKAGES = ("heliograph", "eclipse-zenoh", "msgspec", "numpy", "mcap", "orjson")


class SampleFailed(Exception):
    """A sample that ended without figures; carries the traceback of its process."""


@dataclass(frozen=True)
class Switches:
    """Context switches: given up waiting for something, and taken away by the scheduler."""

    voluntary: int = 0
    involuntary: int = 0

    def __add__(self, other: Switches) -> Switches:
        return Switches(self.voluntary + other.voluntary, self.involuntary + other.involuntary)

    def __sub__(self, other: Switches) -> Switches:
        return Switches(self.voluntary - other.voluntary, self.involuntary - other.involuntary)


@dataclass(frozen=True)
class _Reading:
    wall_ns: int
    broker_ns: int
    robots_ns: int
    machine_ns: int
    """CPU time of everybody on this machine, and what its host took from it."""
    broker: Switches
    robots: Switches


class Meter:
    """Reads clocks and counters of this process (the broker) and of robot processes."""

    def __init__(self, robots: Sequence[int]) -> None:
        """`robots`: process ids; they have to live until `end`."""
        self._robots = robots
        self._begun: _Reading | None = None
        self._ended: _Reading | None = None

    def begin(self) -> None:
        """Start measuring; the last thing read is what moves fastest."""
        robots, broker = self._switches()
        robots_ns = sum(map(cpu_ns, self._robots))
        machine_ns = _machine_ns()
        wall_ns, broker_ns = time.perf_counter_ns(), time.process_time_ns()
        self._begun = _Reading(wall_ns, broker_ns, robots_ns, machine_ns, broker, robots)

    def end(self) -> None:
        """Stop measuring; the first thing read is what moves fastest."""
        wall_ns, broker_ns = time.perf_counter_ns(), time.process_time_ns()
        machine_ns = _machine_ns()
        robots_ns = sum(map(cpu_ns, self._robots))
        robots, broker = self._switches()
        self._ended = _Reading(wall_ns, broker_ns, robots_ns, machine_ns, broker, robots)

    def per_activation(self, activations: int, prefix: str = "") -> Figures:
        """Microseconds and switches per activation between `begin` and `end`.

        `others_cores` is no such: how many cores were busy with anything but us.
        """
        begun, ended = self._begun, self._ended
        if begun is None or ended is None or not activations:
            raise SampleFailed("nothing was measured: the run is shorter than its warm-up")
        broker_ns, robots_ns = ended.broker_ns - begun.broker_ns, ended.robots_ns - begun.robots_ns
        broker, robots = ended.broker - begun.broker, ended.robots - begun.robots
        wall_ns, machine_ns = ended.wall_ns - begun.wall_ns, ended.machine_ns - begun.machine_ns
        others_cores = max(0.0, (machine_ns - broker_ns - robots_ns) / wall_ns)
        amounts = {
            "wall_us": wall_ns / 1000,
            "cpu_us": (broker_ns + robots_ns) / 1000,
            "broker_us": broker_ns / 1000,
            "robots_us": robots_ns / 1000,
            "broker_voluntary": broker.voluntary,
            "broker_involuntary": broker.involuntary,
            "robots_voluntary": robots.voluntary,
            "robots_involuntary": robots.involuntary,
        }
        figures = {prefix + name: amount / activations for name, amount in amounts.items()}
        return {**figures, f"{prefix}others_cores": others_cores}

    def _switches(self) -> tuple[Switches, Switches]:
        return sum(map(switches, self._robots), Switches()), switches(os.getpid())


def cpu_ns(pid: int) -> int:
    """CPU time of all threads a process has had [ns]."""
    # clock_getcpuclockid(3) builds the clock's number in this way; /proc would be read task by task.
    return time.clock_gettime_ns((~pid << 3) | 2)


def switches(pid: int) -> Switches:
    """Context switches of all threads a process has now."""
    total = Switches()
    for status in Path(f"/proc/{pid}/task").glob("*/status"):
        fields = _fields(status)
        total += Switches(int(fields["voluntary_ctxt_switches"]), int(fields["nonvoluntary_ctxt_switches"]))
    return total


def _machine_ns() -> int:
    fields = Path("/proc/stat").read_text().partition("\n")[0].split()[1:]
    user, nice, system, _idle, _iowait, irq, softirq, steal, *_ = map(int, fields)
    return (user + nice + system + irq + softirq + steal) * (1_000_000_000 // os.sysconf("SC_CLK_TCK"))


def pss_mib(pid: int) -> float:
    """Proportional set size: own pages, and the fair share of those shared with others [MiB]."""
    return int(_fields(Path(f"/proc/{pid}/smaps_rollup"))["Pss"].split()[0]) / 1024


def parent_of(pid: int) -> int:
    """Process id of a process's parent."""
    return int(_fields(Path(f"/proc/{pid}/status"))["PPid"])


def _fields(path: Path) -> dict[str, str]:
    lines = (line.partition(":") for line in path.read_text().splitlines())
    return {name.strip(): value.strip() for name, _, value in lines}


def in_fresh_process(function: Callable[..., Figures], *arguments: Any) -> Figures:
    """Call a function in a fork of this process, so that no sample inherits another's threads or heap.

    Raises SampleFailed where it raises, dies, or takes more than two minutes.
    """
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_send_result, args=(theirs, function, arguments), daemon=True)
    process.start()
    theirs.close()
    try:
        if not ours.poll(SAMPLE_TIMEOUT_S):
            raise SampleFailed(f"no result within {SAMPLE_TIMEOUT_S:g} s")
        result = ours.recv()
    except EOFError:
        raise SampleFailed("the process of the sample died") from None
    finally:
        process.join(1.0)
        process.kill()  # robots end with their broker
        process.join()
    if isinstance(result, str):
        raise SampleFailed(result)
    figures: Figures = result
    return figures


def _send_result(
    connection: multiprocessing.connection.Connection,
    function: Callable[..., Figures],
    arguments: Sequence[Any],
) -> None:
    try:
        connection.send(function(*arguments))
    except BaseException:
        connection.send(traceback.format_exc())


def measure_speed() -> Figures:
    """Nanoseconds of one pass of a fixed loop of plain Python: how fast this machine is just now."""
    begun_ns = time.process_time_ns()
    table: dict[int, int] = {}
    for number in range(SPEED_PASSES):
        table[number % 1000] = table.get(number % 997, 0) + number
    return {"pass_ns": (time.process_time_ns() - begun_ns) / SPEED_PASSES}


def environment() -> dict[str, str]:
    """What the numbers depend on."""
    versions = ", ".join(f"{package} {metadata.version(package)}" for package in PACKAGES)
    return {
        "processor": f"{_processor()}, {os.cpu_count()} cores ({len(os.sched_getaffinity(0))} ours)",
        "system": f"Linux {platform.release()}, Python {platform.python_version()}",
        "versions": versions,
        "load": load_average(),
    }


def load_average() -> str:
    """Runnable processes over the last 1, 5 and 15 minutes; the bench itself counts too."""
    return " ".join(f"{load:.2f}" for load in os.getloadavg())


def _processor() -> str:
    return _fields(Path("/proc/cpuinfo")).get("model name", platform.machine())
