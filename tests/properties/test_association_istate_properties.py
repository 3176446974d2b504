"""The i-state against matrices of ones and zeros, multiplied element by element as the papers print it."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from agent.behaviours.association.istate import StationaryIState


def names(w: int) -> list[str]:
    return [f"{h:02d}" for h in range(w)]


@given(st.data())
def test_equals_element_wise_multiplication(data: st.DataObject) -> None:
    """2016, Alg. 1."""
    w = data.draw(st.integers(0, 12))
    v = data.draw(st.integers(0, 12))
    istate = StationaryIState(names(w), range(v))
    matrix = np.ones((w, v), dtype=int)
    for _ in range(data.draw(st.integers(0, 6))):
        active_w = data.draw(st.lists(st.booleans(), min_size=w, max_size=w))
        active_v = data.draw(st.lists(st.booleans(), min_size=v, max_size=v))
        observed = np.equal.outer(np.array(active_w, dtype=bool), np.array(active_v, dtype=bool)).astype(int)
        before = matrix
        matrix = matrix * observed
        changed = istate.update(
            {name for name, on in zip(names(w), active_w, strict=True) if on},
            {s for s in range(v) if active_v[s]},
        )
        assert changed == bool((before != matrix).any())
        assert_is(istate, matrix)


@given(st.data())
def test_equals_element_wise_multiplication_with_colours(data: st.DataObject) -> None:
    """A cell of the observation is 1 if both are dark, or both are active in the same colour."""
    w = data.draw(st.integers(0, 8))
    v = data.draw(st.integers(0, 8))
    colour = st.integers(0, data.draw(st.integers(1, 4)))
    istate = StationaryIState(names(w), range(v))
    matrix = np.ones((w, v), dtype=int)
    for _ in range(data.draw(st.integers(0, 6))):
        spoken = data.draw(st.lists(colour, min_size=w, max_size=w))
        shown = data.draw(st.lists(colour, min_size=v, max_size=v))
        matrix = matrix * np.array([[int(a == b) for b in shown] for a in spoken], dtype=int).reshape(w, v)
        istate.update(
            {name: c for name, c in zip(names(w), spoken, strict=True) if c}, dict(enumerate(shown))
        )
        assert_is(istate, matrix)


def assert_is(istate: StationaryIState, matrix: np.ndarray) -> None:
    w, v = matrix.shape
    assert istate.edges() == {s: [name for h, name in enumerate(names(w)) if matrix[h, s]] for s in range(v)}
    columns = matrix.sum(axis=0)
    assert istate.matches() == {s: names(w)[int(matrix[:, s].argmax())] for s in range(v) if columns[s] == 1}
    assert istate.is_final() == bool((columns == 1).all())
    if istate.is_final():
        assert matrix.sum() == v  # "contains only v 1's"


@given(st.data())
def test_no_inclusion_keeps_what_belongs_together(data: st.DataObject) -> None:
    """Whoever is heard and seen keeps its edge; whoever is only seen ends with candidates only by accident."""
    heard = data.draw(st.sets(st.integers(0, 9)))
    seen = data.draw(st.sets(st.integers(0, 9)))
    istate = StationaryIState(map(str, heard), seen)
    strings: dict[int, list[int]] = {robot: [] for robot in range(10)}
    for _ in range(data.draw(st.integers(0, 8))):
        sent = {robot: data.draw(st.integers(0, 2)) for robot in range(10)}
        for robot, colour in sent.items():
            strings[robot].append(colour)
        istate.update({str(robot): sent[robot] for robot in heard if sent[robot]}, sent)
    # An edge survives exactly while the two strings of activity agree.
    assert istate.edges() == {
        s: sorted(str(robot) for robot in heard if strings[robot] == strings[s]) for s in sorted(seen)
    }
