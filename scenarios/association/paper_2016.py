"""Ivanov & Shell 2016, "Hark! Who goes there? Concurrent association of communication channels"."""

from __future__ import annotations

from scenarios.association.figures_mobile import (
    FRACTION_MATCHED,
    MIX,
    RANGE,
    RATIO,
    SEPARATION,
    SPEED,
    over_time,
)
from scenarios.association.figures_models import BY_RANGE, BY_SEPARATION, BY_SPEED, steady_state
from scenarios.association.figures_stationary import (
    against_branching_process,
    all_neighbourhoods,
    distributions,
    fractions,
)
from scenarios.figures import Paper

PAPER = Paper(
    name="ivanov-shell-2016",
    title="Ivanov & Shell 2016",
    figures={
        5: all_neighbourhoods("Mean steps to completion of all neighbourhoods"),
        6: distributions(),
        7: against_branching_process(20),
        8: against_branching_process(40),
        9: fractions(),
        10: over_time(MIX, FRACTION_MATCHED),
        11: over_time(MIX, RATIO),
        12: over_time(RANGE, FRACTION_MATCHED),
        13: over_time(RANGE, RATIO),
        14: over_time(SEPARATION, FRACTION_MATCHED),
        15: over_time(SEPARATION, RATIO),
        16: over_time(SPEED, FRACTION_MATCHED),
        17: over_time(SPEED, RATIO),
        20: steady_state(BY_RANGE, FRACTION_MATCHED),
        21: steady_state(BY_SEPARATION, FRACTION_MATCHED),
        22: steady_state(BY_SPEED, FRACTION_MATCHED),
        23: steady_state(BY_RANGE, RATIO),
        24: steady_state(BY_SEPARATION, RATIO),
        25: steady_state(BY_SPEED, RATIO),
    },
)
