"""Who was in contact with whom, from a log; whether robots knew, and whether teams held together.

What is true is what the radio goes by: places and links where `radio.link` is "graph", positions, range and
sight where it is "disc"; `score_history` says of which instant. What else keeps messages from arriving, as
losses and collisions do, is no part of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, pairwise
from typing import Any

from scenarios.reconnection.score_history import History, Moment


def contacts(history: History, search: Sequence[Moment]) -> dict[str, dict[str, Any]]:
    """By pair of ids: when both were truly in one network (`History.networks`).

    `first_step` of the `search` (None: never), `share` of its steps, and whether `in_random_phase`. Steps
    count from the end of the random phase.
    """
    before = [moment for moment in history.moments if moment.step < history.random_steps]
    met = {pair for moment in before for network in history.networks(moment) for pair in _pairs(network)}
    steps: dict[tuple[int, int], list[int]] = {pair: [] for pair in _pairs(range(len(history.robots)))}
    for moment in search:
        for network in history.networks(moment):
            for pair in _pairs(network):
                steps[pair].append(moment.step - history.random_steps)
    return {
        "-".join(history.robots[robot] for robot in pair): {
            "first_step": each[0] if each else None,
            "share": len(each) / len(search) if search else None,
            "in_random_phase": pair in met,
        }
        for pair, each in steps.items()
    }


def agreement(history: History) -> dict[str, int]:
    """How often a robot told who was in its network (`asked`), and how often that was right (`same`).

    Right is who truly was (`History.networks`), of those whose behaviour ran.
    """
    asked = same = 0
    for moment in history.moments:
        truly = {robot: network for network in history.networks(moment) for robot in network}
        asked += len(moment.told)
        same += sum(tuple(entry["network"]) == truly.get(robot) for robot, entry in moment.told.items())
    return {"asked": asked, "same": same}


def broken(history: History, search: Sequence[Moment]) -> dict[str, int]:
    """How often robots that searched together were not in one network a step later.

    `told`: by what they themselves took for their network; `true`: truly (`History.networks`). Groups of
    which a member died in between do not count.
    """
    told = true = 0
    for before, after in pairwise(search):
        networks = history.networks(after)
        for group in before.groups(history.hearing):
            members = set(group)
            if not members <= set(after.alive):
                continue
            told += any(
                not members <= set(entry["network"])
                for robot, entry in after.told.items()
                if robot in members
            )
            true += not any(members <= set(network) for network in networks)
    return {"told": told, "true": true}


def _pairs(robots: Sequence[int]) -> list[tuple[int, int]]:
    return list(combinations(robots, 2))
