"""Beliefs on the air, byte by byte; what is refused; what a belief costs."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest

from agent.behaviours.reconnection import belief as beliefs
from agent.behaviours.reconnection import pieces, wire
from agent.behaviours.reconnection.model import walk_model, ways_of
from agent.behaviours.reconnection.wire import WireError
from channels.graphs import Floats, Graph

BELIEF = np.array([0.0, 0.5, 0.0, 0.25, 0.25])
EXACT = bytes((2, 5, 0, 0b01011000)) + struct.pack("<3d", 0.5, 0.25, 0.25)


def _grid(width: int, height: int) -> Graph:
    cells = [(x, y) for y in range(height) for x in range(width)]
    across = [(y * width + x, y * width + x + 1, 1.0) for x, y in cells if x + 1 < width]
    up = [(y * width + x, y * width + x + width, 1.0) for x, y in cells if y + 1 < height]
    return Graph(vertices=tuple((float(x), float(y)) for x, y in cells), edges=(*across, *up))


def _after(steps: int) -> Floats:
    """What is believed on a grid of 150 vertices of a robot that was in the corner so long ago."""
    graph = _grid(15, 10)
    model = walk_model(graph, ways_of(graph, 2))
    belief = beliefs.at_vertex(model, 0)
    for _ in range(steps):
        belief = beliefs.advanced(model, belief)
    return belief


def test_exact_bytes_by_hand() -> None:
    assert wire.exact(BELIEF) == EXACT
    assert wire.decode(5, EXACT).tolist() == BELIEF.tolist()


def test_rounded_bytes_by_hand() -> None:
    """One bit: level 0 for 1/2, level 1 for 3/20 and, since 1/5 is nearer to that by ratio, for 1/5.

    The other 3/20 is left out of keep = 0.8; of what is kept, 0.85, shares are 1 : 3/10 : 3/10.
    """
    raw = wire.encode(np.array([0.5, 0.0, 0.2, 0.15, 0.15]), bits=1, keep=0.8)
    ratio, left_out = struct.unpack("<2d", raw[5:21])
    assert raw[:5] == bytes((1, 5, 0, 0b10111000, 1))
    assert (ratio, left_out) == (pytest.approx(0.3), 0.15)
    assert raw[21:] == bytes((0, 0b11010000, 0b01100000))
    share = 0.85 / (1 + 0.3 + 0.3)
    assert wire.decode(5, raw) == pytest.approx([share, 0, 0.3 * share, 0.15, 0.3 * share])


def test_runs_where_they_are_shorter() -> None:
    belief = np.zeros(1000)
    belief[300:302] = 0.5
    raw = wire.exact(belief)
    assert raw[:3] == bytes((2, 0b11101000, 7))  # 1000 = 104 + 7 * 128
    assert raw[3:-16] == bytes((1, 0b10101100, 2, 2, 0b10111010, 5))  # 300 not, 2 marked, 698 not
    assert np.array_equal(wire.decode(1000, raw), belief)


def test_a_certain_belief_is_short_and_whole() -> None:
    belief = np.zeros(1800)
    belief[0] = 1.0
    assert len(wire.encode(belief)) < 40
    assert np.array_equal(wire.decode(1800, wire.encode(belief)), belief)


def test_equal_probabilities_survive() -> None:
    belief = np.full(1800, 1 / 1800)
    assert wire.decode(1800, wire.encode(belief, keep=1 - 1e-9)) == pytest.approx(belief, rel=1e-12)


@pytest.mark.parametrize("steps", [5, 50, 200])
@pytest.mark.parametrize(("bits", "keep"), [(4, 0.99), (8, 0.999), (12, 0.9999)])
def test_what_a_belief_costs(steps: int, bits: int, keep: float) -> None:
    belief = _after(steps)
    raw = wire.encode(belief, bits=bits, keep=keep)
    possible = int(np.count_nonzero(belief))
    assert len(raw) <= 30 + 2 * (len(belief) / 8) + possible * bits / 8
    got = wire.decode(len(belief), raw)
    assert np.abs(got - belief).sum() / 2 <= wire.error_bound(possible, bits=bits, keep=keep)
    assert len(raw) < len(wire.exact(belief))


def test_the_bound_is_within_twice_of_what_can_happen() -> None:
    """Half the probability is rounded up as far as can be, half down; the least is hardly kept."""
    keep, bits = 1 - 1e-9, 4
    least = 1.1e-9
    depth = -math.log(4 * least) / (2**bits - 1) / 2  # of the border between levels 0 and 1
    near = np.array([1.0, *[math.exp(-depth * 0.99)] * 2, *[math.exp(-depth * 1.03)] * 2])
    belief = np.array([*near / near.sum() * (1 - least), least])
    error = np.abs(wire.decode(6, wire.encode(belief, bits=bits, keep=keep)) - belief).sum() / 2
    bound = wire.error_bound(6, bits=bits, keep=keep)
    assert bound / 2 < error <= bound


def test_more_bits_err_less() -> None:
    belief = _after(50)
    errors = [
        float(np.abs(wire.decode(1800, wire.encode(belief, bits=bits, keep=1 - 1e-9)) - belief).sum())
        for bits in (2, 4, 8, 16)
    ]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 1e-3 * errors[0]


def _changed(raw: bytes, at: int, new: bytes) -> bytes:
    return raw[:at] + new + raw[at + len(new) :]


ROUNDED = wire.encode(np.array([0.5, 0.0, 0.25, 0.125, 0.125]), bits=2, keep=0.8)


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        (b"", "cut off"),
        (EXACT[:-1], "cut off"),
        (EXACT + b"\0", "more follows"),
        (_changed(EXACT, 0, b"\3"), "no kind 3"),
        (_changed(EXACT, 1, b"\6"), "over 6 states, not 5"),
        (b"\2" + b"\xff" * 5, "number is too long"),
        (_changed(EXACT, 2, b"\2"), "marks of kind 2"),
        (_changed(EXACT, 3, b"\x5c"), "left over"),
        (bytes((2, 5, 0, 0)), "no state is possible"),
        (bytes((2, 5, 1, 5)), "no state is possible"),
        (bytes((2, 5, 1, 1, 5)), "no room"),
        (bytes((2, 5, 1, 1, 0, 4)), "no room"),
        (_changed(EXACT, 4, struct.pack("<d", math.nan)), "not above 0"),
        (_changed(EXACT, 4, struct.pack("<d", -0.5)), "not above 0"),
        (_changed(EXACT, 4, struct.pack("<d", 0.0)), "not above 0"),
        (_changed(EXACT, 4, struct.pack("<d", 0.75)), "sum to 1"),
        (_changed(EXACT, 4, struct.pack("<d", math.inf)), "not above 0"),
        (_changed(ROUNDED, 4, b"\0"), "levels of 0 bits"),
        (_changed(ROUNDED, 4, b"\x11"), "levels of 17 bits"),
        (_changed(ROUNDED, 5, struct.pack("<d", math.nan)), "does not fit"),
        (_changed(ROUNDED, 5, struct.pack("<d", 1.5)), "does not fit"),
        (_changed(ROUNDED, 5, struct.pack("<d", 1e-200)), "not above 0"),
        (_changed(ROUNDED, 13, struct.pack("<d", 0.0)), "does not fit"),
        (_changed(ROUNDED, 13, struct.pack("<d", 1.0)), "does not fit"),
        (_changed(ROUNDED, 22, b"\0"), "does not fit"),
        (_changed(ROUNDED, 23, b"\xfc"), "no state has level 0"),
    ],
)
def test_what_is_no_belief(raw: bytes, message: str) -> None:
    with pytest.raises(WireError, match=message):
        wire.decode(5, raw)


@pytest.mark.parametrize("values", [[0.5, 0.4], [1.5, -0.5], [math.nan, 1.0], [math.inf, 0.0], []])
def test_only_beliefs_are_sent(values: list[float]) -> None:
    for send in (wire.encode, wire.exact):
        with pytest.raises(WireError, match="probabilities that sum to 1"):
            send(np.array(values))


def test_only_known_roundings() -> None:
    for options, message in (
        ({"bits": 0}, "bits"),
        ({"bits": 17}, "bits"),
        ({"keep": 1.0}, "exactly"),
        ({"keep": math.nan}, "keep"),
    ):
        with pytest.raises(WireError, match=message):
            wire.encode(BELIEF, **options)


def test_pieces_by_hand() -> None:
    one, other = pieces.split(b"123456789", 13)
    check = bytes.fromhex("cbf43926")  # of CRC-32, published
    assert one == b"\0\0\0\2" + check + b"12345"
    assert other == b"\0\1\0\2" + check + b"6789"
    assert pieces.joined([other, one]) == b"123456789"
    assert pieces.piece_of(other) == (1, 2, 0xCBF43926)
    assert pieces.joined(pieces.split(b"", 9)) == b""


def test_pieces_that_do_not_fit() -> None:
    one, other = pieces.split(b"123456789", 13)
    foreign, _ = pieces.split(b"12345678x", 13)
    for given, message in (
        ([], "not of one message"),
        ([one], "1 of a message of 2"),
        ([one, one], "1 of them different"),
        ([one, one, other], "3 of a message of 2"),
        ([foreign, other], "not of one message"),
        ([one, other[:-1]], "damaged"),
        ([one, b"\0\2" + other[2:]], "number 2 of 2"),
        ([one, b"\0\0"], "too few"),
    ):
        with pytest.raises(pieces.PieceError, match=message):
            pieces.joined(given)
    for blob, limit in ((b"1", 8), (b"", 8), (b"1" * 65_536, 9)):
        with pytest.raises(pieces.PieceError, match="too small"):
            pieces.split(blob, limit)
