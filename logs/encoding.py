"""Records of the JSON topics as bytes, strictly: what JSON cannot say is refused or named, never bent."""

from __future__ import annotations

import base64
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import orjson
from numpy.typing import NDArray

from channels.messages import MessageError, decode_payload
from channels.visual import Capture

# Dates and the like have no form of their own in JSON: their owner is to choose one.
_STRICT = orjson.OPT_PASSTHROUGH_DATETIME | orjson.OPT_PASSTHROUGH_DATACLASS | orjson.OPT_PASSTHROUGH_SUBCLASS
# A msgpack float that is infinite or no number starts like this; so may other bytes, hence "may".
_MAY_BE_NON_FINITE = re.compile(rb"\xcb[\x7f\xff][\xf0-\xff]|\xca[\x7f\xff][\x80-\xff]").search


def encode_record(record: Mapping[str, Any]) -> bytes:
    """A record as JSON. Raises ValueError for bytes, keys that are no text, NaN and infinity."""
    try:
        encoded = orjson.dumps(record, option=_STRICT)
    except TypeError as error:
        raise ValueError(str(error)) from None
    # orjson turns NaN and infinity into null without a word.
    if b"null" in encoded and _has_non_finite(record):
        raise ValueError("JSON has no NaN and no infinity")
    return encoded


def encode_transmission(record: dict[str, Any], payload: bytes) -> bytes:
    """A record of /radio as JSON, its field "payload" filled in with what the msgpack `payload` says.

    Bytes in it become {"base64": text}; so does the whole payload where it is no msgpack or no JSON.
    """
    try:
        value = decode_payload(payload)
        if _MAY_BE_NON_FINITE(payload) and _has_non_finite(value):
            value = payload
    except MessageError:
        value = payload
    record["payload"] = value
    try:
        return orjson.dumps(record, _base64, _STRICT)
    except TypeError:
        record["payload"] = payload
        return orjson.dumps(record, _base64)


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


def _rounded(values: NDArray[np.float32], digits: int) -> list[float]:
    # As float64, so that 1.234 is printed as such; adding zero turns -0.0 into 0.0.
    rounded: list[float] = (np.round(values.astype(np.float64), digits) + 0.0).tolist()
    return rounded


def _base64(value: object) -> dict[str, str]:
    if isinstance(value, bytes):
        return {"base64": base64.b64encode(value).decode()}
    raise TypeError


def _has_non_finite(value: object) -> bool:
    """Whether a value that is plain JSON otherwise holds NaN or infinity."""
    pending: list[Any] = [value]
    for item in pending:
        kind = type(item)
        if kind is float:
            if not math.isfinite(item):
                return True
        elif kind is dict:
            pending.extend(item.values())
        elif kind is list or kind is tuple:
            pending.extend(item)
    return False
