"""The stationary i-state: the papers' example, coloured lights, stop rules, and the laws it must follow."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import pytest

from agent.behaviours.association.istate import StationaryIState, survival


def test_by_hand() -> None:
    istate = StationaryIState(["a", "b", "c"], [7, 9])
    assert istate.edges() == {7: ["a", "b", "c"], 9: ["a", "b", "c"]}
    assert istate.matches() == {}
    assert istate.update({"a", "c"}, {7})
    assert istate.edges() == {7: ["a", "c"], 9: ["b"]}
    assert istate.matches() == {9: "b"}
    assert not istate.is_final()
    assert not istate.update({"a", "c"}, {7})  # the same again tells nothing
    assert istate.update({"c"}, {7})
    assert istate.edges() == {7: ["c"], 9: ["b"]}
    assert istate.matches() == {7: "c", 9: "b"}
    assert istate.is_final()
    assert istate.steps == 3


def columns(istate: StationaryIState) -> list[str]:
    """The i-state as the papers draw it: one line of zeros and ones per wireless id."""
    edges = istate.edges().values()
    return ["".join("01"[name in candidates] for candidates in edges) for name in istate.wireless]


def test_a_path_through_the_papers_transition_graph() -> None:
    """2014, Fig. 3 (w = 4, v = 3): 111/111/111/111 -> 110/110/001/001 -> 100/010/001/000."""
    istate = StationaryIState(["1", "2", "3", "4"], [1, 2, 3])
    assert columns(istate) == ["111", "111", "111", "111"]
    istate.update({"1", "2"}, {1, 2})
    assert columns(istate) == ["110", "110", "001", "001"]
    for zero_information in (["1", "2", "3", "4"], []):
        assert not istate.update(zero_information, {1, 2, 3} if zero_information else set())
    istate.update({"1", "3"}, {1, 3})
    assert columns(istate) == ["100", "010", "001", "000"]
    assert istate.is_final()
    assert istate.matches() == {1: "1", 2: "2", 3: "3"}


def test_an_and_observation_would_not_do() -> None:
    """2014 prints that a cell stays if both are active; what it draws is: if both are, or both are not."""
    istate = StationaryIState(["a", "b"], [1, 2])
    istate.update({"a"}, {1})
    assert istate.edges() == {1: ["a"], 2: ["b"]}


@pytest.mark.parametrize(
    ("wireless", "visual", "final"),
    [([], [], True), (["a"], [], True), (["a"], [1], True), ([], [1], False), (["a", "b"], [1], False)],
)
def test_what_is_final_at_once(wireless: list[str], visual: list[int], final: bool) -> None:
    istate = StationaryIState(wireless, visual)
    assert istate.is_final() is final
    assert istate.edges() == dict.fromkeys(visual, wireless)


def test_unknown_ids_are_ignored() -> None:
    istate = StationaryIState(["a", "b"], [1])
    istate.update({"a", "stranger"}, {1, 99})
    assert istate.edges() == {1: ["a"]}


def test_names_and_ids_come_in_order_and_once() -> None:
    istate = StationaryIState(["b", "a", "b"], [9, 3, 9])
    assert (istate.wireless, istate.visual) == (["a", "b"], [3, 9])


# --- coloured lights ------------------------------------------------------------------------------


def test_colours_by_hand() -> None:
    istate = StationaryIState(["a", "b", "c", "d"], [1, 2, 3, 4])
    istate.update({"a": 1, "b": 2, "c": 2}, {1: 1, 2: 2, 3: 2, 4: 0})
    assert istate.edges() == {1: ["a"], 2: ["b", "c"], 3: ["b", "c"], 4: ["d"]}
    istate.update({"b": 3, "c": 1}, {2: 3, 3: 1})  # what is in no mapping is silent, and dark
    assert istate.matches() == {1: "a", 2: "b", 3: "c", 4: "d"}


def test_a_colour_that_nobody_named_belongs_to_nobody() -> None:
    istate = StationaryIState(["a", "b"], [1])
    istate.update({"a": 1}, {1: 2})
    assert istate.edges() == {1: []}


def test_plain_collections_mean_colour_one() -> None:
    plain, coloured = (StationaryIState(["a", "b", "c"], [1, 2]) for _ in range(2))
    plain.update(["a", "b"], [1])
    coloured.update({"a": 1, "b": 1}, {1: 1, 2: 0})
    assert plain.edges() == coloured.edges()


@pytest.mark.parametrize(
    ("probability", "colours", "expected"),
    [(0.5, 1, 0.5), (0.5, 4, 0.3125), (1.0, 4, 0.25), (0.0, 3, 1.0), (1.0, 1, 1.0), (0.2, 2, 0.66)],
)
def test_survival(probability: float, colours: int, expected: float) -> None:
    assert survival(probability, colours) == pytest.approx(expected)


def signals(rng: np.random.Generator, robots: int, probability: float, colours: int = 1) -> dict[int, int]:
    """Colours of the robots that send a pair in one step."""
    active = rng.random(robots) < probability
    drawn = rng.integers(1, colours, size=robots, endpoint=True)
    return {robot: int(drawn[robot]) for robot in np.flatnonzero(active).tolist()}


def take(
    istate: StationaryIState, sent: dict[int, int], wireless: Iterable[int], visual: Iterable[int]
) -> None:
    """One step of a listener that hears and sees these robots; robot k is wireless id "k", visual id k."""
    istate.update(
        {str(robot): sent[robot] for robot in wireless if robot in sent},
        {robot: sent.get(robot, 0) for robot in visual},
    )


@pytest.mark.parametrize(("probability", "colours"), [(0.5, 1), (0.3, 1), (0.7, 3), (1.0, 2)])
def test_wrong_edges_survive_as_often_as_they_should(probability: float, colours: int) -> None:
    """After t steps v + v (w - 1) c^t edges are left in the mean; true ones never go."""
    rng = np.random.default_rng(5)
    w, v, steps, runs = 7, 4, 3, 1500
    left = np.zeros((runs, steps))
    for run in range(runs):
        istate = StationaryIState(map(str, range(w)), range(v))
        for step in range(steps):
            take(istate, signals(rng, w, probability, colours), range(w), range(v))
            edges = istate.edges()
            assert all(str(robot) in candidates for robot, candidates in edges.items())
            left[run, step] = sum(map(len, edges.values()))
    expected = v + v * (w - 1) * survival(probability, colours) ** np.arange(1, steps + 1)
    error = left.std(axis=0, ddof=1) / math.sqrt(runs)
    assert (np.abs(left.mean(axis=0) - expected) <= 4.5 * error).all()


@pytest.mark.parametrize(("wireless", "visual"), [(8, 8), (12, 8), (13, 3)])
def test_completion_follows_its_exact_law(wireless: int, visual: int) -> None:
    """P(done by t) = prod_{i<v} (1 - i/M) (1 - v/M)^(w-v) with M = 2^t: all ids' strings must tell apart."""
    rng = np.random.default_rng(wireless)
    runs, horizon = 4000, 14
    names = [f"{h:02d}" for h in range(wireless)]
    done_by = np.zeros(horizon)
    for _ in range(runs):
        istate = StationaryIState(names, range(visual))
        for step in range(horizon):
            if istate.is_final():
                done_by[step:] += 1
                break
            active = rng.random(wireless) < 0.5
            istate.update(
                [name for name, on in zip(names, active, strict=True) if on],
                np.flatnonzero(active[:visual]).tolist(),
            )
    cells = 2.0 ** np.arange(horizon)
    spread = np.prod([np.maximum(0.0, 1 - i / cells) for i in range(visual)], axis=0)
    law = spread * np.maximum(0.0, 1 - visual / cells) ** (wireless - visual)
    error = np.sqrt(np.maximum(law * (1 - law), 1e-9) / runs)
    assert np.abs(done_by / runs - law).max() < 5 * error.max()
    assert (np.abs(done_by / runs - law) <= 5 * error + 1e-9).all()


# --- without channel inclusion -------------------------------------------------------------------


def test_settled_by_hand() -> None:
    """w = 2, v = 2, c = 1/2: lone candidates count once 4 / 2^t <= 0.1, from t = 6 on."""
    istate = StationaryIState(["a", "b"], [1, 2])
    for step in range(1, 9):
        # light 1 is a's; light 2 does something else; nobody sees b
        istate.update({1: ["a"], 2: ["b"], 3: []}[step % 3 + 1], {1: {1}, 2: set(), 3: {2}}[step % 3 + 1])
        if step >= 3:
            assert istate.edges() == {1: ["a"], 2: []}
            assert not istate.is_final()
            assert istate.is_settled(0.5, 0.1) is (step >= 6)
    assert istate.matches() == {1: "a"}


def test_two_candidates_are_never_settled() -> None:
    istate = StationaryIState(["a", "b"], [1])
    for _ in range(100):
        istate.update([], [])
    assert not istate.is_settled(0.5, 1.0)


@pytest.mark.parametrize(("wireless", "visual"), [([], []), (["a"], []), ([], [1, 2])])
def test_nothing_in_common_is_settled_at_once(wireless: list[str], visual: list[int]) -> None:
    istate = StationaryIState(wireless, visual)
    assert istate.is_settled(0.5, 0.0)
    assert istate.matches() == {}


def test_an_istate_that_has_become_empty_is_settled_without_waiting() -> None:
    istate = StationaryIState(["a", "b"], [1, 2])
    istate.update(["a", "b"], [])
    assert istate.edges() == {1: [], 2: []}
    assert istate.is_settled(0.5, 0.0)


def test_signals_that_tell_nothing_settle_nothing() -> None:
    """With p = 1 and one colour a lone candidate stays an accident for ever."""
    istate = StationaryIState(["a"], [1])
    for _ in range(1000):
        istate.update(["a"], [1])
    assert not istate.is_settled(survival(1.0), 0.01)


def completion(rng: np.random.Generator, bound: float, colours: int) -> StationaryIState:
    """Run until settled: robots 0-5 are heard, 4-8 seen, so 4 and 5 both."""
    istate = StationaryIState(map(str, range(6)), range(4, 9))
    while not istate.is_settled(survival(0.5, colours), bound):
        take(istate, signals(rng, 9, 0.5, colours), range(6), range(4, 9))
    return istate


def wrong_claims(istate: StationaryIState) -> int:
    return sum(str(visual) != name for visual, name in istate.matches().items())


@pytest.mark.parametrize("colours", [1, 3])
@pytest.mark.parametrize("bound", [0.2, 0.05])
def test_false_matches_stay_below_the_bound(bound: float, colours: int) -> None:
    rng = np.random.default_rng(11)
    runs = 1500
    ends = [completion(rng, bound, colours) for _ in range(runs)]
    wrong = sum(wrong_claims(istate) > 0 for istate in ends) / runs
    assert wrong <= bound + 3 * math.sqrt(bound * (1 - bound) / runs)
    for istate in ends:  # what is there to be found is found
        assert {4: "4", 5: "5"}.items() <= istate.matches().items()


def test_without_the_bound_false_matches_are_frequent() -> None:
    rng = np.random.default_rng(12)
    wrong = sum(wrong_claims(completion(rng, 30.0, 1)) > 0 for _ in range(500)) / 500
    assert wrong > 0.25
