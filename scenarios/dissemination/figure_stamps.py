"""Time stamps of the most current estimates at the remotest robot: Julian et al. 2009, Fig. 5.

As robot processes on the emulator receive them; and, over random placements, how age and updates depend on
distance, and on alpha: nearer is fresher under any scheme, for news comes by hops; what alpha changes is how
often estimates are renewed.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from msgspec import Struct

from scenarios.dissemination.stamps import STAMPS, StampsParameters
from scenarios.dissemination.study_age import STUDY, AgeParameters
from scenarios.figures import Cell, Figure, Run, Table

EMULATED_RUNS = 4
PLACEMENTS = 150
SHOWN_S = 50.0
"""The last part of the run, long after the cold start; the table has all of it."""

COLUMNS = (
    "kind", "scheme", "alpha", "robot", "distance_m", "moves", "received_s", "stamp_s",
    "from_m", "to_m", "age_s", "age_se", "updates_per_minute", "updates_se", "spearman", "spearman_se",
    "samples",
)  # fmt: skip
"""Kinds of rows: `stamp`, an update of the receiver's estimate of `robot` (mean `distance_m`) in the first
emulated run; `receiver`, who that is, and over `samples` runs the rank correlation of distance with updates
a minute; `age`, mean age and updates a minute by distance over so many random placements; `ranks`, the same
rank correlation, in each of these over the pairs whose receiver is the remotest robot."""


class Compared(Struct, frozen=True):
    """One way of telling each other, among random placements."""

    label: str
    parameters: AgeParameters
    colour: str


COMPARED = (
    Compared("alpha = 1", AgeParameters(), "C0"),
    Compared("alpha = 0", AgeParameters(alpha=0.0), "C1"),
    Compared("flooding", AgeParameters(scheme="flooding", m=9), "C2"),
)


def runs() -> list[Run]:
    """The emulator's, then the placements."""
    return [
        Run(STAMPS, StampsParameters(), EMULATED_RUNS, at_most=True),
        *(Run(STUDY, compared.parameters, PLACEMENTS) for compared in COMPARED),
    ]


def tabulate(results: list[dict[str, Any]]) -> Table:
    """The table, with columns as explained at `COLUMNS`."""
    emulated, *ages = results
    rows = list(_stamps(emulated))
    for compared, result in zip(COMPARED, ages, strict=True):
        rows += _ages(compared.parameters, result)
    return Table(COLUMNS, rows)


def _stamps(result: dict[str, Any]) -> Iterator[tuple[Cell, ...]]:
    first, parameters = result["first"], StampsParameters()
    said = {"scheme": parameters.scheme, "alpha": parameters.alpha}
    rank = result["spearman"]
    yield _row(
        kind="receiver", **said, robot=first["receiver"], distance_m=0.0, spearman=rank["mean"],
        spearman_se=rank["se"], samples=result["samples"],
    )  # fmt: skip
    for robot in first["robots"]:
        about = {key: robot[key] for key in ("robot", "distance_m")} | {"moves": int(robot["moves"])}
        for received_s, stamp_s in zip(robot["received_s"], robot["stamp_s"], strict=True):
            yield _row(kind="stamp", **said, **about, received_s=received_s, stamp_s=stamp_s)


def _ages(parameters: AgeParameters, result: dict[str, Any]) -> Iterator[tuple[Cell, ...]]:
    said = {"scheme": parameters.scheme, "alpha": parameters.alpha, "samples": result["samples"]}
    rank = result["spearman"]["remotest"]["distance_and_updates"]
    yield _row(kind="ranks", **said, spearman=rank["mean"], spearman_se=rank["se"])
    for found in result["by_distance"]:
        age, updates = found["age_s"]["mean"], found["updates_per_minute"]
        yield _row(
            kind="age", **said, from_m=found["from_m"], to_m=found["to_m"], age_s=age["mean"],
            age_se=age["se"], updates_per_minute=updates["mean"], updates_se=updates["se"],
        )  # fmt: skip


def _row(**cells: Cell) -> tuple[Cell, ...]:
    """A row with these cells, the others empty."""
    return tuple(cells.get(name) for name in COLUMNS)


# --- the picture ---------------------------------------------------------------------------------


def draw(table: Table, canvas: Canvas) -> None:
    """Stamps on the left; age and updates over distance on the right."""
    grid = canvas.add_gridspec(2, 2, width_ratios=(1.6, 1.0))
    _draw_stamps(canvas.add_subplot(grid[:, 0]), table)
    ages, updates = canvas.add_subplot(grid[0, 1]), canvas.add_subplot(grid[1, 1])
    for compared in COMPARED:
        _draw_by_distance(ages, table, compared, "age_s", "age_se")
        _draw_by_distance(updates, table, compared, "updates_per_minute", "updates_se")
    ages.set(ylabel="mean age [s]", ylim=(0, None))
    ages.legend(fontsize=8)
    ages.set_title("random placements, with standard errors", fontsize=8)
    updates.set(xlabel="distance [m]", ylabel="updates a minute", ylim=(0, None))


def _draw_stamps(axes: Axes, table: Table) -> None:
    receiver = table.where(kind="receiver").column("robot")[0]
    stamps = table.where(kind="stamp")
    apart = dict(zip(stamps.column("robot"), stamps.column("distance_m"), strict=True))
    nearest_first = sorted(apart, key=lambda robot: apart[robot])
    end = StampsParameters().duration
    oldest = end - SHOWN_S
    axes.plot([0, end], [0, end], "k-", linewidth=0.8, label=f"{receiver}: its own")
    for place, robot in enumerate(nearest_first):
        part = stamps.where(robot=robot)
        colour = colormaps["viridis"](place / max(1, len(nearest_first) - 1) * 0.9)
        moves = " (moves)" if part.column("moves")[0] else ""
        received, stamp = part.numbers("received_s"), part.numbers("stamp_s")
        oldest = min(oldest, *stamp[received <= end - SHOWN_S][-1:])
        axes.step(
            np.append(received, end), np.append(stamp, stamp[-1:]), where="post",
            color=colour, linewidth=1, label=f"{robot}: {apart[robot]:.0f} m{moves}",
        )  # fmt: skip
    axes.set(xlim=(end - SHOWN_S, end), ylim=(oldest, end), xlabel="time [s]", ylabel="time stamp [s]")
    axes.set_title(f"most current estimates at the remotest robot, {receiver}", fontsize=9)
    axes.legend(fontsize=7)


def _draw_by_distance(axes: Axes, table: Table, compared: Compared, key: str, error: str) -> None:
    said = {"scheme": compared.parameters.scheme, "alpha": compared.parameters.alpha}
    part = table.where(kind="age", **said)
    middles = (part.numbers("from_m") + part.numbers("to_m")) / 2
    axes.errorbar(
        middles, part.numbers(key), yerr=np.nan_to_num(part.numbers(error)), fmt="o-", markersize=3,
        linewidth=1, color=compared.colour, label=compared.label,
    )  # fmt: skip


FIGURE = Figure("Time stamps of the most current estimates at the remotest robot", runs, tabulate, draw)
