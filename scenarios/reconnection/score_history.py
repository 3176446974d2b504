"""What a log says of a search: of every step, what the robots told, where they really were, who heard whom.

Where `radio.link` is "graph", who hears whom follows from the vertices that robots communicate from, and
robots keep these for all the time in which they exchange anything. Where it is "disc", it follows from their
positions, the range and, with `radio.line_of_sight`, obstacles, by the very rules of the emulator. Then one
instant has to be taken: the beginning of the step by true time, at which all tell that they are there. What
this can miss is little, and only of robots that are on their way: a message is judged when its transmission
ends, and passed on a latency later, `params.repeats` times until `params.phase_s` is over, and by that time
some may have driven into reach or out of it. Robots whose clocks are wrong do all this earlier or later.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Any, TypeAlias

import numpy as np
from msgspec import MsgspecError, Struct, convert, msgpack

from agent.behaviours.reconnection.team import networks
from channels.fates import Floats
from channels.gates.range import Reach
from channels.graphs import Bools, Graph, Rectangle, hearing
from channels.medium import reach_of
from channels.settings import RadioSettings
from channels.units import NS_PER_S, to_ns
from emulator.graphs import GraphSettings, graph_of
from logs.reader import LogReader
from scenarios.places import altitudes, positions, vertices
from scenarios.runs import Run, read_run

STEP, PLAN, BELIEF, MERGE, OUTCOME, REFUSED = NAMES = (
    "reconnection", "plan", "belief", "merge", "outcome", "refused message",
)  # fmt: skip
"""What `agent.behaviours.reconnection.reconnect` logs."""

KINDS = {"p": "presences", "k": "facts", "d": "decisions", "": "other"}
"""By the tags of `agent.behaviours.reconnection.messages`."""

Sent: TypeAlias = dict[tuple[int, str], tuple[int, int]]
Entry: TypeAlias = tuple[int, int, Mapping[str, Any]]
"""(log time [ns], number of the robot, what it logged)"""


class Moment(Struct, frozen=True):
    """One step of the team's common time."""

    step: int
    time_ns: int
    """When the first robot logged it. Robots are at their places for the whole step from there on."""
    told: dict[int, Mapping[str, Any]]
    """What each robot logged of it, by number; those that are dead or were late are missing."""
    places: tuple[int, ...]
    """The vertex that each robot really communicated from."""
    alive: tuple[int, ...]
    """Whose behaviour had not returned when the step began."""
    positions_m: Floats | None = None
    """x, y [m] of every robot, (N, 2), when the step began by true time; None where links decide."""

    @property
    def searching(self) -> tuple[int, ...]:
        """Who had nothing else to do."""
        return tuple(robot for robot, entry in self.told.items() if entry["searching"])

    def groups(self, hearing: Bools) -> list[tuple[int, ...]]:
        """Who searched together: connected by those who search, and aware of each other.

        As robots reckon it among those they are aware of, by places and the links of the graph (`hearing`),
        whatever their radio goes by.
        """
        found = []
        left = list(self.searching)
        while left:
            aware = self.told[left[0]]["network"]
            places = {robot: self.places[robot] for robot in left if robot in aware}
            group = networks(places, hearing)[0]
            found.append(group)
            left = [robot for robot in left if robot not in group]
        return found


class History(Struct, frozen=True):
    """What scoring takes from a log."""

    robots: tuple[str, ...]
    moments: list[Moment]
    entries: dict[str, list[Entry]]
    """By name, in the order of the log."""
    sent: Sent
    """How many messages, and payload bytes, by number of the sender and tag, of `KINDS`."""
    dead: tuple[int, ...]
    """Whose behaviour returned before the run was over."""
    end_ns: int
    hearing: Bools
    """Which places hear each other, by the links of the graph."""
    settings: Mapping[str, Any]
    """The scenario as it was run."""
    reach: Reach | None = None
    """Who is out of reach of whom, by positions; None: `hearing` says it, by places."""

    @property
    def step_s(self) -> float:
        """Length of a step [s]."""
        return float(self.settings.get("params", {}).get("step_s", 1.0))

    @property
    def random_steps(self) -> int:
        """How many steps all wander at first."""
        return int(self.settings.get("params", {}).get("random_steps", 50))

    def networks(self, moment: Moment) -> list[tuple[int, ...]]:
        """Who of those alive could hear each other, directly or by others.

        By the places they communicated from and the links of the graph, or by their positions as the step
        began, the radio's range and what is in between.
        """
        if self.reach is None:
            return networks({robot: moment.places[robot] for robot in moment.alive}, self.hearing)
        assert moment.positions_m is not None  # reach goes by them
        heard = ~self.reach.beyond(moment.positions_m, None, np.arange(len(self.robots)))
        return networks({robot: robot for robot in moment.alive}, heard)

    @property
    def duration_s(self) -> float:
        """Length of the run."""
        return self.end_ns / NS_PER_S


def read(log: LogReader) -> History:
    """Everything scoring needs, read once. Raises ValueError for a log of no search on a graph."""
    run = read_run(log)
    graph = graph_of(convert(run.settings["world"].get("graph"), GraphSettings | None))
    if graph is None:
        raise ValueError(f"{log.path}: its world has no graph; score a run of robots that search on one")
    entries = _entries(log, run.robots)
    times_ns: dict[int, int] = {}
    told: dict[int, dict[int, Mapping[str, Any]]] = {}
    for time_ns, robot, data in entries[STEP]:
        times_ns.setdefault(data["step"], time_ns)
        told.setdefault(data["step"], {})[robot] = data
    at = vertices(run.truth, run.settings["world"]["motion"], graph, times_ns.values())
    step_ns = to_ns(run.params.get("step_s", 1.0))
    reach = _reach(run, graph)
    began = {} if reach is None else _positions_m(run, times_ns, step_ns)
    everybody = range(len(run.robots))
    dead = [robot for robot in everybody if run.ended_ns[robot] < run.end_ns]
    moments = [
        Moment(
            step=step,
            time_ns=time_ns,
            told=dict(sorted(told[step].items())),
            places=tuple(places.tolist()),
            alive=tuple(i for i in everybody if i not in dead or run.ended_ns[i] > step * step_ns),
            positions_m=began.get(step),
        )
        for (step, time_ns), places in zip(times_ns.items(), at, strict=True)
    ]
    return History(
        robots=tuple(run.robots),
        moments=moments,
        entries=entries,
        sent=_sent(log, run.robots, int(run.settings["radio"].get("overhead_bits", 0))),
        dead=tuple(dead),
        end_ns=run.end_ns,
        hearing=hearing(graph),
        settings=run.settings,
        reach=reach,
    )


def _reach(run: Run, graph: Graph) -> Reach | None:
    """Who is out of reach of whom where that depends on positions, as in the emulator's medium."""
    radio = convert(run.settings["radio"], RadioSettings)
    if radio.link == "graph":
        return None
    obstacles = convert(run.settings["world"].get("obstacles", []), list[Rectangle])
    return reach_of(radio, altitudes(run.truth), graph, [*obstacles, *graph.obstacles])


def _positions_m(run: Run, steps: Iterable[int], step_ns: int) -> dict[int, Floats]:
    """x, y [m] of every robot, (N, 2), at the beginning of each of these steps."""
    ascending = sorted(steps)
    at = positions(run.truth, run.settings["world"]["motion"], [step * step_ns for step in ascending])
    return dict(zip(ascending, at, strict=True))


def _entries(log: LogReader, robots: Sequence[str]) -> dict[str, list[Entry]]:
    number = {name: index for index, name in enumerate(robots)}
    found: dict[str, list[Entry]] = {name: [] for name in NAMES}
    for time_ns, record in log.records("/robot"):
        if record["entry"] in found:
            found[record["entry"]].append((time_ns, number[record["robot"]], record["data"]))
    return found


def _sent(log: LogReader, robots: Sequence[str], overhead_bits: int) -> Sent:
    number = {name: index for index, name in enumerate(robots)}
    found: Sent = {}
    for _, record in log.records("/radio"):
        tag = _tag(record["payload"])
        key = number[record["from"]], tag if tag in KINDS else ""
        messages, size = found.get(key, (0, 0))
        found[key] = messages + 1, size + (record["bits"] - overhead_bits) // 8
    return found


def _tag(payload: object) -> str:
    """What a message begins with; the log has those that JSON has no form for as bytes."""
    if isinstance(payload, dict) and payload.keys() == {"base64"}:
        with suppress(ValueError, MsgspecError):
            payload = msgpack.decode(base64.b64decode(payload["base64"]), type=list[Any], strict=False)
    return payload[0] if isinstance(payload, list) and payload and isinstance(payload[0], str) else ""
