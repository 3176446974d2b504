"""Parameters that studies of dissemination and of what builds on it have in common."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from msgspec import Meta

from agent.behaviours.dissemination.selection import MOST_ALPHA

SlotLength: TypeAlias = Annotated[int, Meta(ge=1, le=10_000, description="estimates in a slot")]
Alpha: TypeAlias = Annotated[
    float, Meta(ge=0, le=MOST_ALPHA, description="importance falls with distance to the power of -alpha")
]
Scheme: TypeAlias = Annotated[
    Literal["location", "location-probabilistic", "flooding", "own", "round-robin", "freshest-first"],
    Meta(description="which estimates a robot sends"),
]
NewEstimates: TypeAlias = Annotated[
    Literal["first", "literal", "true-distance"],
    Meta(description="what becomes of an estimate just learned, under location"),
]
Order: TypeAlias = Annotated[
    Literal["drawn", "fixed", "drawn_each_frame"],
    Meta(description="of the slots in a frame; drawn: once"),
]
BitRate: TypeAlias = Annotated[float, Meta(gt=0, le=1e9, description="of the radio [bit/s]")]
Bits: TypeAlias = Annotated[int, Meta(ge=1, le=1_000_000, description="of one estimate, b")]


def check_flooding(scheme: str, m: int, robots: int) -> None:
    """Raises ValueError where flooding is to go into slots that do not hold everything."""
    if scheme == "flooding" and m < robots:
        raise ValueError(
            f"m: flooding sends everything, so a slot must take {robots} estimates; set m to {robots}"
        )
