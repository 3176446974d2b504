"""The mobile i-state against Algorithm 2 with lists and matrices, and what must hold in an honest world."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from agent.behaviours.association.mobile_istate import MobileIState

VOICES = "abcdef"
LIGHTS = range(6)


class PlainMobile:
    """2016, Alg. 2: rows and columns come and go; at the end of a step the matrix is multiplied."""

    def __init__(self, drop_time: int, exceeds: bool) -> None:
        self.w_ids: list[str] = []
        self.v_ids: list[int] = []
        self.inactivity: list[int] = []
        self.istate = np.zeros((0, 0), dtype=int)
        self.drop_time, self.exceeds = drop_time, exceeds

    def step(self, heard: set[str], in_view: set[int], lit: set[int]) -> None:
        self._keep([True] * len(self.w_ids), [s in in_view for s in self.v_ids])
        self.istate = self.istate * self._observation(heard, lit)
        self.inactivity = [
            0 if h in heard else n + 1 for h, n in zip(self.w_ids, self.inactivity, strict=True)
        ]
        self._keep([n < self.drop_time for n in self.inactivity], [True] * len(self.v_ids))

        solved_w = {
            int(self.istate[:, s].argmax()) for s in range(len(self.v_ids)) if self.istate[:, s].sum() == 1
        }
        old_w = len(self.w_ids)
        w_new = [h for h in heard if h not in self.w_ids]
        v_new = [s for s in lit if s not in self.v_ids]
        grown = np.zeros((old_w + len(w_new), len(self.v_ids) + len(v_new)), dtype=int)
        grown[:old_w, : len(self.v_ids)] = self.istate
        grown[old_w:, len(self.v_ids) :] = 1
        if self.exceeds:
            for h in range(old_w):
                if self.w_ids[h] in heard and h not in solved_w:
                    grown[h, len(self.v_ids) :] = 1
        self.w_ids, self.v_ids = self.w_ids + w_new, self.v_ids + v_new
        self.inactivity += [0] * len(w_new)
        self.istate = grown * self._observation(heard, lit)

    def edges(self) -> dict[int, list[str]]:
        return {
            visual: sorted(h for h, on in zip(self.w_ids, self.istate[:, s], strict=True) if on)
            for s, visual in sorted(enumerate(self.v_ids), key=lambda item: item[1])
        }

    def _observation(self, heard: set[str], lit: set[int]) -> np.ndarray:
        return np.array([[int((h in heard) == (s in lit)) for s in self.v_ids] for h in self.w_ids]).reshape(
            len(self.w_ids), len(self.v_ids)
        )

    def _keep(self, rows: list[bool], columns: list[bool]) -> None:
        self.istate = self.istate[rows][:, columns]
        self.w_ids = [h for h, kept in zip(self.w_ids, rows, strict=True) if kept]
        self.inactivity = [n for n, kept in zip(self.inactivity, rows, strict=True) if kept]
        self.v_ids = [s for s, kept in zip(self.v_ids, columns, strict=True) if kept]


@given(st.data(), st.integers(1, 4), st.booleans())
def test_equals_the_plain_algorithm(data: st.DataObject, drop_time: int, exceeds: bool) -> None:
    istate, plain = MobileIState(drop_time, exceeds), PlainMobile(drop_time, exceeds)
    for _ in range(data.draw(st.integers(1, 10))):
        heard = data.draw(st.sets(st.sampled_from(VOICES)))
        in_view = data.draw(st.sets(st.sampled_from(LIGHTS)))
        lit = data.draw(st.sets(st.sampled_from(LIGHTS))) & in_view
        istate.update(heard, in_view, lit)
        plain.step(heard, in_view, lit)
        assert istate.edges() == plain.edges()
        assert istate.wireless == sorted(plain.w_ids)
        assert istate.visual == sorted(plain.v_ids)
        assert istate.matches() == {s: names[0] for s, names in plain.edges().items() if len(names) == 1}


@given(st.data(), st.booleans())
def test_a_true_edge_never_goes_while_both_ids_stay(data: st.DataObject, exceeds: bool) -> None:
    """Perfect channels, one robot behind each pair of ids: only leaving and silence can break them up."""
    istate = MobileIState(3, exceeds)
    true: set[int] = set()
    for _ in range(data.draw(st.integers(1, 12))):
        in_view = data.draw(st.sets(st.sampled_from(LIGHTS)))
        farther = data.draw(st.sets(st.sampled_from(LIGHTS))) if exceeds else set()
        sending = data.draw(st.sets(st.sampled_from(LIGHTS)))
        heard = {VOICES[robot] for robot in (in_view | farther) & sending}
        istate.update(heard, in_view, in_view & sending)
        edges = istate.edges()
        for robot in true:
            kept = robot in istate.visual and VOICES[robot] in istate.wireless and robot in in_view
            assert not kept or VOICES[robot] in edges[robot]
        true = {robot for robot, candidates in edges.items() if VOICES[robot] in candidates}
