"""The deterministic algorithms against the tables they are printed with, and always right in the end."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from agent.behaviours.association.logarithmic import LogarithmicTable
from agent.behaviours.association.naive import NaiveTable


@st.composite
def neighbourhoods(draw: st.DrawFn) -> tuple[int, dict[str, int], dict[int, int]]:
    """n, wireless id -> number, visual id -> number: any numbers heard, any seen."""
    ids = draw(st.integers(1, 40))
    numbers = st.sets(st.integers(0, ids - 1), max_size=12)
    heard, seen = draw(numbers), draw(numbers)
    names = draw(st.permutations([f"v{number}" for number in heard]))
    lights = draw(st.permutations(range(100, 100 + len(seen))))
    return ids, dict(zip(names, heard, strict=True)), dict(zip(lights, seen, strict=True))


def expected(voices: dict[str, int], lights: dict[int, int]) -> dict[int, str]:
    name_of = {number: name for name, number in voices.items()}
    return {light: name_of[number] for light, number in lights.items() if number in name_of}


@given(neighbourhoods())
def test_naive(neighbourhood: tuple[int, dict[str, int], dict[int, int]]) -> None:
    ids, voices, lights = neighbourhood
    table = NaiveTable(voices, lights, ids)
    match_table: dict[int, int] = {}  # the printed algorithm: visual id -> number
    for step in range(1, ids + 1):
        active = {light for light, number in lights.items() if number == step - 1}
        match_table |= dict.fromkeys(active, step - 1)
        table.update(step, active)
        for light, candidates in table.edges().items():
            if light in match_table:
                assert candidates == sorted(n for n, k in voices.items() if k == match_table[light])
            else:
                assert candidates == sorted(n for n, k in voices.items() if k >= step)
    assert table.matches() == expected(voices, lights)
    assert table.is_final(ids)
    assert not table.is_final(ids - 1)


@given(neighbourhoods())
def test_logarithmic(neighbourhood: tuple[int, dict[str, int], dict[int, int]]) -> None:
    ids, voices, lights = neighbourhood
    table = LogarithmicTable(voices, lights, ids)
    steps = LogarithmicTable.steps(ids)
    assert steps == math.ceil(math.log2(ids))
    bits = {light: [0] * steps for light in lights}  # table_arr[j][t - 1]
    for step in range(1, steps + 1):
        active = {light for light, number in lights.items() if f"{number:0{steps}b}"[-step] == "1"}
        for light in active:
            bits[light][step - 1] = 1
        table.update(step, active)
        for light, candidates in table.edges().items():
            shown = sum(bit << index for index, bit in enumerate(bits[light]))
            assert candidates == sorted(n for n, k in voices.items() if k % 2**step == shown)
    assert table.matches() == expected(voices, lights)
    assert table.is_final(steps)


@given(neighbourhoods(), st.sampled_from([NaiveTable, LogarithmicTable]))
def test_a_true_edge_never_goes(
    neighbourhood: tuple[int, dict[str, int], dict[int, int]], table_type: type[NaiveTable | LogarithmicTable]
) -> None:
    ids, voices, lights = neighbourhood
    table = table_type(voices, lights, ids)
    for step in range(1, table_type.steps(ids) + 1):
        table.update(step, {light for light, number in lights.items() if table_type.flashes(number, step)})
        edges = table.edges()
        assert all(name in edges[light] for light, name in expected(voices, lights).items())
