"""Robots that share slots: on random teams, against neighbourhoods counted by hand."""

from __future__ import annotations

import math
from typing import Any

import networkx as nx
import numpy as np
import pytest
from numpy.typing import NDArray

from channels.medium import Medium
from channels.settings import RadioSettings, TdmaSettings
from emulator.scenario import RobotSpec
from emulator.slots import colouring, connectivity, shared_slots
from tests.traffic import BYTE_A_NANOSECOND, Send, play

TEAMS = [(seed, robots) for seed in range(6) for robots in (1, 2, 12, 40)]


def specs(positions: list[tuple[float, float]], altitudes_m: list[float] | None = None) -> list[RobotSpec]:
    return [
        RobotSpec(f"r{index:02}", place, 0.0, (0.0, 0.0), "m:f", {}, altitude)
        for index, (place, altitude) in enumerate(
            zip(positions, altitudes_m or [0.0] * len(positions), strict=True)
        )
    ]


def drawn(seed: int, robots: int, *, high: bool = False) -> list[RobotSpec]:
    """A team at random, with some five neighbours each."""
    rng = np.random.default_rng(seed)
    side = math.sqrt(robots)
    places = [(float(x), float(y)) for x, y in rng.uniform(0, side, (robots, 2))]
    return specs(places, rng.uniform(0, 1, robots).tolist() if high else None)


def radio(reuse: str = "distance_two", range_m: float = 1.3, **tdma: Any) -> RadioSettings:
    slots = TdmaSettings(slot_s=10e-9, reuse=reuse, **tdma)  # type: ignore[arg-type]
    return RadioSettings(range_m, "tdma", slots, BYTE_A_NANOSECOND, collisions=True)


def neighbours(team: list[RobotSpec], range_m: float = 1.3) -> list[set[int]]:
    """By distance alone."""

    def at(spec: RobotSpec) -> tuple[float, float, float]:
        return *spec.position_m, spec.altitude_m

    return [
        {
            other
            for other in range(len(team))
            if other != one and math.dist(at(team[one]), at(team[other])) <= range_m
        }
        for one in range(len(team))
    ]


def slots_of(radio: RadioSettings, team: list[RobotSpec], seed: int = 1) -> list[int]:
    slots = shared_slots(radio, team, seed)
    assert slots is not None
    return slots


def speak_in_turn(radio: RadioSettings, team: list[RobotSpec], slots: list[int]) -> list[list[str]]:
    """Everybody's fate who sends a message of 8 ns at the beginning of each of its slots of 10 ns."""
    medium = Medium(
        radio, [spec.id for spec in team], 1, slots=slots, altitudes_m=[spec.altitude_m for spec in team]
    )
    assert medium.schedule is not None
    sends, frames = [], 3
    for robot, slot in enumerate(slots):
        for frame in range(frames):
            start = medium.schedule.next_start(slot, frame * medium.schedule.frame_ns)
            sends.append(Send(start, robot, 8))
    places: NDArray[np.float64] = np.array([spec.position_m for spec in team])
    heard = play(medium, sends, lambda _now: places)
    return [heard[robot, seq].reasons for robot in range(len(team)) for seq in range(frames)]


@pytest.mark.parametrize(("seed", "robots"), TEAMS)
def test_connectivity_is_who_is_in_range_of_whom(seed: int, robots: int) -> None:
    for high in (False, True):
        team = drawn(seed, robots, high=high)
        graph = connectivity(RadioSettings(1.3), team)
        assert [set(graph[robot]) for robot in range(robots)] == neighbours(team)


def test_connectivity_includes_the_edge_of_the_range_and_reckons_with_altitude() -> None:
    assert connectivity(RadioSettings(5.0), specs([(0.0, 0.0), (3.0, 4.0)])).number_of_edges() == 1
    assert (
        connectivity(RadioSettings(5.0), specs([(0.0, 0.0), (3.0, 0.0)], [0.0, 4.0])).number_of_edges() == 1
    )
    assert (
        connectivity(RadioSettings(5.0), specs([(0.0, 0.0), (3.0, 0.0)], [0.0, 4.001])).number_of_edges() == 0
    )


@pytest.mark.parametrize(("seed", "robots"), TEAMS)
@pytest.mark.parametrize("order", ["fixed", "drawn", "drawn_each_frame"])
def test_no_two_of_a_slot_are_neighbours_or_have_one_in_common(seed: int, robots: int, order: str) -> None:
    team = drawn(seed, robots, high=seed % 2 == 1)
    slots = slots_of(radio(order=order), team)
    near = neighbours(team)
    for one in range(robots):
        for other in range(one):
            if slots[one] == slots[other]:
                assert other not in near[one]
                assert not near[one] & near[other]
    assert set(slots) == set(range(max(slots) + 1))
    # Whoever has k neighbours needs as many slots, and one of its own.
    assert max(slots) + 1 >= 1 + max(map(len, near))
    assert robots < 40 or max(slots) + 1 < robots


@pytest.mark.parametrize(("seed", "robots"), TEAMS)
def test_at_distance_one_only_neighbours_are_kept_apart(seed: int, robots: int) -> None:
    team = drawn(seed, robots)
    slots, apart = slots_of(radio("distance_one"), team), slots_of(radio(), team)
    for one, near in enumerate(neighbours(team)):
        assert all(slots[one] != slots[other] for other in near)
    assert max(slots) <= max(apart)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("order", ["fixed", "drawn", "drawn_each_frame"])
def test_a_team_that_stands_has_no_collisions_at_distance_two(seed: int, order: str) -> None:
    team = drawn(seed, 30, high=seed % 2 == 1)
    settings = radio(order=order)
    fates = speak_in_turn(settings, team, slots_of(settings, team))
    assert {reason for row in fates for reason in row} == {"delivered", "out_of_range", "not_a_candidate"}
    delivered = sum(row.count("delivered") for row in fates)
    assert delivered == 3 * sum(map(len, neighbours(team)))


@pytest.mark.parametrize("seed", range(4))
def test_at_distance_one_robots_collide_at_their_common_neighbours(seed: int) -> None:
    team = drawn(seed, 30)
    settings = radio("distance_one")
    slots, near = slots_of(settings, team), neighbours(team)
    lost = 0
    for index, row in enumerate(speak_in_turn(settings, team, slots)):
        sender = index // 3
        others = {robot for robot in range(30) if slots[robot] == slots[sender]} - {sender}
        for receiver, reason in enumerate(row):
            if receiver in near[sender]:
                expected = "collision" if near[receiver] & others else "delivered"
                assert reason == expected
                lost += expected == "collision"
    assert lost > 0


def test_a_line_takes_three_slots_at_distance_two_and_two_at_one() -> None:
    line = specs([(float(x), 0.0) for x in range(7)])
    assert max(slots_of(radio(range_m=1.0), line)) + 1 == 3
    assert max(slots_of(radio("distance_one", range_m=1.0), line)) + 1 == 2
    assert max(slots_of(radio(range_m=100.0), line)) + 1 == 7
    assert slots_of(radio(range_m=0.5), line) == [0] * 7


def test_colourings_of_graphs_whose_least_number_is_known() -> None:
    # 13 nodes in a star around one: all are within two hops of each other.
    star = nx.star_graph(12)
    assert sorted(colouring(star, "distance_two")) == list(range(13))
    assert len(set(colouring(star, "distance_one"))) == 2
    square = nx.convert_node_labels_to_integers(nx.grid_2d_graph(10, 10))
    assert len(set(colouring(square, "distance_one"))) == 2
    found = colouring(square, "distance_two")
    assert (
        5 <= len(set(found)) <= 9
    )  # five suffice (a knight's move apart); nobody has more than 12 within two
    for one, reached in nx.all_pairs_shortest_path_length(square, cutoff=2):
        assert all(found[one] != found[other] for other in reached if other != one)


def test_a_drawn_order_permutes_the_slots_and_leaves_who_shares_them() -> None:
    team = drawn(3, 40)
    fixed = slots_of(radio(), team)
    orders = [slots_of(radio(order="drawn"), team, seed) for seed in (1, 1, 2, 3)]
    assert orders[0] == orders[1]
    assert len({tuple(order) for order in [fixed, *orders]}) == 4
    for order in orders:
        new_of = dict(zip(fixed, order, strict=True))
        assert [new_of[slot] for slot in fixed] == order
        assert sorted(new_of.values()) == sorted(set(fixed))
    assert slots_of(radio(order="drawn_each_frame"), team) == fixed


def test_each_has_a_slot_of_its_own_where_none_are_shared() -> None:
    team = drawn(1, 12)
    assert shared_slots(radio("none"), team, 1) is None
    assert shared_slots(RadioSettings(1.3), team, 1) is None
    ideal = RadioSettings(1.3, "ideal", TdmaSettings(slot_s=1.0, reuse="distance_two"))
    assert shared_slots(ideal, team, 1) is None
