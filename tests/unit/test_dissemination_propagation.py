"""Propagation on grids: by hand, against a team of the classes robots run, and against what is known."""

from __future__ import annotations

from itertools import count, permutations
from typing import Any

import msgspec
import numpy as np
import pytest

from agent.behaviours.dissemination.estimates import Estimate, EstimateTable, News
from agent.behaviours.dissemination.selection import selection
from channels.units import airtime_ns
from scenarios.dissemination.lattices import Lattice, subgraphs
from scenarios.dissemination.predictions import PREDICTION, FrameRateParameters
from scenarios.dissemination.study_propagation import (
    FRAMES_AT_ONCE,
    STUDY,
    PropagationParameters,
    check,
    simulate,
    summarise,
)
from scenarios.study import run_study


def slots_of(seed: int = 1, samples: int = 1, **changes: Any) -> list[list[int]]:
    """Slots until each part is done, in each run."""
    parameters = PropagationParameters(**changes)
    check(parameters)
    found: list[list[int]] = simulate(parameters, np.random.default_rng(seed), samples).tolist()
    return found


class TestLattices:
    @pytest.mark.parametrize(
        ("neighbours", "links"),
        [(4, 2 * 4 * 5 - 4 - 5), (8, 2 * 4 * 5 - 4 - 5 + 2 * 3 * 4), (6, 4 * 4 + 3 * (2 * 5 - 1))],
    )
    def test_links(self, neighbours: Any, links: int) -> None:
        grid = Lattice(4, 5, neighbours)
        assert grid.links().sum() == 2 * links
        assert (grid.links() == grid.links().T).all()
        assert not grid.links().diagonal().any()
        assert grid.links().sum(axis=1).max() == neighbours

    def test_corners_and_middle_of_a_triangular_lattice(self) -> None:
        linked = Lattice(3, 3, 6).links()
        assert np.flatnonzero(linked[0]).tolist() == [1, 3]
        assert np.flatnonzero(linked[3]).tolist() == [0, 1, 4, 6, 7]  # its row is shifted to the right
        assert np.flatnonzero(linked[4]).tolist() == [1, 2, 3, 5, 7, 8]

    @pytest.mark.parametrize("neighbours", [4, 8, 6])
    def test_distances_are_those_of_the_places(self, neighbours: Any) -> None:
        grid = Lattice(5, 4, neighbours)
        apart = grid.places()[:, np.newaxis] - grid.places()
        assert grid.euclidean() == pytest.approx(np.hypot(apart[..., 0], apart[..., 1]))
        assert (
            grid.links() == ((grid.euclidean() > 0) & (grid.euclidean() < (1.5 if neighbours == 8 else 1.1)))
        ).all()

    def test_hops(self) -> None:
        row, column = np.divmod(np.arange(20), 5)
        across, along = abs(row[:, np.newaxis] - row), abs(column[:, np.newaxis] - column)
        assert (Lattice(4, 5, 4).hops() == across + along).all()
        assert (Lattice(4, 5, 8).hops() == np.maximum(across, along)).all()
        assert Lattice(3, 3, 6).hops()[0].tolist() == [0, 1, 2, 1, 2, 3, 2, 2, 3]

    def test_the_middle(self) -> None:
        assert Lattice(4, 5, 4).middle(2, 3).tolist() == [6, 7, 8, 11, 12, 13]
        assert Lattice(4, 5, 4).middle(4, 5).tolist() == list(range(20))

    @pytest.mark.parametrize("neighbours", [4, 8, 6])
    def test_who_shares_a_slot_shares_no_neighbour(self, neighbours: Any) -> None:
        grid = Lattice(6, 7, neighbours)
        slots = grid.slots("distance_two")
        assert sorted(np.concatenate(slots).tolist()) == list(range(42))
        for senders in slots:
            heard = grid.links()[senders]
            assert heard.sum(axis=0).max() <= 1
            assert not heard[:, senders].any()
        assert len(slots) >= neighbours + 1  # a robot and its neighbours are at most two hops apart

    def test_five_slots_serve_any_square_grid(self) -> None:
        assert [len(Lattice(side, side, 4).slots("distance_two")) for side in (5, 10, 20)] == [5, 5, 5]

    def test_names_of_parts(self) -> None:
        assert subgraphs("2x2, 4x10") == {"2x2": (2, 2), "4x10": (4, 10)}


LINE = {"rows": 1, "columns": 3, "m": 2, "subgraphs": "1x3", "order": "fixed"}


class TestByHand:
    """Three robots in a line, in order, m = 2."""

    def test_first(self) -> None:
        """0: -> 1. 1: 1 and 0 -> all know 1, 2 knows 0. 2: -> 1. 0: nothing new. 1: 1 and its news 2 -> 0."""
        assert slots_of(**LINE) == [[5]]

    def test_literal(self) -> None:
        """As above, but in slot 5 both counters of robot 1 are 1/2, and 0 comes first; in slot 8 it is 2."""
        assert slots_of(**LINE, new_estimates="literal") == [[8]]

    def test_true_distance(self) -> None:
        """In slot 2 the counters of robot 1 are 1/2 and 1/2, 2 being unknown: so 1/2 and 1/4 in slot 5."""
        assert slots_of(**LINE, new_estimates="true-distance") == [[5]]

    def test_two_in_the_middle_need_no_relay(self) -> None:
        assert slots_of(rows=1, columns=4, m=1, subgraphs="1x2,1x4", order="fixed") == [[3, 0]]

    def test_units_and_frames(self) -> None:
        result = run_study(STUDY, PropagationParameters(**LINE), samples=3, jobs=1)
        assert result == {
            "units": {"1x3": {"mean": 10.0, "sd": 0.0, "se": 0.0, "incomplete": 0}},
            "frames": {"1x3": {"mean": 5 / 3, "sd": 0.0, "se": 0.0, "incomplete": 0}},
            "slots_per_frame": 3,
            "samples": 3,
        }

    def test_runs_that_were_not_completed_are_left_out(self) -> None:
        parameters = PropagationParameters(rows=4, columns=4, m=3, subgraphs="2x2,4x4")
        result = summarise(parameters, [np.array([[10, 0], [16, 0]]), np.array([[0, 20]])])
        assert result["units"]["2x2"] == {
            "mean": 39.0,
            "sd": pytest.approx(162**0.5),
            "se": 9.0,
            "incomplete": 1,
        }
        assert result["frames"]["2x2"]["mean"] == 13 / 16
        assert result["frames"]["2x2"]["se"] == pytest.approx(3 / 16)
        assert result["units"]["4x4"] == {"mean": 60.0, "sd": None, "se": None, "incomplete": 2}
        nobody = summarise(parameters, [np.zeros((2, 2), dtype=np.int64)])
        assert nobody["units"]["2x2"] == {"mean": None, "sd": None, "se": None, "incomplete": 2}


class Team:
    """A team of the classes robots run. All of a slot speak at once: packets are frozen, then delivered."""

    def __init__(self, parameters: PropagationParameters, chance: np.random.Generator) -> None:
        self.grid = Lattice(parameters.rows, parameters.columns, parameters.neighbours)
        self.m, self.chance, self.order = parameters.m, chance, parameters.order
        self.slots = self.grid.slots(parameters.reuse)
        n = self.grid.robots
        self.distances = self.grid.euclidean() if parameters.distance == "euclidean" else self.grid.hops()
        self.tables = [EstimateTable(i, n) for i in range(n)]
        self.choosers = [
            selection(
                parameters.scheme, i, n,
                alpha=parameters.alpha, new_estimates=parameters.new_estimates, generator=chance,
            )
            for i in range(n)
        ]  # fmt: skip
        for i, table in enumerate(self.tables):
            table.update_own(Estimate(i, 0, 0.0, 0.0, 0.0, 0.0))

    def slot(self, senders: list[int], now: int) -> None:
        packets = []
        for i in senders:
            self.tables[i].update_own(Estimate(i, now, 0.0, 0.0, 0.0, 0.0))
            chosen = self.choosers[i].choose(self.m, self.distances[i].tolist(), self.tables[i].stamps())
            packets.append((i, [self.tables[i][j] for j in chosen]))
        for i, packet in packets:
            for receiver in np.flatnonzero(self.grid.links()[i]).tolist():
                for estimate in packet:
                    assert estimate is not None
                    if self.tables[receiver].receive(estimate) is News.first:
                        self.choosers[receiver].heard_first(estimate.number)

    def run(self, parts: list[list[int]], frames: int) -> list[int]:
        """Slots until each part is done, or 0."""
        order = np.arange(len(self.slots))
        if self.order == "drawn":
            self.chance.shuffle(order)
        done = [0] * len(parts)
        for frame in range(frames):
            if self.order == "drawn_each_frame" and frame % FRAMES_AT_ONCE == 0:
                orders = self.chance.permuted(np.tile(np.arange(len(order)), (FRAMES_AT_ONCE, 1)), axis=1)
            if self.order == "drawn_each_frame":
                order = orders[frame % FRAMES_AT_ONCE]
            for place, slot in enumerate(order):
                now = frame * len(order) + place
                self.slot(self.slots[slot].tolist(), now)
                for k, part in enumerate(parts):
                    known = all(self.tables[i][j] is not None for i in part for j in part)
                    done[k] = done[k] or (now + 1) * known
                if all(done):
                    return done
        return done


@pytest.mark.parametrize(
    "changes",
    [
        {"new_estimates": "first"},
        {"new_estimates": "literal"},
        {"new_estimates": "true-distance"},
        {"new_estimates": "literal", "alpha": 2.0, "distance": "graph"},
        {"neighbours": 8, "alpha": 0.5},
        {"neighbours": 6, "m": 2},
        {"neighbours": 6, "m": 2, "new_estimates": "literal"},
        {"order": "fixed"},
        {"order": "drawn_each_frame"},
        {"reuse": "distance_two"},
        {"reuse": "distance_two", "neighbours": 6, "order": "drawn_each_frame", "new_estimates": "literal"},
        {"scheme": "location-probabilistic"},
        {"scheme": "flooding", "m": 20},
        {"scheme": "own"},
        {"m": 1, "neighbours": 8},
        {"m": 30},
        {"scheme": "round-robin"},
        {"scheme": "round-robin", "reuse": "distance_two"},
        {"scheme": "freshest-first"},
        {"scheme": "freshest-first", "m": 6, "order": "drawn_each_frame"},
    ],
    ids=lambda changes: " ".join(map(str, changes.values())),
)
def test_as_a_team_of_the_classes_robots_run(changes: dict[str, Any]) -> None:
    """Not stopped early in a run that goes nowhere either: the team takes its 40 frames."""
    parameters = PropagationParameters(
        **{"rows": 4, "columns": 5, "m": 3, "subgraphs": "2x1,2x3,4x5", "max_frames": 40, **changes}
    )
    parts = [
        Lattice(4, 5, parameters.neighbours).middle(*shape).tolist() for shape in ((2, 1), (2, 3), (4, 5))
    ]
    for seed in (1, 2):
        expected = Team(parameters, np.random.default_rng(seed)).run(parts, 40)
        assert simulate(parameters, np.random.default_rng(seed), 1).tolist() == [expected]


def test_flooding_of_a_square_of_four_over_all_orders() -> None:
    """By rumours alone: what is known spreads from slot to slot."""

    def slots(order: tuple[int, ...]) -> int:
        around = {0: (1, 2), 1: (0, 3), 2: (0, 3), 3: (1, 2)}
        known = {i: {i} for i in range(4)}
        for now in count():
            sender = order[now % 4]
            for receiver in around[sender]:
                known[receiver] |= known[sender]
            if all(len(each) == 4 for each in known.values()):
                return now + 1
        raise AssertionError

    exact = [slots(order) for order in permutations(range(4))]
    runs = [
        run[0] for run in slots_of(rows=2, columns=2, m=4, scheme="flooding", subgraphs="2x2", samples=2000)
    ]
    assert set(runs) == set(exact)
    assert np.mean(runs) == pytest.approx(np.mean(exact), abs=4 * np.std(exact) / 2000**0.5)


class TestWhereNobodyCanLearnMore:
    """A million frames would take minutes."""

    def test_nobody_relays(self) -> None:
        frames = 1_000_000
        assert slots_of(m=1, max_frames=frames, samples=50) == [[0, 0, 0, 0]] * 50
        own = slots_of(scheme="own", m=7, neighbours=8, max_frames=frames, samples=50)
        assert own == slots_of(scheme="location", m=1, neighbours=8, max_frames=frames, samples=50)
        assert all(0 < two <= 100 and rest == [0, 0, 0] for two, *rest in own)

    def test_the_freshest_crowd_out_the_rest(self) -> None:
        assert slots_of(scheme="freshest-first", m=7, max_frames=1_000_000)[0][1:] == [0, 0, 0]

    def test_a_run_ends_with_its_last_frame(self) -> None:
        (run,) = slots_of(new_estimates="literal", max_frames=30)
        assert 0 < run[1] <= 3000
        assert run[2:] == [0, 0]


class TestTheGridOfThePaper:
    """10 x 10; means of 1000 runs by an independent calculation, here of fewer: within 5 standard errors."""

    @pytest.mark.parametrize(
        ("changes", "samples", "expected"),
        [
            ({"scheme": "flooding", "m": 100}, 200, {"2x2": 12_693, "8x8": 54_139}),
            ({"new_estimates": "first"}, 100, {"2x2": 889, "4x4": 5_112, "6x6": 9_637, "8x8": 11_589}),
            ({"new_estimates": "literal"}, 10, {"2x2": 892, "4x4": 17_633, "6x6": 80_607, "8x8": 178_315}),
        ],
        ids=["flooding", "first", "literal"],
    )
    def test_propagation_times(
        self, changes: dict[str, Any], samples: int, expected: dict[str, float]
    ) -> None:
        result = run_study(STUDY, PropagationParameters(**changes), samples=samples, jobs=1)
        for name, mean in expected.items():
            found = result["units"][name]
            assert found["incomplete"] == 0
            assert abs(found["mean"] - mean) < 5 * found["se"]
            assert found["mean"] == pytest.approx(mean, rel=0.1 if name == "2x2" else 0.03)

    def test_reuse_takes_a_twentieth_of_the_frame(self) -> None:
        alone = run_study(STUDY, PropagationParameters(), samples=20, jobs=1)
        shared = run_study(STUDY, PropagationParameters(reuse="distance_two"), samples=20, jobs=1)
        assert (alone["slots_per_frame"], shared["slots_per_frame"]) == (100, 5)
        assert shared["units"]["8x8"]["mean"] < alone["units"]["8x8"]["mean"] / 15


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"subgraphs": "3x3"}, "subgraphs: 3x3 cannot be centred on 10x10; let rows and columns differ"),
        ({"subgraphs": "2x3"}, "subgraphs: 2x3 cannot be centred"),
        ({"subgraphs": "12x2"}, "subgraphs: 12x2 is larger than the grid of 10x10; leave it out"),
        ({"subgraphs": "2x2,4x4,2x2"}, "subgraphs: 2x2 is listed twice; list it once"),
        ({"subgraphs": "1x1", "rows": 3, "columns": 3}, "subgraphs: 1x1 is one robot"),
        ({"subgraphs": ""}, "subgraphs: '' is no part of a grid; write rows x columns, as \"2x2,4x4\""),
        ({"subgraphs": "2x2,"}, "subgraphs: '' is no part"),
        ({"subgraphs": "2x2x2"}, "subgraphs: '2x2x2' is no part"),
        ({"subgraphs": "0x2"}, "subgraphs: '0x2' is no part"),
        ({"subgraphs": "02x2"}, "subgraphs: '02x2' is no part"),
        ({"subgraphs": "²x2"}, "subgraphs: '²x2' is no part"),
        ({"scheme": "flooding", "m": 99}, "m: flooding sends everything, so a slot must take 100 estimates, not 99"),
    ],
)  # fmt: skip
def test_what_does_not_go_together_is_named(changes: dict[str, Any], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        check(PropagationParameters(**changes))


@pytest.mark.parametrize(
    "wrong",
    [
        {"neighbours": 5},
        {"m": 0},
        {"rows": 0},
        {"alpha": -1.0},
        {"scheme": "gossip"},
        {"max_frames": 0},
        {"k": 1},
    ],
)
def test_what_is_out_of_range_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(wrong, PropagationParameters)


class TestFrameRate:
    @pytest.mark.parametrize(("m", "rate"), [(1, 1.736), (3, 0.579), (9, 0.193)])
    def test_of_the_paper(self, m: int, rate: float) -> None:
        result = PREDICTION.predict(FrameRateParameters(robots=9, m=m))
        assert round(result["frame_rate_hz"], 3) == rate
        assert result == pytest.approx(
            {
                "unit_s": 0.064,
                "slot_s": 0.064 * m,
                "frame_s": 0.576 * m,
                "frame_rate_hz": 3000 / (9 * m * 192),
            }
        )

    def test_overhead_comes_once_a_message_and_the_guard_once_a_slot(self) -> None:
        result = PREDICTION.predict(
            FrameRateParameters(robots=10, m=4, bits=100, bit_rate=1000, overhead_bits=50, guard_s=0.05)
        )
        assert result == {"unit_s": 0.1, "slot_s": 0.5, "frame_s": 5.0, "frame_rate_hz": 0.2}

    def test_shared_slots(self) -> None:
        result = PREDICTION.predict(FrameRateParameters(robots=100, slots=5))
        assert result["frame_s"] == pytest.approx(5 * 0.192)

    def test_to_the_nanosecond(self) -> None:
        """192 bits at 9600 / 7 bit/s are no whole number of them: slots are rounded up, as the medium does."""
        result = PREDICTION.predict(FrameRateParameters(robots=1000, m=1, bit_rate=9600 / 7))
        assert round(result["frame_s"] * 1e9) == 1000 * airtime_ns(192, 9600 / 7)

    def test_more_slots_than_robots(self) -> None:
        with pytest.raises(ValueError, match="slots: 9 robots need no 10 slots; set slots to 9 or less"):
            PREDICTION.check(FrameRateParameters(slots=10))
        PREDICTION.check(FrameRateParameters(slots=9))
