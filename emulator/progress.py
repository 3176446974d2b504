"""A progress bar of virtual time on the terminal's standard error."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NoReturn

from tqdm import tqdm

from channels.units import to_s

REFRESH_S = 0.1


@contextmanager
def progress_bar(duration_s: float, *, show: bool) -> Iterator[Callable[[int], None]]:
    """Yields a function to be told the virtual time [ns] as often as one likes."""
    layout = "{percentage:3.0f}%|{bar}| {n:.1f}/{total:.1f} virtual s [{elapsed}<{remaining}, {rate_fmt}]"
    bar: tqdm[NoReturn] | None = None
    last = 0.0

    def advance(now_ns: int) -> None:
        nonlocal bar, last
        if not show:
            return
        if bar is None:  # not before something runs: a mistake found until then has the terminal alone
            bar = tqdm(total=duration_s, bar_format=layout, unit="s", leave=False)
        now = time.monotonic()
        if now - last >= REFRESH_S:
            last = now
            bar.update(to_s(now_ns) - bar.n)

    try:
        yield advance
    finally:
        if bar is not None:
            bar.close()
