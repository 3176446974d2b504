"""Counter-based draws: reference values, and statistics that a poor hash would fail."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from channels.randomness import Draws, _finalise, _finalise_in_place, _link, stable_key, stable_keys

WORDS = np.arange(100_000, dtype=np.uint64)
SEEDS = 20


def check_even(samples: list[NDArray[np.int64]]) -> None:
    """Bins 0 .. 255 fill neither worse nor better than chance: chi-square summed over the samples."""
    total = 0.0
    for sample in samples:
        counts = np.bincount(sample, minlength=256)
        expected = len(sample) / 256
        total += float(((counts - expected) ** 2).sum() / expected)
    freedom = 255 * len(samples)
    # The chi-square distribution has this mean, and twice as much variance.
    assert abs(total - freedom) < 5 * np.sqrt(2 * freedom)


def test_links_are_the_published_splitmix64() -> None:
    # First outputs for seed 1234567 of the reference implementation (Vigna, splitmix64.c).
    expected = [6457827717110365317, 3203168211198807973, 9817491932198370423, 4593380528125082431]
    assert [_link(1234567, word) for word in range(4)] == expected
    assert np.asarray(_link(1234567, np.arange(4, dtype=np.uint64))).tolist() == expected


def test_golden_values_of_this_version() -> None:
    # A change here changes every recorded run.
    draws = Draws(4711, "loss")
    assert stable_key("r00") == 11269522859794866252
    assert [int(draws.bits(word)) for word in range(3)] == [
        3251728213360791721,
        2698762639939181849,
        10050115649171073045,
    ]
    assert float(draws.uniform(7, 8, 9)) == 0.3612063400491472
    assert abs(float(draws.normal(7, 8, 9)) + 0.9841056872488606) < 1e-12


def test_integer_and_array_arithmetic_agree() -> None:
    numbers = [0, 1, 2**63, 2**64 - 1, 0x0123456789ABCDEF]
    array = _finalise_in_place(np.array(numbers, dtype=np.uint64))
    assert array.tolist() == [_finalise(number) for number in numbers]


def test_words_of_every_kind_ask_the_same_question() -> None:
    draws = Draws(1, "s")
    expected = int(draws.bits(5, 6))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert int(draws.bits(np.uint64(5), np.int64(6))) == expected
        assert int(draws.bits(np.array(5), 6)) == expected
        assert draws.bits(np.array([5]), np.array([[6]])).tolist() == [[expected]]
        assert draws.bits(np.array([4, 5]), 6)[1] == expected
    assert int(draws.bits(-1)) == int(draws.bits(2**64 - 1)) == int(draws.bits(np.array([-1]))[0])


def test_shape_is_what_the_words_broadcast_to() -> None:
    draws = Draws(1, "s")
    assert draws.bits(3).shape == ()
    assert draws.bits(np.array([[3]])).shape == (1, 1)
    assert draws.uniform(np.array([[3]]), np.arange(4)).shape == (1, 4)
    assert draws.uniform(np.arange(4), np.array([[3]])).shape == (1, 4)
    assert draws.normal(np.zeros((2, 1), dtype=np.int64), np.arange(4)).shape == (2, 4)
    assert draws.normal(np.zeros((1, 1), dtype=np.int64)).shape == (1, 1)
    assert draws.uniform(np.arange(0), 3).shape == (0,)


def test_answer_depends_on_the_number_and_order_of_words() -> None:
    draws = Draws(1, "s")
    answers = {int(draws.bits(*words)) for words in [(1,), (1, 0), (0, 1), (1, 1), (0,), (0, 0), ()]}
    assert len(answers) == 7


def test_seeds_and_streams_are_different_worlds() -> None:
    answers = {
        int(Draws(seed, stream).bits(0))
        for seed in (0, 1, -1, 11, 2**80)
        for stream in ("loss", "1/loss", "jitter")
    }
    assert len(answers) == 15


def test_one_more_robot_changes_nobody_elses_draws() -> None:
    draws = Draws(4711, "loss")
    few, more = stable_keys(["r00", "r01"]), stable_keys(["r00", "new", "r01"])
    before = draws.uniform(few[:, None], 3, few)
    after = draws.uniform(more[:, None], 3, more)
    assert np.array_equal(before, after[np.ix_([0, 2], [0, 2])])


def test_uniform_fills_its_range_evenly() -> None:
    draws = [Draws(seed, "uniform").uniform(WORDS) for seed in range(SEEDS)]
    assert min(draw.min() for draw in draws) >= 0
    assert max(draw.max() for draw in draws) < 1
    check_even([(draw * 256).astype(np.int64) for draw in draws])


def test_low_bits_are_as_good_as_high_ones() -> None:
    check_even([(Draws(seed, "low").bits(WORDS) & np.uint64(255)).astype(np.int64) for seed in range(SEEDS)])


def test_pairs_of_neighbouring_words_fill_the_plane_evenly() -> None:
    draws = [(Draws(seed, "pairs").uniform(WORDS) * 16).astype(np.int64) for seed in range(SEEDS)]
    check_even([draw[:-1:2] * 16 + draw[1::2] for draw in draws])


def test_small_numbers_as_words_are_no_worse() -> None:
    robots, seqs = np.arange(10, dtype=np.uint64), np.arange(1000, dtype=np.uint64)
    draws = [Draws(seed, "s").uniform(robots[:, None, None], seqs[:, None], robots) for seed in range(SEEDS)]
    check_even([(draw.ravel() * 256).astype(np.int64) for draw in draws])


def test_neighbouring_words_do_not_correlate() -> None:
    draws = Draws(1, "neighbours")
    for other in (draws.uniform(WORDS + np.uint64(1)), draws.uniform(WORDS, 0), draws.uniform(0, WORDS)):
        correlation = np.corrcoef(draws.uniform(WORDS), other)[0, 1]
        assert abs(correlation) < 5 / np.sqrt(len(WORDS))


def test_each_bit_of_a_word_flips_half_of_the_answer() -> None:
    draws = Draws(1, "avalanche")
    words = WORDS[:2000]
    for bit in range(64):
        changed = draws.bits(words) ^ draws.bits(words ^ np.uint64(2**bit))
        flipped = np.unpackbits(changed.view(np.uint8)).mean()
        assert abs(flipped - 0.5) < 5 * 0.5 / np.sqrt(64 * len(words))


def test_normal_has_the_moments_and_tails_of_the_normal_distribution() -> None:
    draws = Draws(1, "normal").normal(WORDS)
    root_n = np.sqrt(len(WORDS))
    assert abs(draws.mean()) < 5 / root_n
    assert abs((draws**2).mean() - 1) < 5 * np.sqrt(2) / root_n
    assert abs((draws**4).mean() - 3) < 5 * np.sqrt(96) / root_n
    for bound, beyond in ((1.0, 0.317311), (2.0, 0.045500), (3.0, 0.002700)):
        assert abs((abs(draws) > bound).mean() - beyond) < 5 * np.sqrt(beyond) / root_n
    assert abs(np.corrcoef(draws[:-1], draws[1:])[0, 1]) < 5 / root_n
