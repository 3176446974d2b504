"""How fast news crosses the middle of a grid, by the length of a slot: Julian et al. 2009, Fig. 2.

Once for each reading of what becomes of an estimate just learned, which the paper leaves open; beside it
flooding, and what robots on the emulator do.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, NullFormatter, StrMethodFormatter

from agent.behaviours.dissemination.selection import NEW_ESTIMATES
from scenarios.dissemination.emulated import PROPAGATION
from scenarios.dissemination.study_propagation import STUDY, PropagationParameters
from scenarios.figures import Cell, Figure, Run, Table

SLOTS = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 15, 20, 30)
"""m, the estimates in a slot."""
RUNS = {"first": 400, "true-distance": 150, "literal": 50}
"""Of each point; where news waits for its turn at every hop, runs are long."""
FLOODING_RUNS = 1000
PARTS = ("2x2", "4x4", "6x6", "8x8")
MARKERS = "osD^"
TITLES = {
    "first": "first: news is relayed at once",
    "true-distance": "true-distance: unknown ones count",
    "literal": "literal: news waits for its turn",
}

COLUMNS = ("kind", "new_estimates", "m", "subgraph", "units", "se", "sd", "incomplete", "samples")
"""Kinds of rows: `simulated`; `flooding`, the whole list in every slot; `emulated`, robot processes. `units`:
the mean over the runs that were completed, None where none was; `incomplete`: the runs that were not."""

EMULATED_RUNS = 4
EMULATED: tuple[tuple[PropagationParameters, Run], ...] = (
    (PropagationParameters(m=7), Run(PROPAGATION, PropagationParameters(m=7), EMULATED_RUNS, at_most=True)),
)
"""What the emulator's robots do: which point it is, and a run of a study whose result is that of `STUDY`."""


def runs() -> list[Run]:
    """Flooding, then all that is simulated, then the emulator's."""
    return [
        Run(STUDY, PropagationParameters(scheme="flooding", m=100), FLOODING_RUNS),
        *(Run(STUDY, point, RUNS[point.new_estimates]) for point in _points()),
        *(run for _, run in EMULATED),
    ]


def tabulate(results: list[dict[str, Any]]) -> Table:
    """The table, with columns as explained at `COLUMNS`."""
    flooding, *rest = results
    points = list(_points())
    rows = list(_rows("flooding", PropagationParameters(scheme="flooding", m=100), flooding))
    for point, result in zip(points, rest, strict=False):
        rows += _rows("simulated", point, result)
    for (point, _), result in zip(EMULATED, rest[len(points) :], strict=True):
        rows += _rows("emulated", point, result)
    return Table(COLUMNS, rows)


def _points() -> Iterator[PropagationParameters]:
    for new in NEW_ESTIMATES:
        for m in SLOTS:
            yield PropagationParameters(new_estimates=new, m=m)  # type: ignore[arg-type]


def _rows(kind: str, point: PropagationParameters, result: dict[str, Any]) -> Iterator[tuple[Cell, ...]]:
    new = None if kind == "flooding" else point.new_estimates
    for part, found in result["units"].items():
        yield (
            kind, new, point.m, part, found["mean"], found["se"], found["sd"], found["incomplete"],
            result["samples"],
        )  # fmt: skip


# --- the picture ---------------------------------------------------------------------------------


def draw(table: Table, canvas: Canvas) -> None:
    """A panel for each reading, on one scale."""
    panels = canvas.subplots(1, len(NEW_ESTIMATES), sharey=True)
    for axes, new in zip(panels, NEW_ESTIMATES, strict=True):
        for number, part in enumerate(PARTS):
            _draw_part(axes, table, new, part, f"C{number}", MARKERS[number])
        axes.set_title(TITLES[new], fontsize=8)
        axes.set(xlabel="m: estimates in a slot", xscale="log", yscale="log", xlim=(0.9, 36))
        axes.xaxis.set_major_locator(FixedLocator([1, 2, 3, 5, 7, 10, 20, 30]))
        axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
    panels[0].set_ylabel("propagation time [units], mean and standard error")
    _legend(canvas, table)


def _draw_part(axes: Axes, table: Table, new: str, part: str, colour: str, marker: str) -> None:
    simulated = table.where(kind="simulated", new_estimates=new, subgraph=part)
    axes.errorbar(
        simulated.column("m"), simulated.numbers("units"), yerr=_errors(simulated), fmt="-", marker=marker,
        markersize=3, linewidth=1, color=colour,
    )  # fmt: skip
    for level in table.where(kind="flooding", subgraph=part).numbers("units"):
        axes.axhline(level, linestyle="--", linewidth=0.8, color=colour)
    emulated = table.where(kind="emulated", new_estimates=new, subgraph=part)
    axes.errorbar(
        emulated.column("m"), emulated.numbers("units"), yerr=_errors(emulated), fmt="*", markersize=9,
        markerfacecolor="white", capsize=2, color=colour, zorder=3,
    )  # fmt: skip


def _errors(table: Table) -> np.ndarray[Any, Any]:
    """Standard errors; 0 where one run has none."""
    return np.nan_to_num(table.numbers("se"))


def _legend(canvas: Canvas, table: Table) -> None:
    entries = [
        Line2D([], [], color=f"C{number}", marker=MARKERS[number], markersize=4, label=part)
        for number, part in enumerate(PARTS)
    ]
    entries.append(Line2D([], [], color="0.4", linestyle="--", label="flooding"))
    if table.where(kind="emulated").rows:
        entries.append(
            Line2D([], [], color="0.4", linestyle="", marker="*", markerfacecolor="white", markersize=9,
                   label="emulated")
        )  # fmt: skip
    canvas.legend(handles=entries, loc="outside lower center", ncols=len(entries), fontsize=8)


FIGURE = Figure("Propagation time over the length of a slot", runs, tabulate, draw)
