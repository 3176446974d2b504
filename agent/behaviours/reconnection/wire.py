"""Beliefs on the air: whole, or rounded with a known error. For what is too long for the radio: `pieces`.

| bytes | what |
|---|---|
| 1 | 1: rounded, 2: exact |
| 1 to 4 | S, the number of states, as a number |
| | which of the S states are possible (probability above 0), as marks |
| 8 each | exact: the probability of each possible state, and that is all |
| 1 | rounded: bits per level, 1 to 16 |
| 8 | ratio between levels, in (0, 1] |
| 8 | d, the probability of the states that are left out, all together |
| | which of the possible states are not left out, as marks |
| bits / 8 each, rounded up at the end | the level of each of those, most significant bit first |

Numbers: seven bits per byte, lowest first, the eighth set where another byte follows. Marks, whichever is
shorter: a 0 and a bit for each, eight per byte, filled up with 0; or a 1 and the lengths of runs as numbers,
in turns of those not marked (first, perhaps 0) and marked. Other values are float64, little-endian.

A state left out has an equal share of d: it stays possible, since in a merge (`belief.merged`) a 0 is a
certainty that no other belief overrules. A state of level l has a probability proportional to ratio^l; the
most probable one has level 0.
"""

from __future__ import annotations

import math

import numpy as np

from channels.graphs import Bools, Floats, Ints

BITS = 8
KEEP = 0.999

_ROUNDED, _EXACT = 1, 2
_BITMAP, _RUNS = 0, 1
_MOST_BITS = 16
_SUM_SLACK = 1e-6
_LEAST = np.nextafter(0.0, 1.0)
_REALS = np.dtype("<f8")


class WireError(ValueError):
    """Bytes that are no belief, or what does not fit into them."""


def encode(belief: Floats, *, bits: int = BITS, keep: float = KEEP) -> bytes:
    """A belief, rounded. `decode` gives the same states a probability above 0, no other, and errs by at most
    `error_bound` in total variation.

    `keep`: the least probable states, up to 1 - keep of it in all, are left out; `bits`: as many bits for
    the level of each of the others. Levels reach from the most to the least probable of these in equal
    ratios. Raises WireError for what is no probability distribution.
    """
    if not 1 <= bits <= _MOST_BITS:
        raise WireError(f"bits: must be 1 to {_MOST_BITS}, is {bits}")
    if not 0.5 <= keep <= 1 - 1e-9:
        raise WireError(f"keep: must be 0.5 to 1 - 1e-9, is {keep}; to keep all, send it exactly")
    possible = _possible(belief)
    values = belief[possible]
    order = np.argsort(values, kind="stable")
    left_out = int(np.searchsorted(np.cumsum(values[order]), 1 - keep, side="right"))
    kept = np.ones(len(values), dtype=bool)
    kept[order[:left_out]] = False
    # Depths below the most probable, in units of the logarithm.
    depths = np.log(values[order[-1]]) - np.log(values[kept])
    most = 2**bits - 1
    ratio = math.exp(-float(depths.max()) / most)
    levels = np.rint(depths / -math.log(ratio)) if ratio < 1 else np.zeros(len(depths))
    return b"".join(
        (
            bytes((_ROUNDED,)),
            _number(len(belief)),
            _marks(possible),
            bytes((bits,)),
            np.array([ratio, math.fsum(values[~kept])], dtype=_REALS).tobytes(),
            _marks(kept),
            _packed(np.clip(levels, 0, most).astype(np.int64), bits),
        )
    )


def error_bound(possible: int, *, bits: int = BITS, keep: float = KEEP) -> float:
    """The most by which rounding can change a belief, in total variation: half the sum of |differences|.

    With d = 1 - keep, n possible states and L = 2^bits - 1, it is d + tanh(ln(n / d) / (4 L)), for 1,800
    states with 8 bits and d = 0.001 some 0.015. That is:

    - Those left out have d' <= d in all, before as after, so they differ by d' at most; those kept have
      1 - d' in all.
    - The least probable state kept would have brought d' above d: all states up to it, n at most and none
      more probable, have more than d, so it has more than d / n. Depths below the most probable hence are
      less than ln(n / d), and levels are less than h = ln(n / d) / L apart.
    - Each of those kept is rounded by h / 2 at most. So the ratios r of what is decoded to what was
      encoded, given that the state is kept, lie between some m <= 1 and M >= 1 with M / m <= e^h, their
      mean being 1. The total variation is the mean of max(0, r - 1), which is convex in r, and thus at
      most what it is if r is m or M only: (M - 1)(1 - m) / (M - m). For given M / m this is largest at
      m M = 1, namely tanh(h / 4).

    What is rounded in computing comes on top: less than 1e-9.
    """
    d = 1 - keep
    return d + math.tanh(math.log(possible / d) / (4 * (2**bits - 1)))


def exact(belief: Floats) -> bytes:
    """A belief to the last bit. Raises WireError for what is no probability distribution."""
    possible = _possible(belief)
    head = bytes((_EXACT,)) + _number(len(belief)) + _marks(possible)
    return head + belief[possible].astype(_REALS).tobytes()


def decode(states: int, blob: bytes) -> Floats:
    """The belief over so many states that `encode` or `exact` made these bytes of: (S,).

    The same on every machine, to the last bit. Raises WireError for what neither can have made; nothing
    larger than S is made before it is known to be sound.
    """
    rest = _Rest(blob)
    kind = rest.byte()
    if kind not in (_ROUNDED, _EXACT):
        raise WireError(f"belief: there is no kind {kind}")
    if (told := rest.number()) != states:
        raise WireError(f"belief: it is over {told} states, not {states}")
    possible = rest.marks(states)
    count = int(np.count_nonzero(possible))
    if count == 0:
        raise WireError("belief: no state is possible")
    values = rest.reals(count) if kind == _EXACT else _rounded(rest, count)
    rest.end()
    if not (np.all(np.isfinite(values)) and np.all(values > 0)):
        raise WireError("belief: a probability is not above 0")
    if abs(math.fsum(values) - 1) > _SUM_SLACK:
        raise WireError("belief: probabilities do not sum to 1")
    belief = np.zeros(states)
    belief[possible] = values
    return belief


def _rounded(rest: _Rest, count: int) -> Floats:
    bits = rest.byte()
    if not 1 <= bits <= _MOST_BITS:
        raise WireError(f"belief: levels of {bits} bits")
    ratio, left_out = rest.reals(2).tolist()
    kept = rest.marks(count)
    number = int(np.count_nonzero(kept))
    if not (0 < ratio <= 1 and 0 <= left_out < 1 and number and (left_out > 0) == (number < count)):
        raise WireError("belief: what is left out does not fit")
    levels = rest.levels(number, bits)
    if levels.min() > 0:
        raise WireError("belief: no state has level 0")
    shares = _powers(ratio, levels, bits)
    values = np.empty(count)
    values[kept] = shares * ((1 - left_out) / math.fsum(shares))
    values[~kept] = max(left_out / max(count - number, 1), _LEAST)
    return values


def _powers(ratio: float, levels: Ints, bits: int) -> Floats:
    """ratio^level by multiplications only, which are the same everywhere; `exp` and `pow` are not."""
    found = np.ones(len(levels))
    for bit in range(bits):
        found[levels >> bit & 1 == 1] *= ratio
        ratio *= ratio
    return found


def _possible(belief: Floats) -> Bools:
    if belief.ndim != 1 or not np.all(belief >= 0) or not abs(belief.sum() - 1) <= _SUM_SLACK / 10:
        raise WireError("belief: must be probabilities that sum to 1")
    return belief > 0


def _number(value: int) -> bytes:
    found = bytearray()
    while value >= 128:
        found.append(value & 127 | 128)
        value >>= 7
    found.append(value)
    return bytes(found)


def _marks(marks: Bools) -> bytes:
    bitmap = bytes((_BITMAP,)) + np.packbits(marks).tobytes()
    changes = np.flatnonzero(np.diff(marks, prepend=False, append=not marks[-1]))
    lengths = np.diff(changes, prepend=0).tolist()
    runs = bytes((_RUNS,)) + b"".join(map(_number, lengths))
    return min(runs, bitmap, key=len)


def _packed(levels: Ints, bits: int) -> bytes:
    return np.packbits(levels[:, None] >> np.arange(bits - 1, -1, -1) & 1).tobytes()


class _Rest:
    """What is still to be read; whatever is asked for and is not there is a WireError."""

    def __init__(self, blob: bytes) -> None:
        self._blob = blob
        self._at = 0

    def _take(self, size: int) -> bytes:
        taken = self._blob[self._at : self._at + size]
        if len(taken) < size:
            raise WireError("belief: it is cut off")
        self._at += size
        return taken

    def end(self) -> None:
        if self._at != len(self._blob):
            raise WireError("belief: more follows")

    def byte(self) -> int:
        return self._take(1)[0]

    def number(self) -> int:
        value = 0
        for shift in (0, 7, 14, 21):
            byte = self.byte()
            value |= (byte & 127) << shift
            if byte < 128:
                return value
        raise WireError("belief: a number is too long")

    def reals(self, count: int) -> Floats:
        return np.frombuffer(self._take(8 * count), dtype=_REALS).astype(np.float64)

    def levels(self, count: int, bits: int) -> Ints:
        each = self._bits(count * bits).reshape(count, bits)
        return each @ (1 << np.arange(bits - 1, -1, -1))

    def marks(self, count: int) -> Bools:
        kind = self.byte()
        if kind == _BITMAP:
            return np.asarray(self._bits(count) == 1)
        if kind != _RUNS:
            raise WireError(f"belief: there are no marks of kind {kind}")
        marks = np.zeros(count, dtype=bool)
        at, marked = 0, False
        while at < count:
            length = self.number()
            if at + length > count or (length == 0 and at > 0):
                raise WireError("belief: a run has no room")
            marks[at : at + length] = marked
            at, marked = at + length, not marked
        return marks

    def _bits(self, count: int) -> Ints:
        bits = np.unpackbits(np.frombuffer(self._take((count + 7) // 8), dtype=np.uint8)).astype(np.int64)
        if bits[count:].any():
            raise WireError("belief: bits that are left over are not 0")
        return bits[:count]
