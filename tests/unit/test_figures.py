"""Figures: the table alone makes the picture, files are never overwritten by accident, equal for a seed."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure as Canvas
from msgspec import Struct

from emulator.errors import UserError
from scenarios.figures import Figure, Paper, Run, Table, Work, reproduce
from scenarios.study import Study


class Coin(Struct, frozen=True, kw_only=True):
    weight: float = 0.5


SIMULATED: list[tuple[float, int]] = []


def ten(_coin: Coin) -> int:
    return 10


def flip(coin: Coin, rng: np.random.Generator, samples: int) -> int:
    SIMULATED.append((coin.weight, samples))
    return int((rng.random(samples) < coin.weight).sum())


def heads(_coin: Coin, partials: list[int]) -> dict[str, Any]:
    return {"heads": sum(partials)}


def fine(_coin: Coin) -> None:
    pass


FLIPS = Study("coin", "A coin", Coin, 30, "flips", ten, flip, heads, fine)


def tabulate(results: list[dict[str, Any]]) -> Table:
    rows = [(weight, result["heads"]) for weight, result in zip((0.25, 0.5), results, strict=True)]
    return Table(("weight", "heads"), rows)


def draw(table: Table, canvas: Canvas) -> None:
    canvas.subplots().plot(table.column("weight"), table.column("heads"))


def figure(title: str, **limits: bool) -> Figure:
    return Figure(
        title, lambda: [Run(FLIPS, Coin(weight=w), 30, **limits) for w in (0.25, 0.5)], tabulate, draw
    )


PAPER = Paper(
    "coins",
    "Coins 2026",
    {
        1: figure("Heads"),
        4: figure("Heads again"),
        5: figure("Few", at_most=True),
        6: figure("Many", at_least=True),
    },
)


@pytest.fixture(autouse=True)
def _forget() -> None:
    SIMULATED.clear()


def test_a_figure_is_three_files(tmp_path: Path) -> None:
    files = reproduce(PAPER, [4], tmp_path / "new" / "folder", Work(jobs=1))
    assert [file.name for file in files] == ["figure-04.png", "figure-04.svg", "figure-04.csv"]
    with files[2].open() as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["weight", "heads"]
    assert [row[0] for row in rows[1:]] == ["0.25", "0.5"]
    assert files[0].read_bytes().startswith(b"\x89PNG")
    assert b"Coins 2026, Fig. 4: Heads again" in files[1].read_bytes()


def test_all_figures_do_each_run_once(tmp_path: Path) -> None:
    files = reproduce(PAPER, None, tmp_path, Work(jobs=1))
    assert len(files) == 12
    assert SIMULATED == [(0.25, 10)] * 3 + [(0.5, 10)] * 3


def test_samples_are_the_users_but_for_what_is_costly(tmp_path: Path) -> None:
    reproduce(PAPER, [1], tmp_path / "a", Work(samples=40, jobs=1))
    assert sum(samples for _, samples in SIMULATED) == 80
    SIMULATED.clear()
    reproduce(PAPER, [5], tmp_path / "b", Work(samples=40, jobs=1))
    assert sum(samples for _, samples in SIMULATED) == 60
    SIMULATED.clear()
    reproduce(PAPER, [5], tmp_path / "c", Work(samples=4, jobs=1))
    assert sum(samples for _, samples in SIMULATED) == 8
    SIMULATED.clear()
    reproduce(PAPER, [6], tmp_path / "d", Work(samples=4, jobs=1))
    assert sum(samples for _, samples in SIMULATED) == 60
    SIMULATED.clear()
    reproduce(PAPER, [6], tmp_path / "e", Work(samples=40, jobs=1))
    assert sum(samples for _, samples in SIMULATED) == 80
    with pytest.raises(UserError, match="--samples 1: figures show standard errors, which take 2 samples"):
        Work(samples=1)


def test_equal_for_a_seed(tmp_path: Path) -> None:
    first = reproduce(PAPER, [1], tmp_path / "a", Work(seed=3, jobs=1))
    second = reproduce(PAPER, [1], tmp_path / "b", Work(seed=3, jobs=2))
    other = reproduce(PAPER, [1], tmp_path / "c", Work(seed=4, jobs=1))
    assert [file.read_bytes() for file in first] == [file.read_bytes() for file in second]
    assert first[2].read_bytes() != other[2].read_bytes()


def test_nothing_is_overwritten_by_accident(tmp_path: Path) -> None:
    (tmp_path / "figure-04.csv").write_text("mine")
    with pytest.raises(UserError, match=r"figure-04\.csv exists; choose another --out or say --force"):
        reproduce(PAPER, None, tmp_path, Work(jobs=1))
    assert SIMULATED == []
    assert [path.name for path in tmp_path.iterdir()] == ["figure-04.csv"]
    reproduce(PAPER, [4], tmp_path, Work(jobs=1), force=True)
    assert (tmp_path / "figure-04.csv").read_text() != "mine"


def test_a_figure_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="--figure 2: coins can be drawn in its figures 1, 4, 5, 6"):
        reproduce(PAPER, [2], tmp_path, Work())


def test_a_folder_that_cannot_be(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="cannot be made"):
        reproduce(PAPER, [1], tmp_path / "file" / "folder", Work())
    with pytest.raises(UserError, match="file: is a file; choose a folder"):
        reproduce(PAPER, [1], tmp_path / "file", Work())
    (tmp_path / "figure-01.svg").mkdir()
    with pytest.raises(UserError, match=r"figure-01\.svg is a folder; choose another --out"):
        reproduce(PAPER, [1], tmp_path, Work(), force=True)
    assert SIMULATED == []


def test_a_file_that_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_path: Path, _data: bytes) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(UserError, match=r"figure-01\.png: cannot be written \(No space left on device\)"):
        reproduce(PAPER, [1], tmp_path, Work(jobs=1))


def test_a_table_by_hand() -> None:
    table = Table(("kind", "x"), [("a", 1), ("b", 2), ("a", 3)])
    assert table.where(kind="a").column("x") == [1, 3]
    assert table.where(kind="c").rows == []
