"""Figures of stationary association: Ivanov & Shell 2016, Figs. 5-9; 2014, Fig. 4.

The simulation as in the papers, and beside it the exact law, which they did not have.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator

from scenarios.association.approximations import branching_process_time
from scenarios.association.study_stationary import (
    NEIGHBOURHOODS,
    STUDY,
    NeighbourhoodParameters,
    StationaryParameters,
)
from scenarios.association.theory import CompletionLaw, fraction_matched, fraction_matched_model
from scenarios.figures import Figure, Run, Table

LARGEST = 40
"""Neighbourhoods have w in [2, 40] wireless and v in [1, w - 1] visual ids."""
RUNS = 50_000
"""Of every neighbourhood, as in both papers."""
EXAMPLES = ((10, 5), (20, 10), (30, 20), (40, 35))
"""Four neighbourhoods (w, v) for Fig. 6; the paper's text does not say which it shows."""
SIZES = (5, 10, 20, 40)
"""Numbers of wireless ids for Fig. 9."""


def all_neighbourhoods(title: str) -> Figure:
    """Mean steps to completion of all neighbourhoods (2016 Fig. 5, 2014 Fig. 4)."""
    return Figure(title, _runs_of_all, _table_of_all, _draw_all)


def distributions() -> Figure:
    """How the steps to completion are distributed (2016 Fig. 6)."""
    return Figure("Distributions of the steps to completion", _runs_of_examples, _table_of_examples,
                  _draw_examples)  # fmt: skip


def against_branching_process(wireless: int) -> Figure:
    """Mean and deviation for odd v beside the branching process (2016 Figs. 7 and 8)."""

    def runs() -> list[Run]:
        return [Run(NEIGHBOURHOODS, NeighbourhoodParameters(wireless=wireless), RUNS)]

    def tabulate(results: list[dict[str, Any]]) -> Table:
        columns = ("wireless", "visual", "mean", "se", "sd", "exact_mean", "exact_sd", "branching_process")
        rows = []
        for visual in range(1, wireless, 2):
            law = CompletionLaw(wireless, visual)
            steps = results[0]["steps"][visual]
            rows.append((wireless, visual, steps["mean"], steps["se"], steps["sd"], law.mean, law.sd,
                         branching_process_time(wireless, visual)))  # fmt: skip
        return Table(columns, rows)

    return Figure(f"Steps to completion for w = {wireless} and odd v, and the branching process",
                  runs, tabulate, _draw_against_branching_process)  # fmt: skip


def fractions() -> Figure:
    """Fraction matched per step, simulated, modelled and exact (2016 Fig. 9)."""
    return Figure("Fraction matched per step", _runs_of_fractions, _table_of_fractions, _draw_fractions)


# --- all neighbourhoods --------------------------------------------------------------------------


def _runs_of_all() -> list[Run]:
    return [Run(NEIGHBOURHOODS, NeighbourhoodParameters(wireless=w), RUNS) for w in range(2, LARGEST + 1)]


def _table_of_all(results: list[dict[str, Any]]) -> Table:
    rows = []
    for wireless, result in enumerate(results, 2):
        for visual in range(1, wireless):
            steps = result["steps"][visual]
            exact = CompletionLaw(wireless, visual).mean
            rows.append((wireless, visual, steps["mean"], steps["se"], steps["sd"], exact))
    return Table(("wireless", "visual", "mean", "se", "sd", "exact_mean"), rows)


def _draw_all(table: Table, canvas: Canvas) -> None:
    axes = canvas.subplots()
    simulated = _matrix(table, "mean")
    edges = np.arange(LARGEST + 1) + 0.5
    mesh = axes.pcolormesh(edges, edges, simulated, cmap="viridis")
    places = np.arange(1, LARGEST + 1)
    lines = axes.contour(places, places, _matrix(table, "exact_mean"), levels=np.arange(1, 14),
                         colors="white", linewidths=0.8)  # fmt: skip
    axes.clabel(lines, fmt="%g", fontsize=8)
    canvas.colorbar(mesh, label="mean steps to completion, simulated")
    axes.set(xlabel="wireless ids w", ylabel="visual ids v", title="white: the exact law")
    axes.grid(visible=False)


def _matrix(table: Table, column: str) -> np.ndarray[Any, Any]:
    """By v - 1 and w - 1; NaN where there is no such neighbourhood."""
    matrix = np.full((LARGEST, LARGEST), np.nan)
    places = np.array([table.column("visual"), table.column("wireless")]) - 1
    matrix[tuple(places)] = table.column(column)
    return matrix


# --- distributions -------------------------------------------------------------------------------


def _runs_of_examples() -> list[Run]:
    return [Run(STUDY, StationaryParameters(wireless=w, visual=v), RUNS) for w, v in EXAMPLES]


def _table_of_examples(results: list[dict[str, Any]]) -> Table:
    columns = ("wireless", "visual", "step", "fraction_of_runs", "se", "exact_probability",
               "mean", "branching_process")  # fmt: skip
    rows = []
    for (wireless, visual), result in zip(EXAMPLES, results, strict=True):
        law = np.diff(CompletionLaw(wireless, visual).cdf, prepend=0.0)
        model = branching_process_time(wireless, visual)
        for step, count in enumerate(result["distribution"]):
            part = count / result["samples"]
            error = (part * (1 - part) / result["samples"]) ** 0.5
            exact = float(law[step]) if step < len(law) else 0.0
            rows.append((wireless, visual, step, part, error, exact, result["steps"]["mean"], model))
    return Table(columns, rows)


def _draw_examples(table: Table, canvas: Canvas) -> None:
    for axes, (wireless, visual) in zip(_flat(canvas.subplots(2, 2)), EXAMPLES, strict=True):
        part = table.where(wireless=wireless, visual=visual)
        steps = part.column("step")
        axes.bar(steps, part.numbers("fraction_of_runs"), color="0.75", label="simulated")
        axes.plot(steps, part.numbers("exact_probability"), "k.", markersize=4, label="exact")
        axes.axvline(part.numbers("mean")[0], color="tab:blue", label="mean")
        axes.axvline(part.numbers("branching_process")[0], color="tab:red", label="branching process")
        axes.set(title=f"w = {wireless}, v = {visual}", xlabel="steps to completion", ylabel="probability")
        axes.set_xlim(0, _last(steps, part.column("exact_probability")))
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    handles, labels = axes.get_legend_handles_labels()
    canvas.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8)


def _last(steps: Sequence[int], probabilities: Sequence[float]) -> int:
    """The last step worth drawing."""
    return max(step for step, probability in zip(steps, probabilities, strict=True) if probability > 1e-3) + 1


# --- against the branching process ---------------------------------------------------------------


def _draw_against_branching_process(table: Table, canvas: Canvas) -> None:
    axes = canvas.subplots()
    visual = table.column("visual")
    axes.errorbar(visual, table.numbers("mean"), yerr=table.numbers("sd"), fmt="o", markersize=4, capsize=3,
                  label="simulated, mean and one standard deviation")  # fmt: skip
    axes.plot(visual, table.numbers("exact_mean"), "k-", linewidth=1, label="exact mean")
    axes.plot(
        visual, table.numbers("branching_process"), "--", color="tab:red", label="branching process (Eq. 1)"
    )
    axes.set(xlabel="visual ids v", ylabel="steps to completion", ylim=(0, None))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend()


# --- fraction matched ----------------------------------------------------------------------------


def _runs_of_fractions() -> list[Run]:
    return [Run(STUDY, StationaryParameters(wireless=w, visual=w - 1), RUNS) for w in SIZES]


def _table_of_fractions(results: list[dict[str, Any]]) -> Table:
    rows = []
    for wireless, result in zip(SIZES, results, strict=True):
        simulated = result["fraction_matched"]
        last = len(simulated) - 1
        exact = fraction_matched(wireless, last)
        model = fraction_matched_model(wireless, last)
        for step, (mean, error) in enumerate(simulated):
            rows.append((wireless, step, mean, error, float(exact[step]), float(model[step])))
    return Table(("wireless", "step", "fraction_matched", "se", "exact", "model"), rows)


def _draw_fractions(table: Table, canvas: Canvas) -> None:
    axes = canvas.subplots()
    for number, wireless in enumerate(SIZES):
        part = table.where(wireless=wireless)
        colour = f"C{number}"
        axes.errorbar(part.column("step"), part.numbers("fraction_matched"), yerr=part.numbers("se"), fmt="o",
                      markersize=4, color=colour, label=f"w = {wireless}")  # fmt: skip
        axes.plot(part.column("step"), part.numbers("exact"), "-", linewidth=1, color=colour)
        axes.plot(part.column("step"), part.numbers("model"), "--", linewidth=1, color=colour)
    axes.set(xlabel="step", ylabel="fraction matched", xlim=(0, 15),
             title="dots: simulated; lines: exact; dashed: model (Eqs. 2, 3)")  # fmt: skip
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend()


def _flat(axes: Any) -> list[Axes]:
    return list(axes.flat)
