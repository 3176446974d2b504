"""Score of the dissemination of state estimates from a log (Julian et al. 2009, sec. 4).

How fast news crosses the middle of a grid, how old estimates are, how often they are renewed, and what of the
radio that took.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import msgspec
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from agent.behaviours.dissemination.wire import ESTIMATE_BITS
from channels.settings import RadioSettings
from channels.tdma import slot_length_ns
from channels.units import NS_PER_S, bits_within, to_ns
from emulator.scenario import RobotSpec
from emulator.slots import shared_slots
from logs.reader import LogReader
from scenarios.dissemination.knowledge import History, Knowledge, Transmission, knowledge, read
from scenarios.dissemination.lattices import ALL, Lattice
from scenarios.dissemination.score_age import Around, Updates, Window, around, summary
from scenarios.places import altitudes, positions
from scenarios.runs import start_of

Floats = NDArray[np.float64]

PLACES_S = 1.0
"""How often the places of robots that move are looked at; where they all stand, once."""
MOST_DISTANCES = 5_000_000
"""Distances between robots over all these instants; for larger teams they are fewer."""
BINS_PER_RANGE = 2


class Slots(Struct, frozen=True):
    """The frame, by true time."""

    slot_ns: int
    per_frame: int
    units: int | None
    """Estimates that fit into one, m; None where the air has no limit."""

    @property
    def frame_ns(self) -> int:
        """Length of a frame."""
        return self.slot_ns * self.per_frame

    def number(self, instant_ns: int) -> int:
        """Slots that are over at an instant; the one that begins then is not."""
        return instant_ns // self.slot_ns

    def holds(self, one: Transmission) -> bool:
        """Whether a transmission lies in the slot of its sender."""
        if one.refused or one.slot is None:
            return False
        into_ns = one.start_ns % self.frame_ns - one.slot * self.slot_ns
        return 0 <= into_ns < self.slot_ns and into_ns + one.airtime_ns <= self.slot_ns


def score(log: LogReader) -> dict[str, Any]:
    """Score of one log; see `score_history` for what it holds."""
    return score_history(read(log))


def score_history(history: History) -> dict[str, Any]:
    """Score of a run.

    - `robots`, `duration_s`; `slot_s`, `units_per_slot`, `slots_per_frame`, `frame_rate_hz`: None without
      slots.
    - `propagation`: by part of the grid, see `propagation`; empty where robots begin on none.
    - `age_s`, `updates_per_minute`, `by_distance`, `by_hops`, `never_known`, `unknown_part`, `spearman`: see
      `score_age.summary`, from `params.score_from_s` (0) on, until the run or the behaviour of the receiver
      ends. Distances are straight lines, in bins of half the radio range; hops are counted over links of at
      most that range. Places of robots that move are
      looked at once a second.
    - `unexplained`: estimates of unknown age, see `knowledge.Knowledge`.
    - `bytes_sent` (payload), `estimates_sent`, `slots_used`, `slots_missed`: see `costs`; `per_robot`: each
      of these by robot.
    """
    slots = slots_of(history)
    known = knowledge(history.transmissions, len(history.robots))
    return {
        "robots": len(history.robots),
        "duration_s": history.end_ns / NS_PER_S,
        "slot_s": None if slots is None else slots.slot_ns / NS_PER_S,
        "units_per_slot": None if slots is None else slots.units,
        "slots_per_frame": None if slots is None else slots.per_frame,
        "frame_rate_hz": None if slots is None else NS_PER_S / slots.frame_ns,
        "propagation": propagation(history, known, slots),
        **ages(history, known),
        "unexplained": known.unexplained,
        **costs(history, slots),
    }


# --- propagation ---------------------------------------------------------------------------------


def propagation(history: History, known: Knowledge, slots: Slots | None) -> dict[str, Any]:
    """By centred part of the grid: when every member first held an estimate of every other member.

    `s`: of the last reception; `units` and `frames`: of the end of the slot it was sent in, where a slot
    takes m units (None without slots); all from the start of the run. None where pairs are missing; how
    many, says `missing_pairs`. All estimates of a run were made after its start.

    Which parts says `params.subgraphs` ("all"), see `lattices.Lattice.parts`; none where the robots begin on
    no square grid. Raises ValueError for parts that the grid has not.
    """
    grid = _grid(history)
    if grid is None:
        return {}
    team = len(history.robots)
    pair = known.receiver * team + known.origin
    first = np.append(True, pair[1:] != pair[:-1])[: len(pair)]
    found = {}
    for name, part in grid.parts(str(history.params.get("subgraphs", ALL))).items():
        members = np.isin(np.arange(team), part)
        rows = np.flatnonzero(first & members[known.receiver] & members[known.origin])
        missing = int(members.sum() * (members.sum() - 1)) - len(rows)
        found[name] = {**_completed(known, rows, slots, missing), "missing_pairs": missing}
    return found


def _completed(known: Knowledge, rows: Any, slots: Slots | None, missing: int) -> dict[str, float | None]:
    if missing:
        return {"s": None, "units": None, "frames": None}
    over = None if slots is None else slots.number(int(known.sent_ns[rows].max())) + 1
    return {
        "s": int(known.received_ns[rows].max()) / NS_PER_S,
        "units": None if over is None or slots is None or slots.units is None else over * slots.units,
        "frames": None if over is None or slots is None else over / slots.per_frame,
    }


def _grid(history: History) -> Lattice | None:
    """The grid on which the robots begin, numbered along its rows; None where they begin on none."""
    places = _starts(history)[:, :2]
    same_row = np.isclose(places[:, 1], places[0, 1])
    columns = int(same_row.sum())
    rows, odd = divmod(len(places), columns)
    if odd or len(places) < 2:
        return None
    lattice = places.reshape(rows, columns, 2)
    steps = [np.diff(lattice[:, :, axis], axis=1 - axis) for axis in (0, 1)]
    even = all(np.allclose(step, step.flat[0]) and step.flat[0] > 0 for step in steps if step.size)
    straight = np.allclose(lattice[:, :, 0], lattice[0, :, 0]) and np.allclose(
        lattice[:, :, 1], lattice[:, :1, 1]
    )
    return Lattice(rows, columns, 4) if even and straight else None


def ages(history: History, known: Knowledge) -> dict[str, Any]:
    """`score_age.summary` of a run. Raises ValueError where `params.score_from_s` is not within it."""
    from_s = history.params.get("score_from_s", 0.0)
    if isinstance(from_s, bool) or not isinstance(from_s, int | float) or from_s < 0:
        raise ValueError(f"params.score_from_s: must be a number, 0 or more, is {from_s!r}")
    updates = Updates(
        known.receiver, known.origin, known.received_ns / NS_PER_S, known.made_ns / NS_PER_S
    )  # fmt: skip
    window = Window(float(from_s), np.array(history.ended_ns) / NS_PER_S)
    range_m = float(history.settings["radio"]["range_m"])
    return summary(updates, window, distances(history, range_m), range_m / BINS_PER_RANGE)


def distances(history: History, range_m: float) -> Around:
    """How far apart robots were, from instant to instant."""
    instants = instants_s(history)
    return around(instants, places(history, instants), range_m)


def instants_s(history: History) -> Floats:
    """When to look at places [s]: every `PLACES_S` from 0 on, or once where all robots stand."""
    starts = start_of(history.truth)
    moving = any(any(robot["velocity_mps"]) for robot in starts["robots"])
    if not moving and all(record["kind"] != "motion" for _, record in history.truth):
        return np.zeros(1)
    end_s = history.end_ns / NS_PER_S
    most = max(1, MOST_DISTANCES // len(history.robots) ** 2)
    return np.arange(0.0, max(end_s, PLACES_S), max(PLACES_S, end_s / most))


def places(history: History, instants: Iterable[float]) -> Floats:
    """x, y and altitude [m] of every robot at these instants, which ascend: (T, n, 3)."""
    altitudes_m = altitudes(history.truth)
    motion = history.settings["world"]["motion"]
    at = positions(history.truth, motion, [to_ns(instant) for instant in instants])
    return np.array([np.column_stack((place, altitudes_m)) for place in at])


def _starts(history: History) -> Floats:
    start = start_of(history.truth)
    return np.array(
        [(*robot["position_m"], robot.get("altitude_m", 0.0)) for robot in start["robots"]], dtype=np.float64
    )


# --- the radio -----------------------------------------------------------------------------------


def slots_of(history: History) -> Slots | None:
    """The frame of a run; None where robots speak whenever they like."""
    radio = msgspec.convert(history.settings["radio"], RadioSettings)
    if radio.access != "tdma" or radio.tdma is None:
        return None
    slot_ns = slot_length_ns(radio, radio.tdma)
    shared = shared_slots(radio, _specs(history), int(history.settings["seed"]))
    per_frame = len(history.robots) if shared is None else max(shared) + 1
    return Slots(slot_ns, per_frame, _units(radio, slot_ns))


def costs(history: History, slots: Slots | None) -> dict[str, Any]:
    """What was sent, in all and by robot: payload bytes, estimates, and slots used and missed.

    Of the whole frames of the run: a robot uses its slot where a transmission of its own lies in it, by true
    time, and misses it otherwise, be it late, silent or dead. None without slots.
    """
    overhead = int(history.settings["radio"].get("overhead_bits", 0))
    frames = 0 if slots is None else history.end_ns // slots.frame_ns
    sent: list[list[Transmission]] = [[] for _ in history.robots]
    for one in history.transmissions:
        sent[one.sender].append(one)
    of_robots = [_costs(of_robot, slots, frames, overhead) for of_robot in sent]
    columns = {key: [costs[key] for costs in of_robots] for key in _COSTS}
    return {key: _total(column) for key, column in columns.items()} | {
        "per_robot": {key: dict(zip(history.robots, column, strict=True)) for key, column in columns.items()}
    }


_COSTS = ("bytes_sent", "estimates_sent", "slots_used", "slots_missed")


def _costs(
    sent: Sequence[Transmission], slots: Slots | None, frames: int, overhead: int
) -> dict[str, int | None]:
    found: dict[str, int | None] = {
        "bytes_sent": sum((one.bits - overhead) // 8 for one in sent),
        "estimates_sent": sum(len(one.estimates) for one in sent),
        "slots_used": None,
        "slots_missed": None,
    }
    if slots is not None:
        used = {one.start_ns // slots.frame_ns for one in sent if slots.holds(one)}
        in_time = sum(frame < frames for frame in used)
        found |= {"slots_used": in_time, "slots_missed": frames - in_time}
    return found


def _total(values: Sequence[int | None]) -> int | None:
    return None if None in values else sum(value for value in values if value is not None)


def _units(radio: RadioSettings, slot_ns: int) -> int | None:
    tdma = radio.tdma
    if tdma is not None and tdma.units is not None and tdma.unit_bits is not None:
        return tdma.units * tdma.unit_bits // ESTIMATE_BITS
    if tdma is None or radio.bit_rate_bps is None:
        return None
    bits = bits_within(slot_ns - to_ns(tdma.guard_s), radio.bit_rate_bps) - radio.overhead_bits
    return max(bits // ESTIMATE_BITS, 0)


def _specs(history: History) -> list[RobotSpec]:
    return [
        RobotSpec(name, (x, y), 0.0, (0.0, 0.0), "", {}, altitude_m=z)
        for name, (x, y, z) in zip(history.robots, _starts(history).tolist(), strict=True)
    ]
