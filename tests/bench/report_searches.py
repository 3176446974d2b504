"""The tables of searches."""

from __future__ import annotations

from tests.bench.layout import spread, table
from tests.bench.plan import BELIEFS, COMPILING, SEARCH_KINDS, SEARCH_TEAMS, Cell, Samples
from tests.bench.searches import GROUPS

AIM_OF_PLAN = {1: "< 50", 4: "< 1000"}
"""Median milliseconds at horizon 12 on 150 vertices, by number of searchers."""


def reconnection_table(samples: Samples) -> str:
    """Plans, what they miss, beliefs, and compiling."""
    large = max(SEARCH_TEAMS)
    sizes = [(team, 1, team - 1) for team in SEARCH_TEAMS]
    sizes += [(large, members, large - members) for members in GROUPS]
    rows = []
    for kind in SEARCH_KINDS:
        for team, members, targets in sizes:
            cell, of = Cell(f"search, {kind}", team), f"{members}, {targets}: "
            names = ("plans", "wall_ms", "wall_95_ms", "cpu_ms", "cpu_95_ms", "nodes", "proven", "tight")
            digits = (0, 1, 1, 1, 1, 0, 2, 2)
            figures = (samples.values(cell, of + name) for name in names)
            row = [spread(values, each) for values, each in zip(figures, digits, strict=True)]
            rows.append([kind, str(members), str(targets), *row, AIM_OF_PLAN.get(members, "")])
    head = ["", "searchers", "targets", "plans", "wall ms", "95 %", "CPU ms", "95 %", "nodes", "proven",
            "found/bound", "aim, wall ms"]  # fmt: skip
    title = "Plans at horizon 12 on 150 vertices, as whole searches make them: medians and 95th percentiles"
    return "\n\n".join([table(title, head, rows), _wider_table(samples), _beliefs_table(samples)])


def _wider_table(samples: Samples) -> str:
    rows = []
    for kind in SEARCH_KINDS:
        cell = Cell(f"wider, {kind}", max(SEARCH_TEAMS))
        for members in GROUPS:
            names = (
                ("plans", 0),
                ("cpu_ms", 0),
                ("nodes", 0),
                ("proven", 2),
                ("tight", 2),
                ("found", 3),
                ("least", 3),
            )
            row = [spread(samples.values(cell, f"{members}: {name}"), digits) for name, digits in names]
            rows.append([kind, str(members), *row])
    head = ["", "searchers", "plans", "CPU ms", "nodes", "proven", "found/bound", "usual/this", "least"]
    return table("The same by groups that look much further", head, rows)


def _beliefs_table(samples: Samples) -> str:
    rows = []
    for label, name in (("step", "step"), ("merging 2", "merge_2"), ("merging 5", "merge_5")):
        costs = [spread(samples.values(BELIEFS, f"{name}{kind}_us")) for kind in ("", "_dense")]
        ratio = spread(samples.ratios(BELIEFS, f"{name}_dense_us", BELIEFS, f"{name}_us"), 2)
        rows.append([label, *costs, ratio])
    for label, name, digits in (("states", "states", 0), ("dense tensor, MiB", "dense_mib", 0)):
        rows.append([label, spread(samples.values(BELIEFS, name), digits), "", ""])
    for label, name in (("compiling, CPU s", "compile_s"), ("loading what was compiled, CPU s", "load_s")):
        rows.append([label, spread(samples.values(COMPILING, name)), "", ""])
    return table("Beliefs on gridholes, CPU us; and compiling", ["", "", "dense", "dense/ours"], rows)
