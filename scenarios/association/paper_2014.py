"""Ivanov & Shell 2014, "Associating nearby robots to their voices"."""

from __future__ import annotations

from scenarios.association.figures_chain import transitions
from scenarios.association.figures_stationary import all_neighbourhoods
from scenarios.figures import Paper

PAPER = Paper(
    name="ivanov-shell-2014",
    title="Ivanov & Shell 2014",
    figures={
        3: transitions(),
        4: all_neighbourhoods("Mean steps to completion of all neighbourhoods"),
    },
)
