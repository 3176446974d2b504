"""Age of estimates: the sawtooth by hand and by brute force; the study, against the classes that robots run."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agent.behaviours.dissemination.distances import hops
from agent.behaviours.dissemination.estimates import Estimate, EstimateTable, News
from agent.behaviours.dissemination.selection import selection
from scenarios.dissemination.score_age import (
    UNREACHABLE,
    Around,
    Updates,
    Window,
    around,
    cut,
    mean_age,
    quantile,
    remotest,
    spearman,
    summary,
    teeth,
)
from scenarios.dissemination.study_age import STUDY, AgeParameters, Placement, check, draw, updates
from scenarios.study import generator, run_study


def heard(*rows: tuple[int, int, float, float]) -> Updates:
    """Receiver, origin, received, made."""
    receiver, origin, received, made = zip(*rows, strict=True) if rows else ((), (), (), ())
    return Updates(
        np.array(receiver, dtype=np.int64), np.array(origin, dtype=np.int64),
        np.array(received, dtype=np.float64), np.array(made, dtype=np.float64),
    )  # fmt: skip


def window(*until_s: float, from_s: float = 0.0) -> Window:
    return Window(from_s, np.array(until_s))


def standing(*places: tuple[float, float], range_m: float) -> Around:
    return around(np.zeros(1), np.array([places]), range_m)


# --- the sawtooth ------------------------------------------------------------------------------------

TWO = heard((0, 1, 2.0, 1.0), (0, 1, 5.0, 4.0))
"""Age 1 at 2 s, growing to 4 at 5 s; there again 1."""


def test_teeth_by_hand() -> None:
    whole = teeth(TWO, window(10.0, 10.0))
    assert whole.begins_s.tolist() == [2.0, 5.0]
    assert whole.low_s.tolist() == [1.0, 1.0]
    assert whole.high_s.tolist() == [4.0, 6.0]
    assert mean_age(whole.low_s, whole.high_s) == (3 * 2.5 + 5 * 3.5) / 8
    # Two teeth between ages 1 and 4, one from there to 6: 8 s in all.
    assert quantile(whole.low_s, whole.high_s, 0.5) == pytest.approx(3.0)
    assert quantile(whole.low_s, whole.high_s, 0.75) == pytest.approx(4.0)
    assert quantile(whole.low_s, whole.high_s, 0.95) == pytest.approx(5.6)
    assert quantile(whole.low_s, whole.high_s, 1.0) == pytest.approx(6.0)


def test_teeth_are_cut_off_by_the_window() -> None:
    part = teeth(TWO, window(7.0, 10.0, from_s=4.0))
    assert (part.begins_s.tolist(), part.low_s.tolist(), part.high_s.tolist()) == ([4, 5], [3, 1], [4, 3])
    assert len(teeth(TWO, window(2.0, 10.0)).low_s) == 0  # the receiver ends as it hears for the first time
    assert len(teeth(heard(), window(2.0, 10.0)).low_s) == 0


def test_each_pair_has_teeth_of_its_own() -> None:
    several = heard((0, 1, 2.0, 1.0), (0, 2, 3.0, 0.0), (1, 0, 4.0, 4.0))
    whole = teeth(several, window(10.0, 8.0, 10.0))
    assert whole.high_s.tolist() == [9.0, 10.0, 4.0]


def test_nothing_known_has_no_age() -> None:
    nothing = np.empty(0)
    assert mean_age(nothing, nothing) is None
    assert quantile(nothing, nothing, 0.95) is None


def test_cut_by_hand() -> None:
    parts = cut(teeth(TWO, window(10.0, 10.0)), np.array([0.0, 3.0, 5.0, 6.0, 10.0]))
    assert parts.begins_s.tolist() == [2, 3, 5, 6]
    assert parts.low_s.tolist() == [1, 2, 1, 2]
    assert parts.high_s.tolist() == [2, 4, 2, 6]


sawteeth = st.lists(st.tuples(st.floats(0, 50), st.floats(0.01, 50)), min_size=1, max_size=12)


@given(sawteeth, st.floats(0.01, 0.99))
def test_quantiles_divide_the_time(pieces: list[tuple[float, float]], part: float) -> None:
    """By definition: so much of the time estimates are at most that old."""
    low = np.array([begin for begin, _ in pieces])
    high = low + np.array([length for _, length in pieces])
    found = quantile(low, high, part)
    assert found is not None
    below = np.clip(found - low, 0, high - low).sum()
    assert below == pytest.approx(part * (high - low).sum(), rel=1e-9, abs=1e-9)


@given(sawteeth, st.lists(st.floats(0, 120), max_size=8))
def test_cutting_changes_no_age(pieces: list[tuple[float, float]], at: list[float]) -> None:
    rows = [(0, number + 1, begin + 1, 1.0) for number, (begin, _) in enumerate(pieces)]
    whole = teeth(heard(*rows), window(*[200.0] * (len(pieces) + 1)))
    parts = cut(whole, np.array(sorted(at)))
    assert (parts.high_s - parts.low_s >= 0).all()
    assert mean_age(parts.low_s, parts.high_s) == pytest.approx(mean_age(whole.low_s, whole.high_s))
    middles = parts.begins_s + (parts.high_s - parts.low_s) / 2
    sides = np.searchsorted(sorted(at), parts.begins_s, "right") == np.searchsorted(
        sorted(at), middles, "right"
    )
    assert sides[parts.high_s - parts.low_s > 1e-9].all()  # none reaches across a cut


# --- distances ---------------------------------------------------------------------------------------


def test_around_by_hand() -> None:
    where = standing((0, 0), (3, 4), (6, 8), (50, 0), range_m=5.0)  # 5 m is just in range
    assert where.distance_m[0, 0].tolist() == [0, 5, 10, 50]
    assert where.hops[0, 0].tolist() == [0, 1, 2, UNREACHABLE]
    assert remotest(where.distance_m[0]) == 3


def test_altitude_counts() -> None:
    where = around(np.zeros(1), np.array([[(0, 0, 0), (3, 0, 4)]]), 4.9)
    assert where.distance_m[0, 0, 1] == 5.0
    assert where.hops[0, 0, 1] == UNREACHABLE


def test_mean_distance_is_weighted_by_time() -> None:
    moving = around(np.array([0.0, 1.0, 4.0]), np.array([[(0, 0), (d, 0)] for d in (6, 2, 10)]), 5.0)
    assert moving.mean_distance_m(0.0, 5.0)[0, 1] == pytest.approx((1 * 6 + 3 * 2 + 1 * 10) / 5)
    assert moving.mean_distance_m(3.0, 4.0)[0, 1] == pytest.approx(2)
    assert moving.mean_distance_m(2.0, 2.0)[0, 1] == 2


def test_rank_correlation() -> None:
    assert spearman(np.array([1.0, 2.0, 5.0]), np.array([7.0, 3.0, 2.0])) == pytest.approx(-1)
    # Ranks 1, 2, 3, 4 and 1, 2.5, 2.5, 4: Pearson's correlation of these, by hand.
    tied = spearman(np.array([1.0, 2.0, 3.0, 4.0]), np.array([0.0, 5.0, 5.0, 9.0]))
    assert tied == pytest.approx(4.5 / math.sqrt(5 * 4.5))
    assert spearman(np.array([1.0, 2.0]), np.array([3.0, 3.0])) is None
    assert spearman(np.array([1.0]), np.array([3.0])) is None


# --- of a team ---------------------------------------------------------------------------------------


LINE = ((0, 0), (4, 0), (10, 0))
"""Robots 4, 6 and 10 m apart."""


def test_summary_by_hand() -> None:
    """5 m range: robot 2 is cut off, and yet, once, heard of; robot 1 never hears of anybody."""
    rows = heard((0, 1, 20.0, 10.0), (0, 1, 40.0, 30.0), (0, 2, 30.0, 0.0))
    found = summary(rows, window(60.0, 60.0, 60.0), standing(*LINE, range_m=5.0), 5.0)
    # Ages of (0, 1): twice from 10 to 30; of (0, 2): from 30 to 60.
    near = {"age_s": {"mean": 20.0, "p95": 29.0}, "updates_per_minute": 2 / 2}
    far = {"age_s": {"mean": 45.0, "p95": 58.5}, "updates_per_minute": 1 / 4}
    assert found["age_s"] == {"mean": pytest.approx((20 * 40 + 45 * 30) / 70), "p95": pytest.approx(56.5)}
    assert found["updates_per_minute"] == 3 / 6
    assert found["by_distance"] == [
        {"from_m": 0.0, "to_m": 5.0, **near},
        {"from_m": 5.0, "to_m": 10.0, **far},
    ]
    assert list(found["by_hops"].items()) == [("1", near), ("unreachable", far)]
    assert found["never_known"] == {"pairs": 4, "of": 6}
    assert found["unknown_part"] == pytest.approx(1 - 70 / 360)
    # Distances 4, 4, 6, 6, 10, 10 with 2, 0, 0, 0, 1, 0 updates; and 4, 10 with mean ages 20, 45.
    ranks = np.corrcoef([1.5, 1.5, 3.5, 3.5, 5.5, 5.5], [6, 2.5, 2.5, 2.5, 5, 2.5])[0, 1]
    assert found["spearman"]["all_pairs"]["distance_and_updates"] == pytest.approx(ranks)
    assert found["spearman"]["all_pairs"]["distance_and_age"] == pytest.approx(1)
    assert found["spearman"]["remotest"] == {"distance_and_updates": None, "distance_and_age": None}


def test_a_dead_receiver_has_no_ages_and_a_dead_origin_has() -> None:
    rows = heard((0, 1, 10.0, 10.0), (1, 0, 10.0, 10.0), (1, 0, 40.0, 40.0))
    found = summary(rows, window(60.0, 30.0), standing((0, 0), (4, 0), range_m=5.0), 5.0)
    assert found["age_s"]["mean"] == (50 * 25 + 20 * 10) / 70
    assert found["updates_per_minute"] == 2 / 1.5  # what came after its death is none
    assert found["unknown_part"] == pytest.approx(20 / 90)


def test_who_moves_is_judged_by_where_it_is_at_the_time() -> None:
    """Two robots 4 m apart for 10 s, and then 7 m; an estimate that is 2 s old when it comes at 5 s."""
    where = around(np.array([0.0, 10.0]), np.array([[(0, 0), (4, 0)], [(0, 0), (7, 0)]]), 5.0)
    found = summary(heard((0, 1, 5.0, 3.0), (0, 1, 15.0, 15.0)), window(20.0, 20.0), where, 5.0)
    near, far = found["by_distance"]
    assert near["age_s"]["mean"] == (2 + 7) / 2
    assert far["age_s"]["mean"] == ((7 + 12) / 2 * 5 + 2.5 * 5) / 10
    assert near["updates_per_minute"] == far["updates_per_minute"] == 1 / (20 / 60)
    assert list(found["by_hops"]) == ["1", "unreachable"]


def test_only_the_window_counts() -> None:
    found = summary(TWO, window(7.0, 7.0, from_s=4.0), standing((0, 0), (4, 0), range_m=5.0), 5.0)
    assert found["age_s"]["mean"] == (1 * 3.5 + 2 * 2) / 3
    assert found["updates_per_minute"] == 1 / (6 / 60)


def test_what_comes_as_the_window_ends_is_an_update_that_is_never_used() -> None:
    found = summary(heard((0, 1, 10.0, 9.0)), window(10.0, 10.0), standing((0, 0), (4, 0), range_m=5.0), 5.0)
    assert found["updates_per_minute"] == 1 / (20 / 60)
    assert found["age_s"]["mean"] is None
    assert found["never_known"] == {"pairs": 2, "of": 2}
    assert found["unknown_part"] == 1.0


def test_ranks_are_of_rates_while_the_receiver_lives() -> None:
    """Robot 2 has as many updates as robot 0 in a tenth of the time, so it is the one with more a minute."""
    places = standing((0, 0), (1, 0), (3, 0), range_m=5.0)  # 0 and 1: 1 m, 1 and 2: 2 m, 0 and 2: 3 m
    rows = heard((0, 1, 1.0, 1.0), (0, 1, 2.0, 2.0), (0, 2, 1.0, 1.0), (2, 0, 1.0, 1.0))
    found = summary(rows, window(60.0, 60.0, 6.0), places, 5.0)["spearman"]["all_pairs"]
    minutes = [2.0, 1.0, 0.0, 0.0, 10.0, 0.0]  # (0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)
    expected = spearman(np.array([1.0, 3.0, 1.0, 2.0, 3.0, 2.0]), np.array(minutes))
    assert found["distance_and_updates"] == pytest.approx(expected)


def test_ranks_are_by_distances_within_the_window() -> None:
    """Robots 1 and 2 change places after 10 s, when the window begins."""
    where = around(
        np.array([0.0, 10.0]), np.array([[(0, 0), (1, 0), (9, 0)], [(0, 0), (6, 0), (4, 0)]]), 20.0
    )
    rows = heard(
        (0, 1, 11.0, 11.0), (0, 2, 11.0, 11.0), (0, 2, 12.0, 12.0), (1, 0, 11.0, 11.0), (2, 0, 11.0, 11.0)
    )
    found = summary(rows, window(12.0, 12.0, 12.0, from_s=10.0), where, 5.0)["spearman"]["all_pairs"]
    # (0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)
    expected = spearman(np.array([6.0, 4.0, 6.0, 2.0, 4.0, 2.0]), np.array([1.0, 2.0, 1.0, 0.0, 1.0, 0.0]))
    assert found["distance_and_updates"] == pytest.approx(expected)


def test_nobody_hears_anything() -> None:
    found = summary(heard(), window(10.0, 10.0), standing((0, 0), (4, 0), range_m=1.0), 5.0)
    assert found["age_s"] == {"mean": None, "p95": None}
    assert found["never_known"] == {"pairs": 2, "of": 2}
    assert found["unknown_part"] == 1.0
    assert found["updates_per_minute"] == 0.0


# --- the study ---------------------------------------------------------------------------------------

PLACES = np.random.default_rng(5).random((7, 2)) * 50
SCHEMES = ("location", "flooding", "own", "round-robin", "freshest-first")


def by_classes(parameters: AgeParameters, placement: Placement) -> set[tuple[int, int, int, int]]:
    """Receiver, origin, reception and stamp [slots] of every update, by the classes robots run."""
    team = range(parameters.robots)
    at = placement.places_m.tolist()
    tables = [EstimateTable(own, len(team)) for own in team]
    schemes = [
        selection(
            parameters.scheme, own, len(team), alpha=parameters.alpha, new_estimates=parameters.new_estimates
        )
        for own in team
    ]
    found = set()
    for slot, sender in zip(range(parameters.slots), itertools.cycle(placement.order.tolist())):
        table = tables[sender]
        table.update_own(Estimate(sender, slot, *at[sender], 0.0, 0.0))
        known: Sequence[float | None] = [math.dist(at[sender], place) for place in at]
        if parameters.distance == "graph":
            known = hops(
                sender, [Estimate(j, 0, x, y, 0.0, 0.0) for j, (x, y) in enumerate(at)], parameters.range
            )
        if parameters.new_estimates != "true-distance":
            known = [None if table[j] is None else known[j] for j in team]
        packet = [table[number] for number in schemes[sender].choose(parameters.m, known, table.stamps())]
        for receiver in team:
            if receiver == sender or math.dist(at[sender], at[receiver]) > parameters.range:
                continue
            for estimate in packet:
                assert estimate is not None
                news = tables[receiver].receive(estimate)
                if news is News.first:
                    schemes[receiver].heard_first(estimate.number)
                if news is not News.nothing:
                    found.add((receiver, estimate.number, slot + 1, estimate.time_ms))
    return found


@pytest.mark.parametrize("new_estimates", ["first", "literal", "true-distance"])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_the_study_does_what_robots_do(scheme: Any, new_estimates: Any) -> None:
    m = {"flooding": 7, "own": 1}.get(scheme, 3)
    parameters = AgeParameters(
        robots=7, range=28.0, m=m, scheme=scheme, new_estimates=new_estimates, bits=300, duration=6.0 * m
    )
    order = np.random.default_rng(6).permutation(7)
    found = updates(parameters, Placement(PLACES, order), np.random.default_rng(7))
    rows = zip(
        found.receiver.tolist(), found.origin.tolist(),
        np.rint(found.received_s / parameters.slot_s).astype(int).tolist(),
        np.rint(found.made_s / parameters.slot_s).astype(int).tolist(), strict=True,
    )  # fmt: skip
    assert parameters.slots == 60
    assert set(rows) == by_classes(parameters, Placement(PLACES, order))
    assert len(found.receiver) > 100


@pytest.mark.parametrize("new_estimates", ["first", "true-distance"])
def test_by_hops_the_study_does_what_robots_do_and_who_is_cut_off_is_n_hops_away(new_estimates: Any) -> None:
    """Six robots in a line, and three that nobody hears; known or not, by true-distance they count."""
    places = np.array(
        [(10.0 * k, 3.0 * (k % 2)) for k in range(6)] + [(0, 500.0), (500.0, 0), (500.0, 500.0)]
    )
    parameters = AgeParameters(
        robots=9, range=12.0, distance="graph", new_estimates=new_estimates, m=2, bits=300, duration=80.0,
        connected=False,
    )  # fmt: skip
    placement = Placement(places, np.random.default_rng(6).permutation(9))
    found = updates(parameters, placement, np.random.default_rng(7))
    rows = zip(
        found.receiver.tolist(), found.origin.tolist(),
        np.rint(found.received_s / parameters.slot_s).astype(int).tolist(),
        np.rint(found.made_s / parameters.slot_s).astype(int).tolist(), strict=True,
    )  # fmt: skip
    assert set(rows) == by_classes(parameters, placement)
    assert len(found.receiver) > 50


def test_schemes_are_compared_on_the_same_placements() -> None:
    placements = [
        draw(parameters, np.random.default_rng(3))
        for parameters in (AgeParameters(), AgeParameters(scheme="flooding", m=9), AgeParameters(alpha=0.0))
    ]
    for other in placements[1:]:
        assert (other.places_m == placements[0].places_m).all()
        assert (other.order == placements[0].order).all()


def test_placements_are_connected_unless_all_are_wanted() -> None:
    chance = np.random.default_rng(8)
    parameters = AgeParameters(side=90.0)
    drawn = [draw(parameters, chance) for _ in range(20)]
    assert sum(placement.redrawn for placement in drawn) > 20
    for placement in drawn:
        assert (around(np.zeros(1), placement.places_m[None], 30.0).hops >= 0).all()
    whatever = msgspec.structs.replace(parameters, connected=False)
    hops = [around(np.zeros(1), draw(whatever, chance).places_m[None], 30.0).hops for _ in range(20)]
    assert any((of_one < 0).any() for of_one in hops)


def run(samples: int = 12, **changed: Any) -> dict[str, Any]:
    return run_study(STUDY, AgeParameters(duration=120.0, **changed), samples=samples, jobs=1)


def test_nearer_is_fresher_under_any_scheme_that_relays() -> None:
    """For news comes by hops (the paper's Fig. 5 would look alike without any importance)."""
    for changed in ({}, {"alpha": 0.0}, {"scheme": "flooding", "m": 9}, {"scheme": "round-robin"}):
        age = run(**changed)["spearman"]["all_pairs"]["distance_and_age"]
        assert age["mean"] - 4 * age["se"] > 0.5


def test_alpha_makes_updates_of_far_robots_rarer() -> None:
    near_first, all_alike = run(), run(alpha=0.0)
    for one, other in zip(near_first["by_distance"], all_alike["by_distance"], strict=True):
        rate, alike = one["updates_per_minute"]["mean"], other["updates_per_minute"]["mean"]
        if one["to_m"] <= 30.0:  # its own estimate everybody sends in every slot
            assert rate == pytest.approx(alike) == pytest.approx(60 / (9 * 3 * 0.064), rel=0.02)
        elif one["from_m"] >= 60.0:
            assert rate < 0.8 * alike


def test_after_the_start_flooding_renews_everybody_alike() -> None:
    """One update a frame, however far away; a window of whole frames (0.576 s times 9) shows nothing else."""
    frames = 10 * 9 * 0.576
    result = run(scheme="flooding", m=9, warm_up=120.0 - frames)
    for part in result["by_distance"]:
        assert part["updates_per_minute"]["mean"] == pytest.approx(60 / (9 * 0.576), rel=0.02)


def test_moments_are_over_placements() -> None:
    result = run(samples=3)
    singles = STUDY.simulate(AgeParameters(duration=120.0), generator("age", 1, 0), 3)
    means = [one["age_s"]["mean"] for one in singles]
    assert result["age_s"]["mean"]["mean"] == pytest.approx(np.mean(means))
    assert result["age_s"]["mean"]["se"] == pytest.approx(np.std(means, ddof=1) / math.sqrt(3))
    assert result["redrawn"] == sum(one["redrawn"] for one in singles)
    assert result["frame_rate_hz"] == pytest.approx(0.5787, rel=1e-4)
    assert result["never_known"] == {"pairs": 0, "of": 3 * 72}
    assert result["samples"] == 3


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"scheme": "flooding"}, "m: flooding sends everything, so a slot must take 9 estimates; set m to 9"),
        ({"duration": 0.1}, "duration: 0.1 s hold no slot, which takes 0.192 s; set more"),
        ({"warm_up": 300.0}, "warm_up: nothing of 300 s is left after 300 s; set less"),
        ({"bit_rate": 1e9}, "duration: makes more estimates than memory holds; set less, or a lower bit_rate"),
        ({"side": 1000.0}, "side: fewer than one of 1000 placements is connected; set less, or a larger range, or connected=false"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(changed: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match="^" + sentence.replace(".", r"\.") + "$"):
        check(AgeParameters(**changed))


def test_what_can_be_is_not_refused() -> None:
    check(AgeParameters())
    check(AgeParameters(side=1000.0, connected=False))
    check(AgeParameters(duration=0.192))
    check(AgeParameters(m=1000, duration=2e5))  # a slot of 64 s carries no more than nine estimates


def test_a_slot_that_ends_with_the_duration_is_whole() -> None:
    for m, duration, slots in (
        (1, 2.752, 43),
        (1, 3.264, 51),
        (1, 2.751, 42),
        (1, 2.753, 43),
        (3, 300.0, 1562),
    ):
        assert AgeParameters(m=m, duration=duration).slots == slots


@pytest.mark.parametrize("slots", [42, 43, 51])
def test_the_slot_that_ends_with_the_duration_counts(slots: int) -> None:
    # 43 and 51 slots of 0.064 s are a last digit longer than 2.752 and 3.264 s, as floats go.
    parameters = AgeParameters(robots=2, side=1.0, m=1, scheme="own", duration=round(slots * 0.064, 3))
    result = run_study(STUDY, parameters, samples=2, jobs=1)
    assert result["updates_per_minute"]["mean"] == pytest.approx(slots * 60 / (2 * parameters.duration))
