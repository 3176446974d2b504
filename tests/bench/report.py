"""The tables of the bench: medians with their range over the rounds, and ratios within rounds."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from tests.bench.layout import Row, spread, table
from tests.bench.plan import LARGE_TEAM, SLOT_WORKLOADS, STUDIES, TEAMS, TURNS_BESIDE, Cell, Samples
from tests.bench.report_searches import reconnection_table

AIMS_OF_RATIO = {30: "<= 3", 100: "<= 4"}
"""Product over floor, by size of team."""
AIM_IN_PROCESS = "< 100 us"


def tables(samples: Samples, names: Sequence[str]) -> str:
    """The tables of these names, as text."""
    return "\n\n".join(TABLES[name](samples) for name in names)


def activation_table(samples: Samples) -> str:
    """Microseconds per activation, beside the floor of the same size of team."""
    head = [
        "robots",
        "",
        "wall us",
        "CPU us",
        "of it broker",
        "of it robots",
        "wall/floor",
        "CPU/floor",
        "aim",
    ]
    dense = [
        _activation_row(samples, label, Cell(kind, robots), "", aim)
        for robots in TEAMS
        for label, kind, aim in (
            ("product", "product", AIMS_OF_RATIO.get(robots, "")),
            ("in process", "in process", AIM_IN_PROCESS),
            ("bare Zenoh fleet", "bare", ""),
            ("floor", "floor", ""),
        )
    ]
    turns = [
        _activation_row(samples, label, Cell(kind, robots), prefix, "")
        for robots in TEAMS
        for label, kind, prefix in (
            ("product", "turns", ""),
            ("bare Zenoh fleet", "bare", "turns_"),
            ("floor", "floor", "turns_"),
        )
    ]
    return "\n\n".join(
        [
            table("Cost per activation, all robots due at every instant", head, dense),
            table("Cost per activation, one robot due at every instant", head, turns),
            _sizes_table(samples),
        ]
    )


def _activation_row(samples: Samples, label: str, cell: Cell, prefix: str, aim: str) -> Row:
    one_due = prefix or cell.kind == "turns"
    floor, floor_prefix = Cell("floor", cell.robots), "turns_" if one_due else ""
    costs = [
        spread(samples.values(cell, f"{prefix}{name}_us")) for name in ("wall", "cpu", "broker", "robots")
    ]
    ratios = [
        spread(samples.ratios(cell, f"{prefix}{name}_us", floor, f"{floor_prefix}{name}_us"), 2)
        for name in ("wall", "cpu")
    ]
    return [str(cell.robots), label, *costs, *ratios, aim]


def _sizes_table(samples: Samples) -> str:
    rows = [
        [str(cell.robots), cell.kind, str(sizes.grant_bytes), str(sizes.report_bytes)]
        for cell, sizes in sorted(samples.sizes.items(), key=lambda item: (item[0].kind, item[0].robots))
    ]
    head = ["robots", "workload", "grant bytes", "report bytes"]
    return table("Mean length of messages, from runs of the product; the floor's are as long", head, rows)


def realtime_table(samples: Samples) -> str:
    """Virtual over wall-clock seconds."""
    cell = Cell("product", 100)
    rows = [["100", spread(samples.values(cell, "realtime")), "60"]]
    return table(
        "Virtual over wall-clock time, steps of 0.5 s, all recorded",
        ["robots", "times real time", "aim"],
        rows,
    )


def startup_table(samples: Samples) -> str:
    """Seconds and memory."""
    cell = Cell("startup", 100)
    what = [
        ("s from the request to fork robots to the last handshake", "spawn_s", 2, "1"),
        ("s of starting the fleet: the same, and opening the router", "start_s", 2, ""),
        ("s from nothing to all robots ready (startup_s)", "startup_s", 2, ""),
        ("MiB PSS per robot after 10 virtual seconds", "pss_mib", 2, "5"),
        ("MiB PSS of the zygote", "zygote_pss_mib", 1, ""),
    ]
    rows = [
        ["100", label, spread(samples.values(cell, name), digits), aim] for label, name, digits, aim in what
    ]
    return table("Start-up and memory, Zenoh fleet", ["robots", "", "", "aim"], rows)


def recording_table(samples: Samples) -> str:
    """How much of a run goes into its log."""
    rows = []
    for robots in (30, 100):
        cell = Cell("product", robots)
        names = ("recording_share", "recording_cpu_share")
        shares = [spread([100 * value for value in samples.values(cell, name)]) for name in names]
        rows.append([str(robots), *shares, spread(samples.values(cell, "log_bytes"), 0), "< 15"])
    head = ["robots", "% of wall time", "its CPU, % of wall time", "log bytes per activation", "aim %"]
    return table("Share of a run spent recording, Zenoh fleet", head, rows)


def scaling_table(samples: Samples) -> str:
    """The same density, ten times the robots."""
    small, large = Cell("product", 30), Cell("product", LARGE_TEAM)
    rows = []
    for label, name in (("wall us", "wall_us"), ("CPU us", "cpu_us"), ("of it broker", "broker_us")):
        costs = [spread(samples.values(cell, name)) for cell in (small, large)]
        rows.append([label, *costs, spread(samples.ratios(large, name, small, name), 2)])
    head = ["per activation", "30 robots", f"{LARGE_TEAM} robots", "ratio"]
    return table("Growth with the team at equal density, Zenoh fleet", head, rows)


def slots_table(samples: Samples) -> str:
    """Microseconds per slot, beside the product with one robot due at every instant."""
    rows = []
    for workload, robots in SLOT_WORKLOADS.items():
        product, turns = Cell("slots", robots), Cell("turns", TURNS_BESIDE[robots])
        for label, cell in (
            (workload, product),
            ("in process", Cell("slots in process", robots)),
            ("its behaviour alone", Cell("slots, behaviour alone", robots)),
            (f"turns, {turns.robots} robots", turns),
        ):
            costs = [spread(samples.values(cell, f"{name}_us")) for name in ("wall", "cpu")]
            ratios = [
                spread(samples.ratios(cell, f"{name}_us", product, f"{name}_us"), 2)
                for name in ("wall", "cpu")
            ]
            recorded = [100 * part for part in samples.values(cell, "recording_cpu_share")]
            rows.append([str(robots), label, *costs, *ratios, spread(recorded)])
    head = [
        "robots",
        "",
        "wall us",
        "CPU us",
        "wall/product",
        "CPU/product",
        "recording's CPU, % of wall time",
    ]
    return "\n\n".join(
        [table("Cost per slot, one robot due at every instant", head, rows), _behaviour_table(samples)]
    )


def _behaviour_table(samples: Samples) -> str:
    rows = []
    for workload, robots in SLOT_WORKLOADS.items():
        alone = Cell("slots, behaviour alone", robots)
        shares = [
            samples.ratios(alone, "cpu_us", Cell(kind, robots), "cpu_us")
            for kind in ("slots in process", "slots")
        ]
        rows.append([workload, *(spread([100 * share for share in column]) for column in shares)])
    head = ["", "% of the slot in process", "% of the product's slot"]
    return table("The behaviour alone: table, distances, selection, packets; CPU", head, rows)


def switches_table(samples: Samples) -> str:
    """Who is woken how often for one activation."""
    names = ("robots_voluntary", "robots_involuntary", "broker_voluntary", "broker_involuntary")
    rows = [
        [label, *(spread(samples.values(Cell(kind, 30), name), 2) for name in names)]
        for label, kind in (("product", "product"), ("bare Zenoh fleet", "bare"), ("floor", "floor"))
    ]
    head = ["", "robots voluntary", "robots involuntary", "broker voluntary", "broker involuntary"]
    return table("Context switches per activation, 30 robots, all due", head, rows)


def studies_table(samples: Samples) -> str:
    """Samples of studies, vectorised or compiled, beside the classes that robots run."""
    rows = []
    for label, name in (
        ("stationary: a neighbourhood of 20 and 10 ids, until done", "stationary"),
        ("mobile: an observer's step at the defaults", "mobile"),
        ("noisy: a step of 20 and 10 ids (class: with posteriors)", "noisy"),
        ("propagation: a slot of the 10 x 10 grid, m = 7", "propagation"),
        ("age: a slot of nine robots, m = 3", "age"),
        ("age: the same, with placements drawn and ages scored", "age_scored"),
        ("coverage: a centroid among nine robots", "coverage"),
    ):
        costs = [spread(samples.values(STUDIES, f"{name}{kind}_us"), 2) for kind in ("_class", "")]
        ratio = spread(samples.ratios(STUDIES, f"{name}_class_us", STUDIES, f"{name}_us"), 0)
        rows.append([label, *costs, ratio])
    head = ["", "class, CPU us", "study, CPU us", "ratio"]
    return table("Monte Carlo studies beside the classes that robots run", head, rows)


TABLES: dict[str, Callable[[Samples], str]] = {
    "activation": activation_table,
    "realtime": realtime_table,
    "startup": startup_table,
    "recording": recording_table,
    "reconnection": reconnection_table,
    "scaling": scaling_table,
    "slots": slots_table,
    "switches": switches_table,
    "studies": studies_table,
}
