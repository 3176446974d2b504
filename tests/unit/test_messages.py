"""The wire format, checked with a decoder that is not ours, and the limits of what is taken from it."""

from __future__ import annotations

import contextlib
import dataclasses
import math

import msgpack
import msgspec
import numpy as np
import orjson
import pytest
from hypothesis import given
from hypothesis import strategies as st

from channels.messages import (
    MAX_REPORT_BYTES,
    MAX_TRANSMISSIONS,
    Grant,
    LampCommand,
    LogEntry,
    Message,
    MessageError,
    MotionCommand,
    RawGrant,
    Report,
    Transmission,
    WireFrame,
    decode_grant,
    decode_payload,
    decode_report,
    encode,
    encode_entry,
    encode_payload,
)

FULL = Report(
    7, 2_500_000_000, 3,
    [Transmission(5, b"abc"), Transmission(6, b"", refused=True)],
    [LampCommand(8, 2)],
    [MotionCommand((1.0, -2.0)), MotionCommand(towards_m=(3.0, 4.0), speed_mps=0.5)],
    [LogEntry("name", b'{"a":1}')],
    "why", True,
)  # fmt: skip


def test_a_report_is_plain_msgpack() -> None:
    assert msgpack.unpackb(encode(FULL)) == [
        7, 2_500_000_000, 3,
        [[5, b"abc", False], [6, b"", True]],
        [[8, 2]],
        [[[1.0, -2.0], None, 0.0], [[0.0, 0.0], [3.0, 4.0], 0.5]],
        [["name", b'{"a":1}']],
        "why", True,
    ]  # fmt: skip
    assert decode_report(encode(FULL)) == FULL
    assert decode_report(msgpack.packb([1, None])) == Report(1, None)


def test_a_grant_made_of_encoded_parts_is_a_grant() -> None:
    messages = [Message(1, "a", b"x"), Message(2, "b", b"")]
    frames = [WireFrame(3, b"\1\0\0\0", b"\0\0\0\0", b"\0\0\0\0", b"\1")]
    raw = RawGrant(
        4,
        5,
        [msgspec.Raw(encode(m)) for m in messages],
        [msgspec.Raw(encode(f)) for f in frames],
        (0.0, 1.0, 2.0),
    )
    assert decode_grant(encode(raw)) == Grant(4, 5, messages, frames, (0.0, 1.0, 2.0))
    assert msgpack.unpackb(encode(raw))[2] == [[1, "a", b"x"], [2, "b", b""]]


@given(st.binary(max_size=200))
def test_any_bytes_are_a_report_or_refused(raw: bytes) -> None:
    try:
        report = decode_report(raw)
    except MessageError:
        return
    assert decode_report(encode(report)) == report


@given(st.data())
def test_a_report_with_one_byte_changed_is_a_report_or_refused(data: st.DataObject) -> None:
    raw = bytearray(encode(FULL))
    raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    with contextlib.suppress(MessageError):
        decode_report(bytes(raw))


@pytest.mark.parametrize(
    "wrong",
    [
        ["1", None], [1, "soon"], [1, None, 0, [[0, b"x" * 65_537]]], [1, None, 0, [[0, "text"]]],
        [1, None, 0, [[0, b""]] * (MAX_TRANSMISSIONS + 1)], [1, 2**63], [1, None, 0, [], [[0, 256]]],
        [1, None, 0, [], [], [[[1.0], None, 0.0]]], [1, None, 0, [], [], [], [["", b"{}"]]], [], {}, 5,
    ],
)  # fmt: skip
def test_refused(wrong: object) -> None:
    with pytest.raises(MessageError):
        decode_report(msgpack.packb(wrong))


def test_a_report_that_is_too_long_is_not_even_read() -> None:
    with pytest.raises(MessageError, match="the limit is"):
        decode_report(b"\0" * (MAX_REPORT_BYTES + 1))


def test_nesting_that_would_exhaust_the_stack_is_refused() -> None:
    with pytest.raises(MessageError):
        decode_payload(b"\x91" * 1_000_000)


def test_payloads_take_numpy_for_what_it_stands_for() -> None:
    payload = {"n": np.int64(3), "x": np.float32(0.5), "v": np.arange(3), "b": np.bool_(True)}
    assert decode_payload(encode_payload(payload)) == {"n": 3, "x": 0.5, "v": [0, 1, 2], "b": True}
    with pytest.raises(TypeError, match="values of type object cannot be sent or logged"):
        encode_payload(object())


def test_entries_are_json() -> None:
    data = {"n": np.int64(3), "list": [1.5, None, True], 7: "number", "raw": b"\0\1"}
    expected = {"n": 3, "list": [1.5, None, True], "7": "number", "raw": "AAE="}
    assert orjson.loads(encode_entry(data)) == expected  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "value", [math.nan, math.inf, np.float64("nan"), np.array([1.0, -math.inf]), [{"a": math.nan}]]
)
def test_entries_do_not_lose_what_json_cannot_say(value: object) -> None:
    with pytest.raises(ValueError, match="no NaN and no infinity"):
        encode_entry({"value": value})


@dataclasses.dataclass
class Seen:
    names: set[str]
