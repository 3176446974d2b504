"""Whatever happens to a file, a log never tells what was not recorded, and never crashes its reader."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from logs import LogError
from logs.reader import LogReader
from logs.recover import recover
from tests.unit.test_logs_recorder import doctor, write, write_everything

Record = tuple[str, int, int, bytes]
MAGIC_BYTES = 8


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[bytes, list[Record], Path]]:
    folder = tmp_path_factory.mktemp("damage")
    path = write(folder / "whole.mcap", lambda recorder: write_everything(recorder, 6))
    with LogReader(path) as reader:
        assert len(reader.chunks) == 7
        yield path.read_bytes(), list(reader.raw()), folder


def read(path: Path) -> tuple[list[Record], bool]:
    with LogReader(path) as reader:
        raw = list(reader.raw())
        assert sum(topic.messages for topic in reader.topics.values()) == len(raw)
        assert reader.whole_bytes <= reader.size_bytes
        return raw, reader.torn


anywhere = st.floats(0, 1, exclude_max=True)
slow_is_fine = settings(
    deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150
)


@given(where=anywhere)
@example(where=0.0)
@slow_is_fine
def test_a_cut_anywhere_leaves_a_prefix(log: tuple[bytes, list[Record], Path], where: float) -> None:
    content, whole, folder = log
    cut = folder / "cut.mcap"
    cut.write_bytes(content[: int(where * len(content))])
    if cut.stat().st_size < MAGIC_BYTES:
        with pytest.raises(LogError):
            LogReader(cut)
        return
    raw, torn = read(cut)
    assert torn
    assert raw == whole[: len(raw)]


def test_a_cut_loses_no_whole_chunk(log: tuple[bytes, list[Record], Path]) -> None:
    content, _, folder = log
    cut = folder / "cut.mcap"
    lengths = []
    for size in range(MAGIC_BYTES, len(content), 97):
        cut.write_bytes(content[:size])
        lengths.append(len(read(cut)[0]))
    assert lengths == sorted(lengths)
    assert len(set(lengths)) == 8


@given(where=anywhere)
@settings(slow_is_fine, max_examples=15)
def test_what_is_recovered_satisfies_the_official_validator(
    log: tuple[bytes, list[Record], Path], where: float
) -> None:
    content, _, folder = log
    cut, made = folder / "cut.mcap", folder / "recovered.mcap"
    cut.write_bytes(content[: MAGIC_BYTES + int(where * (len(content) - MAGIC_BYTES))])
    recover(cut, made, force=True)
    assert doctor(made) == ""
    assert read(made) == (read(cut)[0], False)


@given(where=anywhere, bit=st.integers(0, 7))
@slow_is_fine
def test_a_flipped_bit_is_noticed_and_leaves_a_prefix(
    log: tuple[bytes, list[Record], Path], where: float, bit: int
) -> None:
    content, whole, folder = log
    damaged = bytearray(content)
    damaged[int(where * len(content))] ^= 1 << bit
    path = folder / "flipped.mcap"
    path.write_bytes(damaged)
    try:
        raw, torn = read(path)
    except LogError:
        assert damaged[:MAGIC_BYTES] != content[:MAGIC_BYTES]
        return
    assert torn
    assert raw == whole[: len(raw)]


@given(junk=st.binary(max_size=400))
@slow_is_fine
def test_junk_behind_the_magic_is_an_empty_torn_log(
    log: tuple[bytes, list[Record], Path], junk: bytes
) -> None:
    content, _, folder = log
    path = folder / "junk.mcap"
    path.write_bytes(content[:MAGIC_BYTES] + junk)
    try:
        assert read(path) == ([], True)
    except LogError as error:
        assert "give a log that heliograph recorded" in str(error)  # noqa: PT017 - either end is fine
