"""Messages longer than the radio takes, in pieces."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable

_PIECE = struct.Struct(">HHI")


class PieceError(ValueError):
    """What is no piece of a message, or not all of one, or cannot be split so."""


_MOST_PIECES = 0xFFFF


def least_limit(length: int) -> int:
    """The least limit with which `split` can split any message of at most so many bytes."""
    return _PIECE.size + max(1, -(-length // _MOST_PIECES))


def split(blob: bytes, limit: int) -> list[bytes]:
    """A message in pieces of at most `limit` bytes, for `joined`; all but the last are of that size.

    Each begins with its number and how many there are, 16 bits, and the CRC-32 of the whole, all
    big-endian. Raises PieceError where that takes more than 65,535 pieces.
    """
    room = limit - _PIECE.size
    parts = max(1, -(-len(blob) // room)) if room > 0 else 0
    if not 1 <= parts <= _MOST_PIECES:
        raise PieceError(f"limit: pieces of {limit} bytes are too small for a message of {len(blob)}")
    check = zlib.crc32(blob)
    return [_PIECE.pack(i, parts, check) + blob[i * room : (i + 1) * room] for i in range(parts)]


def piece_of(piece: bytes) -> tuple[int, int, int]:
    """Its number, from 0, how many there are, and a number that is the same in all of them.

    Raises PieceError for what is no piece.
    """
    if len(piece) < _PIECE.size:
        raise PieceError(f"piece: {len(piece)} bytes are too few")
    part, parts, check = _PIECE.unpack_from(piece)
    if part >= parts:
        raise PieceError(f"piece: it is number {part} of {parts}")
    return part, parts, check


def joined(pieces: Iterable[bytes]) -> bytes:
    """The message whose pieces these are, each once, in any order. Raises PieceError if they are not."""
    found = {}
    kinds = set()
    count = 0
    for piece in pieces:
        part, *kind = piece_of(piece)
        found[part] = piece[_PIECE.size :]
        kinds.add(tuple(kind))
        count += 1
    if len(kinds) != 1:
        raise PieceError("pieces: they are not of one message")
    parts, check = kinds.pop()
    if not count == len(found) == parts:
        raise PieceError(f"pieces: {count} of a message of {parts}, {len(found)} of them different")
    blob = b"".join(found[part] for part in range(parts))
    if zlib.crc32(blob) != check:
        raise PieceError("pieces: one is damaged")
    return blob
