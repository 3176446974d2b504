"""Vandermeulen, Groß & Kolling, "Re-establishing communication in teams of mobile robots"."""

from __future__ import annotations

from scenarios.figures import Figure, Name, Paper
from scenarios.reconnection import (
    figure_beliefs,
    figure_livelock,
    figure_sensitivity,
    figure_tests,
    figure_times,
)

_TIMES: dict[Name, Figure] = {f"times-{kind}": figure_times.figure(kind) for kind in figure_tests.KINDS}

PAPER = Paper(
    name="vandermeulen",
    title="Vandermeulen, Groß & Kolling",
    figures={
        **_TIMES,  # its Fig. 3
        "table-1": figure_tests.FIGURE,
        "beliefs": figure_beliefs.FIGURE,
        "memory": figure_sensitivity.MEMORY,
        "horizon": figure_sensitivity.HORIZON,
        "loss": figure_sensitivity.LOSS,
        "livelock": figure_livelock.FIGURE,
        "parity": figure_sensitivity.PARITY,
    },
)
