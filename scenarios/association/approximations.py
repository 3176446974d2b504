"""What the papers approximate the completion time by, and what their deterministic algorithms cost."""

from __future__ import annotations

import math
from collections.abc import Collection

from scenarios.association.theory import agreement, check_neighbourhood


def branching_process_time(wireless: int, visual: int, p: float = 0.5, colours: int = 1) -> float:
    """Steps until wv - v false edges are extinct: ln(wv - v) / |ln m| (2016, Eq. 1); m = 1/2 at p = 1/2.

    0 where there is no false edge.
    """
    check_neighbourhood(wireless, visual, p, colours)
    false_edges = wireless * visual - visual
    return math.log(false_edges) / abs(math.log(agreement(p, colours))) if false_edges else 0.0


def fits(wireless: int, visual: int) -> dict[str, float]:
    """The approximations of 2014, "Probabilistic Algorithm", for p = 1/2, in steps; h = wireless, s = visual.

    - `log_product`: 2 log2(h) log2(s+1), as printed. Several times too large.
    - `log_product_root`: 2 sqrt(log2(h) log2(s+1)). Of the readings with a square root it is the one near
      the exact mean: over h in [2, 40], s in [1, h-1] its error has a root mean square of 0.94 steps; for
      sqrt(2 log2(h) log2(s+1)) that is 3.2, with the root over one factor only 7.5 to 9.0, as printed 27.
    - `arsinh`: arsinh(hs), 2.6 steps too small on average over the same range.
    """
    check_neighbourhood(wireless, visual, 0.5, 1)
    product = math.log2(wireless) * math.log2(visual + 1) if wireless else 0.0
    return {
        "log_product": 2 * product,
        "log_product_root": 2 * math.sqrt(product),
        "arsinh": math.asinh(wireless * visual),
    }


def naive_cost(possible_ids: int, ids_in_use: Collection[int] | None = None) -> dict[str, int]:
    """Steps and messages of the naive algorithm (2014, Alg. 1): one step per id that there could be.

    `ids_in_use` None: all of 0 ... n-1. Returns `steps` (n), `messages` (one a robot), `messages_bound` (n).
    Raises ValueError for an id out of range.
    """
    used = _ids(possible_ids, ids_in_use)
    return {"steps": possible_ids, "messages": len(used), "messages_bound": possible_ids}


def logarithmic_cost(possible_ids: int, ids_in_use: Collection[int] | None = None) -> dict[str, float]:
    """Steps and messages of the logarithmic algorithm (2014, Alg. 2): one step per bit of the ids 0 ... n-1.

    Returns `steps` (ceil(log2 n)), `messages` (all ones in the ids in use; id 0 never flashes) and
    `messages_bound` (n log2(n) / 2, as in the paper; ids 0 ... n-1 reach it where n is a power of 2).
    """
    used = _ids(possible_ids, ids_in_use)
    return {
        "steps": max(0, possible_ids - 1).bit_length(),
        "messages": sum(number.bit_count() for number in used),
        "messages_bound": possible_ids * math.log2(possible_ids) / 2 if possible_ids else 0.0,
    }


def _ids(possible_ids: int, ids_in_use: Collection[int] | None) -> Collection[int]:
    if possible_ids < 0:
        raise ValueError(f"ids: {possible_ids} is too few; give 0 or more")
    used = range(possible_ids) if ids_in_use is None else set(ids_in_use)
    for number in used:
        if not 0 <= number < possible_ids:
            raise ValueError(f"ids: {number} is not an id; give numbers from 0 to {possible_ids - 1}")
    return used
