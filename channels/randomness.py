"""Counter-based randomness: every draw answers one question and is a pure function of it.

A generator with a state (`random`, `numpy.random`) hands out its n-th number to whoever asks n-th, so
one more robot, or two checks in another order, changes every draw that follows. Here a draw is a hash
of (seed, stream, words): "does message 7 of r03 reach r05" has the same answer whoever asks, whenever,
in a batch of whatever shape, and in whatever team. Two runs that differ in one parameter therefore share
all other draws (common random numbers) and can be compared one by one.

The hash chains SplitMix64 (Steele, Lea & Flood, "Fast splittable pseudorandom number generators",
OOPSLA 2014; finaliser: Stafford's variant 13): each word w replaces the state s by output number w of a
SplitMix64 seeded with s. Counter-based generation as such: Salmon et al., "Parallel random numbers: as
easy as 1, 2, 3", SC 2011. Not for cryptography.
"""

from __future__ import annotations

from collections.abc import Iterable
from hashlib import blake2b
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

UInts: TypeAlias = NDArray[np.uint64]
Floats: TypeAlias = NDArray[np.float64]
Word: TypeAlias = "int | np.integer[Any] | NDArray[np.integer[Any]]"
"""One part of a question: a number, or an array of them; reduced modulo 2**64."""

_MASK = 2**64 - 1
_GAMMA = 0x9E3779B97F4A7C15
_FIRST = 0xBF58476D1CE4E5B9
_SECOND = 0x94D049BB133111EB


def stable_key(name: str) -> int:
    """64-bit number of a name, the same in every process (unlike `hash`) and on every machine."""
    return int.from_bytes(blake2b(name.encode(), digest_size=8).digest(), "little")


def stable_keys(names: Iterable[str]) -> UInts:
    """`stable_key` of every name, as a uint64 array."""
    return np.array([stable_key(name) for name in names], dtype=np.uint64)


class Draws:
    """The draws of one stream of one seed, for example Draws(4711, "loss")."""

    def __init__(self, seed: int, stream: str) -> None:
        self._key = stable_key(f"{seed}/{stream}")

    @classmethod
    def of_key(cls, key: int) -> Draws:
        """The draws of a stream whose key somebody else has made: it tells nothing of the seed."""
        draws = cls.__new__(cls)
        draws._key = key
        return draws

    @property
    def key(self) -> int:
        """What `of_key` takes; below 2**64."""
        return self._key

    def bits(self, *words: Word) -> UInts:
        """64 random bits per question: uint64, of the shape the words broadcast to."""
        return _shaped(_chain(self._key, words), words)

    def uniform(self, *words: Word) -> Floats:
        """Uniform in [0, 1) with 53 bits: float64, of the shape the words broadcast to."""
        return _unit(self.bits(*words))

    def normal(self, *words: Word) -> Floats:
        """Standard normal: float64, of the shape the words broadcast to.

        Box & Muller 1958, from two uniform draws. The last bit depends on the CPU's `log` and `cos`:
        quantise what is recorded.
        """
        state = _chain(self._key, words)
        radius = _unit(_shaped(_link(state, 0), words))
        angle = _unit(_shaped(_link(state, 1), words))
        # 1 - u lies in (0, 1], so the logarithm is finite.
        return np.asarray(np.sqrt(-2.0 * np.log1p(-radius)) * np.cos(2.0 * np.pi * angle))


def _unit(bits: UInts) -> Floats:
    return np.asarray((bits >> np.uint64(11)) * 2.0**-53)


def _shaped(bits: int | UInts, words: Iterable[Word]) -> UInts:
    """Give back the leading axes of length 1 that `_link` dropped with words of a single element."""
    shaped = np.asarray(bits, dtype=np.uint64)
    missing = max((word.ndim for word in words if isinstance(word, np.ndarray)), default=0) - shaped.ndim
    return shaped.reshape((1,) * missing + shaped.shape) if missing > 0 else shaped


def _chain(state: int | UInts, words: Iterable[Word]) -> int | UInts:
    for word in words:
        state = _link(state, word)
    return state


def _link(state: int | UInts, word: Word) -> int | UInts:
    """Output number `word`, counted from 0, of a SplitMix64 seeded with `state`."""
    # A single word is computed with as an integer: a prefix that all questions share costs no array, and
    # numpy's scalars, unlike its arrays, warn when they wrap around.
    if not isinstance(word, np.ndarray) or word.size == 1:
        step = ((word if isinstance(word, int) else int(word.item())) + 1) * _GAMMA & _MASK
        if isinstance(state, int):
            return _finalise(state + step & _MASK)
        return _finalise_in_place(state + step)
    steps = word.astype(np.uint64) * _GAMMA
    if isinstance(state, int):
        steps += state + _GAMMA & _MASK
        return _finalise_in_place(steps)
    return _finalise_in_place(steps + (state + _GAMMA))


def _finalise(z: int) -> int:
    z = (z ^ z >> 30) * _FIRST & _MASK
    z = (z ^ z >> 27) * _SECOND & _MASK
    return z ^ z >> 31


def _finalise_in_place(z: UInts) -> UInts:
    z ^= z >> 30
    z *= _FIRST
    z ^= z >> 27
    z *= _SECOND
    z ^= z >> 31
    return z
