"""Julian, Schwager, Angermann & Rus 2009, "A location-based algorithm for multi-hopping state estimates"."""

from __future__ import annotations

from scenarios.dissemination import figure_coverage, figure_propagation, figure_stamps
from scenarios.figures import Paper

PAPER = Paper(
    name="julian-2009",
    title="Julian et al. 2009",
    figures={2: figure_propagation.FIGURE, 3: figure_coverage.FIGURE, 5: figure_stamps.FIGURE},
)
