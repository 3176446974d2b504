"""Compiled selections against the classes robots run: the same numbers, slot by slot, bit for bit."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import get_args, get_type_hints

import numpy as np
import pytest
from numpy.typing import NDArray

from agent.behaviours.dissemination.estimates import Estimate, EstimateTable, News
from agent.behaviours.dissemination.selection import NEW_ESTIMATES, SCHEMES, importances, selection
from scenarios.dissemination import kernels
from scenarios.dissemination.kernels import (
    NEW_NUMBERS,
    SCHEME_NUMBERS,
    UNKNOWN,
    choose,
    deliver,
    fresh_team,
    receive,
    rule,
)
from scenarios.dissemination.study_propagation import PropagationParameters

ROBOTS = 12
SLOTS = 300

Links = NDArray[np.bool_]
Floats = NDArray[np.float64]
Slot = tuple[int, list[int], list[list[int | None]]]


def world(seed: int) -> tuple[Links, Floats]:
    """A path that leads through all robots, and some links besides; distances with many ties."""
    rng = np.random.default_rng(seed)
    links = rng.random((ROBOTS, ROBOTS)) < 0.1
    path = rng.permutation(ROBOTS)
    links[path[:-1], path[1:]] = True
    links |= links.T
    np.fill_diagonal(links, False)
    distances = np.sqrt(rng.integers(0, 9, (ROBOTS, ROBOTS)))
    return links, np.maximum(distances, distances.T)


def by_classes(scheme: str, m: int, new: str, alpha: float, seed: int) -> Iterator[Slot]:
    """Who transmits, what, and all time stamps afterwards."""
    links, distances = world(seed)
    order = np.random.default_rng(seed).permutation(ROBOTS).tolist()
    chance = np.random.default_rng(seed)
    tables = [EstimateTable(i, ROBOTS) for i in range(ROBOTS)]
    choosers = [
        selection(scheme, i, ROBOTS, alpha=alpha, new_estimates=new, generator=chance) for i in range(ROBOTS)
    ]
    for i, table in enumerate(tables):
        table.update_own(Estimate(i, 0, 0.0, 0.0, 0.0, 0.0))
    for now in range(SLOTS):
        sender = order[now % ROBOTS]
        table = tables[sender]
        table.update_own(Estimate(sender, now, 0.0, 0.0, 0.0, 0.0))
        known = [
            d if new == "true-distance" or table[j] is not None else None
            for j, d in enumerate(distances[sender].tolist())
        ]
        chosen = choosers[sender].choose(m, known, table.stamps())
        packet = [table[j] for j in chosen]
        for receiver in np.flatnonzero(links[sender]).tolist():
            for estimate in packet:
                assert estimate is not None
                if tables[receiver].receive(estimate) is News.first:
                    choosers[receiver].heard_first(estimate.number)
        yield sender, chosen, [table.stamps() for table in tables]


def by_kernel(scheme: str, m: int, new: str, alpha: float, seed: int) -> Iterator[Slot]:
    links, distances = world(seed)
    importance = kernels.importances(distances, alpha)
    order = np.random.default_rng(seed).permutation(ROBOTS).tolist()
    draws = np.random.default_rng(seed).random((SLOTS, min(m, ROBOTS) - 1))
    code = rule(scheme, m, new)
    team = fresh_team(ROBOTS)
    weights, chosen = np.empty(ROBOTS), np.empty(ROBOTS, dtype=np.int64)
    news = np.empty((ROBOTS, ROBOTS), dtype=np.int64)
    for now in range(SLOTS):
        sender = order[now % ROBOTS]
        team.stamps[sender, sender] = now
        count = choose(
            code, sender, distances[sender], importance[sender], team.stamps[sender], team.counters[sender],
            team.last, draws[now], weights, chosen,
        )  # fmt: skip
        packet = chosen[:count]
        sent = team.stamps[sender][packet]
        deliver(code, np.flatnonzero(links[sender]), packet, sent, team.stamps, team.counters, news)
        stamps: list[list[int | None]] = [
            [None if stamp == UNKNOWN else stamp for stamp in row] for row in team.stamps.tolist()
        ]
        yield sender, packet.tolist(), stamps


CASES = [
    ("location", m, new, alpha)
    for new in NEW_ESTIMATES
    for m, alpha in ((1, 1.0), (2, 1.0), (4, 0.37), (5, 2.0), (20, 1.0), (3, 0.0), (3, 20.0))
] + [
    ("location-probabilistic", 4, "first", 1.3),
    ("location-probabilistic", 20, "first", 1.0),
    ("flooding", 12, "first", 1.0),
    ("flooding", 15, "first", 1.0),
    ("own", 1, "first", 1.0),
    ("own", 5, "first", 1.0),
    ("round-robin", 2, "first", 1.0),
    ("round-robin", 5, "first", 1.0),
    ("round-robin", 20, "first", 1.0),
    ("freshest-first", 4, "first", 1.0),
    ("freshest-first", 20, "first", 1.0),
]


@pytest.mark.parametrize(("scheme", "m", "new", "alpha"), CASES)
def test_same_choices_slot_by_slot(scheme: str, m: int, new: str, alpha: float) -> None:
    seed = 7 * m
    pairs = zip(by_classes(scheme, m, new, alpha, seed), by_kernel(scheme, m, new, alpha, seed), strict=True)
    for expected, found in pairs:
        # Before anybody has spoken, its own stamp is 0 in the classes and in the kernel.
        assert found == expected


@pytest.mark.parametrize("new", NEW_ESTIMATES)
def test_one_estimate_at_a_time_or_the_whole_packet(new: str) -> None:
    rng = np.random.default_rng(3)
    code = rule("location", 3, new)
    one, other = fresh_team(5), fresh_team(5)
    news = np.empty((5, 5), dtype=np.int64)
    seen = set()
    for _ in range(200):
        numbers = rng.permutation(5)[:3]
        sent = rng.integers(0, 30, 3)
        receivers = rng.permutation(5)[:2]
        first = deliver(code, receivers, numbers, sent, one.stamps, one.counters, news)
        singly = [
            [receive(code, r, j, t, other.stamps, other.counters) for j, t in zip(numbers, sent, strict=True)]
            for r in receivers
        ]
        assert news[:2, :3].tolist() == singly
        assert first == any(News.first in row for row in singly)
        assert (one.stamps == other.stamps).all()
        assert (one.counters == other.counters).all()
        seen |= {what for row in singly for what in row}
    assert seen == {0, 1, 2}


def test_importances_are_those_of_the_classes() -> None:
    rng = np.random.default_rng(1)
    distances = np.concatenate([[0.0, 1e-9, 0.001, 1.0], 10 ** rng.uniform(-4, 6, 500)])
    for alpha in (0.0, 0.1, 1.0, 1.7, 2.0, 20.0):
        listed = importances(list(range(len(distances))), distances.tolist(), alpha)
        assert kernels.importances(distances, alpha).tolist() == list(listed.values())
        assert all(0 < f < math.inf for f in listed.values())


def test_every_name_is_known_everywhere() -> None:
    hints = get_type_hints(PropagationParameters)
    assert set(SCHEME_NUMBERS) == set(SCHEMES) == set(get_args(hints["scheme"]))
    assert set(NEW_NUMBERS) == set(NEW_ESTIMATES) == set(get_args(hints["new_estimates"]))
    assert len(set(SCHEME_NUMBERS.values())) == len(SCHEMES)
    assert len(set(NEW_NUMBERS.values())) == len(NEW_ESTIMATES)


def test_rounding_lets_nobody_go_before_news() -> None:
    """As `test_news_goes_before_whoever_outweighs_all_the_others`, compiled."""
    distances = np.array([0.0, 3.0, 30.0, 30.0])
    importance = kernels.importances(distances[None], 20.0)[0]
    team, weights, chosen = fresh_team(4), np.empty(4), np.empty(4, dtype=np.int64)
    stamps, counters = team.stamps[0], team.counters[0]
    stamps[:2] = 0
    said = []
    for slot in range(12):
        if slot == 3:
            stamps[2:], counters[2:] = 0, 0.0
        code = rule("location", 2, "first")
        count = choose(code, 0, distances, importance, stamps, counters, team.last, weights, weights, chosen)
        said += chosen[1:count].tolist()
    assert said == [1, 1, 1, 2, 3, 1, 1, 1, 1, 1, 1, 1]
