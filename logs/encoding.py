"""Records of the JSON topics as bytes.

Strictly: what JSON cannot say is refused, or shown as the bytes that came over the air, and never bent.
What a behaviour logs arrives as JSON text and is embedded as it stands.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import orjson
from numpy.typing import NDArray

from channels.messages import MessageError, decode_payload, has_non_finite
from channels.visual import Capture
from logs.schemas import LOSSES

# Dates and the like have no form of their own in JSON: their owner is to choose one.
_STRICT = orjson.OPT_PASSTHROUGH_DATETIME | orjson.OPT_PASSTHROUGH_DATACLASS | orjson.OPT_PASSTHROUGH_SUBCLASS
# A msgpack float that is infinite or no number starts like this; so may other bytes, hence "may".
_MAY_BE_NON_FINITE = re.compile(rb"\xcb[\x7f\xff][\xf0-\xff]|\xca[\x7f\xff][\x80-\xff]").search
_IS_LOSS = np.isin(np.arange(256), list(LOSSES))


def encode_record(record: Mapping[str, Any]) -> bytes:
    """A record as JSON. Raises ValueError for bytes, keys that are no text, NaN and infinity."""
    try:
        encoded = orjson.dumps(record, option=_STRICT)
    except TypeError as error:
        raise ValueError(str(error)) from None
    # orjson turns NaN and infinity into null without a word.
    if b"null" in encoded and has_non_finite(record):
        raise ValueError("JSON has no NaN and no infinity")
    return encoded


def embed_entry(robot: str, name: str, text: bytes) -> bytes:
    """A record of /robot around the JSON object `text`, which is neither checked nor changed."""
    return _entry_head(robot, name) + text + b"}"


def encode_transmissions(
    robots: Sequence[str],
    senders: Sequence[int],
    seqs: Sequence[int],
    payloads: Sequence[bytes],
    bits: Sequence[int],
    slots: Sequence[int | None],
    airtimes_ns: Sequence[int],
    reasons: NDArray[np.uint8],
    deliveries: Sequence[tuple[list[int], list[int]]],
) -> Iterator[bytes]:
    """Records of /radio as JSON, one per transmission; arguments as in `Recorder.radio_batch`.

    `robots` are all ids. A payload is shown as what its msgpack says, with bytes in it as
    {"base64": text}; so is the whole payload where it is no msgpack, or says what JSON cannot.
    """
    columns = senders, seqs, payloads, bits, slots, airtimes_ns, deliveries, _dropped(reasons, robots)
    for sender, seq, payload, size, slot, airtime_ns, (receivers, delays_ns), dropped in zip(
        *columns, strict=True
    ):
        record = {
            "from": robots[sender],
            "seq": seq,
            "payload": None,
            "bits": size,
            "slot": slot,
            "airtime_ns": airtime_ns,
            "delivered": [robots[receiver] for receiver in receivers],
            "delay_ns": delays_ns,
            "dropped": dropped,
        }
        yield _with_payload(record, payload)


def encode_camera(capture: Capture, robots: Sequence[str]) -> bytes:
    """A record of /camera as JSON, with the shortest numbers that tell its steps of range and bearing."""
    visual = capture.visual.tolist()
    ranges_m = _rounded(capture.range_m, 3)
    bearings_rad = _rounded(capture.bearing_rad, 4)
    lamps = capture.lamp.tolist()
    offsets = capture.offsets.tolist()
    frames = [
        {
            "robot": robots[observer],
            "visual": visual[start:end],
            "range_m": ranges_m[start:end],
            "bearing_rad": bearings_rad[start:end],
            "lamp": lamps[start:end],
        }
        for observer, start, end in zip(capture.observers.tolist(), offsets[:-1], offsets[1:], strict=True)
    ]
    return orjson.dumps({"frames": frames})


@lru_cache(maxsize=10_000)
def _entry_head(robot: str, name: str) -> bytes:
    return orjson.dumps({"robot": robot, "entry": name})[:-1] + b',"data":'


def _dropped(reasons: NDArray[np.uint8], robots: Sequence[str]) -> list[dict[str, list[str]]]:
    """Per transmission the receivers in range that did not get it, by reason."""
    dropped: list[dict[str, list[str]]] = [{} for _ in range(len(reasons))]
    rows, columns = _IS_LOSS[reasons].nonzero()
    if len(rows):
        codes = reasons[rows, columns].tolist()
        for row, code, receiver in zip(rows.tolist(), codes, columns.tolist(), strict=True):
            dropped[row].setdefault(LOSSES[code], []).append(robots[receiver])
    return dropped


def _with_payload(record: dict[str, Any], payload: bytes) -> bytes:
    try:
        value = decode_payload(payload)
        if _MAY_BE_NON_FINITE(payload) and has_non_finite(value):
            value = payload
    except MessageError:
        value = payload
    record["payload"] = value
    try:
        return orjson.dumps(record, _base64, _STRICT)
    except TypeError:
        record["payload"] = payload
        return orjson.dumps(record, _base64)


def _rounded(values: NDArray[np.float32], digits: int) -> list[float]:
    # As float64, so that 1.234 is printed as such; adding zero turns -0.0 into 0.0.
    rounded: list[float] = (np.round(values.astype(np.float64), digits) + 0.0).tolist()
    return rounded


def _base64(value: object) -> dict[str, str]:
    if isinstance(value, bytes):
        return {"base64": base64.b64encode(value).decode()}
    raise TypeError
