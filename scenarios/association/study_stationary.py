"""Large samples of stationary association, all at once, without an i-state (Ivanov & Shell 2016, sec. 4).

An edge stays exactly while both its ends are active alike (Alg. 1, lines 15-16), so a visual id is matched
one step after the longest common prefix of its robot's activity string with that of any other robot in
range. Sorting the strings of a neighbourhood puts the nearest one next to each. No string is cut: those
that are equal as far as they were drawn are drawn on.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from agent.behaviours.association.istate import survival
from scenarios.study import Study, error_of_sums

Ints = NDArray[np.int64]
Words = NDArray[np.uint64]

WORD_BITS = 64
IDS_PER_CHUNK = 2**18
"""Activity strings held at once: as many as fit a processor's cache."""
HISTORY_CELLS = 2**21
"""Counts per sample and step held at once."""
LONGEST_AGREEMENT = 1000.0
"""Steps in which two robots are told apart, on average, beyond which a study is refused."""

Wireless = Annotated[int, Meta(ge=0, le=10_000, description="robots heard, w")]
Activity = Annotated[float, Meta(gt=0, le=1, description="probability that a robot transmits in a step")]
Colours = Annotated[int, Meta(ge=1, le=255, description="colours a lamp can show besides off")]


class StationaryParameters(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One neighbourhood."""

    wireless: Wireless = 20
    visual: Annotated[int, Meta(ge=0, le=10_000, description="robots seen, v, all of them heard")] = 10
    p: Activity = 0.5
    colours: Colours = 1


class NeighbourhoodParameters(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All neighbourhoods of one number of wireless ids."""

    wireless: Wireless = 20
    p: Activity = 0.5
    colours: Colours = 1


class Histories(Struct, frozen=True):
    """What a chunk of neighbourhoods has to tell; whole numbers, so that chunks add up exactly."""

    completions: Ints
    """Neighbourhoods completed at step t, index t."""
    matched: Ints
    """Visual ids matched after t steps, summed over the neighbourhoods."""
    matched_squared: Ints
    """The same of the squares."""


# --- the process ---------------------------------------------------------------------------------


def matched_steps(
    generator: np.random.Generator, wireless: int, samples: int, p: float = 0.5, colours: int = 1
) -> Ints:
    """Steps after which each id has no other candidate left; shape (samples, wireless).

    One row per neighbourhood of `wireless` robots, each of which sends a message pair with probability
    `p` in every step, in one of `colours` colours. Step 0 is the initial roll call, which does not count:
    with one robot only there is nothing to tell apart. The robots of a row are alike, so its first v
    entries are those of v visual ids. Exact: the strings have no end. Raises ValueError where robots hardly
    ever differ.
    """
    check_activity(p, colours)
    if wireless <= 1 or not samples:
        return np.zeros((samples, wireless), dtype=np.int64)
    code = _Code(wireless, p, colours)
    # The id in the lowest bits, under the activity string: sorting values is twice as fast as sorting places.
    packed = code.draw(generator, samples * wireless).reshape(samples, wireless)
    packed |= np.arange(wireless, dtype=np.uint64)
    packed.sort(axis=1)
    rows = np.repeat(np.arange(samples), wireless)
    flat = packed.ravel()
    ids = rows * wireless + (flat & ~code.mask).astype(np.int64)
    steps = np.zeros(samples * wireless, dtype=np.int64)
    _tell_apart(generator, code, steps, rows, ids, flat & code.mask)
    return steps.reshape(samples, wireless)


def completion_steps(matched: Ints) -> Ints:
    """Steps to completion with the first v ids of each row visible; shape (samples, wireless + 1), index v.

    Done is who has matched every visual id (sec. 4.1). One row serves every v: results for different v are
    right, each by itself, but not independent of each other.
    """
    none_visible = np.zeros((len(matched), 1), dtype=np.int64)
    return np.maximum.accumulate(np.concatenate([none_visible, matched], axis=1), axis=1)


def activity_words(generator: np.random.Generator, p: float, count: int) -> Words:
    """`count` words of 64 independent bits, each of which is set with probability `p` in [0, 1], exactly.

    Bit by bit a uniform number is compared with the binary digits of `p`, in all 64 places of a word at
    once, until it has turned out to be smaller (set) or greater in every place.
    """
    words = np.zeros(count, dtype=np.uint64)
    undecided = np.full(count, ~np.uint64(0))
    open_ = np.arange(count)
    rest = p
    while rest > 0 and open_.size:
        coins = generator.integers(0, 2**WORD_BITS, open_.size, dtype=np.uint64)
        rest *= 2
        if rest >= 1:
            rest -= 1
            words[open_] |= undecided & ~coins
            undecided &= coins
        else:
            undecided &= ~coins
        left = undecided != 0
        if not left.all():
            open_, undecided = open_[left], undecided[left]
    return words


class _Code:
    """How activity strings are written into words: steps from the highest bit down, ids below them."""

    def __init__(self, wireless: int, p: float, colours: int) -> None:
        self._p = p
        self._colours = colours
        self._bits = colours.bit_length()
        self.steps = (WORD_BITS - (wireless - 1).bit_length()) // self._bits
        self._shift = np.uint64(WORD_BITS - self.steps * self._bits)
        self.mask = ~np.uint64(0) << self._shift

    def draw(self, generator: np.random.Generator, count: int) -> Words:
        """So many strings of `steps` steps each."""
        if self._colours == 1:
            return activity_words(generator, self._p, count) & self.mask
        words = np.zeros(count, dtype=np.uint64)
        for _ in range(self.steps):
            shown = generator.integers(1, self._colours, count, dtype=np.uint64, endpoint=True)
            words = words << np.uint64(self._bits) | np.where(generator.random(count) < self._p, shown, 0)
        return words << self._shift

    def common_steps(self, difference: Words) -> Ints:
        """Steps before the first one that differs, of words given as their exclusive or."""
        # With the bit below each set bit cleared, rounding to a float cannot carry into the next power of 2.
        exponents = (difference & ~(difference >> np.uint64(1))).astype(np.float64).view(np.int64) >> 52
        zeros = np.where(difference == 0, WORD_BITS, WORD_BITS - 1 + 1023 - exponents)
        common: Ints = np.minimum(zeros // self._bits, self.steps)
        return common


def _tell_apart(
    generator: np.random.Generator, code: _Code, steps: Ints, groups: Ints, ids: Ints, words: Words
) -> None:
    """Fill in `steps` for `ids`, sorted by `groups` (who was equal so far) and `words` (what came next)."""
    before = 0
    while ids.size:
        common = code.common_steps(words[1:] ^ words[:-1])
        common[groups[1:] != groups[:-1]] = -1
        longest = np.full(ids.size, -1)
        longest[1:] = common
        np.maximum(longest[:-1], common, out=longest[:-1])
        told = longest < code.steps
        steps[ids[told]] = before + longest[told] + 1
        if told.all():
            return
        equal = np.concatenate([[False], common == code.steps])
        groups = np.cumsum(~equal)[~told]
        ids = ids[~told]
        words = code.draw(generator, ids.size)
        order = np.lexsort((words, groups))
        groups, ids, words = groups[order], ids[order], words[order]
        before += code.steps


# --- one neighbourhood ---------------------------------------------------------------------------


def check(parameters: StationaryParameters) -> None:
    """Raises ValueError for parameters that do not go together, naming the key."""
    check_inclusion(parameters.wireless, parameters.visual)
    check_activity(parameters.p, parameters.colours)


def check_inclusion(wireless: int, visual: int) -> None:
    """Raises ValueError where more robots are seen than heard."""
    if visual > wireless:
        raise ValueError(
            f"visual: {visual} robots are seen but only {wireless} heard, and who is seen "
            f"is heard here (channel inclusion); set visual to {wireless} or less"
        )


def check_activity(p: float, colours: int) -> None:
    """Raises ValueError where robots behave so much alike that it takes ages to tell them apart."""
    differ = 1 - survival(p, colours)
    if differ * LONGEST_AGREEMENT < 1:
        raise ValueError(
            f"p: with {p:g} two robots differ in less than one of {LONGEST_AGREEMENT:.0f} steps, and "
            "association hardly ever ends; choose a value nearer to 0.5"
        )


def chunk(parameters: StationaryParameters | NeighbourhoodParameters) -> int:
    """Neighbourhoods per chunk."""
    return max(1, IDS_PER_CHUNK // max(1, parameters.wireless))


def simulate(parameters: StationaryParameters, generator: np.random.Generator, samples: int) -> Histories:
    """So many neighbourhoods, until each is done."""
    steps = matched_steps(generator, parameters.wireless, samples, parameters.p, parameters.colours)
    steps = steps[:, : parameters.visual]
    done = steps.max(axis=1, initial=0)
    horizon = int(done.max()) + 1
    matched = np.zeros(horizon, dtype=np.int64)
    squared = np.zeros(horizon, dtype=np.int64)
    block = max(1, HISTORY_CELLS // horizon)
    for start in range(0, samples, block):
        part = steps[start : start + block]
        cells = np.arange(len(part))[:, np.newaxis] * horizon + part
        counts = np.bincount(cells.ravel(), minlength=len(part) * horizon)
        counts = counts.reshape(len(part), horizon).cumsum(axis=1)
        matched += counts.sum(axis=0)
        squared += (counts**2).sum(axis=0)
    return Histories(np.bincount(done, minlength=horizon), matched, squared)


def summarise(parameters: StationaryParameters, partials: list[Histories]) -> dict[str, Any]:
    """What was found, over all neighbourhoods.

    - `steps`: `mean`, `sd` and `se` of the steps to completion (`sd` and `se`: None below two samples);
    - `distribution`: how many were completed at step t, index t;
    - `fraction_matched`: `[mean, se]` of the fraction of visual ids matched after t steps, index t, up to
      the last step at which any neighbourhood was completed; empty where nobody is visible;
    - `samples`.
    """
    horizon = max(len(partial.completions) for partial in partials)
    completions, matched, squared = np.zeros((3, horizon), dtype=np.int64)
    for partial in partials:
        completions += _padded(partial.completions, horizon, 0)
        matched += _padded(partial.matched, horizon, partial.matched[-1])
        squared += _padded(partial.matched_squared, horizon, partial.matched_squared[-1])
    samples = int(completions.sum())
    visual = parameters.visual
    fractions = [
        [total / (samples * visual), error_of_sums(samples, total, square, visual)]
        for total, square in zip(matched.tolist(), squared.tolist(), strict=True)
        if visual
    ]
    return {
        "steps": steps_summary(completions),
        "distribution": completions.tolist(),
        "fraction_matched": fractions,
        "samples": samples,
    }


def steps_summary(completions: Ints) -> dict[str, float | None]:
    """`mean`, `sd` and `se` of steps of which `completions[t]` were t."""
    counts: list[int] = completions.tolist()
    samples = sum(counts)
    total = sum(step * count for step, count in enumerate(counts))
    square = sum(step * step * count for step, count in enumerate(counts))
    error = error_of_sums(samples, total, square)
    sd = None if error is None else error * math.sqrt(samples)
    return {"mean": total / samples, "sd": sd, "se": error}


def _padded(values: Ints, length: int, last: int) -> Ints:
    return np.concatenate([values, np.full(length - len(values), last)])


# --- all neighbourhoods of one size --------------------------------------------------------------


def check_all(parameters: NeighbourhoodParameters) -> None:
    """Raises ValueError for parameters that do not go together, naming the key."""
    check_activity(parameters.p, parameters.colours)


def simulate_all(parameters: NeighbourhoodParameters, generator: np.random.Generator, samples: int) -> Ints:
    """Neighbourhoods with v visible that were completed at step t; index (v, t), v = 0 ... wireless."""
    matched = matched_steps(generator, parameters.wireless, samples, parameters.p, parameters.colours)
    steps = completion_steps(matched)
    horizon = int(steps.max(initial=0)) + 1
    cells = np.arange(parameters.wireless + 1) * horizon + steps
    counts = np.bincount(cells.ravel(), minlength=(parameters.wireless + 1) * horizon)
    return counts.reshape(parameters.wireless + 1, horizon)


def summarise_all(parameters: NeighbourhoodParameters, partials: list[Ints]) -> dict[str, Any]:
    """Steps to completion: `steps`, a list of `mean`, `sd` and `se` with index v = 0 ... wireless; `samples`.

    All v were simulated with the same robots, so the means err together; each is right by itself.
    """
    horizon = max(partial.shape[1] for partial in partials)
    counts = np.zeros((parameters.wireless + 1, horizon), dtype=np.int64)
    for partial in partials:
        counts[:, : partial.shape[1]] += partial
    return {"steps": [steps_summary(row) for row in counts], "samples": int(counts[0].sum())}


STUDY = Study(
    name="association",
    title="Stationary association: steps to completion and fraction matched",
    parameters=StationaryParameters,
    samples=50_000,
    unit="runs",
    chunk=chunk,
    simulate=simulate,
    summarise=summarise,
    check=check,
)

NEIGHBOURHOODS = Study(
    name="association-neighbourhoods",
    title="Stationary association: steps to completion for every number of visual ids at once",
    parameters=NeighbourhoodParameters,
    samples=50_000,
    unit="runs",
    chunk=chunk,
    simulate=simulate_all,
    summarise=summarise_all,
    check=check_all,
)
"""For figures: one neighbourhood of w robots serves all v <= w."""
