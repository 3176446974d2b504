"""Which cells there are, which table needs which, and how they are sampled: in turn, several times."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass, field

from tests.bench.alone import measure_alone
from tests.bench.bare import measure_bare
from tests.bench.floor import Sizes, measure_floor
from tests.bench.measure import Figures, SampleFailed, in_fresh_process, measure_speed
from tests.bench.product import Workload, measure_product, measure_sizes, measure_startup, sizes_of
from tests.bench.searches import measure_beliefs, measure_compiling, measure_search, measure_wider
from tests.bench.studies import measure_studies

TEAMS = (10, 30, 100)
LARGE_TEAM = 300
SLOT_WORKLOADS: dict[Workload, int] = {"dissemination": 100, "dissemination-mixed": 9}
"""Scenarios with slots, and their teams."""
SLOT_KINDS = ("slots", "slots in process", "slots, behaviour alone")
TURNS_BESIDE = {100: 100, 9: 10}
"""By team with slots, the team that takes turns to be set beside it."""


SEARCH_KINDS = ("gridholes", "delaunay-thinned", "delaunay")
"""Environments of searches."""
SEARCH_TEAMS = (2, 5)
"""The smallest team; and one large enough for groups of four, and for four targets of one searcher."""


@dataclass(frozen=True, order=True)
class Cell:
    """One thing that is measured, for one size of team."""

    kind: str
    robots: int

    def __str__(self) -> str:
        return f"{self.kind}, {self.robots} robots"


STUDIES = Cell("studies", 20)
BELIEFS = Cell("beliefs", 5)
COMPILING = Cell("compiling", 2)
SPEED = Cell("speed", 1)
"""Measured in every round, whatever else is: runs on different days are compared by it."""


@dataclass(frozen=True)
class Effort:
    """How much is measured of everything."""

    rounds: int
    floor_activations: int
    bare_activations: int
    duration_s: dict[int, float]
    """Virtual seconds of association by size of team."""
    turns_duration_s: dict[int, float]
    slots_duration_s: dict[int, float]
    """Likewise, of scenarios with slots: 30 frames, or 10, of a hundred robots."""
    searches: dict[int, int]
    """How many, by size of team."""


FULL = Effort(
    rounds=3,
    floor_activations=30_000,
    bare_activations=9000,
    duration_s={10: 240.0, 30: 120.0, 100: 60.0, 300: 60.0},
    turns_duration_s={10: 120.0, 30: 60.0, 100: 30.0},
    slots_duration_s={100: 1344.0, 9: 600.0},
    searches={2: 8, 5: 4},
)
QUICK = Effort(
    rounds=1,
    floor_activations=10_000,
    bare_activations=3000,
    duration_s={10: 60.0, 30: 30.0, 100: 20.0, 300: 12.0},
    turns_duration_s={10: 40.0, 30: 20.0, 100: 10.0},
    slots_duration_s={100: 448.0, 9: 200.0},
    searches={2: 2, 5: 2},
)


def _teams(*kinds: str) -> list[Cell]:
    return [Cell(kind, robots) for robots in TEAMS for kind in kinds]


NEEDS: dict[str, list[Cell]] = {
    "activation": _teams("product", "bare", "floor", "in process", "turns"),
    "realtime": [Cell("product", 100)],
    "startup": [Cell("startup", 100)],
    "recording": [Cell("product", 30), Cell("product", 100)],
    "scaling": [Cell("product", 30), Cell("product", LARGE_TEAM)],
    "slots": [
        *(Cell(kind, robots) for robots in SLOT_WORKLOADS.values() for kind in SLOT_KINDS),
        *(Cell("turns", robots) for robots in TURNS_BESIDE.values()),
    ],
    "reconnection": [
        *(Cell(f"search, {kind}", robots) for kind in SEARCH_KINDS for robots in SEARCH_TEAMS),
        *(Cell(f"wider, {kind}", max(SEARCH_TEAMS)) for kind in SEARCH_KINDS),
        BELIEFS,
        COMPILING,
    ],
    "studies": [STUDIES],
    "switches": [Cell("product", 30), Cell("floor", 30), Cell("bare", 30)],
}
"""Cells by table."""


@dataclass
class Samples:
    """All figures of all rounds."""

    sizes: dict[Cell, Sizes] = field(default_factory=dict)
    """Lengths of messages by workload (association or turns)."""
    rounds: list[dict[Cell, Figures]] = field(default_factory=list)

    def values(self, cell: Cell, name: str) -> list[float]:
        """One figure of a cell over the rounds; shorter where samples failed."""
        return [done[cell][name] for done in self.rounds if name in done.get(cell, {})]

    def everywhere(self, name: str) -> list[float]:
        """One figure of every sample that has it."""
        return [figures[name] for done in self.rounds for figures in done.values() if name in figures]

    def ratios(self, cell: Cell, name: str, of: Cell, of_name: str) -> list[float]:
        """One figure over another of the same round, over the rounds."""
        return [
            done[cell][name] / done[of][of_name]
            for done in self.rounds
            if name in done.get(cell, {}) and done.get(of, {}).get(of_name)
        ]


class Bench:
    """Samples cells."""

    def __init__(self, effort: Effort) -> None:
        self._effort = effort
        self.samples = Samples()

    def run(self, tables: Iterable[str]) -> Samples:
        """Measure what these tables need. A sample that fails is told of and left out."""
        needed = (cell for table in tables for cell in NEEDS[table])
        cells = list(dict.fromkeys([SPEED, *needed]))
        self._measure_sizes(cells)
        for number in range(1, self._effort.rounds + 1):
            done: dict[Cell, Figures] = {}
            self.samples.rounds.append(done)
            for cell in cells:
                _say(f"round {number} of {self._effort.rounds}: {cell}")
                try:
                    done[cell] = self._measure(cell)
                except SampleFailed as failure:
                    print(f"\n{cell}: a sample failed and is left out\n{failure}", file=sys.stderr)
        _say("")
        return self.samples

    def _measure_sizes(self, cells: Iterable[Cell]) -> None:
        """How long messages are, for the floors among the cells: the same in every round."""
        effort = self._effort
        durations = {"association": effort.duration_s, "turns": effort.turns_duration_s}
        for robots in sorted({cell.robots for cell in cells if cell.kind == "floor"}):
            for workload, duration_s in durations.items():
                cell = Cell(workload, robots)
                _say(f"sizes of messages: {cell}")
                figures = in_fresh_process(measure_sizes, workload, robots, duration_s[robots])
                self.samples.sizes[cell] = sizes_of(figures)

    def _measure(self, cell: Cell) -> Figures:
        effort, robots = self._effort, cell.robots
        kind, _, of = cell.kind.partition(", ")
        if of in SEARCH_KINDS:
            measured = measure_search if kind == "search" else measure_wider
            return in_fresh_process(measured, of, robots, effort.searches[robots])
        match cell.kind:
            case "product":
                return in_fresh_process(
                    measure_product, "association", robots, effort.duration_s[robots], "zenoh"
                )
            case "in process":
                return in_fresh_process(
                    measure_product, "association", robots, effort.duration_s[robots], "in_process"
                )
            case "turns":
                return in_fresh_process(
                    measure_product, "turns", robots, effort.turns_duration_s[robots], "zenoh"
                )
            case "slots" | "slots in process" | "slots, behaviour alone":
                return self._measure_slots(cell)
            case "bare":
                return in_fresh_process(measure_bare, robots, effort.bare_activations)
            case "floor":
                sizes = self.samples.sizes
                dense, turns = sizes[Cell("association", robots)], sizes[Cell("turns", robots)]
                return in_fresh_process(measure_floor, robots, dense, turns, effort.floor_activations)
            case "startup":
                return in_fresh_process(measure_startup, robots)
            case "studies":
                return in_fresh_process(measure_studies)
            case "beliefs":
                return in_fresh_process(measure_beliefs)
            case "compiling":
                return in_fresh_process(measure_compiling)
            case "speed":
                return in_fresh_process(measure_speed)
        raise ValueError(f"no cell is called {cell.kind}")

    def _measure_slots(self, cell: Cell) -> Figures:
        workload = next(name for name, robots in SLOT_WORKLOADS.items() if robots == cell.robots)
        duration_s = self._effort.slots_duration_s[cell.robots]
        if cell.kind == "slots, behaviour alone":
            return in_fresh_process(measure_alone, workload, cell.robots, duration_s)
        fleet = "zenoh" if cell.kind == "slots" else "in_process"
        return in_fresh_process(measure_product, workload, cell.robots, duration_s, fleet)


def _say(what: str) -> None:
    """Progress, on one line that is written over."""
    if sys.stderr.isatty():
        print(f"\r\033[K{what}", end="", file=sys.stderr, flush=True)
