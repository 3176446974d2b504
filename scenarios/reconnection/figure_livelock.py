"""Livelock: how often searches never end, by how first moves are chosen and who searches for whom."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from scenarios.figures import Cell, Figure, Run, Table
from scenarios.reconnection.statistics import share_interval
from scenarios.reconnection.study_reconnection import STUDY, ReconnectionParameters

RUNS = 300

CASES = {
    "always the best move": ReconnectionParameters(robots=2, environment="gabriel", deterministic=True),
    "always the best, target waits": ReconnectionParameters(
        robots=2, environment="gabriel", deterministic=True, targets="upwards"
    ),
    "within 5 % of the best": ReconnectionParameters(robots=2, environment="gabriel"),
    "within 5 %, target waits": ReconnectionParameters(robots=2, environment="gabriel", targets="upwards"),
}

COLUMNS = ("kind", "case", "steps", "share", "low", "high", "count", "stuck", "runs")
"""Kinds of rows: `share` of the runs of a case that did not end before the limit, with Wilson's interval
(95 %), how many these are (`count`), and how many of them came back to where they had been (`stuck`);
`left`: the share of runs that had not ended at `steps`, from there to the next."""


def runs() -> list[Run]:
    """Two robots on Gabriel graphs, in all four cases."""
    return [Run(STUDY, parameters, RUNS) for parameters in CASES.values()]


def tabulate(results: list[dict[str, Any]]) -> Table:
    """The table, with columns as explained at `COLUMNS`."""
    rows: list[tuple[Cell, ...]] = []
    for (case, parameters), result in zip(CASES.items(), results, strict=True):
        total, count = result["samples"], result["censored"]
        low, high = share_interval(count, total)
        rows.append(("share", case, None, count / total, low, high, count, result["stuck"], total))
        rows += [
            ("left", case, steps, share, *[None] * 5) for steps, share in _left(result["times"], parameters)
        ]
    return Table(COLUMNS, rows)


def _left(times: list[int], parameters: ReconnectionParameters) -> Iterator[tuple[int, float]]:
    """Steps at which runs ended, and the share of those that had not."""
    ended = sorted(time for time in times if time < parameters.limit)
    yield 0, 1.0
    for number, time in enumerate(ended, 1):
        if number == len(ended) or ended[number] != time:
            yield time, 1 - number / len(times)
    yield parameters.limit, 1 - len(ended) / len(times)


def draw(table: Table, canvas: Canvas) -> None:
    """Who is left after so many steps; and for good."""
    left, right = canvas.subplots(1, 2, width_ratios=(1.4, 1.0))
    for number, case in enumerate(CASES):
        curve = table.where(kind="left", case=case)
        left.step(np.maximum(curve.numbers("steps"), 1), curve.numbers("share"), where="post",
                  color=f"C{number}", label=case)  # fmt: skip
    left.set_xscale("log")
    left.set_yscale("log")
    left.set_xlabel("steps")
    left.set_ylabel("share of runs not reconnected")
    left.legend(fontsize=7)
    _draw_shares(right, table.where(kind="share"))


def _draw_shares(axes: Axes, shares: Table) -> None:
    share, low, high = (100 * shares.numbers(name) for name in ("share", "low", "high"))
    places = np.arange(len(share))
    colours = [f"C{number}" for number in places]
    axes.bar(places, share, color=colours, alpha=0.6)
    axes.errorbar(places, share, (share - low, high - share), fmt="none", color="black", capsize=4)
    for place, top, stuck, count, runs in zip(
        places, high, *(shares.column(name) for name in ("stuck", "count", "runs")), strict=True
    ):
        axes.annotate(f"{count} of {runs}\n{stuck} stuck", (place, top), fontsize=7, ha="center", va="bottom")
    axes.set_ylim(0, 1.25 * float(high.max()))
    axes.set_xticks([])
    axes.set_ylabel("not ended before the limit [%]")


FIGURE = Figure(title="livelock of two robots on Gabriel graphs", runs=runs, tabulate=tabulate, draw=draw)
