"""What theory says of channel association: `heliograph predict association` and `association-mobile`."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any, Literal

from msgspec import Meta, Struct

from scenarios.association.approximations import branching_process_time, fits, logarithmic_cost, naive_cost
from scenarios.association.mobile_batches import NewIds, batch_model, new_ids
from scenarios.association.mobile_models import (
    MobileSystem,
    fraction_matched_corrected,
    fraction_matched_literal,
    multi_region_model,
    new_false_edges,
    overlap_area,
    two_region_model,
)
from scenarios.association.theory import (
    CompletionLaw,
    check_neighbourhood,
    exact_lower_bound,
    fraction_matched,
    fraction_matched_model,
    lower_bound,
)
from scenarios.prediction import Prediction

CUT = 1e-12
"""Arrays end where the probability not to be done falls below this."""
LEVELS = (0.05, 0.25, 0.5, 0.75, 0.9, 0.95, 0.99)


class PredictAssociation(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A neighbourhood of robots that stand still."""

    wireless: Annotated[int, Meta(ge=1, le=1000, description="wireless ids in range, w")]
    visual: Annotated[int, Meta(ge=1, le=1000, description="visual ids in range, v, all of them heard")]
    p: Annotated[float, Meta(ge=0, le=1, description="probability that a robot transmits in a step")] = 0.5
    colours: Annotated[int, Meta(ge=1, le=255, description="colours a lamp can show besides off")] = 1
    ids: (
        Annotated[
            int,
            Meta(
                ge=1, le=2**20, description="ids in the whole system, all in use, for naive and logarithmic"
            ),
        ]
        | None
    ) = None
    """None: those of this neighbourhood and of its observer."""


class PredictMobile(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Robots in motion; lengths in robot diameters. The defaults are the paper's (2016, sec. 5.5)."""

    range: Annotated[float, Meta(gt=0, le=1e6, description="radius of both channels")] = 16.0
    speed: Annotated[float, Meta(gt=0, le=1e6, description="diameters the observer drives in a step")] = 1.4
    separation: Annotated[float, Meta(gt=0, le=1e6, description="of the grid that robots stand on")] = 4.0
    mobile_fraction: Annotated[
        float, Meta(ge=0, le=1, description="of the other robots; only the refined model knows it")
    ] = 0.05
    variance: Annotated[
        Literal["listed", "frontier", "poisson"],
        Meta(description="Var[v_new] in Eq. 10: of ids newly listed, of robots in the frontier, or the mean"),
    ] = "listed"
    new_ids_variance: Annotated[float, Meta(ge=0, description="Var[v_new] as a number")] | None = None
    """None: as `variance` says."""


def predict_association(params: PredictAssociation) -> dict[str, Any]:
    """The exact law, and what the papers have beside it. Steps do not count the initial one.

    - `expected_steps`, `sd`, `quantiles` (level -> steps): exact
    - `cdf`, `fraction_matched` (index t = 0, 1, ...): exact
    - `fraction_matched_model`: 2016, Eqs. 2 and 3, with w = v as in the paper
    - `branching_process`: 2016, Eq. 1; `fits`: 2014 (empty unless p = 1/2 with one colour)
    - `errors`: of these, minus the exact mean
    - `lower_bound`: 2014, ceil(log2 v); `exact_lower_bound`: fewest steps of positive probability
    - `messages_per_robot`: expected message pairs up to then, without the initial one
    - `naive`, `logarithmic`: steps and messages of the deterministic algorithms for `ids`, all in use

    Raises ValueError for a neighbourhood that is none, or never completes.
    """
    w, v, p, colours = params.wireless, params.visual, params.p, params.colours
    check_association(params)
    law = CompletionLaw(w, v, p, colours)
    end = int((law.survival >= CUT).sum())
    time = branching_process_time(w, v, p, colours)
    fitted = fits(w, v) if p == 0.5 and colours == 1 else {}
    ids = w + 1 if params.ids is None else params.ids
    return {
        "wireless": w,
        "visual": v,
        "p": p,
        "colours": colours,
        "expected_steps": law.mean,
        "sd": law.sd,
        "quantiles": {str(level): law.quantile(level) for level in LEVELS},
        "cdf": law.cdf[: end + 1].tolist(),
        "fraction_matched": fraction_matched(w, end, p, colours).tolist(),
        "fraction_matched_model": fraction_matched_model(w, end, p, colours).tolist(),
        "branching_process": time,
        "fits": fitted,
        "errors": {name: value - law.mean for name, value in {"branching_process": time, **fitted}.items()},
        "lower_bound": lower_bound(v),
        "exact_lower_bound": exact_lower_bound(w, v, colours),
        "messages_per_robot": p * law.mean,
        "naive": naive_cost(ids),
        "logarithmic": logarithmic_cost(ids),
    }


def predict_association_mobile(params: PredictMobile) -> dict[str, Any]:
    """Steady state by the paper's models, as printed (`literal`) and without their faults (`corrected`).

    Both hold `fraction_matched` (sec. 5.7; None where the printed formula has no value) and the `ratio` of
    total to true edges by the `two_region` and the `multi_region` model (sec. 5.8); `refined` is the model of
    `mobile_batches`, the only one that knows `mobile_fraction`. `geometry` has the area of Eq. 5 and expected
    robots, `new_ids` means and variances of what is new in a step.

    Raises ValueError for a geometry or a variance that cannot be.
    """
    system = MobileSystem(params.range, params.speed, params.separation)
    new = new_ids(system)
    variance = _variance(params, new)
    multi_region = multi_region_model(system, variance).ratio()
    populations = system.regions()
    return {
        "range": params.range,
        "speed": params.speed,
        "separation": params.separation,
        "mobile_fraction": params.mobile_fraction,
        "geometry": {
            "overlap_area": float(overlap_area(params.range, params.speed)),
            "age_regions": len(populations),
            "robots_in_range": float(populations.sum()),
            "robots_by_age": populations.tolist(),
        },
        "new_ids": {
            "mean": new.mean,
            "variance_used": variance,
            "frontier_variance": new.frontier_variance,
            "listed_mean": new.listed_mean,
            "listed_variance": new.listed_variance,
        },
        "literal": {
            "fraction_matched": fraction_matched_literal(system),
            "fraction_matched_eq_10": fraction_matched_literal(system, variance),
            "ratio": {
                "two_region": two_region_model(system, variance, corrected=False).ratio(),
                "multi_region": multi_region,
            },
        },
        "corrected": {
            "fraction_matched": fraction_matched_corrected(system, variance),
            "ratio": {
                "two_region": two_region_model(system, variance, corrected=True).ratio(),
                "multi_region": multi_region,
            },
        },
        "refined": asdict(batch_model(system, params.mobile_fraction)),
    }


def check_association(params: PredictAssociation) -> None:
    """Raise ValueError, "key: what is wrong and what helps", for parameters that do not go together."""
    check_neighbourhood(params.wireless, params.visual, params.p, params.colours)
    if params.ids is not None and params.ids < params.wireless:
        raise ValueError(
            f"ids: {params.ids} are fewer than the ids in range; give at least {params.wireless}"
        )


def check_mobile(params: PredictMobile) -> None:
    """Raise ValueError, "key: what is wrong and what helps", for parameters that do not go together."""
    system = MobileSystem(params.range, params.speed, params.separation)
    if params.new_ids_variance is not None:
        new_false_edges(system.new_ids(), params.new_ids_variance)


ASSOCIATION = Prediction(
    name="association",
    title="Steps to complete the association, and fraction matched, for robots that stand still",
    parameters=PredictAssociation,
    predict=predict_association,
    check=check_association,
)
ASSOCIATION_MOBILE = Prediction(
    name="association-mobile",
    title="Fraction matched and ratio of total to true edges for moving robots, by the models of 2016",
    parameters=PredictMobile,
    predict=predict_association_mobile,
    check=check_mobile,
)


def _variance(params: PredictMobile, new: NewIds) -> float:
    if params.new_ids_variance is not None:
        return params.new_ids_variance
    return {"listed": new.listed_variance, "frontier": new.frontier_variance, "poisson": new.mean}[
        params.variance
    ]
