"""What LIMITATIONS.md says of claims under noise: how many are wrong, by what the observer was told.

Neighbourhoods of 20 voices and 10 lights. What counts is the first claim for each light: later ones mend
some of them, but whoever acts on the first has acted.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from msgspec import Struct

from agent.behaviours.association.noisy_istate import NoisyIState
from agent.behaviours.association.rates import ChannelRates

WIRELESS, VISUAL = 20, 10
CONFIDENCES = (0.9, 0.99)
STEPS = 60
USUAL = ("wireless_loss", "visual_miss", "visual_false")
NOISY = ChannelRates(wireless_loss=0.1, visual_miss=0.1, visual_false=0.05)
WORSE = ChannelRates(wireless_loss=0.3, visual_miss=0.1, visual_false=0.05)


class FirstClaims(Struct):
    """Of all neighbourhoods together."""

    made: int = 0
    wrong: int = 0
    said: float = 0.0
    """Of these, by their own account: the sum of what is missing to 1."""

    def add(self, right: bool, posterior: float) -> None:
        self.made += 1
        self.wrong += not right
        self.said += 1.0 - posterior


def first_claims(
    told: ChannelRates, true: ChannelRates, neighbourhoods: int, estimate: tuple[str, ...] = ()
) -> dict[float, FirstClaims]:
    """By confidence. Every neighbourhood has a roll call and then its steps, until there is nothing to add."""
    found = {confidence: FirstClaims() for confidence in CONFIDENCES}
    for number in range(neighbourhoods):
        rng = np.random.default_rng([20_160_601, number])
        istate = NoisyIState(told, estimate=estimate)
        names = [f"{name:02d}" for name in rng.permutation(WIRELESS)]  # of robots; the first are in sight
        istate.roll_call(itertools.compress(names, rng.random(WIRELESS) >= true.wireless_loss), range(VISUAL))
        claimed: dict[float, set[int]] = {confidence: set() for confidence in CONFIDENCES}
        for _ in range(STEPS):
            observe(rng, istate, true, names)
            for confidence in CONFIDENCES:
                for light, (name, posterior) in istate.claims(confidence).items():
                    if light not in claimed[confidence]:
                        claimed[confidence].add(light)
                        found[confidence].add(name == names[light], posterior)
            if len(claimed[CONFIDENCES[-1]]) == VISUAL:
                break
    return found


def observe(rng: np.random.Generator, istate: NoisyIState, true: ChannelRates, names: list[str]) -> None:
    """One step over channels that err."""
    sent = rng.random(WIRELESS) < true.transmission_probability
    heard = sent & (rng.random(WIRELESS) >= true.wireless_loss)
    missed = rng.random(VISUAL) < true.visual_miss
    imagined = rng.random(VISUAL) < true.visual_false
    lit = np.where(sent[:VISUAL], ~missed, imagined)
    istate.update(set(itertools.compress(names, heard)), dict(enumerate(lit.tolist())))


def test_a_rate_told_as_zero_is_a_promise() -> None:
    """Of the claims that are said to be 99 % sure, a third is wrong (0.323, standard error 0.009, of 3574)."""
    claims = first_claims(ChannelRates(wireless_loss=0.1), WORSE, 20)[0.99]
    assert claims.made > 100
    assert claims.wrong / claims.made > 0.15
    assert claims.said / claims.made < 0.01


def test_told_the_truth_as_many_are_wrong_as_it_says() -> None:
    """Whichever confidence is asked for."""
    for claims in first_claims(NOISY, NOISY, 40).values():
        assert claims.made == 40 * VISUAL
        # Mistakes come in pairs, where two lights are swapped: twice the variance of single ones.
        assert abs(claims.wrong - claims.said) < 4 * math.sqrt(2 * claims.said)


def test_rates_that_are_estimated_leave_few_claims_wrong() -> None:
    """More than it says, since the uncertainty of the rates is left out; but not many."""
    claims = first_claims(NOISY, WORSE, 20, USUAL)[0.99]
    assert claims.made > 150
    assert claims.wrong / claims.made < 0.03


def test_a_guess_that_is_far_off_is_better_learnt_from_than_believed() -> None:
    guess = ChannelRates(wireless_loss=0.02, visual_miss=0.02, visual_false=0.02)
    believed, learnt = (first_claims(guess, WORSE, 15, estimate)[0.99] for estimate in ((), USUAL))
    assert min(believed.made, learnt.made) > 100
    assert believed.wrong / believed.made > 0.08
    assert learnt.wrong / learnt.made < 0.05
