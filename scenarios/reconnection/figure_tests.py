"""Is search by beliefs faster? Vandermeulen et al., Table I, and tests that heavy tails do not disturb."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, get_args

from matplotlib.figure import Figure as Canvas

from agent.behaviours.reconnection.methods import Method
from scenarios.figures import Cell, Figure, Run, Table
from scenarios.reconnection import figure_times
from scenarios.reconnection.figure_times import ROBOTS
from scenarios.reconnection.statistics import compared, mean_interval
from scenarios.reconnection.study_reconnection import Kind

KINDS: tuple[Kind, ...] = get_args(Kind)

LEVEL = 0.01
"""Of P, "the 99% confidence level"."""

PAPER: dict[Method, dict[int, float]] = {
    "random": {2: 1.63e-18, 3: 1.84e-11, 4: 2.06e-10},  # that of 5 cannot be read in the copy at hand
    "persistent": {2: 7.68e-7, 3: 7.57e-6, 4: 6.17e-8, 5: 1.44e-7},
}
"""Table I: P of the hypothesis that means are equal, for 50 runs."""

COLUMNS = (
    "environment", "robots", "versus", "runs",
    "semi_markov_mean", "semi_markov_low", "semi_markov_high", "semi_markov_censored",
    "versus_mean", "versus_low", "versus_high", "versus_censored",
    "welch_p", "paper_welch_p", "reaches_99", "mann_whitney_p", "wins", "ratio", "ratio_low", "ratio_high",
)  # fmt: skip
"""Semi-Markov against another method. `low` and `high`: bootstrap intervals (95 %) of the mean before, or of
the ratio of means, semi-Markov over the other; `wins`: share of the pairs of runs in which semi-Markov took
less steps; `reaches_99`: "yes" where Welch's P is less than 0.01 and semi-Markov the faster one."""


def runs() -> list[Run]:
    """Those of Fig. 3, of all kinds."""
    return [run for kind in KINDS for run in figure_times.runs(kind)]


def tabulate(results: list[dict[str, Any]]) -> Table:
    """The table, with columns as explained at `COLUMNS`."""
    cells = [parameters for kind in KINDS for parameters in figure_times.cells(kind)]
    found = {
        (cell.environment, cell.robots, cell.method): result
        for cell, result in zip(cells, results, strict=True)
    }
    rows: list[tuple[Cell, ...]] = []
    for kind in KINDS:
        for robots in ROBOTS:
            by_method = {method: found[kind, robots, method] for method in figure_times.LOOKS}
            rows += [(kind, robots, *row) for row in _compared(robots, by_method)]
    return Table(COLUMNS, rows)


def _compared(robots: int, results: dict[Method, dict[str, Any]]) -> Iterator[tuple[Cell, ...]]:
    semi = results["semi-markov"]
    for versus, paper in PAPER.items():
        other = results[versus]
        tests = compared(semi["times"], other["times"])
        reached = tests.welch < LEVEL and tests.ratio < 1
        yield (
            versus, semi["samples"], *_mean(semi), *_mean(other), tests.welch, paper.get(robots),
            "yes" if reached else "no", tests.mann_whitney, tests.wins, tests.ratio, *tests.ratio_interval,
        )  # fmt: skip


def _mean(result: dict[str, Any]) -> tuple[Cell, ...]:
    return result["steps"]["mean"], *mean_interval(result["times"]), result["censored"]


# --- the picture ---------------------------------------------------------------------------------

_HEADS = (
    "environment", "n", "semi", "random", "persist.",
    "P random\nWelch", "paper", "rank", "wins", "P persist.\nWelch", "paper", "rank", "wins",
    "ratio of means\nto persistent",
)  # fmt: skip


def draw(table: Table, canvas: Canvas) -> None:
    """A page: a line for each kind of environment and team size."""
    lines = []
    for row in table.where(versus="random").rows:
        cell = dict(zip(COLUMNS, row, strict=True))
        (other,) = table.where(
            versus="persistent", environment=cell["environment"], robots=cell["robots"]
        ).rows
        lines.append(_line(cell, dict(zip(COLUMNS, other, strict=True))))
    canvas.set_size_inches(11.5, 1.2 + 0.23 * len(lines))
    axes = canvas.subplots()
    axes.set_axis_off()
    page = axes.table(lines, colLabels=_HEADS, loc="center", cellLoc="right", edges="horizontal")
    page.auto_set_font_size(False)
    page.set_fontsize(8)
    page.auto_set_column_width(list(range(len(_HEADS))))
    for (place, _), box in page.get_celld().items():
        box.set_height((2 if place == 0 else 1) / (len(lines) + 3))
        box.set_linewidth(0.4)
    axes.set_title(
        "means [steps]; P of equality; wins: share of pairs in which semi-Markov is faster; "
        f"*: Welch's P is {LEVEL:g} or more",
        fontsize=9,
    )


def _line(random: dict[str, Cell], persistent: dict[str, Cell]) -> list[str]:
    low, high = (_number(persistent[name]) for name in ("ratio_low", "ratio_high"))
    return [
        str(random["environment"]), str(random["robots"]),
        f"{_number(random['semi_markov_mean']):.0f}", f"{_number(random['versus_mean']):.0f}",
        f"{_number(persistent['versus_mean']):.0f}", *_tests(random), *_tests(persistent),
        f"{_number(persistent['ratio']):.2f} ({low:.2f} to {high:.2f})",
    ]  # fmt: skip


def _tests(row: dict[str, Cell]) -> list[str]:
    paper = row["paper_welch_p"]
    return [
        f"{_number(row['welch_p']):.1e}" + ("" if row["reaches_99"] == "yes" else " *"),
        "-" if paper is None else f"{_number(paper):.1e}",
        f"{_number(row['mann_whitney_p']):.1e}",
        f"{_number(row['wins']):.0%}",
    ]


def _number(cell: Cell) -> float:
    assert isinstance(cell, float | int)
    return cell


FIGURE = Figure(
    title="tests of equal times of semi-Markov, random and persistent search",
    runs=runs,
    tabulate=tabulate,
    draw=draw,
)
