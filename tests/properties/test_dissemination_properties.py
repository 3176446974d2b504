"""Tables, selections and packets under whatever may come."""

from __future__ import annotations

import contextlib
import math
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from agent.behaviours.dissemination.distances import euclidean_3d, hops
from agent.behaviours.dissemination.estimates import Estimate, EstimateTable, News
from agent.behaviours.dissemination.geodesy import TangentPlane
from agent.behaviours.dissemination.selection import NEW_ESTIMATES, SCHEMES, Location, selection
from agent.behaviours.dissemination.wire import ESTIMATE_BYTES, PacketError, Wire
from scenarios.dissemination import kernels

TEAM = 5

metres = st.floats(-1e4, 1e4)
estimates = st.builds(
    Estimate, st.integers(0, TEAM - 1), st.integers(0, 50), metres, metres, metres, st.floats(-10, 10)
)
planes = st.builds(TangentPlane, st.tuples(st.floats(-80, 80), st.floats(-180, 180)))


@given(own=st.integers(0, TEAM - 1), heard=st.lists(estimates, max_size=40))
def test_the_newest_wins_and_of_equals_the_first(own: int, heard: list[Estimate]) -> None:
    table = EstimateTable(own, TEAM)
    news = [table.receive(each) for each in heard]
    for number in range(TEAM):
        of = [each for each in heard if each.number == number and number != own]
        assert table[number] == (max(of, key=lambda each: each.time_ms) if of else None)
    assert news.count(News.first) == len(table.known())
    assert table.known() == sorted({each.number for each in heard} - {own})


@given(plane=planes, sent=st.lists(estimates, max_size=8))
def test_packets_there_and_back(plane: TangentPlane, sent: list[Estimate]) -> None:
    wire = Wire(plane, TEAM)
    packet = wire.pack(sent)
    assert len(packet) == ESTIMATE_BYTES * len(sent)
    for before, after in zip(sent, wire.unpack(packet), strict=True):
        assert (after.number, after.time_ms) == (before.number, before.time_ms)
        assert math.dist((after.x_m, after.y_m), (before.x_m, before.y_m)) < 0.0081
        assert abs(after.z_m - before.z_m) < 0.00051
        assert abs(math.remainder(after.yaw_rad - before.yaw_rad, math.tau)) < 1e-6


@given(plane=planes, sent=st.lists(estimates, max_size=4))
def test_relaying_changes_no_byte(plane: TangentPlane, sent: list[Estimate]) -> None:
    """However often an estimate is passed on, it stays where it was."""
    wire = Wire(plane, TEAM)
    once = wire.unpack(wire.pack(sent))
    again = wire.unpack(wire.pack(once))
    for one, other in zip(once, again, strict=True):
        assert math.dist((one.x_m, one.y_m, one.z_m), (other.x_m, other.y_m, other.z_m)) < 1e-6
        assert abs(math.remainder(one.yaw_rad - other.yaw_rad, math.tau)) < 1.5e-6


@given(st.binary(max_size=60) | st.binary(min_size=24, max_size=24))
def test_no_packet_does_harm(raw: bytes) -> None:
    table = EstimateTable(0, TEAM)
    with contextlib.suppress(PacketError):
        for each in Wire(TangentPlane((10.0, 20.0)), TEAM).unpack(raw):
            table.receive(each)


@given(
    places=st.lists(st.tuples(metres, metres, metres) | st.none(), min_size=1, max_size=8),
    link=st.floats(1, 2e4),
)
def test_hops_are_no_shortcut(places: list[tuple[float, float, float] | None], link: float) -> None:
    own = len(places)
    listed = [
        None if at is None else Estimate(k, 0, *at, 0.0) for k, at in enumerate([*places, (0.0, 0.0, 0.0)])
    ]
    counted, apart = hops(own, listed, link), euclidean_3d(own, listed)
    for k, (hop, metre) in enumerate(zip(counted, apart, strict=True)):
        assert (hop is None) == (metre is None) == (listed[k] is None)
        if hop is not None and metre is not None and hop < len(listed):
            assert metre <= hop * link * (1 + 1e-12)
            assert (hop == 0) == (k == own)
            assert (hop == 1) == (k != own and metre <= link)


@st.composite
def histories(draw: st.DrawFn) -> dict[str, Any]:
    """A robot, where the others are, and which of them it comes to know before each slot."""
    team = draw(st.integers(1, 7))
    return {
        "team": team,
        "own": draw(st.integers(0, team - 1)),
        "distances": draw(
            st.lists(st.sampled_from([0.0, 1.0, 1.5]) | st.floats(0, 1e5), min_size=team, max_size=team)
        ),
        "alpha": draw(st.sampled_from([0.0, 1.0, 2.0, 20.0]) | st.floats(0, 20)),
        "m": draw(st.integers(1, 9)),
        "heard": draw(st.lists(st.lists(st.integers(0, team - 1), max_size=3), max_size=15)),
    }


@settings(deadline=None)  # the first call compiles
@given(history=histories(), scheme=st.sampled_from(SCHEMES), new=st.sampled_from(NEW_ESTIMATES))
def test_selections(history: dict[str, Any], scheme: str, new: str) -> None:
    """The own first, nobody twice, only who is known, no place wasted; and compiled code chooses the same."""
    team, own, distances = history["team"], history["own"], history["distances"]
    m = max(history["m"], team) if scheme == "flooding" else history["m"]
    chance, draws = np.random.default_rng(1), np.random.default_rng(1)
    chooser = selection(scheme, own, team, alpha=history["alpha"], new_estimates=new, generator=chance)
    code, compiled = kernels.rule(scheme, m, new), kernels.fresh_team(team)
    importance = kernels.importances(np.array(distances), history["alpha"])
    chosen = np.empty(team, dtype=np.int64)
    stamps: list[int | None] = [0 if j == own else None for j in range(team)]
    for now, heard in enumerate(history["heard"], start=1):
        for j in heard:
            if stamps[j] is None:
                chooser.heard_first(j)
            stamps[j] = now
            kernels.receive(code, own, j, now, compiled.stamps, compiled.counters)
        compiled.stamps[own, own] = stamps[own] = now
        sent = chooser.choose(m, distances, stamps)

        known = {j for j in range(team) if stamps[j] is not None}
        assert sent[0] == own
        assert len(set(sent)) == len(sent) == (1 if scheme == "own" else min(m, len(known)))
        assert set(sent) <= known
        if isinstance(chooser, Location):
            assert all(0 <= counter <= 1 for counter in chooser.counters)
            assert chooser.counters[own] == 1

        count = kernels.choose(
            code, own, np.array(distances), importance, compiled.stamps[own], compiled.counters[own],
            compiled.last, draws.random(min(m, team) - 1), np.empty(team), chosen,
        )  # fmt: skip
        assert chosen[:count].tolist() == sent


@given(
    distances=st.lists(st.floats(1, 10), min_size=2, max_size=6),
    alpha=st.floats(0, 2),
    m=st.integers(2, 4),
    new=st.sampled_from(NEW_ESTIMATES),
)
def test_nobody_is_forgotten(distances: list[float], alpha: float, m: int, new: str) -> None:
    """Importances differ by 100 at most here, so that each of six counters falls below all others in time."""
    team = len(distances)
    chooser = Location(0, team, alpha, new)
    sent: set[int] = set()
    for _ in range(1500):
        sent |= set(chooser.choose(m, distances, [0] * team))
        if len(sent) == team:
            return
    raise AssertionError(f"never sent: {set(range(team)) - sent}")
