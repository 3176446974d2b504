"""Coverage cost by what robots hear of each other, and where they end: Julian et al. 2009, Fig. 3."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.patches import Polygon
from matplotlib.ticker import FixedLocator, NullFormatter, StrMethodFormatter
from msgspec import Struct

from agent.behaviours.coverage.cells import own_cell, ring
from scenarios.coverage.emulated import EMULATED as EMULATED_STUDY
from scenarios.coverage.simulation import CoverageParameters
from scenarios.coverage.study_coverage import FIRST_S, STUDY
from scenarios.figures import Cell, Figure, Run, Table

RUNS = 60

COLUMNS = ("kind", "m", "scheme", "time_s", "cost_over_optimum", "se", "robot", "x_m", "y_m")
"""Kinds of rows: `optimum`, the line at 1; `curve`, means over the runs of the simulation; `place`, where
each robot of the first run is at the end; `corner`, the corners of its cell there, counterclockwise;
`emulated`, means over runs of robot processes."""

EMULATED_EVERY_S = 20.0
"""Emulated costs are shown at every so many seconds."""


class Compared(Struct, frozen=True):
    """One way of telling each other."""

    m: int
    scheme: Literal["own", "location", "flooding"]
    label: str
    colour: str

    def parameters(self) -> CoverageParameters:
        """The study's defaults but for this."""
        return CoverageParameters(m=self.m, scheme=self.scheme)


COMPARED = (
    Compared(1, "own", "m = 1: no hop", "C3"),
    Compared(3, "location", "m = 3: location-based", "C0"),
    Compared(9, "flooding", "m = 9: flooding", "C2"),
)
CELLS_SHOWN = COMPARED[:2]

EMULATED_RUNS = 4
EMULATED = tuple(
    (compared, Run(EMULATED_STUDY, compared.parameters(), EMULATED_RUNS, at_most=True))
    for compared in COMPARED
)
"""What the emulator's robots do: a run of a study, whose result has `cost_over_optimum` as `coverage` has."""


def runs() -> list[Run]:
    """The simulation of all that is compared, then the emulator's."""
    simulated = [Run(STUDY, compared.parameters(), RUNS) for compared in COMPARED]
    return simulated + [run for _, run in EMULATED]


def tabulate(results: list[dict[str, Any]]) -> Table:
    """The table, with columns as explained at `COLUMNS`."""
    rows: list[tuple[Cell, ...]] = [("optimum", None, None, None, 1.0, None, None, None, None)]
    for compared, result in zip(COMPARED, results, strict=False):
        rows += _curve("curve", compared, result)
        if compared in CELLS_SHOWN:
            rows += _places(compared, result)
    for (compared, _), result in zip(EMULATED, results[len(COMPARED) :], strict=True):
        rows += [row for row in _curve("emulated", compared, result) if _time(row) % EMULATED_EVERY_S == 0]
    return Table(COLUMNS, rows)


def _time(row: tuple[Cell, ...]) -> float:
    time_s = row[COLUMNS.index("time_s")]
    assert isinstance(time_s, float)
    return time_s


def _curve(kind: str, compared: Compared, result: dict[str, Any]) -> Iterator[tuple[Cell, ...]]:
    costs = result["cost_over_optimum"]
    series = zip(costs["times_s"], costs["per_time"]["mean"], costs["per_time"]["se"], strict=True)
    for time_s, mean, error in series:
        yield kind, compared.m, compared.scheme, time_s, mean, error, None, None, None


def _places(compared: Compared, result: dict[str, Any]) -> Iterator[tuple[Cell, ...]]:
    parameters = compared.parameters()
    area_m = (parameters.side, parameters.side)
    places = [(x, y) for x, y in result["final_places_m"]]
    start = (compared.m, compared.scheme, parameters.duration, None, None)
    for robot, place in enumerate(places):
        yield "place", *start, robot, *place
        cell = own_cell(place, places[:robot] + places[robot + 1 :], area_m)
        for x, y in ring(cell).tolist():
            yield "corner", *start, robot, x, y


# --- the picture ---------------------------------------------------------------------------------


def draw(table: Table, canvas: Canvas) -> None:
    """Costs on the left, at first and later; the cells at the end on the right."""
    grid = canvas.add_gridspec(2, 2, width_ratios=(2.2, 1.0))
    first, later = canvas.add_subplot(grid[0, 0]), canvas.add_subplot(grid[1, 0])
    for axes in (first, later):
        _draw_costs(axes, table)
    end_s = max(table.where(kind="curve").column("time_s"))
    _zoom(first, table, 0.0, FIRST_S)
    _zoom(later, table, FIRST_S, end_s)
    first.set_yscale("log")
    first.yaxis.set_major_locator(FixedLocator([1, 2, 5, 10, 20, 50]))
    first.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    first.yaxis.set_minor_formatter(NullFormatter())
    first.legend(fontsize=8)
    later.set_xlabel("time [s]")
    first.set_title("means and standard errors", fontsize=9)
    canvas.supylabel("coverage cost over optimum", fontsize=10)
    for row, compared in enumerate(CELLS_SHOWN):
        _draw_cells(canvas.add_subplot(grid[row, 1]), table, compared)


def _zoom(axes: Axes, table: Table, begin_s: float, end_s: float) -> None:
    """These times, and all costs there."""
    times, costs = table.numbers("time_s"), table.numbers("cost_over_optimum")
    most = np.nanmax(costs[(times >= begin_s) & (times <= end_s)])
    axes.set_xlim(begin_s, end_s)
    axes.set_ylim(1 - 0.1 * (most - 1) / most, 1 + 1.2 * (most - 1))


def _draw_costs(axes: Axes, table: Table) -> None:
    for compared in COMPARED:
        curve = table.where(kind="curve", m=compared.m, scheme=compared.scheme)
        times, mean, error = (curve.numbers(name) for name in ("time_s", "cost_over_optimum", "se"))
        axes.plot(times, mean, color=compared.colour, label=compared.label)
        axes.fill_between(times, mean - error, mean + error, color=compared.colour, alpha=0.25, linewidth=0)
        emulated = table.where(kind="emulated", m=compared.m, scheme=compared.scheme)
        if emulated.rows:
            axes.errorbar(emulated.numbers("time_s"), emulated.numbers("cost_over_optimum"),
                          emulated.numbers("se"), fmt="D", markersize=4, color=compared.colour,
                          label=f"{compared.label}, emulated")  # fmt: skip
    for value in table.where(kind="optimum").column("cost_over_optimum"):
        axes.axhline(value, color="black", linestyle="--", linewidth=1, label="optimum: 3x3 grid")


def _draw_cells(axes: Axes, table: Table, compared: Compared) -> None:
    chosen = {"m": compared.m, "scheme": compared.scheme}
    places = table.where(kind="place", **chosen)
    for robot in places.column("robot"):
        corners = table.where(kind="corner", robot=robot, **chosen)
        outline = list(zip(corners.column("x_m"), corners.column("y_m"), strict=True))
        axes.add_patch(Polygon(outline, facecolor="none", edgecolor=compared.colour))
    axes.plot(places.column("x_m"), places.column("y_m"), "o", markersize=4, color=compared.colour)
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_title(f"m = {compared.m}: end of the first run", fontsize=9)


FIGURE = Figure(
    title="coverage cost by what robots hear of each other, and final Voronoi cells",
    runs=runs,
    tabulate=tabulate,
    draw=draw,
)
