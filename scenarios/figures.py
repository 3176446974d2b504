"""Figures of papers, drawn anew: studies become a table, and the table alone becomes a picture.

Every number in a picture therefore stands in its CSV file, with its standard error where it has one.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

import matplotlib as mpl
import msgspec
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Canvas
from msgspec import Struct
from numpy.typing import NDArray
from tqdm import tqdm

from emulator.errors import UserError
from scenarios.study import Study, Workers, run_study

Cell = float | int | str | None

STYLE: dict[Any, Any] = {
    **mpl.rcParamsDefault,
    "backend": "agg",
    "figure.dpi": 100,
    "savefig.dpi": 160,
    "font.size": 10,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "svg.hashsalt": "heliograph",  # element ids are drawn at random without one
}


class Table(Struct, frozen=True):
    """What is plotted: rows of numbers under named columns."""

    columns: tuple[str, ...]
    rows: Sequence[tuple[Cell, ...]]

    def where(self, **values: Cell) -> Table:
        """The rows whose columns have these values."""
        places = [(self.columns.index(name), value) for name, value in values.items()]
        rows = [row for row in self.rows if all(row[place] == value for place, value in places)]
        return Table(self.columns, rows)

    def column(self, name: str) -> list[Any]:
        """One column, from top to bottom."""
        place = self.columns.index(name)
        return [row[place] for row in self.rows]

    def numbers(self, name: str) -> NDArray[np.float64]:
        """One column to be drawn; NaN where there is no number."""
        return np.array([np.nan if cell is None else cell for cell in self.column(name)], dtype=np.float64)


class Run(Struct, frozen=True):
    """A study that a figure needs."""

    study: Study
    parameters: Struct
    samples: int
    """Unless the user says."""
    at_most: bool = False
    """For costly ones: the user can have fewer, and not more."""
    at_least: bool = False
    """For those that others are judged by: the user can have more, and not fewer."""


class Figure(Struct, frozen=True):
    """One figure of a paper."""

    title: str
    runs: Callable[[], list[Run]]
    tabulate: Callable[[list[dict[str, Any]]], Table]
    """The table, from the results of the runs in their order."""
    draw: Callable[[Table, Canvas], None]


Name = int | str
"""A figure's number in the paper; or a name, where it has none of its own."""


class Paper(Struct, frozen=True):
    """A paper and the figures of it that can be drawn."""

    name: str
    title: str
    figures: dict[Name, Figure]
    """In the order in which they are drawn."""


class Work:
    """Does the runs of figures, each once, however many figures need it."""

    def __init__(self, *, samples: int | None = None, seed: int = 1, jobs: int | None = None) -> None:
        """Raises UserError below two samples, which have no standard error."""
        if samples is not None and samples < 2:
            raise UserError(
                f"--samples {samples}: figures show standard errors, which take 2 samples or more"
            )
        self._samples = samples
        self._seed = seed
        self.workers = Workers(jobs)
        self._results: dict[bytes, dict[str, Any]] = {}

    def result(self, run: Run, on_progress: Callable[[float], None]) -> dict[str, Any]:
        """The result of one run; `on_progress` is told which part of it is done, from 0 to 1."""
        samples = self._samples_of(run)
        key = self.key(run)
        if key not in self._results:
            self._results[key] = run_study(
                run.study, run.parameters, samples=samples, seed=self._seed, workers=self.workers,
                on_progress=lambda done: on_progress(done / samples),
            )  # fmt: skip
        return self._results[key]

    def key(self, run: Run) -> bytes:
        """The same for runs that give the same result."""
        return msgspec.json.encode((run.study.name, run.parameters, self._samples_of(run)))

    def _samples_of(self, run: Run) -> int:
        wanted = run.samples if self._samples is None else self._samples
        if run.at_most:
            wanted = min(wanted, run.samples)
        return max(wanted, run.samples) if run.at_least else wanted


def reproduce(
    paper: Paper,
    names: Sequence[Name] | None,
    folder: Path,
    work: Work,
    *,
    force: bool = False,
    show: bool = False,
) -> list[Path]:
    """Draw figures of a paper (None: all) into `folder`, each as PNG, SVG and CSV; returns the files.

    `show`: a progress bar on the terminal. Raises UserError for a figure that the paper has not, or
    files that exist and are not to be overwritten.
    """
    chosen = _chosen(paper, names)
    _refuse_to_overwrite(folder, chosen, force)
    runs = {name: paper.figures[name].runs() for name in chosen}
    total = len({work.key(run) for listed in runs.values() for run in listed})
    files: list[Path] = []
    with work.workers, _progress(total, show) as bar:
        for name in chosen:
            results = [bar.watch(name, work, run) for run in runs[name]]
            table = paper.figures[name].tabulate(results)
            files += _write(paper, name, table, folder)
    return files


def drawn(figure: Figure, table: Table) -> Canvas:
    """The picture of a table."""
    with mpl.rc_context(STYLE):
        canvas = Canvas(figsize=(7.0, 4.6), layout="constrained")
        FigureCanvasAgg(canvas)
        figure.draw(table, canvas)
    return canvas


def _chosen(paper: Paper, names: Sequence[Name] | None) -> list[Name]:
    for name in names or ():
        if name not in paper.figures:
            known = ", ".join(map(str, paper.figures))
            raise UserError(f"--figure {name}: {paper.name} can be drawn in its figures {known}")
    return [name for name in paper.figures if not names or name in names]


def _files(folder: Path, name: Name) -> dict[str, Path]:
    stem = name if isinstance(name, str) else f"figure-{name:02d}"
    return {kind: folder / f"{stem}.{kind}" for kind in ("png", "svg", "csv")}


def _refuse_to_overwrite(folder: Path, names: Iterable[Name], force: bool) -> None:
    for name in names:
        for path in _files(folder, name).values():
            if path.is_dir():
                raise UserError(f"{path} is a folder; choose another --out")
            if path.exists() and not force:
                raise UserError(f"{path} exists; choose another --out or say --force")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise UserError(f"--out {folder}: is a file; choose a folder") from None
    except OSError as error:
        raise UserError(f"--out {folder}: cannot be made ({error.strerror}); choose another folder") from None
    if not os.access(folder, os.W_OK | os.X_OK):
        raise UserError(f"--out {folder}: cannot be written to; choose another folder")


def _write(paper: Paper, name: Name, table: Table, folder: Path) -> list[Path]:
    figure = paper.figures[name]
    place = name if isinstance(name, str) else f"Fig. {name}"
    title = f"{paper.title}, {place}: {figure.title}"
    files = _files(folder, name)
    # Everything is made before anything is written: a figure is there whole or not at all.
    contents = {"csv": _csv(table), **_pictures(figure, table, title)}
    for kind, path in files.items():
        try:
            path.write_bytes(contents[kind])
        except OSError as error:
            raise UserError(f"{path}: cannot be written ({error.strerror}); choose another --out") from None
    return list(files.values())


def _csv(table: Table) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.columns)
    writer.writerows(table.rows)
    return text.getvalue().encode()


def _pictures(figure: Figure, table: Table, title: str) -> dict[str, bytes]:
    canvas = drawn(figure, table)
    png, svg = io.BytesIO(), io.BytesIO()
    with mpl.rc_context(STYLE):
        canvas.savefig(png, format="png", metadata={"Title": title, "Software": "Heliograph"})
        canvas.savefig(svg, format="svg", metadata={"Title": title, "Creator": "Heliograph", "Date": None})
    return {"png": png.getvalue(), "svg": svg.getvalue()}


class _Bar:
    """Progress over all runs of a command."""

    def __init__(self, bar: tqdm[NoReturn]) -> None:
        self._bar = bar
        self._finished: set[bytes] = set()

    def watch(self, name: Name, work: Work, run: Run) -> dict[str, Any]:
        self._bar.set_description_str(f"figure {name}", refresh=False)
        done = len(self._finished)
        result = work.result(run, lambda part: self._set(done + part))
        self._finished.add(work.key(run))
        self._set(len(self._finished))
        return result

    def _set(self, done: float) -> None:
        self._bar.update(done - self._bar.n)


@contextmanager
def _progress(total: int, show: bool) -> Iterator[_Bar]:
    layout = "{percentage:3.0f}%|{bar}| {desc} [{elapsed}<{remaining}]"
    bar: tqdm[NoReturn] = tqdm(total=total, bar_format=layout, leave=False, disable=not (show and total))
    with bar:
        yield _Bar(bar)
