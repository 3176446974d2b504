"""What one step tells about a pair, and what many tell of the rates."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from agent.behaviours.association.rates import RATES, ChannelRates, check_estimable, estimated

Floats = NDArray[np.float64]
NOTHING = np.zeros(2)
USUAL = ("wireless_loss", "visual_miss", "visual_false")


def test_ideal_channels_by_hand() -> None:
    table = ChannelRates(transmission_probability=0.25).log_likelihood_ratios()
    assert table[1, 1] == pytest.approx(math.log(4))
    assert table[0, 0] == pytest.approx(math.log(4 / 3))
    assert table[0, 1] == table[1, 0] == -math.inf


def test_lost_messages_by_hand() -> None:
    """p = 1/2, a tenth lost: heard and dark is impossible, silent and lit is not."""
    table = ChannelRates(wireless_loss=0.1).log_likelihood_ratios()
    assert table[1, 1] == pytest.approx(math.log(0.45 / (0.45 * 0.5)))
    assert table[0, 1] == pytest.approx(math.log(0.05 / (0.55 * 0.5)))
    assert table[0, 0] == pytest.approx(math.log(0.5 / (0.55 * 0.5)))
    assert table[1, 0] == -math.inf


def test_joint_probabilities_by_listing_all_that_can_happen() -> None:
    p, loss, ghost, miss, false = 0.3, 0.2, 0.05, 0.15, 0.1
    rates = ChannelRates(
        transmission_probability=p,
        wireless_loss=loss,
        wireless_false=ghost,
        visual_miss=miss,
        visual_false=false,
    )
    table = np.zeros((2, 2))
    for sent, error_x, error_y in itertools.product((0, 1), repeat=3):
        chance = p if sent else 1 - p
        rate_x, rate_y = (loss, miss) if sent else (ghost, false)
        chance *= rate_x if error_x else 1 - rate_x
        chance *= rate_y if error_y else 1 - rate_y
        table[sent ^ error_x, sent ^ error_y] += chance
    assert rates.joint() == pytest.approx(table)
    assert rates.heard() == pytest.approx(table.sum(axis=1))
    assert rates.lit() == pytest.approx(table.sum(axis=0))


@pytest.mark.parametrize("p", [0.0, 1.0])
@pytest.mark.parametrize("errors", [{}, {"wireless_loss": 0.1, "visual_miss": 0.2, "visual_false": 0.3}])
def test_who_always_does_the_same_tells_nothing(p: float, errors: dict[str, float]) -> None:
    table = ChannelRates(transmission_probability=p, **errors).log_likelihood_ratios()
    assert table == pytest.approx(np.zeros((2, 2)), abs=1e-12)


@pytest.mark.parametrize("name", ["transmission_probability", *RATES])
@pytest.mark.parametrize("value", [-0.01, 1.01, math.nan])
def test_no_probability(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"^{name}: a probability lies in"):
        ChannelRates(**{name: value})


def test_what_can_be_estimated() -> None:
    check_estimable([])
    check_estimable(USUAL)
    with pytest.raises(ValueError, match=r"^wireless_false: not all four"):
        check_estimable(RATES)
    with pytest.raises(ValueError, match=r"^radio_loss: there is no rate of this name"):
        check_estimable(["radio_loss"])


def solved(rates: ChannelRates, pairs: Floats) -> dict[str, float]:
    """The three equations of `estimated`, solved for wireless_loss, visual_miss and visual_false."""
    p, ghost = rates.transmission_probability, rates.wireless_false
    q = 1 - p
    joint = pairs / pairs.sum()
    heard, lit, both = joint[1].sum(), joint[:, 1].sum(), joint[1, 1]
    received = (heard - q * ghost) / p
    shown, false = np.linalg.solve([[p, q], [p * received, q * ghost]], [lit, both])
    return {"wireless_loss": 1 - received, "visual_miss": 1 - shown, "visual_false": false}


def draw(rng: np.random.Generator, rates: ChannelRates, count: int) -> Floats:
    pairs: Floats = rng.multinomial(count, rates.joint().ravel()).reshape(2, 2).astype(float)
    return pairs


@pytest.mark.parametrize(("p", "ghost"), [(0.5, 0.0), (0.3, 0.0), (0.5, 0.1)])
def test_estimates_solve_the_equations_and_lie_within_their_standard_errors(p: float, ghost: float) -> None:
    true = ChannelRates(
        transmission_probability=p,
        wireless_loss=0.15,
        wireless_false=ghost,
        visual_miss=0.1,
        visual_false=0.06,
    )
    guess = ChannelRates(
        transmission_probability=p,
        wireless_loss=0.3,
        wireless_false=ghost,
        visual_miss=0.3,
        visual_false=0.2,
    )
    rng = np.random.default_rng(1)
    found = []
    for _ in range(60):
        pairs = draw(rng, true, 20_000)
        rates = estimated(guess, USUAL, pairs, NOTHING, NOTHING, prior_observations=0)
        by_hand = solved(true, pairs)
        assert [getattr(rates, name) for name in USUAL] == pytest.approx(
            [by_hand[name] for name in USUAL], abs=1e-5
        )
        assert (rates.transmission_probability, rates.wireless_false) == (p, ghost)
        found.append([getattr(rates, name) for name in USUAL])
    error = np.std(found, axis=0, ddof=1) / math.sqrt(len(found))
    assert (np.abs(np.mean(found, axis=0) - [0.15, 0.1, 0.06]) < 4 * error).all()
    assert (error < 0.002).all()


def log_likelihood(rates: ChannelRates, pairs: Floats, heard: Floats, lit: Floats) -> float:
    with np.errstate(divide="ignore", invalid="ignore"):
        parts = [
            np.where(count > 0, count * np.log(chance), 0.0).sum()
            for count, chance in ((pairs, rates.joint()), (heard, rates.heard()), (lit, rates.lit()))
        ]
    return float(sum(parts))


def test_nothing_is_likelier_than_the_estimate() -> None:
    """On a grid of all rates, with ids observed alone, and few observations, so that bounds matter."""
    rng = np.random.default_rng(2)
    true = ChannelRates(wireless_loss=0.1, visual_miss=0.02, visual_false=0.0)
    pairs = draw(rng, true, 30)
    heard, lit = np.array([30.0, 25.0]), np.array([8.0, 4.0])
    guess = ChannelRates(wireless_loss=0.2, visual_miss=0.2, visual_false=0.2)
    best = log_likelihood(estimated(guess, USUAL, pairs, heard, lit, prior_observations=0), pairs, heard, lit)
    grid = np.linspace(0.0, 0.48, 13)
    for loss, miss, false in itertools.product(grid, repeat=3):
        rates = ChannelRates(wireless_loss=loss, visual_miss=miss, visual_false=false)
        assert log_likelihood(rates, pairs, heard, lit) < best + 1e-6


def test_other_rates_can_be_unknown_too() -> None:
    true = ChannelRates(wireless_loss=0.1, wireless_false=0.05, visual_miss=0.2, visual_false=0.1)
    for names in itertools.combinations(RATES, 3):
        guess = ChannelRates(**{name: 0.15 if name in names else getattr(true, name) for name in RATES})
        found = estimated(guess, names, true.joint() * 1e6, NOTHING, NOTHING, prior_observations=0)
        assert [getattr(found, name) for name in RATES] == pytest.approx([0.1, 0.05, 0.2, 0.1], abs=1e-3)


def test_without_observations_the_guess_stands() -> None:
    guess = ChannelRates(wireless_loss=0.1, visual_miss=0.2, visual_false=0.05)
    for prior in (0.0, 10.0):
        found = estimated(guess, USUAL, np.zeros((2, 2)), NOTHING, NOTHING, prior_observations=prior)
        assert found == guess


def test_the_prior_counts_as_many_observations() -> None:
    """Every message heard, every light seen: only the prior's errors are left."""
    guess = ChannelRates(transmission_probability=1.0, wireless_loss=0.1, visual_miss=0.2)
    pairs = np.array([[0.0, 0.0], [0.0, 90.0]])
    found = estimated(guess, ("wireless_loss", "visual_miss"), pairs, NOTHING, NOTHING)
    assert found.wireless_loss == pytest.approx(0.1 * 10 / 100)
    assert found.visual_miss == pytest.approx(0.2 * 10 / 100)


def test_what_the_rates_leave_no_room_for_is_no_reason_to_fail() -> None:
    guess = ChannelRates(transmission_probability=0.0, wireless_loss=0.1)
    found = estimated(guess, ("wireless_loss",), np.full((2, 2), 5.0), np.ones(2), np.ones(2))
    assert found.wireless_loss == pytest.approx(0.1)
