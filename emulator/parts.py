"""What a run is made of, and what has happened in it so far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from channels.clocks import LocalClock
from emulator.airwaves import Airwaves
from emulator.eyes import Eyes
from emulator.fleet import Fleet
from emulator.lamps import Lamps
from emulator.stopwatch import Stopwatch
from emulator.world import World
from logs.recorder import Recorder


@dataclass(frozen=True)
class StopRule:
    """The run is over once every robot has logged `entry` with a true `field`."""

    entry: str
    field: str
    running_only: bool = False
    """Robots whose behaviour has ended need not have."""


@dataclass
class Progress:
    """What has happened so far; counted, never measured, so that it is the same in every run."""

    now_ns: int = 0
    activations: int = 0
    sent: int = 0
    delivered: int = 0
    dropped: dict[str, int] = field(default_factory=dict)
    unsent: int = 0
    """Messages waiting for their slot or a busy radio, or still on the air, when the run ended."""
    ended_by: str = "duration"
    """`duration`, `stop rule`, or `all robots ended`."""


@dataclass
class Parts:
    """What an engine puts together. One instance makes one run."""

    robots: Sequence[str]
    fleet: Fleet
    world: World
    airwaves: Airwaves
    eyes: Eyes | None
    lamps: Lamps
    clocks: Sequence[LocalClock] | None
    """None: all robots' clocks are exact."""
    recorder: Recorder
    duration_ns: int
    stop: StopRule | None
    scene_rate_hz: float
    max_payload_bytes: int
    colours: int
    watch: Stopwatch = field(default_factory=Stopwatch)
