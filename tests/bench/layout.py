"""How tables of the bench look: medians with their range over the rounds."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

Row = Sequence[str]


def spread(values: Sequence[float], digits: int = 1) -> str:
    """Median, and range where there is one."""
    if not values:
        return "-"
    middle = f"{median(values):.{digits}f}"
    return middle if len(values) == 1 else f"{middle} ({min(values):.{digits}f}-{max(values):.{digits}f})"


def table(title: str, head: Row, rows: Sequence[Row]) -> str:
    """Columns as wide as they have to be."""
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    lines = [
        "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True))
        for row in (head, *rows)
    ]
    return "\n".join([title, *(f"  {line}".rstrip() for line in lines)])
