"""Mobile association of whole worlds: against the i-state of single robots, against plain loops, by hand."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from agent.behaviours.association.mobile_istate import MobileIState
from scenarios.association import study_mobile
from scenarios.association.mobile_simulation import MobileAssociation, stamp_type
from scenarios.association.mobile_world import World, cells_per_side, robots_in
from scenarios.association.study_mobile import COLUMNS, SERIES, STUDY, MobileParameters
from scenarios.study import run_study

Edges = dict[int, list[str]]


def keys(pairs: set[tuple[int, int]], robots: int) -> NDArray[np.int64]:
    return np.array(sorted(observer * robots + other for observer, other in pairs), dtype=np.int64)


class Reference:
    """One `MobileIState` per observer, and a tracker that gives who comes into view a new visual id."""

    def __init__(self, observers: int, drop_time: int, exceeds: bool) -> None:
        self.istates = [MobileIState(drop_time, exceeds) for _ in range(observers)]
        self.visual_ids: list[dict[int, int]] = [{} for _ in range(observers)]
        self.given = 0
        self.ever_seen: set[tuple[int, int]] = set()
        self.returns = 0

    def observe(self, in_view: set[tuple[int, int]], in_earshot: set[tuple[int, int]], active: Any) -> None:
        for observer, istate in enumerate(self.istates):
            now = sorted(other for who, other in in_view if who == observer)
            ids = {}
            for other in now:
                if other not in self.visual_ids[observer]:
                    self.returns += (observer, other) in self.ever_seen
                    self.ever_seen.add((observer, other))
                    self.given += 1
                ids[other] = self.visual_ids[observer].get(other, self.given)
            self.visual_ids[observer] = ids
            heard = [f"{other:04d}" for who, other in in_earshot if who == observer and active[other]]
            istate.update(heard, set(ids.values()), {ids[other] for other in now if active[other]})

    def edges(self, observer: int) -> Edges:
        """By the number of the robot that is seen."""
        robot_of = {visual: other for other, visual in self.visual_ids[observer].items()}
        return {robot_of[visual]: listed for visual, listed in self.istates[observer].edges().items()}


def edges_of(association: MobileAssociation, observer: int, robots: int) -> Edges:
    found: Edges = {int(key % robots): [] for key in association.visual if key // robots == observer}
    for visual, wireless in zip(*association.edges, strict=True):
        assert visual // robots == wireless // robots
        if visual // robots == observer:
            found[int(visual % robots)].append(f"{wireless % robots:04d}")
    return {visual: sorted(listed) for visual, listed in found.items()}


def assert_equal(association: MobileAssociation, reference: Reference, robots: int) -> None:
    counts = association.counts()
    for observer in range(len(reference.istates)):
        edges = reference.edges(observer)
        assert edges_of(association, observer, robots) == edges
        alone = {visual: listed[0] for visual, listed in edges.items() if len(listed) == 1}
        assert counts.visual[observer] == len(edges)
        assert counts.edges[observer] == sum(map(len, edges.values()))
        assert counts.true_edges[observer] == sum(f"{v:04d}" in listed for v, listed in edges.items())
        assert counts.matched[observer] == len(alone)
        assert counts.right[observer] == sum(name == f"{v:04d}" for v, name in alone.items())


# --- the i-states --------------------------------------------------------------------------------


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_equals_the_i_state_of_single_robots(data: st.DataObject) -> None:
    """Robots come and go at random, not even within earshot while in view."""
    observers, robots = 2, data.draw(st.integers(2, 7))
    drop_time, exceeds = data.draw(st.integers(1, 4)), data.draw(st.booleans())
    association = MobileAssociation(observers, robots, drop_time=drop_time, wireless_exceeds_visual=exceeds)
    reference = Reference(observers, drop_time, exceeds)
    everyone = [
        (observer, other) for observer in range(observers) for other in range(robots) if observer != other
    ]
    subsets = st.sets(st.sampled_from(everyone))
    in_view: set[tuple[int, int]] = set()
    for _ in range(data.draw(st.integers(1, 12))):
        in_view = in_view ^ data.draw(subsets)
        in_earshot = in_view if data.draw(st.booleans()) else in_view | data.draw(subsets)
        if data.draw(st.integers(0, 9)) == 9:
            in_earshot = data.draw(subsets)
        active = np.array(data.draw(st.lists(st.booleans(), min_size=robots, max_size=robots)))
        association.observe(keys(in_view, robots), keys(in_earshot, robots), active)
        reference.observe(in_view, in_earshot, active)
        assert_equal(association, reference, robots)


@pytest.mark.parametrize("earshot", [9.0, 15.0])
@pytest.mark.parametrize("drop_time", [3, 20])
def test_a_small_world_step_by_step(earshot: float, drop_time: int) -> None:
    """Distances by plain loops; walls, returns and drops included."""
    generator = np.random.default_rng(7)
    reach = 9.0
    world = World(generator, side=48.0, separation=4.0, mobile_fraction=0.06, speed=1.7)
    exceeds = earshot > reach
    association = MobileAssociation(
        world.mobile, world.robots, drop_time=drop_time, wireless_exceeds_visual=exceeds
    )
    reference = Reference(world.mobile, drop_time, exceeds)
    bounces = drops = false_matches = 0
    for _ in range(60):
        velocity = world.velocity.copy()
        world.move()
        bounces += int((velocity != world.velocity).any(axis=1).sum())
        active = generator.random(world.robots) < 0.5
        in_view = world.in_range(reach)
        in_earshot = world.in_range(earshot) if exceeds else in_view
        plain_view, plain_earshot = plainly_in_range(world, reach), plainly_in_range(world, earshot)
        assert in_view.tolist() == keys(plain_view, world.robots).tolist()
        assert in_earshot.tolist() == keys(plain_earshot, world.robots).tolist()
        association.observe(in_view, in_earshot, active)
        before = [set(istate.wireless) for istate in reference.istates]
        reference.observe(plain_view, plain_earshot, active)
        drops += sum(len(b - set(i.wireless)) for b, i in zip(before, reference.istates, strict=True))
        assert_equal(association, reference, world.robots)
        counts = association.counts()
        false_matches += int((counts.matched - counts.right).sum())
    assert world.mobile == 9
    assert bounces > 20
    assert reference.returns > 100
    assert drops > 50
    # A robot that returns before its voice is forgotten is a new visual id without its own wireless id, and
    # may be taken for another; with a larger wireless range it gets that edge.
    assert (false_matches > 0) == (not exceeds)


def test_by_hand() -> None:
    """Robot 0 watches robots 1, 2 and 3."""
    association = MobileAssociation(1, 4, drop_time=2)
    all_three = np.array([1, 2, 3])

    def step(in_range: list[int], active: list[int]) -> Edges:
        flags = np.zeros(4, dtype=np.bool_)
        flags[active] = True
        seen = np.array(in_range, dtype=np.int64)
        association.observe(seen, seen, flags)
        return edges_of(association, 0, 4)

    assert step(all_three.tolist(), []) == {}  # nobody was active: no visual id enters
    assert step([1, 2, 3], [1, 2]) == {1: ["0001", "0002"], 2: ["0001", "0002"]}
    assert step([1, 2, 3], [1, 3]) == {1: ["0001"], 2: ["0002"], 3: ["0003"]}
    # 2 has been silent for two steps and is dropped: its visual id is left with nobody.
    assert step([1, 2, 3], [1]) == {1: ["0001"], 2: [], 3: ["0003"]}
    assert association.counts().visual.tolist() == [3]
    assert association.counts().matched.tolist() == [2]
    # It is heard again and new, but no visual id is.
    assert step([1, 2, 3], [2]) == {1: ["0001"], 2: [], 3: []}
    # 1 and 2 go out of view; when 2 is back its visual id is new, and its wireless id has been dropped.
    assert step([3], [3]) == {3: []}
    assert step([2, 3], [3]) == {3: []}
    assert step([2, 3], [2]) == {2: ["0002"], 3: []}
    # Back at once: the wireless id is an old one, and no edge leads to it.
    assert step([3], [3]) == {3: []}
    assert step([2, 3], [2]) == {2: [], 3: []}


def test_heard_before_it_is_seen() -> None:
    """With a larger wireless range: edges to old wireless ids, unless they are associated (sec. 5.2)."""
    association = MobileAssociation(1, 4, wireless_exceeds_visual=True)

    def step(in_view: list[int], active: list[int]) -> Edges:
        flags = np.zeros(4, dtype=np.bool_)
        flags[active] = True
        association.observe(np.array(in_view, dtype=np.int64), np.array([1, 2, 3]), flags)
        return edges_of(association, 0, 4)

    assert step([], [1, 2, 3]) == {}
    assert step([1], [1, 2]) == {1: ["0001", "0002"]}
    assert step([1], [1, 3]) == {1: ["0001"]}
    # 1 is associated: it is no candidate for the new visual id, though it is as active as 2 and 3.
    assert step([1, 2], [1, 2, 3]) == {1: ["0001"], 2: ["0002", "0003"]}


def test_the_first_step_has_all_active_with_all_active() -> None:
    active = np.random.default_rng(1).random(50) < 0.5
    association = MobileAssociation(3, 50)
    seen = np.array([key for key in range(150) if key % 50 != key // 50])
    association.observe(seen, seen, active)
    counts = association.counts()
    others = [int(active.sum()) - int(active[observer]) for observer in range(3)]
    assert counts.visual.tolist() == others
    assert counts.true_edges.tolist() == others
    assert counts.edges.tolist() == [number**2 for number in others]


def test_small_and_large_stamps_do_the_same() -> None:
    assert stamp_type(8_000, 20) is np.int16
    assert stamp_type(8_191, 20) is np.int32
    assert stamp_type(100, 40_000) is np.int32
    generator = np.random.default_rng(2)
    world = World(generator, side=40.0, separation=4.0, mobile_fraction=0.1, speed=2.0)
    small = MobileAssociation(world.mobile, world.robots, steps=8_000)
    large = MobileAssociation(world.mobile, world.robots, steps=10_000)
    assert small._seen.dtype == np.int16
    small._step = large._step = 7_950
    for _ in range(50):
        world.move()
        active = generator.random(world.robots) < 0.5
        for association in (small, large):
            association.observe(world.in_range(10.0), world.in_range(10.0), active)
        assert np.array_equal(small.edges, large.edges)


def test_a_drop_time_below_one() -> None:
    with pytest.raises(ValueError, match="drop_time is 1 step or more, not 0"):
        MobileAssociation(1, 2, drop_time=0)


# --- the world -----------------------------------------------------------------------------------


def plainly_in_range(world: World, reach: float) -> set[tuple[int, int]]:
    everyone = [*world.position.tolist(), *world.standing.tolist()]
    return {
        (observer, other)
        for observer in range(world.mobile)
        for other, place in enumerate(everyone)
        if other != observer and math.dist(everyone[observer], place) <= reach
    }


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    side=st.floats(5, 40),
    separation=st.floats(1.5, 12),
    fraction=st.sampled_from([0.001, 0.05, 0.5, 1.0]),
    reach=st.floats(0.1, 60),
    speed=st.floats(0.01, 4.9),
)
def test_everyone_in_range_is_found(
    seed: int, side: float, separation: float, fraction: float, reach: float, speed: float
) -> None:
    world = World(
        np.random.default_rng(seed), side=side, separation=separation, mobile_fraction=fraction, speed=speed
    )
    assert world.robots == cells_per_side(side, separation) ** 2
    assert len(world.position) == world.mobile
    assert len(world.standing) == world.robots - world.mobile
    for _ in range(4):
        assert world.in_range(reach).tolist() == keys(plainly_in_range(world, reach), world.robots).tolist()
        for _ in range(5):
            world.move()
        assert (world.position >= 0).all()
        assert (world.position <= side).all()
        assert np.hypot(*world.velocity.T) == pytest.approx(np.full(world.mobile, speed))


def test_pairs_are_the_same_whatever_the_block(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(np.random.default_rng(1), side=80.0, separation=4.0, mobile_fraction=0.3, speed=1.0)
    whole = world.in_range(12.0)
    monkeypatch.setattr("scenarios.association.mobile_world.BLOCK", 300)
    assert world.in_range(12.0).tolist() == whole.tolist()


def test_standing_robots_have_a_cell_each() -> None:
    world = World(np.random.default_rng(4), side=400.0, separation=4.0, mobile_fraction=0.05, speed=1.4)
    assert (world.robots, world.mobile) == (10_000, 500)
    cells = np.floor(world.standing / 4.0).astype(int)
    assert len({tuple(cell) for cell in cells.tolist()}) == 9_500
    within = world.standing / 4.0 - cells
    # Uniform in the cell: mean 1/2 and standard deviation 1/sqrt(12), along both axes, and uncorrelated.
    assert np.abs(within.mean(axis=0) - 0.5).max() < 4 / math.sqrt(12 * 9_500)
    assert np.abs(within.std(axis=0) - 1 / math.sqrt(12)).max() < 0.005
    assert abs(np.corrcoef(within.T)[0, 1]) < 4 / math.sqrt(9_500)
    # Which ones were replaced was drawn: they lie all over the world, as the mobile robots do.
    missing = np.ones((100, 100))
    missing[cells[:, 0], cells[:, 1]] = 0
    quarters = missing.reshape(2, 50, 2, 50).sum(axis=(1, 3))
    assert np.abs(quarters - 125).max() < 4 * math.sqrt(500 * 0.25 * 0.75)
    start = np.histogram2d(*world.position.T, bins=2, range=[[0, 400], [0, 400]])[0]
    assert np.abs(start - 125).max() < 4 * math.sqrt(500 * 0.25 * 0.75)
    headings = np.histogram(np.arctan2(*world.velocity.T), bins=4, range=(-math.pi, math.pi))[0]
    assert np.abs(headings - 125).max() < 4 * math.sqrt(500 * 0.25 * 0.75)


def test_bouncing_by_hand() -> None:
    world = World(np.random.default_rng(1), side=10.0, separation=2.0, mobile_fraction=0.1, speed=1.0)
    world.position[:] = [[0.5, 9.75], [4.0, 0.25]]
    world.velocity[:] = [[-0.75, 0.5], [0.25, -0.5]]
    world.move()
    assert world.position.tolist() == [[0.25, 9.75], [4.25, 0.25]]
    assert world.velocity.tolist() == [[0.75, -0.5], [0.25, 0.5]]
    assert world.deep(0.2).tolist() == [True, True]
    assert world.deep(0.25).tolist() == [False, False]


@pytest.mark.parametrize(
    ("side", "separation", "fraction", "robots", "mobile"),
    [
        (400, 4, 0.05, 10_000, 500),
        (400, 3.2, 0.05, 15_625, 781),
        (400, 7, 0.05, 57**2, 162),
        (10, 5, 0.0001, 4, 1),
    ],
)
def test_how_many_robots_there_are(
    side: float, separation: float, fraction: float, robots: int, mobile: int
) -> None:
    assert robots_in(side, separation, fraction) == (robots, mobile)


# --- the study -----------------------------------------------------------------------------------


def study(samples: int = 1, **parameters: Any) -> dict[str, Any]:
    return run_study(STUDY, MobileParameters(**parameters), samples=samples, jobs=1)


@pytest.mark.parametrize(
    ("parameters", "fraction", "ratio"),
    [
        ({"steps": 60}, 0.837, 1.312),
        ({"range": 10.0, "steps": 80}, 0.803, 1.299),
        ({"speed": 2.0, "steps": 50}, 0.722, 1.649),
        ({"mobile_fraction": 0.5, "world": 200.0, "steps": 20}, 0.806, 1.403),
    ],
)
def test_steady_states_known_from_elsewhere(parameters: Any, fraction: float, ratio: float) -> None:
    """Deep observers, so that the world's size does not matter."""
    deep = study(**parameters)["deep"]
    assert deep["fraction_matched"]["mean"] == pytest.approx(fraction, abs=0.003)
    assert deep["ratio"]["mean"] == pytest.approx(ratio, abs=0.008)
    assert deep["matches_right"] > 0.999


def test_a_larger_wireless_range_makes_it_harder() -> None:
    parameters = {"world": 150.0, "range": 10.0, "steps": 20}
    equal, larger = study(**parameters), study(**parameters, wireless_range=14.0)
    assert larger["all"]["ratio"]["mean"] > equal["all"]["ratio"]["mean"] + 0.1
    assert larger["warm_up"] == math.ceil(28 / 1.4) + 20
    # Twice the same range is the equal case, not the rule for a larger one.
    assert study(**parameters, wireless_range=10.0) == equal


def test_what_is_summed_up_by_hand() -> None:
    """Two made-up worlds, one step after the warm-up; the second has more observers with visual ids."""
    parameters = MobileParameters(steps=1)
    worlds = np.zeros((2, 2, parameters.warm_up + 2, len(COLUMNS)))
    worlds[:, :, : parameters.warm_up + 1] = 999.0  # of the warm-up nothing counts
    worlds[0, :, -1] = [2, 1, 0.5, 0.25, 1, 2.0, 4.0, 4, 8, 4, 2, 2]
    worlds[1, :, -1] = [2, 2, 1.75, 1.5625, 2, 2.5, 3.25, 12, 14, 10, 10, 9]
    worlds[:, 0, -1] = 0  # and nobody is deep
    result = STUDY.summarise(parameters, [[worlds[0]], [worlds[1]]])
    matched = result["all"]["fraction_matched"]
    assert matched["mean"] == pytest.approx(2.25 / 3)
    assert matched["sd"] == pytest.approx(np.std([0.5, 0.75, 1.0]))
    # Ratio estimator: residuals 0.5 - 0.75 = -1/4 and 1.75 - 1.5 = 1/4.
    assert matched["se"] == pytest.approx(math.sqrt(2 * (1 / 16 + 1 / 16)) / 3)
    assert result["all"]["ratio"]["mean"] == pytest.approx(1.5)
    assert result["all"]["ratio"]["sd"] == pytest.approx(np.std([2.0, 1.0, 1.5]))
    assert result["all"]["ratio_of_sums"] == pytest.approx(22 / 14)
    assert result["all"]["visual_ids_in_list"] == pytest.approx(4.0)
    assert result["all"]["matches_right"] == pytest.approx(11 / 12)
    none = {"mean": None, "sd": None, "se": None}
    assert result["deep"] == {
        "fraction_matched": none, "ratio": none, "ratio_of_sums": None, "visual_ids_in_list": None,
        "matches_right": None,
    }  # fmt: skip
    assert msgspec.json.decode(msgspec.json.encode(result)) == result


def test_sums_over_observers_by_plain_loops() -> None:
    counts = study_mobile.Counts(
        *np.array([[4, 0, 2, 5], [9, 0, 0, 5], [4, 0, 0, 4], [2, 0, 0, 5], [2, 0, 0, 4]])
    )
    sums = dict(zip(COLUMNS, study_mobile._sums(counts, np.array([True, True, True, False])), strict=True))
    assert sums == {
        "observers": 3, "observers with visual ids": 2, "fraction": 0.5, "fraction squared": 0.25,
        "observers with true edges": 1, "ratio": 2.25, "ratio squared": 2.25**2,
        "visual": 6, "edges": 9, "true_edges": 4, "matched": 2, "right": 2,
    }  # fmt: skip


def test_the_series_starts_empty_and_ends_in_the_steady_state() -> None:
    parameters = MobileParameters(world=120.0, range=12.0, steps=10)
    result = run_study(SERIES, parameters, samples=3, jobs=1)
    for name in ("deep", "all"):
        matched, ratio = result["series"][name]["fraction_matched"], result["series"][name]["ratio"]
        for listed in (*matched.values(), *ratio.values()):
            assert len(listed) == parameters.warm_up + 11
            assert listed[0] is None
        # After one step: all active with all active, an edge for each pair.
        assert matched["mean"][1] < 0.1
        assert ratio["mean"][1] == pytest.approx(math.pi * 12**2 / 4**2 / 2, rel=0.2)
        assert ratio["mean"][-1] == pytest.approx(result[name]["ratio"]["mean"], rel=0.1)
        assert matched["mean"][-1] == pytest.approx(result[name]["fraction_matched"]["mean"], rel=0.1)
        assert all(error > 0 for error in matched["se"][5:])
    plain = STUDY.summarise(parameters, [SERIES.simulate(parameters, np.random.default_rng(1), 1)])
    assert plain["all"]["fraction_matched"]["se"] is None


def test_the_same_seed_gives_the_same_result() -> None:
    parameters = {"world": 80.0, "range": 10.0, "steps": 5}
    assert study(**parameters) == study(**parameters)
    first, second = (
        STUDY.simulate(MobileParameters(**parameters), np.random.default_rng(1), 2) for _ in range(2)
    )
    assert np.array_equal(first, second)
    assert not np.array_equal(first[0], first[1])


@pytest.mark.parametrize(
    ("parameters", "sentence"),
    [
        ({"wireless_range": 10.0}, r"^wireless_range: 10 is less than range \(16\)"),
        ({"separation": 300.0}, "^separation: 300 leaves one robot alone in a world of 400; set 200 or less"),
        ({"speed": 400.0}, "^speed: in a world of 400 a robot drives less than 400 a step"),
        ({"speed": 1e-4}, "^speed: at 0.0001 a step it takes 320020 steps, more than 100000,"),
        (
            {"separation": 1.0, "mobile_fraction": 1.0},
            "^world: takes about .* GB, more than 2.5; set a smaller",
        ),
        ({"range": 200.0}, "^world: takes about "),
    ],
)
def test_parameters_that_do_not_go_together(parameters: Any, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        study(**parameters)
