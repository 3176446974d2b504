"""The noise-tolerant i-state: by hand, against a full enumeration of its model, and whether it keeps its word."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from agent.behaviours.association.noisy_istate import NoisyIState
from agent.behaviours.association.rates import ChannelRates

LOSSY = ChannelRates(wireless_loss=0.1)
NOISY = ChannelRates(wireless_loss=0.2, visual_miss=0.1, visual_false=0.05)
USUAL = ("wireless_loss", "visual_miss", "visual_false")


def test_by_hand() -> None:
    """Two voices, one light; a heard and seen lit, b silent; then b heard while the lamp is dark."""
    istate = NoisyIState(LOSSY, wireless=["b", "a"], closed=True)
    istate.update({"a"}, {7: 1})
    assert istate.wireless == ["a", "b"]
    assert istate.visual == [7]
    assert istate.counts[:, 0].tolist() == [[[0, 0], [0, 1]], [[0, 1], [0, 0]]]
    ratios = [2.0, 0.05 / (0.55 * 0.5)]
    assert np.exp(istate.log_likelihood_ratios())[:, 0] == pytest.approx(ratios)
    chance = ratios[0] / sum(ratios)
    assert istate.posteriors()[:, 0] == pytest.approx([chance, 1 - chance])
    assert istate.claims(0.9) == {7: ("a", pytest.approx(chance))}
    assert istate.claims(0.95) == {}
    assert istate.edges(0.05) == {7: ["a", "b"]}
    assert istate.edges(0.2) == {7: ["a"]}

    istate.update({"b"}, {7: 0})
    assert istate.log_likelihood_ratios()[1, 0] == -math.inf
    assert istate.claims(1.0) == {7: ("a", 1.0)}
    assert istate.edges(0.0) == {7: ["a"]}


def test_who_turns_up_late_was_silent_before() -> None:
    early = NoisyIState(NOISY, wireless=["a", "b"])
    late = NoisyIState(NOISY, wireless=["a"])
    steps = [({"a"}, {1: 1, 2: 0}), (set(), {2: 1}), ({"a", "b"}, {1: 0, 2: 1}), ({"b"}, {1: 0})]
    for heard, lamps in steps:
        early.update(heard, lamps)
        late.update(heard, lamps)
    assert late.wireless == ["a", "b"]
    assert late.counts.tolist() == early.counts.tolist()
    assert late.posteriors() == pytest.approx(early.posteriors())


def test_a_light_that_is_not_in_the_frame_tells_nothing_in_that_step() -> None:
    istate = NoisyIState(NOISY)
    istate.update({"a"}, {1: 1})
    istate.update({"a"}, {})
    istate.update({"a"}, {2: 0})
    assert istate.counts[0].sum(axis=(1, 2)).tolist() == [1, 1]


def test_a_roll_call_brings_ids_and_no_evidence() -> None:
    istate = NoisyIState(NOISY)
    istate.roll_call(["b", "a"], [5, 3])
    assert istate.wireless == ["a", "b"]
    assert istate.visual == [3, 5]
    assert istate.counts.sum() == 0
    assert istate.posteriors() == pytest.approx(np.full((2, 2), istate.posteriors()[0, 0]))


@pytest.mark.parametrize(("wireless", "visual"), [([], []), (["a"], []), ([], [1])])
def test_nobody_to_associate(wireless: list[str], visual: list[int]) -> None:
    for nobody in (0.0, 0.1):
        istate = NoisyIState(LOSSY, nobody=nobody)
        istate.roll_call(wireless, visual)
        istate.update(set(wireless), dict.fromkeys(visual, 1))
        assert istate.claims(0.9) == {}
        assert istate.assignment(np.random.default_rng(0)) == {}
        assert istate.edges(0.0) == {visual_id: [] for visual_id in visual}
        assert istate.posteriors().shape == (len(wireless), len(visual))


def test_ties_are_broken_at_random() -> None:
    istate = NoisyIState(LOSSY, wireless=["a", "b", "c"], closed=True)
    istate.roll_call([], [1, 2])
    rng = np.random.default_rng(0)
    found = [tuple(istate.assignment(rng).items()) for _ in range(600)]
    counts = {one: found.count(one) for one in set(found)}
    assert len(counts) == 6
    assert min(counts.values()) > 60
    assert istate.posteriors() == pytest.approx(np.full((3, 2), 1 / 3))


def test_what_contradicts_the_rates_is_claimed_by_nobody() -> None:
    """It is told that nothing is lost, and something is: as the papers' i-state, it never completes."""
    istate = NoisyIState(ChannelRates(), wireless=["a", "b"], closed=True)
    istate.update({"b"}, {1: 1})
    istate.update({"a"}, {1: 1})
    assert (istate.log_likelihood_ratios() == -math.inf).all()
    assert istate.posteriors().tolist() == [[0.0], [0.0]]
    assert istate.claims(0.9) == istate.assignment(np.random.default_rng(0)) == {}


# --- the whole model, enumerated --------------------------------------------------------------------


def enumerated(
    rates: ChannelRates,
    strings: Mapping[str, Sequence[int]],
    lamps: Sequence[Sequence[int]],
    at_roll_call: set[str],
    *,
    nobody: float,
    out_of_sight: float,
) -> list[dict[str, float]]:
    """For each light, the chance of each voice ("": not heard, "-": out of radio range), by definition.

    Robots in sight: one per light, out of radio range with probability `nobody`. Robots out of sight: Poisson.
    All in radio range answer the roll call, and then send with probability p. Given names at random.
    """
    joint, heard, lit = rates.joint(), rates.heard(), rates.lit()

    def of_roll_call(answered: bool) -> float:
        return 1 - rates.wireless_loss if answered else rates.wireless_loss

    names = sorted(strings)
    chances = [dict.fromkeys(["", "-", *names], 0.0) for _ in lamps]
    total = 0.0
    for owners in itertools.product(["", "-", *names], repeat=len(lamps)):
        taken = [name for name in owners if name in strings]
        if len(set(taken)) < len(taken):
            continue
        chance = 1.0
        for owner, row in zip(owners, lamps, strict=True):
            if owner == "-":
                chance *= nobody * math.prod(lit[y] for y in row)
            else:
                string = strings.get(owner, [0] * len(row))
                chance *= (1 - nobody) * of_roll_call(owner in at_roll_call)
                chance *= math.prod(joint[x, y] for x, y in zip(string, row, strict=True))
        for name in set(names) - set(taken):
            chance *= out_of_sight * of_roll_call(name in at_roll_call)
            chance *= math.prod(heard[x] for x in strings[name])
        total += chance
        for light, owner in zip(chances, owners, strict=True):
            light[owner] += chance
    return [{owner: chance / total for owner, chance in light.items()} for light in chances]


@pytest.mark.parametrize("nobody", [0.0, 0.2])
@pytest.mark.parametrize("steps", [0, 1, 4])
def test_against_an_enumeration_of_the_model(nobody: float, steps: int) -> None:
    rng = np.random.default_rng(steps)
    for _ in range(10):
        strings = {name: rng.integers(0, 2, steps).tolist() for name in "abc"[: rng.integers(1, 4)]}
        at_roll_call = {name for name in strings if rng.random() < 0.7 or not any(strings[name])}
        lamps = rng.integers(0, 2, (rng.integers(1, 4), steps)).tolist()
        istate = NoisyIState(NOISY, nobody=nobody, out_of_sight=1.7)
        istate.roll_call(at_roll_call, range(len(lamps)))
        for step in range(steps):
            heard = {name for name, string in strings.items() if string[step]}
            istate.update(heard, {light: row[step] for light, row in enumerate(lamps)})
        expected = enumerated(NOISY, strings, lamps, at_roll_call, nobody=nobody, out_of_sight=1.7)
        chances = istate.posteriors()
        for light, owners in enumerate(expected):
            for row, name in enumerate(istate.wireless):
                assert chances[row, light] == pytest.approx(owners[name], abs=1e-9)
            for bound in (0.05, 0.3, 0.6):
                assert (light in istate.strangers(bound)) == (nobody > 0 and owners["-"] >= bound)


@pytest.mark.parametrize(("wireless", "visual"), [(5, 1), (4, 2), (3, 2), (2, 2), (1, 3)])
def test_unless_told_as_many_are_out_of_sight_as_are_heard_and_not_seen(wireless: int, visual: int) -> None:
    """At least one; and with every robot that turns up late, one more."""
    rng = np.random.default_rng(9)
    strings = {name: [0, *rng.integers(0, 2, 2).tolist()] for name in "abcde"[:wireless]}
    strings["a"][0] = 1  # the first step's only voice: had missed the roll call, and turns up
    lamps = rng.integers(0, 2, (visual, 3)).tolist()
    istate = NoisyIState(NOISY, nobody=0.2)
    istate.roll_call(set(strings) - {"a"}, range(visual))
    for step in range(3):
        heard = {name for name, string in strings.items() if string[step]}
        istate.update(heard, {light: row[step] for light, row in enumerate(lamps)})
        so_far = {name: string[: step + 1] for name, string in strings.items()}
        expected = enumerated(NOISY, so_far, [row[: step + 1] for row in lamps], set(strings) - {"a"},
                              nobody=0.2, out_of_sight=max(1, wireless - visual))  # fmt: skip
        chances = istate.posteriors()
        for light, owners in enumerate(expected):
            found = {name: chances[row, light] for row, name in enumerate(istate.wireless)}
            assert found == pytest.approx({name: owners[name] for name in strings}, abs=1e-9)


def test_out_of_sight_by_hand() -> None:
    """Five voices and one light: four are out of sight, and any of those, too, may have missed the roll call."""
    istate = NoisyIState(LOSSY)
    istate.roll_call("abcde", [7])
    assert istate.posteriors()[:, 0] == pytest.approx([1 / (5 + 4 * 0.1)] * 5)
    few = NoisyIState(LOSSY)
    few.roll_call("a", [7, 8])
    # Both lights nobody's, or one of them a's: 1 * 0.1 * 0.1, or twice 1 * 0.1.
    assert few.posteriors()[0] == pytest.approx([0.1 / 0.21] * 2)


# --- whether it keeps its word ----------------------------------------------------------------------


def observe(
    rng: np.random.Generator, istate: NoisyIState, true: ChannelRates, wireless: int, visual: int, steps: int
) -> dict[int, str]:
    """Let a neighbourhood talk; returns the truth. Robot j is the j-th name of a random order."""
    names = [f"{name:02d}" for name in rng.permutation(wireless)]
    lights = rng.permutation(visual).tolist()
    answered = rng.random(wireless) >= true.wireless_loss
    istate.roll_call(itertools.compress(names, answered), lights)
    for _ in range(steps):
        sent = rng.random(wireless) < true.transmission_probability
        heard = sent & (rng.random(wireless) >= true.wireless_loss)
        seen = np.where(
            sent[:visual], rng.random(visual) >= true.visual_miss, rng.random(visual) < true.visual_false
        )
        istate.update(set(itertools.compress(names, heard)), dict(zip(lights, seen.tolist(), strict=True)))
    return dict(zip(lights, names, strict=False))


def calibration(told: ChannelRates, true: ChannelRates, **keys: object) -> tuple[float, list[int]]:
    """Standardised sum of (right - posterior) over the best pair of one light each, and how many are sure.

    One light per neighbourhood, so that all are independent.
    """
    rng = np.random.default_rng(1)
    difference = variance = 0.0
    sure = [0, 0]
    for sample in range(400):
        istate = NoisyIState(told, **keys)  # type: ignore[arg-type]
        truth = observe(rng, istate, true, 5, 3, 4 + sample % 12)
        chances = istate.posteriors()[:, 0]
        row = int(chances.argmax())
        right = istate.wireless[row] == truth[istate.visual[0]]
        difference += right - chances[row]
        variance += chances[row] * (1 - chances[row])
        if chances[row] > 0.9:
            sure[0] += 1
            sure[1] += right
    return difference / math.sqrt(variance), sure


def test_posteriors_are_calibrated() -> None:
    score, sure = calibration(NOISY, NOISY, out_of_sight=2.0)
    assert abs(score) < 4
    assert sure[0] > 50
    assert sure[1] / sure[0] > 0.9


def test_whoever_is_told_wrong_rates_is_not_calibrated() -> None:
    """The check above can fail."""
    told = ChannelRates(wireless_loss=0.01, visual_miss=0.01, visual_false=0.01)
    true = ChannelRates(wireless_loss=0.3, visual_miss=0.2, visual_false=0.2)
    assert calibration(told, true, out_of_sight=2.0)[0] < -4


def test_estimating_the_rates_mends_that() -> None:
    guess = ChannelRates(wireless_loss=0.1, visual_miss=0.1, visual_false=0.1)
    true = ChannelRates(wireless_loss=0.3, visual_miss=0.15, visual_false=0.1)
    rng = np.random.default_rng(2)
    found = []
    for _ in range(6):
        istate = NoisyIState(guess, estimate=USUAL)
        truth = observe(rng, istate, true, 12, 8, 80)
        rates = istate.rates
        found.append([rates.wireless_loss, rates.visual_miss, rates.visual_false])
        claims = istate.claims(0.95)
        assert len(claims) >= 6
        assert sum(truth[light] == name for light, (name, _) in claims.items()) >= len(claims) - 1
        assert (rates.wireless_false, rates.transmission_probability) == (0.0, 0.5)
    assert np.mean(found, axis=0) == pytest.approx([0.3, 0.15, 0.1], abs=0.04)


def test_one_estimated_rate_leaves_the_others_alone() -> None:
    istate = NoisyIState(NOISY, estimate=["visual_miss"])
    observe(np.random.default_rng(3), istate, NOISY, 5, 3, 10)
    assert istate.rates.visual_miss != NOISY.visual_miss
    assert istate.rates.wireless_loss == NOISY.wireless_loss
    assert istate.rates.visual_false == NOISY.visual_false


# --- mistakes ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"estimate": ["wireless_false"]}, "wireless_false: a rate to be estimated begins between 0 and 1"),
        ({"estimate": ["lost"]}, "lost: there is no rate of this name"),
        ({"nobody": 1.0}, "nobody: a probability below 1"),
        ({"nobody": math.nan}, "nobody: a probability below 1"),
        ({"out_of_sight": -1.0}, "out_of_sight: how many robots"),
        ({"out_of_sight": math.inf}, "out_of_sight: how many robots"),
    ],
)
def test_mistakes_are_told(keys: dict[str, object], sentence: str) -> None:
    with pytest.raises(ValueError, match=f"^{sentence}"):
        NoisyIState(NOISY, **keys)  # type: ignore[arg-type]


@pytest.mark.parametrize("confidence", [0.5, 0.0, 1.01, math.nan])
def test_a_claim_needs_more_than_even_odds(confidence: float) -> None:
    with pytest.raises(ValueError, match=r"^confidence: must be above 0\.5"):
        NoisyIState(NOISY).claims(confidence)


def test_strangers_in_a_closed_circle() -> None:
    with pytest.raises(ValueError, match=r"^c was heard"):
        NoisyIState(NOISY, wireless=["a"], closed=True).update({"c"}, {})
