"""The i-state transition graph and its matrix: Ivanov & Shell 2014, Fig. 3 (also 2016, Fig. 3)."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from scenarios.association.markov import transition_graph
from scenarios.figures import Cell, Figure, Run, Table

WIRELESS, VISUAL = 4, 3
COLUMNS = ("kind", "state", "level", "istate", "expected_steps", "to_state", "observations", "probability")


def transitions() -> Figure:
    """All i-states for 4 wireless and 3 visual ids, what leads from one to another, and the matrix."""
    return Figure(
        f"I-state transition graph and matrix for w = {WIRELESS}, v = {VISUAL}", _no_runs, _tabulate, _draw
    )


def _no_runs() -> list[Run]:
    return []  # nothing is drawn at random


def _tabulate(_results: list[dict[str, Any]]) -> Table:
    graph = transition_graph(WIRELESS, VISUAL)
    chain = graph.chain()
    levels, expected, probabilities = graph.levels(), chain.expected_steps(), chain.matrix()
    rows: list[tuple[Cell, ...]] = []
    for state in range(len(graph.states)):
        matrix = "/".join("".join(map(str, row)) for row in graph.istate_matrix(state).tolist())
        rows.append(("state", state + 1, levels[state], matrix, float(expected[state]), None, None, None))
    for state, target in np.argwhere(graph.observations()).tolist():
        count = int(graph.observations()[state, target])
        rows.append(("transition", state + 1, levels[state], None, None, target + 1, count,
                     float(probabilities[state, target])))  # fmt: skip
    return Table(COLUMNS, rows)


def _draw(table: Table, canvas: Canvas) -> None:
    canvas.set_size_inches(12.0, 5.6)
    graph, matrix = canvas.subplots(1, 2, width_ratios=(1.6, 1))
    _draw_graph(graph, table)
    _draw_matrix(matrix, table)


def _draw_graph(axes: Axes, table: Table) -> None:
    states = table.where(kind="state")
    places = _places(states.column("level"))
    moves = table.where(kind="transition")
    for start, end, count in zip(
        moves.column("state"), moves.column("to_state"), moves.column("observations"), strict=True
    ):
        (x, y), (x_end, y_end) = places[start - 1], places[end - 1]
        if start == end:
            axes.annotate(
                f"{count}",
                (x, y),
                (0, 26),
                textcoords="offset points",
                fontsize=7,
                color="tab:red",
                ha="center",
            )
            continue
        axes.annotate("", (x_end, y_end), (x, y), arrowprops={
            "arrowstyle": "->", "color": "0.6", "linewidth": 0.7, "shrinkA": 20, "shrinkB": 20})  # fmt: skip
        # Not in the middle, where the arrows cross.
        axes.text(
            0.7 * x + 0.3 * x_end,
            0.7 * y + 0.3 * y_end,
            str(count),
            fontsize=6,
            color="tab:blue",
            ha="center",
        )
    for (x, y), text in zip(places, states.column("istate"), strict=True):
        axes.text(x, y, text.replace("/", "\n"), fontsize=7, family="monospace", ha="center", va="center",
                  bbox={"boxstyle": "round", "facecolor": "white", "edgecolor": "0.4"})  # fmt: skip
    axes.set(xlim=(-4.2, 4.2), ylim=(-3.5, 0.6), title="observations per transition (red: to itself)")
    axes.axis("off")


def _places(levels: list[int]) -> list[tuple[float, float]]:
    """Level under level, each in the middle."""
    sizes, seen = Counter(levels), Counter[int]()
    places = []
    for level in levels:
        spread = 8.0 / max(sizes.values())
        places.append(
            (
                (seen[level] - (sizes[level] - 1) / 2) * spread * (1.15 if sizes[level] < 7 else 1.0),
                1.0 - level,
            )
        )
        seen[level] += 1
    return places


def _draw_matrix(axes: Axes, table: Table) -> None:
    moves = table.where(kind="transition")
    count = len(table.where(kind="state").rows)
    matrix = np.zeros((count, count))
    places = np.array([moves.column("state"), moves.column("to_state")]) - 1
    matrix[tuple(places)] = moves.column("probability")
    axes.imshow(matrix, cmap="Blues", vmax=1.4)
    for row, column in places.T.tolist():
        axes.text(column, row, f"{matrix[row, column]:.4g}", ha="center", va="center", fontsize=5)
    axes.set(xticks=range(count), yticks=range(count), xlabel="to i-state", ylabel="from i-state",
             title="transition probabilities")  # fmt: skip
    labels = [str(state) for state in range(1, count + 1)]
    axes.set_xticklabels(labels, fontsize=7)
    axes.set_yticklabels(labels, fontsize=7)
    axes.grid(visible=False)
