"""The i-state transition graph, against the figure in the paper; its Markov chain, against the exact law."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from scenarios.association.markov import bell_number, lumped_chain, number_of_istates, transition_graph
from scenarios.association.theory import CompletionLaw

FIGURE_3_STATES = [
    "111/111/111/111",
    *("100/011/011/011", "101/010/101/101", "110/110/001/001", "110/110/001/110"),
    *("101/010/101/010", "100/011/011/100", "111/111/111/000"),
    *("100/010/001/001", "100/010/001/010", "100/011/011/000"),
    *("100/010/001/100", "101/010/101/000", "110/110/001/000"),
    "100/010/001/000",
]
"""As the matrix has them; the text lists those of the third level in another order."""

FIGURE_3_MATRIX = """
1/8 1/8 1/8 1/8 1/8 1/8 1/8 1/8   0   0   0   0   0   0   0
    1/4   0   0   0   0   0   0 1/4 1/4 1/4   0   0   0   0
        1/4   0   0   0   0   0 1/4   0   0 1/4 1/4   0   0
            1/4   0   0   0   0 1/4   0   0   0   0 1/4 1/4
                1/4   0   0   0   0 1/4   0 1/4   0 1/4   0
                    1/4   0   0   0 1/4   0   0 1/4   0 1/4
                        1/4   0   0   0 1/4 1/4   0   0 1/4
                            1/4   0   0 1/4   0 1/4 1/4   0
                                1/2   0   0   0   0   0 1/2
                                    1/2   0   0   0   0 1/2
                                        1/2   0   0   0 1/2
                                            1/2   0   0 1/2
                                                1/2   0 1/2
                                                    1/2 1/2
                                                          1
""".strip("\n").splitlines()  # fmt: skip
"""As printed (2014), but for the second row, whose last seven cells stand one place to the right in our text."""

NEIGHBOURHOODS = [(w, v) for w in range(1, 9) for v in range(w + 1)]


def test_figure_3() -> None:
    graph = transition_graph(4, 3)
    shown = ["/".join("".join(map(str, row)) for row in graph.istate_matrix(state)) for state in range(15)]
    matrix = np.array(
        [
            [0.0] * (15 - len(row.split())) + [float(Fraction(cell)) for cell in row.split()]
            for row in FIGURE_3_MATRIX
        ]
    )
    assert len(graph.states) == 15
    assert shown == FIGURE_3_STATES
    np.testing.assert_array_equal(graph.chain().matrix(), matrix)
    np.testing.assert_array_equal(graph.observations(), matrix * 16)
    assert graph.levels() == [1] + [2] * 7 + [3] * 6 + [4]
    assert set(graph.observations()[0, :8]) == {2}
    assert graph.chain().expected_steps()[0] == Fraction(88, 21)


@pytest.mark.parametrize(("w", "v"), [(w, v) for w, v in NEIGHBOURHOODS if w <= 6])
def test_what_the_paper_says_of_the_graph(w: int, v: int) -> None:
    """2014, "I-State Transition Graph", 1 to 5; and how many i-states there are."""
    graph = transition_graph(w, v)
    levels, observations = np.array(graph.levels()), graph.observations()
    assert len(graph.states) == len(set(graph.states)) == number_of_istates(w, v)
    assert (number_of_istates(w, v) == bell_number(w)) == (v >= w - 1)
    assert (observations.sum(axis=1) == 2**w).all()
    if v > 0:
        assert (levels[0], levels[-1]) == (1, w)
    assert list(np.flatnonzero(np.diff(levels) < 0)) == []
    for state in range(len(levels)):
        assert observations[state, state] == 2 ** levels[state]
        later = np.flatnonzero(observations[state] * (np.arange(len(levels)) != state))
        assert (levels[later] > levels[state]).all()
        assert set(observations[state, later]) <= {2 ** levels[state]}


def test_number_of_istates() -> None:
    assert [bell_number(n) for n in range(9)] == [1, 1, 2, 5, 15, 52, 203, 877, 4140]
    assert number_of_istates(4, 3) == number_of_istates(4, 4) == 15
    assert number_of_istates(4, 2) == 13
    assert [number_of_istates(w, 1) for w in range(1, 9)] == [2 ** (w - 1) for w in range(1, 9)]
    assert number_of_istates(8, 7) == 4140


@pytest.mark.parametrize(("w", "v"), NEIGHBOURHOODS)
def test_the_lumped_chain_has_the_exact_law(w: int, v: int) -> None:
    chain, law = lumped_chain(w, v), CompletionLaw(w, v)
    assert float(chain.expected_steps()[0]) == pytest.approx(law.mean, abs=1e-13)
    steps = min(len(law.cdf) - 1, 25)
    assert [float(chance) for chance in chain.absorption_cdf(steps)] == law.cdf[: steps + 1].tolist()


@pytest.mark.parametrize(("w", "v"), [(2, 1), (4, 2), (5, 5), (6, 2), (7, 4), (8, 5), (8, 8), (10, 5)])
@pytest.mark.parametrize(("p", "colours"), [(0.3, 1), (0.95, 1), (0.06, 1), (0.5, 2), (0.75, 3), (1.0, 3)])
def test_so_has_the_chain_of_any_probability(w: int, v: int, p: float, colours: int) -> None:
    chain, law = lumped_chain(w, v, p, colours), CompletionLaw(w, v, p, colours)
    assert chain.expected_steps()[0] == pytest.approx(law.mean, rel=1e-12)
    steps = min(len(law.cdf) - 1, 30)
    np.testing.assert_allclose(
        np.array(chain.absorption_cdf(steps), dtype=float), law.cdf[: steps + 1], rtol=0, atol=1e-13
    )


@pytest.mark.parametrize(("w", "v"), [(2, 2), (3, 1), (4, 2), (5, 3), (6, 5)])
@pytest.mark.parametrize("p", [Fraction(1, 2), Fraction(3, 10)])
def test_lumped_or_not(w: int, v: int, p: Fraction) -> None:
    whole, lumped = transition_graph(w, v).chain(p), lumped_chain(w, v, p)
    assert whole.expected_steps()[0] == lumped.expected_steps()[0]
    assert whole.absorption_cdf(5) == lumped.absorption_cdf(5)


def test_equation_1_as_a_matrix() -> None:
    """t = (I - Q)^-1 1, solved by inversion as in the paper."""
    chain = transition_graph(5, 3).chain(Fraction(2, 5))
    transient = chain.matrix()[:-1, :-1]
    steps = np.linalg.inv(np.eye(len(transient)) - transient) @ np.ones(len(transient))
    np.testing.assert_allclose(steps, [float(step) for step in chain.expected_steps()[:-1]], rtol=1e-12)
    assert chain.expected_steps()[-1] == 0


def test_exact_means() -> None:
    """By hand: sums of 1 - (1-1/M)(1-2/M)^2 and the like over M = 1, 2, 4, ..., which are geometric series."""
    means = {(2, 1): "2", (3, 1): "8/3", (3, 2): "10/3", (4, 3): "88/21", (4, 2): "82/21", (4, 1): "22/7"}
    for (w, v), mean in means.items():
        assert lumped_chain(w, v).expected_steps()[0] == Fraction(mean)


@pytest.mark.parametrize(
    ("w", "v", "words"), [(9, 3, "at most 8"), (3, 4, "visual: 4"), (-1, 0, "wireless: -1")]
)
def test_what_is_too_large_or_nothing(w: int, v: int, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        transition_graph(w, v)


def test_what_the_lumped_chain_refuses() -> None:
    with pytest.raises(ValueError, match="at most 12"):
        lumped_chain(13, 2)
    with pytest.raises(ValueError, match="p: with 1"):
        lumped_chain(4, 2, Fraction(1))
