"""Studies by robots on the emulator: parameters in, the scenario that was meant and the numbers of its log out."""

from __future__ import annotations

from functools import partial

import networkx as nx
import numpy as np
import pytest

import scenarios.emulated
from channels.settings import BurstSettings
from channels.tdma import slot_length_ns
from emulator.run import Options
from emulator.scenario import CommandedMotion, Scenario, team
from emulator.scenario_file import load
from emulator.slots import connectivity
from scenarios.coverage import emulated as coverage
from scenarios.coverage.cost import cost
from scenarios.coverage.simulation import CoverageParameters
from scenarios.dissemination import emulated as dissemination
from scenarios.dissemination.emulated import AgeParameters
from scenarios.dissemination.lattices import Lattice
from scenarios.dissemination.study_propagation import PropagationParameters


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Robots need no processes of their own to say what they say."""
    monkeypatch.setattr(scenarios.emulated, "Options", partial(Options, fleet="in_process"))


# --- coverage ----------------------------------------------------------------------------------------


def test_the_scenario_of_coverage_is_what_the_parameters_say() -> None:
    chosen = CoverageParameters(
        robots=5, side=60.0, range=25.0, m=2, scheme="round-robin", alpha=0.5, new_estimates="literal",
        order="drawn_each_frame", gain=0.25, max_speed=3.0, start_box=12.0, duration=30.0, bit_rate=2400.0,
        control_period=0.4,
    )  # fmt: skip
    coverage.check(chosen)
    scenario = load("coverage", robots=5, overrides=coverage.overrides(chosen))
    assert (scenario.world.area_m, scenario.world.start_area_m) == ((60.0, 60.0), (12.0, 12.0))
    assert scenario.world.motion == CommandedMotion(3.0)
    assert scenario.run.duration_s == 30.0
    radio, tdma = scenario.radio, scenario.radio.tdma
    assert tdma is not None
    assert (radio.range_m, radio.bit_rate_bps) == (25.0, 2400.0)
    assert (tdma.units, tdma.unit_bits, tdma.order) == (2, chosen.bits, "drawn_each_frame")
    # A guard of a microsecond is all that a slot has more.
    assert slot_length_ns(radio, tdma) == chosen.slot_ns + 1000
    assert scenario.params == load("coverage").params | {
        "area_m": [60.0, 60.0], "gain": 0.25, "max_speed_mps": 3.0, "control_s": 0.4,
        "scheme": "round-robin", "alpha": 0.5, "new_estimates": "literal",
    }  # fmt: skip


def test_coverage_by_robots_is_read_like_the_simulation(in_process: None) -> None:
    chosen = CoverageParameters(robots=3, side=30.0, start_box=6.0, duration=4.5)
    (course,) = coverage.simulate(chosen, np.random.default_rng(1), 1)
    assert len(course.costs) == len(chosen.times_ns)
    assert course.costs[-1] == pytest.approx(cost(course.places, (30.0, 30.0)))
    # Three robots within 6 m of a corner leave far more uncovered than one in the middle would.
    assert course.costs[0] > 2 * 30.0**4 / 6 > course.costs[-1]


@pytest.mark.parametrize(
    ("parameters", "sentence"),
    [
        ({"sample_period": 0.5}, "sample_period: a log is looked at every second; set 1"),
        ({"bits": 100}, "bits: an estimate of the emulator's robots has 192; leave it so"),
        ({"new_estimates": "true-distance"}, "new_estimates: robots that move know no true distances"),
    ],
)
def test_coverage_that_robots_cannot_do(parameters: dict[str, object], sentence: str) -> None:
    with pytest.raises(ValueError, match="^" + sentence):
        coverage.check(CoverageParameters(**parameters))  # type: ignore[arg-type]


# --- propagation -------------------------------------------------------------------------------------


def grid(chosen: PropagationParameters) -> Scenario:
    dissemination.check_propagation(chosen)
    return load(
        "dissemination",
        robots=chosen.rows * chosen.columns,
        overrides=dissemination.propagation_overrides(chosen),
    )


@pytest.mark.parametrize("neighbours", [4, 8])
def test_robots_hear_whom_the_lattice_says(neighbours: int) -> None:
    chosen = PropagationParameters(rows=3, columns=5, neighbours=neighbours, m=3, subgraphs="3x5")  # type: ignore[arg-type]
    scenario = grid(chosen)
    robots = team(scenario)
    lattice = Lattice(3, 5, neighbours)  # type: ignore[arg-type]
    heard = connectivity(scenario.radio, robots)
    assert nx.utils.edges_equal(heard.edges, lattice.graph().edges)
    assert scenario.params["deployment_m"] == [list(robot.position_m) for robot in robots]
    assert scenario.params["link_range_m"] == scenario.radio.range_m


@pytest.mark.parametrize("reuse", ["none", "distance_two"])
def test_a_run_of_propagation_has_the_frames_that_count(reuse: str) -> None:
    chosen = PropagationParameters(rows=4, columns=4, m=4, max_frames=50, reuse=reuse)  # type: ignore[arg-type]
    scenario = grid(chosen)
    tdma = scenario.radio.tdma
    assert tdma is not None
    frame_ns = len(Lattice(4, 4, 4).slots(reuse)) * slot_length_ns(scenario.radio, tdma)
    assert scenario.run.duration_s == pytest.approx(50 * frame_ns / 1e9, rel=1e-12)
    # Who relays nothing has said all in its first frame.
    alone = grid(PropagationParameters(rows=4, columns=4, m=4, max_frames=50, reuse=reuse, scheme="own"))  # type: ignore[arg-type]
    assert alone.run.duration_s == pytest.approx(frame_ns / 1e9, rel=1e-12)


def test_propagation_counts_slots(in_process: None) -> None:
    """Who only tells of itself is known to neighbours and nobody else."""
    chosen = PropagationParameters(rows=2, columns=2, m=2, subgraphs="2x2", order="fixed")
    # Robots 0, 1, 2, 3 in turn: 3 hears of 0 from 1, 0 of 3 from 1 in its slot after the next frame's first;
    # that is at most two frames, and more than one.
    (found,) = dissemination.simulate_propagation(chosen, np.random.default_rng(1), 1).tolist()
    assert 4 < found[0] <= 8
    own = PropagationParameters(rows=2, columns=2, m=1, subgraphs="2x2", scheme="own")
    assert dissemination.simulate_propagation(own, np.random.default_rng(1), 1).tolist() == [[0]]


# --- age, with what can go wrong ---------------------------------------------------------------------


def aged(chosen: AgeParameters) -> Scenario:
    dissemination.check_age(chosen)
    return load("dissemination-mixed", overrides=dissemination.age_overrides(chosen))


def test_the_scenario_of_age_is_what_the_parameters_say() -> None:
    chosen = AgeParameters(
        m=2, alpha=0.5, scheme="round-robin", duration=40.0, loss=0.125, drift_ppm=20.0, guard=0.01
    )
    scenario = aged(chosen)
    tdma = scenario.radio.tdma
    assert tdma is not None
    assert (tdma.units, tdma.guard_s, scenario.run.duration_s) == (2, 0.01, 40.0)
    assert (scenario.radio.loss, scenario.radio.bursts, scenario.clock.drift_ppm) == (0.125, None, 20.0)
    assert (scenario.params["scheme"], scenario.params["alpha"]) == ("round-robin", 0.5)


@pytest.mark.parametrize(("loss", "length"), [(0.1, 10.0), (0.5, 4.0), (0.25, 2.0)])
def test_bursts_take_their_share_in_the_long_run(loss: float, length: float) -> None:
    bursts = aged(AgeParameters(burst_loss=loss, burst_length=length)).radio.bursts
    assert isinstance(bursts, BurstSettings)
    assert bursts.loss == 1.0
    assert 1 / bursts.leave == pytest.approx(length)
    # As many bursts end as begin.
    assert bursts.enter * (1 - loss) == pytest.approx(bursts.leave * loss)


def test_who_dies_and_who_comes_late_do_so_at_half_time(in_process: None) -> None:
    """Nine robots, 20 s: one that falls silent after 10 s, and two that begin to speak then."""
    chosen = AgeParameters(duration=20.0, dying=1, late=2)
    assert dissemination.age_tables(chosen).count("[[robot]]") == 3
    (found,) = dissemination.simulate_age(chosen, np.random.default_rng(1), 1)
    frames = int(20.0 * found["frame_rate_hz"])
    missed = found["per_robot"]["slots_missed"]
    assert {robot: count for robot, count in missed.items() if count} == {
        robot: pytest.approx(frames / 2, abs=1) for robot in ("r00", "r07", "r08")
    }
    summary = dissemination.summarise_age(chosen, [[found]])
    assert summary["slots_missed"]["mean"] == pytest.approx(sum(missed.values()) / (9 * frames))
    assert summary["age_s"]["mean"] == found["age_s"]["mean"]
    assert summary["age_p95_s"]["mean"] == found["age_s"]["p95"]
    assert summary["samples"] == 1


def test_who_dies_does_not_come_late() -> None:
    dissemination.check_age(AgeParameters(dying=4, late=5))
    with pytest.raises(ValueError, match=r"^dying: there are 9 robots, and who joins late does not die"):
        dissemination.check_age(AgeParameters(dying=5, late=5))
