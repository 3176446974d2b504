"""Models of mobile association: geometry by measuring, limits by hand, the finer model against a small simulation."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from scenarios.association.mobile_batches import OLDEST_BATCH, batch_model, new_ids
from scenarios.association.mobile_models import (
    MobileSystem,
    age_regions,
    fraction_matched_corrected,
    fraction_matched_literal,
    multi_region_model,
    new_false_edges,
    overlap_area,
    two_region_model,
)
from scenarios.association.predictions import PredictMobile, check_mobile, predict_association_mobile

DEFAULT = MobileSystem(radius=16.0, speed=1.4, separation=4.0)
SYSTEMS = [
    DEFAULT,
    MobileSystem(10, 1.4, 4),
    MobileSystem(16, 2, 4),
    MobileSystem(16, 1.4, 8),
    MobileSystem(5, 7, 2),
]


# --- geometry ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("radius", "distance"), [(16, 1.4), (1, 1), (3, 5.9), (2, 0.01), (1, 0), (1, 2), (1, 7)]
)
def test_overlap_area(radius: float, distance: float) -> None:
    """Eq. 5 against a sum over thin slices across the line of centres."""
    x = np.linspace(distance / 2, max(radius, distance / 2), 200_001)
    middle = (x[1:] + x[:-1]) / 2
    slices = 4 * np.sqrt(np.maximum(0, radius**2 - middle**2)) * np.diff(x)
    assert overlap_area(radius, distance) == pytest.approx(slices.sum(), rel=1e-6, abs=1e-12)


def test_limits_of_the_overlap() -> None:
    assert overlap_area(3.0, 0.0) == pytest.approx(math.pi * 9)
    assert overlap_area(3.0, 6.0) == overlap_area(3.0, 60.0) == 0.0
    assert overlap_area(3.0, 1e-6) == pytest.approx(math.pi * 9 - 6e-6, rel=1e-12)  # frontier: 2 r d


@pytest.mark.parametrize("system", SYSTEMS)
def test_age_regions(system: MobileSystem) -> None:
    areas = age_regions(system.radius, system.speed)
    assert areas.sum() == pytest.approx(math.pi * system.radius**2)
    assert (areas > 0).all()
    assert (np.diff(areas) < 0).all()
    assert len(areas) == math.ceil(2 * system.radius / system.speed)
    side = ((np.arange(1500) + 0.5) / 750 - 1) * system.radius
    x, y = (axis.ravel() for axis in np.meshgrid(side, side))
    x, y = x[np.hypot(x, y) <= system.radius], y[np.hypot(x, y) <= system.radius]
    age = np.zeros(len(x), dtype=int)
    for steps in range(1, len(areas)):  # the observer was further back, to the left
        age += np.hypot(x + steps * system.speed, y) <= system.radius
    counted = np.bincount(age, minlength=len(areas)) * (side[1] - side[0]) ** 2
    np.testing.assert_allclose(counted, areas, atol=1e-4 * system.radius**2)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ((0, 1, 1), "range: 0 is not a positive"),
        ((1, -1, 1), "speed: -1 is not a positive"),
        ((1, 1, math.inf), "separation: inf is not a positive"),
        ((math.nan, 1, 1), "range: nan is not a positive"),
        ((1, 0.0001, 1), "speed: 0.0001 is too slow"),
        ((100, 1, 1), "separation: 1 puts 31416 robots in range"),
    ],
)
def test_what_is_no_system(values: tuple[float, float, float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        MobileSystem(*values)


# --- the paper's models -----------------------------------------------------------------------------


def test_fraction_matched_as_printed() -> None:
    """Eqs. 2 and 3 by age region, with other words."""
    v, total, sum_ = DEFAULT.new_ids(), 0.0, 0.0
    for age, area in enumerate(age_regions(16.0, 1.4)):
        false_edges = (v * v - v) * 0.5**age
        sum_ += area * ((v - 1) / v) ** false_edges
        total += area
    assert fraction_matched_literal(DEFAULT) == pytest.approx(sum_ / total)
    assert fraction_matched_literal(DEFAULT) == pytest.approx(0.8617, abs=5e-5)
    assert fraction_matched_literal(MobileSystem(16, 1.4, 8)) is None  # 0.7 new ids a step


def test_fraction_matched_corrected() -> None:
    areas = age_regions(16.0, 1.4)
    others = 1.5  # by the variance that makes it so
    v = DEFAULT.new_ids()
    expected = sum(a * (1 - 0.5**t) ** others for t, a in enumerate(areas)) / areas.sum()
    assert fraction_matched_corrected(DEFAULT, others * v - v * v + v) == pytest.approx(expected)
    assert fraction_matched_corrected(DEFAULT, v - v * v + 1e-15 + v * v) < 1
    alone = MobileSystem(16, 1.4, 8)
    v = alone.new_ids()
    assert fraction_matched_corrected(alone, v - v * v) == pytest.approx(1.0)  # never two at once


@pytest.mark.parametrize("system", SYSTEMS)
@pytest.mark.parametrize("corrected", [False, True])
def test_two_regions(system: MobileSystem, corrected: bool) -> None:
    """Eqs. 6, 9, 10 and 11 by hand, and Eq. 8 applied for long."""
    model = two_region_model(system, 2.0, corrected=corrected)
    populations = system.regions()
    new, rest = populations[0], populations[1:].sum()
    leaves = min(1.0, new / rest)
    either = leaves + leaves - leaves * leaves
    true = new / (leaves if corrected else either)
    false = (2.0 + new**2 - new) / (1 - 0.5 * (1 - either))
    assert model.steady_state() == pytest.approx((true, false))
    assert model.ratio() == pytest.approx((true + false) / true)
    start = np.array([1.0, 30.0])
    after = model.after(start, start, 5000)
    assert (after[0][0], after[1][0]) == (1.0, 1.0)
    assert (after[0][1], after[1][1]) == pytest.approx((true, false))
    stepwise = start
    for _ in range(7):  # Eq. 4
        stepwise = np.array([1.0, stepwise[1] * model.false_edges[1, 1] + model.false_edges[0, 1]])
    assert model.after(start, start, 7)[1] == pytest.approx(stepwise)


def test_corrected_true_edges_are_the_robots_of_the_rest() -> None:
    model = two_region_model(DEFAULT, 2.0, corrected=True)
    assert model.steady_state()[0] == pytest.approx(DEFAULT.regions()[1:].sum())


@pytest.mark.parametrize("system", SYSTEMS)
def test_many_regions(system: MobileSystem) -> None:
    """Every region's true edges are its robots; its false ones also halve with age."""
    model = multi_region_model(system, 2.0)
    populations = system.regions()
    true, false = model.steady_state()
    assert true == pytest.approx(populations.sum())
    per_robot = new_false_edges(populations[0], 2.0) / populations[0]
    assert false == pytest.approx(sum(n * per_robot * 0.5**age for age, n in enumerate(populations)))
    start = np.zeros(len(populations) + 1)
    start[0] = 1
    after = model.after(start, start, len(populations))
    assert after[0][1:] == pytest.approx(populations)
    assert after[1][1:].sum() == pytest.approx(false)


def test_equation_12() -> None:
    """The printed matrix, for five age regions."""
    system = MobileSystem(2.5, 1.0, 1.0)
    a = age_regions(2.5, 1.0)
    m, new = 0.5, new_false_edges(system.new_ids(), 3.0)
    expected = [
        [1, new, 0, 0, 0, 0],
        [0, 0, a[1] / a[0] * m, 0, 0, 0],
        [0, 0, 0, a[2] / a[1] * m, 0, 0],
        [0, 0, 0, 0, a[3] / a[2] * m, 0],
        [0, 0, 0, 0, 0, a[4] / a[3] * m],
        [0, 0, 0, 0, 0, 0],
    ]
    np.testing.assert_allclose(multi_region_model(system, 3.0).false_edges, expected)


def test_new_false_edges() -> None:
    assert new_false_edges(3.0, 0.0) == 6.0  # always three: 3 * 2
    assert new_false_edges(0.5, 0.25) == 0.0  # none or one
    with pytest.raises(
        ValueError, match=r"new_ids_variance: 0\.2 is impossible for 0\.5 new ids a step; give at least 0\.25"
    ):
        new_false_edges(0.5, 0.2)


# --- the finer model --------------------------------------------------------------------------------


def test_new_ids() -> None:
    """Mean and variance of what is new, against robots put on jittered grids."""
    system = MobileSystem(6.0, 2.0, 3.0)
    rng = np.random.default_rng(11)
    samples, lattice = 20_000, np.arange(-4, 5)
    grid = np.stack(np.meshgrid(lattice, lattice), axis=-1).reshape(-1, 2)
    place = (grid + rng.random((samples, 1, 2)) + rng.random((samples, len(grid), 2)) - 1) * 3.0
    angle = rng.uniform(0, 2 * math.pi, (samples, 1))
    along, across = (
        place[..., 0] * np.cos(angle) + place[..., 1] * np.sin(angle),
        place[..., 1] * np.cos(angle) - place[..., 0] * np.sin(angle),
    )
    chord = np.sqrt(np.maximum(0, 36 - across**2))
    in_range = np.hypot(along, across) <= 6
    age = np.where(in_range, np.floor((chord - along) / 2), -1)
    frontier = (age == 0).sum(axis=1)
    listed = (in_range & (rng.random(age.shape) < 0.5 ** (age + 1))).sum(axis=1)
    expected = new_ids(system)
    for counts, mean, variance in (
        (frontier, expected.mean, expected.frontier_variance),
        (listed, expected.listed_mean, expected.listed_variance),
    ):
        assert abs(counts.mean() - mean) < 4 * math.sqrt(variance / samples)
        assert abs(counts.var() - variance) < 4 * counts.var() * math.sqrt(3 / samples)
        assert variance < 0.9 * mean  # less than a Poisson variable's


@pytest.mark.parametrize("system", SYSTEMS)
def test_means_are_exact(system: MobileSystem) -> None:
    """Sums over the quadrature against Eq. 5."""
    populations = system.regions()
    first = 0.5 ** np.arange(1, len(populations) + 1)
    assert new_ids(system).listed_mean == pytest.approx(populations @ first, rel=1e-4)
    assert batch_model(system).visual_ids_in_list == pytest.approx(populations @ (1 - first), rel=1e-4)


def simulated(system: MobileSystem, worlds: int, history: int, seed: int) -> NDArray[np.float64]:
    """Rows (visual ids in the list, matched, total edges) of one observer each among robots that stand still.

    Written from the rules of sec. 5.2, robot by robot, without any formula: in range, active, listed at the first
    activity, edges within a batch, which stay while activity agrees; a wireless id out of range is silent.
    """
    rng = np.random.default_rng(seed)
    radius, speed, separation = system.radius, system.speed, system.separation
    reach = radius + speed * history
    number = np.arange(-math.ceil(reach / separation) - 1, math.ceil(reach / separation) + 2)
    grid = np.stack(np.meshgrid(number, number), axis=-1).reshape(-1, 2)
    rows = []
    for _ in range(worlds):
        heading = rng.uniform(0, 2 * math.pi)
        way = np.array([math.cos(heading), math.sin(heading)])
        place = (grid + rng.random(2) + rng.uniform(-0.5, 0.5, grid.shape)) * separation
        place = place[(np.abs(place @ way[::-1] * 1.0 - 2 * place[:, 0] * way[1]) <= radius)]
        observer = np.arange(-history, 1)[:, None] * speed * way
        in_range = np.hypot(*(place[:, None, :] - observer).transpose(2, 0, 1)) <= radius
        in_range = in_range[in_range.any(axis=1)]
        active = in_range & (rng.random(in_range.shape) < 0.5)
        batch = np.where(active.any(axis=1), active.argmax(axis=1), -1)
        seen = np.flatnonzero(in_range[:, -1] & (batch >= 0))
        heard = np.flatnonzero(batch >= 0)
        agree = (active[seen][:, None, :] == active[heard][None, :, :]).all(axis=2)
        edges = (agree & (batch[seen][:, None] == batch[heard][None, :])).sum(axis=1)
        rows.append((len(seen), (edges == 1).sum(), edges.sum()))
    return np.array(rows, dtype=float)


@pytest.mark.parametrize(
    ("system", "worlds"), [(MobileSystem(10, 1.4, 4), 1200), (MobileSystem(8, 3, 2.5), 1200)]
)
def test_against_a_simulation(system: MobileSystem, worlds: int) -> None:
    ids, matched, edges = simulated(system, worlds, 26, seed=3).T
    model = batch_model(system)

    def close(values: NDArray[np.float64], expected: float) -> bool:
        return bool(abs(values.mean() - expected) < 4 * values.std() / math.sqrt(worlds))

    assert close(ids, model.visual_ids_in_list)
    assert ids.std() == pytest.approx(model.visual_ids_in_list_sd, rel=4 / math.sqrt(2 * worlds))
    assert close(matched / ids, model.fraction_matched)
    assert close(matched - model.fraction_matched_of_sums * ids, 0.0)
    assert close(edges / ids, model.ratio)
    assert close(edges - model.ratio_of_sums * ids, 0.0)


def test_all_mobile_is_poisson() -> None:
    """Without a grid, sums over batches can be written down: n others with probability 2^-a each leave an edge."""
    model = batch_model(DEFAULT, 1.0)
    angles = (np.arange(4000) + 0.5) * math.pi / 4000
    new = ids = 0.0
    here = np.zeros(OLDEST_BATCH)
    for angle in angles:
        speed = max(2 * 1.4 * math.sin(angle / 2), 0.02)
        regions = age_regions(16.0, speed) / 16 / len(angles)
        first = 0.5 ** np.arange(1, len(regions) + 1)
        new += float(regions @ first)
        ids += float(regions @ (1 - first))
        for age in range(min(OLDEST_BATCH, len(regions))):
            here[age] += regions[age:] @ first[: len(regions) - age]
    left = 0.5 ** np.arange(OLDEST_BATCH)
    matched = here @ np.exp(-left * new) + ids - here.sum()
    assert model.visual_ids_in_list == pytest.approx(ids, rel=1e-4)
    assert model.visual_ids_in_list_sd == pytest.approx(math.sqrt(ids), rel=1e-4)
    assert model.fraction_matched_of_sums == pytest.approx(matched / ids, rel=1e-3)
    assert model.ratio_of_sums == pytest.approx(1 + here @ left * new / ids, rel=1e-3)
    assert new == pytest.approx(
        2.8 * 4 / math.pi, rel=0.02
    )  # 2 r * mean relative speed * density; a few leave unlisted


def test_limits_of_the_finer_model() -> None:
    slow = batch_model(MobileSystem(8, 0.05, 4))
    assert slow.fraction_matched == pytest.approx(1.0, abs=2e-3)
    assert slow.ratio == pytest.approx(1.0, abs=2e-3)
    # faster than it sees: everybody is new in every step, and half of them are listed
    fast = batch_model(MobileSystem(8, 100, 4))
    robots = math.pi * 4
    assert fast.visual_ids_in_list == pytest.approx(robots / 2, rel=1e-4)
    cells = new_ids(MobileSystem(8, 100, 4))
    assert fast.ratio_of_sums == pytest.approx(
        new_false_edges(robots / 2, cells.listed_variance) / (robots / 2) + 1, rel=1e-3
    )
    lonely = batch_model(MobileSystem(1, 1, 100))
    assert lonely.ratio_of_sums == pytest.approx(1.0, abs=1e-3)
    assert lonely.fraction_matched_of_sums == pytest.approx(1.0, abs=1e-3)


def test_more_mobile_robots_are_more_ambiguous() -> None:
    """2016, sec. 6.2 found no effect of the mix."""
    models = [batch_model(DEFAULT, fraction) for fraction in (0.0, 0.1, 0.5, 0.9)]
    assert [m.ratio for m in models] == sorted(m.ratio for m in models)
    assert [m.fraction_matched for m in models] == sorted((m.fraction_matched for m in models), reverse=True)
    assert models[3].ratio > models[1].ratio + 0.1
    with pytest.raises(ValueError, match=r"mobile_fraction: 1\.5 is no fraction"):
        batch_model(DEFAULT, 1.5)


# --- predictions ------------------------------------------------------------------------------------


def test_prediction() -> None:
    found = predict_association_mobile(PredictMobile(range=16, speed=1.4, separation=4))
    variance = new_ids(DEFAULT).listed_variance
    model = batch_model(DEFAULT, 0.05)
    assert found["literal"] == {
        "fraction_matched": fraction_matched_literal(DEFAULT),
        "fraction_matched_eq_10": fraction_matched_literal(DEFAULT, variance),
        "ratio": {
            "two_region": two_region_model(DEFAULT, variance, corrected=False).ratio(),
            "multi_region": multi_region_model(DEFAULT, variance).ratio(),
        },
    }
    assert (
        found["corrected"]["ratio"]["two_region"]
        == two_region_model(DEFAULT, variance, corrected=True).ratio()
    )
    assert found["corrected"]["fraction_matched"] == fraction_matched_corrected(DEFAULT, variance)
    assert found["refined"]["fraction_matched"] == model.fraction_matched
    assert found["refined"]["ratio"] == model.ratio
    assert found["geometry"]["robots_in_range"] == pytest.approx(50.265, abs=0.001)
    assert msgspec.json.decode(msgspec.json.encode(found)) == found


@pytest.mark.parametrize(
    ("changed", "used"),
    [
        ({}, "listed_variance"),
        ({"variance": "frontier"}, "frontier_variance"),
        ({"variance": "poisson"}, "mean"),
    ],
)
def test_variances(changed: dict[str, Any], used: str) -> None:
    found = predict_association_mobile(PredictMobile(range=6, **changed))["new_ids"]
    assert found["variance_used"] == found[used]


def test_a_variance_of_ones_own() -> None:
    params = PredictMobile(range=6, new_ids_variance=3.5)
    check_mobile(params)
    assert predict_association_mobile(params)["new_ids"]["variance_used"] == 3.5
    with pytest.raises(ValueError, match="new_ids_variance: 0 is impossible"):
        check_mobile(PredictMobile(separation=8, new_ids_variance=0))
