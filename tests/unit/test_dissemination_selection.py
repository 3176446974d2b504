"""Selections on examples done by hand, in rationals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import permutations
from typing import Any

import numpy as np
import pytest

from agent.behaviours.dissemination.selection import (
    SCHEMES,
    FreshestFirst,
    Location,
    LocationProbabilistic,
    RoundRobin,
    Selection,
    selection,
)

LINE = [Fraction(0), Fraction(1), Fraction(2), Fraction(4)]
"""Robots at x = 0, 1, 2, 4, as seen by the first."""
ALL = [0, 0, 0, 0]


def seconds(chooser: Selection, slots: int, distances: Sequence[object] = LINE) -> list[int]:
    """What follows the own estimate in each slot, m = 2, everybody known."""
    return [chooser.choose(2, distances, [0] * len(distances))[1] for _ in range(slots)]


class TestLocation:
    @pytest.mark.parametrize("new_estimates", ["literal", "first", "true-distance"])
    def test_the_line(self, new_estimates: str) -> None:
        assert seconds(Location(0, 4, 1, new_estimates), 14) == [1, 1, 2, 1, 1, 2, 1, 3, 1, 2, 1, 1, 2, 1]

    def test_counters_on_the_line(self) -> None:
        chooser = Location(0, 4, 1, "literal")
        chooser.choose(2, LINE, ALL)
        assert chooser.counters == [1, 1, Fraction(5, 7), Fraction(6, 7)]
        chooser.choose(2, LINE, ALL)
        assert chooser.counters == [1, 1, Fraction(25, 49), Fraction(36, 49)]
        chooser.choose(2, LINE, ALL)
        assert chooser.counters == [1, Fraction(3, 7), 1, Fraction(216, 343)]

    def test_frequencies_on_the_line_are_the_probabilities(self) -> None:
        """4/7, 2/7, 1/7 in the limit: counts stay near them, however long it goes on."""
        counts: Counter[int] = Counter()
        for slot, number in enumerate(seconds(Location(0, 4, 1, "literal"), 2100), start=1):
            counts[number] += 1
            for robot, share in ((1, Fraction(4, 7)), (2, Fraction(2, 7)), (3, Fraction(1, 7))):
                assert abs(counts[robot] - slot * share) <= 2

    def test_alpha(self) -> None:
        """Of 1 + 1/4 + 1/16."""
        chooser = Location(0, 4, 2, "literal")
        chooser.choose(2, LINE, ALL)
        assert chooser.counters == [1, 1, Fraction(17, 21), Fraction(20, 21)]

    def test_alpha_of_nothing_is_taking_turns(self) -> None:
        assert seconds(Location(0, 4, 0, "literal"), 6) == [1, 2, 3, 1, 2, 3]

    def test_picks_within_a_slot_count_down_what_is_left(self) -> None:
        """First 3/7 5/7 6/7, and 1 goes; then 2 of 2/3 and 3 of 1/3: 5/21 4/7, and 2 goes."""
        chooser = Location(0, 4, 1, "literal")
        assert chooser.choose(3, LINE, ALL) == [0, 1, 2]
        assert chooser.counters == [1, 1, 1, Fraction(4, 7)]

    def test_the_last_one_left_is_picked_with_certainty(self) -> None:
        chooser = Location(0, 4, 1, "literal")
        assert chooser.choose(4, LINE, ALL) == [0, 1, 2, 3]
        assert chooser.counters == [1, 1, 1, 1]

    def test_ties_go_to_the_lowest_number(self) -> None:
        chooser = Location(2, 4, 1, "literal")
        equal = [Fraction(1), Fraction(1), Fraction(0), Fraction(1)]
        assert [chooser.choose(2, equal, ALL)[1] for _ in range(4)] == [0, 1, 3, 0]

    def test_two_robots_at_one_place(self) -> None:
        assert Location(0, 3, 1, "literal").choose(3, [0.0, 5.0, 0.0], [0, 0, 0]) == [0, 2, 1]

    def test_own_counter_never_changes_nor_does_the_own_distance_matter(self) -> None:
        chooser = Location(0, 4, 1, "literal")
        assert chooser.choose(2, [None, *LINE[1:]], [None, 0, 0, 0]) == [0, 1]
        assert chooser.counters[0] == 1

    @pytest.mark.parametrize("alpha", [-0.1, 20.5, float("nan"), float("inf")])
    def test_alpha_out_of_range(self, alpha: float) -> None:
        with pytest.raises(ValueError, match=r"alpha: must lie within 0 \(all alike\) to 20"):
            selection("location", 0, 4, alpha=alpha)

    def test_a_missing_distance_is_named(self) -> None:
        with pytest.raises(ValueError, match="distances: the one to robot 3 is missing"):
            Location(0, 4, 1, "literal").choose(2, [*LINE[:3], None], ALL)
        with pytest.raises(ValueError, match="distances: the one to robot 3 is missing"):
            Location(0, 4, 1, "true-distance").choose(2, [*LINE[:3], None], [0, 0, 0, None])


class TestNewEstimates:
    """Robot 3 is heard of after three slots."""

    unknown = (0, 0, 0, None)

    def after_three(self, new_estimates: str) -> tuple[Location, list[int]]:
        chooser = Location(0, 4, 1, new_estimates)
        distances = LINE if new_estimates == "true-distance" else [*LINE[:3], None]
        picks = [chooser.choose(2, distances, self.unknown)[1] for _ in range(3)]
        chooser.heard_first(3)
        return chooser, picks

    def test_literal_waits(self) -> None:
        """Without robot 3: counters 1/3 2/3, then 1/3 4/9, then 1/3 8/27. With it: 1/7, 3/7, then 125/343."""
        chooser, picks = self.after_three("literal")
        assert picks == [1, 1, 2]
        assert chooser.counters == [1, Fraction(1, 3), 1, 1]
        assert seconds(chooser, 3) == [1, 1, 2]

    def test_true_distance_has_counted_down(self) -> None:
        chooser, picks = self.after_three("true-distance")
        assert picks == [1, 1, 2]
        assert chooser.counters == [1, Fraction(3, 7), 1, Fraction(216, 343)]

    def test_first_relays_news_at_once(self) -> None:
        chooser, _ = self.after_three("first")
        assert chooser.counters[3] == 0
        assert chooser.choose(2, LINE, ALL) == [0, 3]
        assert chooser.counters[3] == 1

    def test_first_takes_the_nearest_news_first(self) -> None:
        chooser = Location(0, 4, 1, "first")
        for number in (1, 2, 3):
            chooser.heard_first(number)
        far_first = [Fraction(0), Fraction(4), Fraction(2), Fraction(2)]
        assert chooser.choose(4, far_first, ALL) == [0, 2, 3, 1]

    def test_first_does_not_mind_news_of_itself(self) -> None:
        chooser = Location(0, 4, 1, "first")
        chooser.heard_first(0)
        assert chooser.counters[0] == 1

    def test_true_distance_never_sends_the_unknown(self) -> None:
        """However low its counter: it is the nearest."""
        chooser = Location(3, 4, 1, "true-distance")
        distances = [Fraction(4), Fraction(3), Fraction(1), Fraction(0)]
        for _ in range(30):
            assert 2 not in chooser.choose(3, distances, [0, 0, None, 0])
        chooser.heard_first(2)
        assert chooser.choose(2, distances, ALL) == [3, 2]

    def test_unknown_name(self) -> None:
        with pytest.raises(ValueError, match="new_estimates: must be one of first, literal, true-distance"):
            selection("location", 0, 4, new_estimates="never")


class TestProbabilistic:
    def test_chances_of_ordered_pairs(self) -> None:
        """Two of three without replacement: 4/7 of 2/3 for (1, 2), and so on."""
        chooser = LocationProbabilistic(0, 4, 1, np.random.default_rng(5))
        slots = 20_000
        counts = Counter(tuple(chooser.choose(3, [0.0, 1.0, 2.0, 4.0], ALL)[1:]) for _ in range(slots))
        weights = {1: Fraction(4, 7), 2: Fraction(2, 7), 3: Fraction(1, 7)}
        for one, other in permutations(weights, 2):
            chance = float(weights[one] * weights[other] / (1 - weights[one]))
            assert abs(counts[one, other] / slots - chance) < 4 * (chance * (1 - chance) / slots) ** 0.5

    def test_takes_as_many_draws_whatever_is_known(self) -> None:
        one, other = np.random.default_rng(5), np.random.default_rng(5)
        LocationProbabilistic(0, 4, 1, one).choose(3, LINE, [0, 0, None, None])
        LocationProbabilistic(0, 4, 1, other).choose(3, LINE, ALL)
        assert one.random() == other.random()

    def test_chance_needs_a_generator(self) -> None:
        with pytest.raises(ValueError, match="hand in a generator"):
            selection("location-probabilistic", 0, 4)


class TestBaselines:
    def test_round_robin_goes_on_after_the_last(self) -> None:
        chooser = RoundRobin(1, 5)
        known = [0, 0, 0, 0, 0]
        sent = [chooser.choose(3, known, known) for _ in range(4)]
        assert sent == [[1, 2, 3], [1, 4, 0], [1, 2, 3], [1, 4, 0]]

    def test_round_robin_while_more_become_known(self) -> None:
        chooser = RoundRobin(0, 5)
        assert chooser.choose(2, [], [0, None, None, None, None]) == [0]
        assert chooser.choose(2, [], [0, None, None, 0, None]) == [0, 3]
        assert chooser.choose(2, [], [0, 0, None, 0, None]) == [0, 1]
        assert chooser.choose(2, [], [0, 0, 0, 0, None]) == [0, 2]
        assert chooser.choose(5, [], [0, 0, 0, 0, None]) == [0, 3, 1, 2]

    def test_freshest_first(self) -> None:
        chooser = FreshestFirst(2, 5)
        assert chooser.choose(4, [], [7, 9, 0, None, 9]) == [2, 1, 4, 0]
        assert chooser.choose(2, [], [7, 7, 0, None, 7]) == [2, 0]

    def test_flooding_sends_all_that_is_known_by_number(self) -> None:
        assert selection("flooding", 2, 4).choose(4, [], [0, None, 0, 0]) == [2, 0, 3]
        assert selection("flooding", 2, 4).choose(9, [], ALL) == [2, 0, 1, 3]

    def test_flooding_needs_room(self) -> None:
        with pytest.raises(
            ValueError,
            match="m: flooding sends everything, so a slot must take 4 estimates, not 3; set m to 4",
        ):
            selection("flooding", 2, 4).choose(3, LINE, ALL)

    @pytest.mark.parametrize("m", [1, 3])
    def test_own_only(self, m: int) -> None:
        assert selection("own", 2, 4).choose(m, LINE, ALL) == [2]


@pytest.mark.parametrize("scheme", SCHEMES)
class TestAllSchemes:
    def chooser(self, scheme: str) -> Selection:
        return selection(scheme, 1, 3, generator=np.random.default_rng(1))

    def test_knows_only_itself(self, scheme: str) -> None:
        assert self.chooser(scheme).choose(3, [None, 0.0, None], [None, 0, None]) == [1]

    def test_no_room_is_no_slot(self, scheme: str) -> None:
        with pytest.raises(
            ValueError, match="m: a slot takes at least the own estimate, so m must be 1 or more, not 0"
        ):
            self.chooser(scheme).choose(0, [1.0, 0.0, 1.0], [0, 0, 0])


def test_unknown_scheme() -> None:
    with pytest.raises(
        ValueError, match="scheme: must be one of location, location-probabilistic, flooding, own,"
    ):
        selection("gossip", 0, 4)


@pytest.mark.parametrize("number", [float, Fraction])
def test_news_goes_before_whoever_outweighs_all_the_others(number: Callable[[int], Any]) -> None:
    """At this alpha the nearest robot's share rounds to 1 in floats, and its counter all but to 0."""
    robot = Location(0, 4, 20, "first")
    distances = [number(0), number(3), number(30), number(30)]
    said = []
    for slot in range(12):
        if slot == 3:
            robot.heard_first(2)
            robot.heard_first(3)
        stamps = [0, 0, 0, 0] if slot >= 3 else [0, 0, None, None]
        said += robot.choose(2, distances, stamps)[1:]
    assert said == [1, 1, 1, 2, 3, 1, 1, 1, 1, 1, 1, 1]
