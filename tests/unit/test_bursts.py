"""Losses in bursts: the law of Gilbert and Elliott, link by link, and that every draw is a function."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from numpy.typing import NDArray

from channels.fates import Fates, Reason
from channels.medium import Medium
from channels.settings import BurstSettings, RadioSettings

ENTER, LEAVE = 0.05, 0.2
IN_BURST = ENTER / (ENTER + LEAVE)
KEPT = 1 - ENTER - LEAVE
"""Correlation of a link's state with that of the transmission before."""
ROBOTS, ROUNDS = 16, 1200
NAMES = [f"r{index:02}" for index in range(ROBOTS)]

Bools = NDArray[np.bool_]


def ask(medium: Medium, robots: int, senders: list[int], seqs: list[int], refused: bool = False) -> Fates:
    number = len(senders)
    return medium.transmit(
        0,
        np.array(senders),
        np.array(seqs),
        np.zeros(number, dtype=np.int64),
        np.full(number, refused),
        np.zeros((robots, 2)),
        np.ones(robots, dtype=bool),
    )


def medium_of(
    robots: list[str] = NAMES, *, seed: int = 4711, loss: float = 1.0, radio_loss: float = 0.0
) -> Medium:
    bursts = BurstSettings(enter=ENTER, leave=LEAVE, loss=loss)
    return Medium(RadioSettings(range_m=1.0, bursts=bursts, loss=radio_loss), robots, seed)


@lru_cache
def reasons(loss: float = 1.0, radio_loss: float = 0.0, rounds: int = ROUNDS) -> NDArray[np.uint8]:
    """(rounds, sender, receiver), everybody sending once a round."""
    medium = medium_of(loss=loss, radio_loss=radio_loss)
    rows = [ask(medium, ROBOTS, list(range(ROBOTS)), [seq] * ROBOTS).reason for seq in range(rounds)]
    return np.array(rows)


def links(loss: float = 1.0) -> Bools:
    """(rounds, links): where bursts lose something."""
    lost: Bools = (reasons(loss) == Reason.burst)[:, ~np.eye(ROBOTS, dtype=bool)]
    return lost


def standard_error(loss: float, transmissions: int) -> float:
    """Of the mean loss of a chain: its variance, and twice the sum of its autocovariances, per transmission."""
    mean = IN_BURST * loss
    together = 2 * loss**2 * IN_BURST * (1 - IN_BURST) * KEPT / (1 - KEPT)
    return float(np.sqrt((mean * (1 - mean) + together) / transmissions))


@pytest.mark.parametrize("loss", [1.0, 0.6])
def test_the_long_run_loss(loss: float) -> None:
    lost = links(loss)
    assert abs(lost.mean() - IN_BURST * loss) < 4 * standard_error(loss, lost.size)
    # And from the first transmission on: no link begins outside of a burst.
    first = lost[0].mean()
    assert abs(first - IN_BURST * loss) < 4 * np.sqrt(IN_BURST * loss * (1 - IN_BURST * loss) / lost.shape[1])


def lengths(lost: Bools, of: bool) -> NDArray[np.int64]:
    """How long runs of one state last that begin in the first half, so that hardly any is cut off."""
    found = []
    for link in lost.T:
        edges = np.flatnonzero(np.diff(link)) + 1
        for start, end in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            if link[start] == of and start < len(lost) // 2:
                found.append(end - start)
    return np.array(found)


@pytest.mark.parametrize(("of", "ends"), [(True, LEAVE), (False, ENTER)])
def test_bursts_and_pauses_last_geometrically_long(of: bool, ends: float) -> None:
    lasting = lengths(links(), of)
    assert len(lasting) > 3000
    assert abs(lasting.mean() - 1 / ends) < 4 * np.sqrt(1 - ends) / ends / np.sqrt(len(lasting))
    for length in (1, 2, 3, 5):
        share = (1 - ends) ** (length - 1) * ends
        found = (lasting == length).mean()
        assert abs(found - share) < 4 * np.sqrt(share * (1 - share) / len(lasting))


def test_links_are_independent_of_each_other_and_of_their_way_back() -> None:
    lost = (reasons() == Reason.burst).astype(float)
    # Between two chains that remember, a chance correlation is larger than between draws that do not.
    error = np.sqrt((1 + KEPT**2) / (1 - KEPT**2) / ROUNDS)
    pairs = [
        *(((a, b), (b, a)) for a in range(ROBOTS) for b in range(a)),
        *(((a, (a + 1) % ROBOTS), (a, (a + 2) % ROBOTS)) for a in range(ROBOTS)),
        *((((a + 1) % ROBOTS, a), ((a + 2) % ROBOTS, a)) for a in range(ROBOTS)),
    ]
    found = np.array([np.corrcoef(lost[:, *one], lost[:, *other])[0, 1] for one, other in pairs])
    assert abs(found.mean()) < 4 * error / np.sqrt(len(pairs))
    assert abs(found).max() < 5.5 * error


def test_ordinary_loss_comes_on_top_and_takes_what_bursts_left() -> None:
    both, alone = reasons(0.6, 0.3, 200), reasons(0.6)[:200]
    assert np.array_equal(both == Reason.burst, alone == Reason.burst)
    left = (alone == Reason.delivered).sum()
    lost = (both == Reason.loss).sum()
    assert abs(lost / left - 0.3) < 4 * np.sqrt(0.3 * 0.7 / left)


def test_the_order_of_asking_does_not_matter() -> None:
    seqs = list(range(60))
    in_order = ask(medium_of(), ROBOTS, [3] * 60, seqs).reason
    shuffled = np.random.default_rng(1).permutation(60).tolist()
    one_by_one, at_once = medium_of(), ask(medium_of(), ROBOTS, [3] * 60, shuffled).reason
    for row, seq in enumerate(shuffled):
        assert np.array_equal(at_once[row], in_order[seq])
        assert np.array_equal(ask(one_by_one, ROBOTS, [3], [seq]).reason[0], in_order[seq])
        assert np.array_equal(ask(one_by_one, ROBOTS, [3], [seq]).reason[0], in_order[seq])
    # Only now and then, and with others between.
    sparse = ask(medium_of(), ROBOTS, [5, 3, 5, 3, 3], [9, 7, 2, 8, 50]).reason
    assert np.array_equal(sparse[[1, 3, 4]], in_order[[7, 8, 50]])
    assert np.array_equal(in_order, reasons()[:60, 3])


def test_a_message_that_was_refused_has_no_burst_and_changes_none() -> None:
    medium = medium_of()
    seqs = list(range(40))
    expected = ask(medium_of(), ROBOTS, [2] * 40, seqs).reason
    for seq in seqs:
        refused = seq % 3 == 1
        row = ask(medium, ROBOTS, [2], [seq], refused).reason[0]
        if refused:
            assert set(row.tolist()) == {Reason.queue_full, Reason.not_a_candidate}
        else:
            assert np.array_equal(row, expected[seq])


@pytest.mark.parametrize("loss", [1.0, 0.6])
def test_one_more_robot_changes_no_other_link(loss: float) -> None:
    few, more = NAMES[:3], [NAMES[0], "new", *NAMES[1:3]]
    senders, seqs = [0, 1, 2] * 80, np.repeat(np.arange(80), 3).tolist()
    here = ask(medium_of(few, loss=loss), 3, senders, seqs).reason
    others = [{0: 0, 1: 2, 2: 3}[sender] for sender in senders]
    there = ask(medium_of(more, loss=loss), 4, others, seqs).reason
    assert np.array_equal(here, there[:, [0, 2, 3]])


def test_seeds_differ() -> None:
    asked = [3] * 60, list(range(60))
    one, same, other = (ask(medium_of(seed=seed), ROBOTS, *asked).reason for seed in (1, 1, 2))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


def test_certain_ends() -> None:
    """Every burst ends after one transmission; enter + leave = 1 is chance that does not remember."""
    settings = BurstSettings(enter=1e-12, leave=1.0)
    medium = Medium(RadioSettings(range_m=1.0, bursts=settings), NAMES, 1)
    assert not (ask(medium, ROBOTS, [0] * 200, list(range(200))).reason == Reason.burst).any()
    settings = BurstSettings(enter=0.3, leave=0.7)
    medium = Medium(RadioSettings(range_m=1.0, bursts=settings), NAMES, 1)
    lost = ask(medium, ROBOTS, [0] * 1000, list(range(1000))).reason[:, 1:] == Reason.burst
    after = lost[1:][lost[:-1]].mean() - lost[1:][~lost[:-1]].mean()
    assert abs(after) < 4 * np.sqrt(0.21 / (0.3 * lost.size) + 0.21 / (0.7 * lost.size))
