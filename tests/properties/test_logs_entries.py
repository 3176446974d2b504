"""Whatever a behaviour logs under whatever name, its record says exactly that."""

from __future__ import annotations

import json
from typing import Any

import orjson
from hypothesis import given
from hypothesis import strategies as st

from logs.encoding import embed_entry

WORDS = st.text(st.characters(codec="utf-8"), max_size=20)
# orjson reads integers beyond 64 bits as floats.
VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats(allow_nan=False, allow_infinity=False)
    | WORDS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORDS, inner, max_size=3),
    max_leaves=8,
)


@given(
    name=WORDS,
    data=st.dictionaries(WORDS, VALUES, max_size=4),
    indent=st.sampled_from([None, 0, 2]),
    ascii_only=st.booleans(),
)
def test_an_entry_is_its_text_and_nothing_else(
    name: str, data: dict[str, Any], indent: int | None, ascii_only: bool
) -> None:
    text = json.dumps(data, indent=indent, ensure_ascii=ascii_only).encode()
    record = embed_entry("r00", name, text)
    assert record.endswith(b',"data":' + text + b"}")
    assert orjson.loads(record) == {"robot": "r00", "entry": name, "data": data}
