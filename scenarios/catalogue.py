"""What there is to predict, to study and to reproduce, by the names users call it.

Modules are named, not imported: nobody who runs a scenario waits for SciPy and matplotlib.
"""

from __future__ import annotations

from difflib import get_close_matches
from importlib import import_module
from typing import Any

from emulator.errors import UserError

PREDICTIONS = {
    "association": "scenarios.association.predictions:ASSOCIATION",
    "association-mobile": "scenarios.association.predictions:ASSOCIATION_MOBILE",
    "frame-rate": "scenarios.dissemination.predictions:PREDICTION",
}
STUDIES = {
    "association": "scenarios.association.study_stationary:STUDY",
    "association-mobile": "scenarios.association.study_mobile:STUDY",
    "association-noisy": "scenarios.association.study_noisy:STUDY",
    "age": "scenarios.dissemination.study_age:STUDY",
    "age-emulated": "scenarios.dissemination.emulated:AGE",
    "coverage": "scenarios.coverage.study_coverage:STUDY",
    "coverage-emulated": "scenarios.coverage.emulated:EMULATED",
    "propagation": "scenarios.dissemination.study_propagation:STUDY",
    "propagation-emulated": "scenarios.dissemination.emulated:PROPAGATION",
    "reconnection": "scenarios.reconnection.study_reconnection:STUDY",
    "reconnection-emulated": "scenarios.reconnection.emulated:EMULATED",
    "reuse": "scenarios.dissemination.study_reuse:STUDY",
}
PAPERS = {
    "ivanov-shell-2014": "scenarios.association.paper_2014:PAPER",
    "ivanov-shell-2016": "scenarios.association.paper_2016:PAPER",
    "julian-2009": "scenarios.dissemination.paper_2009:PAPER",
    "vandermeulen": "scenarios.reconnection.paper:PAPER",
}


def find(kind: str, listed: dict[str, str], name: str) -> Any:
    """The thing of this name. Raises UserError where there is none, or a package it needs is missing."""
    if name not in listed:
        near = get_close_matches(name, listed, n=1)
        hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(sorted(listed))}"
        raise UserError(f"{name}: there is no {kind} of this name, {hint}")
    module, _, attribute = listed[name].partition(":")
    try:
        return getattr(import_module(module), attribute)
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package not in ("matplotlib", "networkx", "numba", "scipy", "shapely"):
            raise
        raise UserError(f"{name}: needs {package}; install heliograph[desk,figures]") from None
