"""What a robot knows of the others, and how far it takes them to be."""

from __future__ import annotations

import math

import pytest

from agent.behaviours.dissemination.distances import distance_function, euclidean, euclidean_3d, hops
from agent.behaviours.dissemination.estimates import Estimate, EstimateTable, News


def at(number: int, x: float = 0.0, y: float = 0.0, z: float = 0.0, time_ms: int = 0) -> Estimate:
    return Estimate(number, time_ms, x, y, z, 0.0)


class TestTable:
    def test_unknown_is_unknown(self) -> None:
        table = EstimateTable(1, 3)
        assert table.known() == []
        assert table.others() == []
        assert table.listed() == [None] * 3
        assert table.stamps() == [None] * 3
        assert not table.complete

    def test_strictly_newer_wins(self) -> None:
        table = EstimateTable(0, 3)
        old, new = at(2, x=1.0, time_ms=10), at(2, x=2.0, time_ms=11)
        assert table.receive(old) is News.first
        assert table.receive(at(2, x=9.0, time_ms=10)) is News.nothing
        assert table[2] == old
        assert table.receive(new) is News.newer
        assert table.receive(old) is News.nothing
        assert table[2] == new

    def test_about_itself_a_robot_knows_better(self) -> None:
        table = EstimateTable(0, 2)
        assert table.receive(at(0, x=5.0, time_ms=99)) is News.nothing
        assert table[0] is None
        table.update_own(at(0, x=1.0, time_ms=7))
        assert table.receive(at(0, x=5.0, time_ms=99)) is News.nothing
        assert table[0] == at(0, x=1.0, time_ms=7)

    def test_own_state_is_current_even_when_its_clock_is_set_back(self) -> None:
        table = EstimateTable(0, 2)
        table.update_own(at(0, x=1.0, time_ms=7))
        table.update_own(at(0, x=2.0, time_ms=3))
        assert table[0] == at(0, x=2.0, time_ms=3)

    def test_a_robot_alone_is_complete_once_it_knows_itself(self) -> None:
        table = EstimateTable(0, 1)
        assert not table.complete
        table.update_own(at(0))
        assert table.complete

    def test_complete_when_all_are_known(self) -> None:
        table = EstimateTable(1, 3)
        table.update_own(at(1, time_ms=5))
        table.receive(at(2, time_ms=6))
        table.receive(at(2, time_ms=7))
        assert not table.complete
        table.receive(at(0, time_ms=4))
        assert table.complete
        assert table.known() == [0, 2]
        assert table.stamps() == [4, 5, 7]
        assert table.others() == [at(0, time_ms=4), at(2, time_ms=7)]

    @pytest.mark.parametrize("number", [-1, 3])
    def test_strangers_are_refused(self, number: int) -> None:
        with pytest.raises(ValueError, match="number: an estimate of robot"):
            EstimateTable(0, 3).receive(at(number))
        with pytest.raises(ValueError, match="number: a team of 3 has the numbers 0 to 2"):
            EstimateTable(number, 3)

    def test_own_state_of_somebody_else_is_refused(self) -> None:
        with pytest.raises(ValueError, match="number: the own estimate of robot 0 says 1"):
            EstimateTable(0, 3).update_own(at(1))


class TestDistances:
    team = (at(0), at(1, 3.0, 4.0), None, at(3, 3.0, 4.0, 12.0))

    def test_over_the_ground_and_through_the_air(self) -> None:
        assert euclidean(0, self.team) == [0.0, 5.0, None, 5.0]
        assert euclidean_3d(0, self.team) == [0.0, 5.0, None, 13.0]
        assert euclidean_3d(3, self.team) == [13.0, 12.0, None, 0.0]

    def test_hops_by_hand(self) -> None:
        line = [at(k, float(k)) for k in range(5)]
        assert hops(0, line, 1.0) == [0, 1, 2, 3, 4]  # heard at exactly the range as well
        assert hops(0, line, 2.0) == [0, 1, 1, 2, 2]
        assert hops(2, line, 1.0) == [2, 1, 0, 1, 2]

    def test_hops_lead_through_known_robots_only(self) -> None:
        gap = [at(0), at(1, 1.0), None, at(3, 3.0), at(4, 4.0)]
        assert hops(0, gap, 1.0) == [0, 1, None, 5, 5]  # cut off: n, more than any path
        assert hops(4, gap, 1.0) == [5, 5, None, 1, 0]

    def test_hops_count_altitude(self) -> None:
        assert hops(0, [at(0), at(1, 3.0, 0.0, 4.0)], 5.0) == [0, 1]
        assert hops(0, [at(0), at(1, 3.0, 0.0, 4.0)], 4.99) == [0, 2]

    def test_robots_at_one_place_are_told_apart(self) -> None:
        assert hops(1, [at(0), at(1), at(2)], 1.0) == [1, 0, 1]

    def test_by_name(self) -> None:
        assert distance_function("euclidean")(0, self.team) == euclidean(0, self.team)
        assert distance_function("euclidean-3d")(0, self.team) == euclidean_3d(0, self.team)
        assert distance_function("graph", 13.0)(0, self.team) == [0, 1, None, 1]

    @pytest.mark.parametrize("link_range", [None, 0.0, -1.0, math.nan])
    def test_hops_need_a_range(self, link_range: float | None) -> None:
        with pytest.raises(ValueError, match="link_range_m: distance graph counts hops"):
            distance_function("graph", link_range)

    def test_bad_input_is_named(self) -> None:
        with pytest.raises(ValueError, match="distance: must be one of euclidean, euclidean-3d, graph"):
            distance_function("manhattan")
        with pytest.raises(ValueError, match="robot 2 does not know its own place"):
            euclidean(2, self.team)
