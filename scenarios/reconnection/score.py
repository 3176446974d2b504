"""Score of a search from a log (Vandermeulen et al., sec. V)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

from logs.reader import LogReader
from scenarios.reconnection.score_beliefs import calibration, mean, merges
from scenarios.reconnection.score_contacts import agreement, broken, contacts
from scenarios.reconnection.score_history import KINDS, PLAN, REFUSED, History, Moment, read


def score(log: LogReader) -> dict[str, Any]:
    """Score of one log; see `score_history` for what it holds."""
    return score_history(read(log))


def score_history(history: History) -> dict[str, Any]:
    """Score of a run. Steps count from the end of the random phase.

    - `robots`, `duration_s`; `ended`: whose behaviour returned before the run was over;
    - `reached`: whether all whose behaviour still ran were one network, and searched; when that was, in
      `steps` and `time_s` (None: never);
    - `moves`: how often each robot came to another vertex until then;
    - `turned_back`: how often robots were turned back until then, so that a network did not break; `plans`:
      see `plans`, until then; `contacts`, `agreement`, `broken`: see `score_contacts`;
    - `beliefs` (None: nothing was believed), `merges`: see `score_beliefs`; `radio`: see `bytes_sent`;
    - `refused`: how many messages robots refused.

    How long planning takes is not in a log, which is the same on every machine: `make bench` measures it.
    """
    found = reunion(history)
    search = until(history, found)
    return {
        "robots": len(history.robots),
        "duration_s": history.duration_s,
        "ended": [history.robots[robot] for robot in history.dead],
        "reached": found is not None,
        "steps": None if found is None else found.step - history.random_steps,
        "time_s": None if found is None else (found.step - history.random_steps) * history.step_s,
        "moves": moves(history, search),
        "contacts": contacts(history, search),
        "agreement": agreement(history),
        "broken": broken(history, search),
        "turned_back": sum(len(data["turned"]) for data in _decisions(search, history)),
        "plans": plans(_decisions(search, history)),
        "beliefs": calibration(history),
        "merges": merges(history),
        "radio": bytes_sent(history),
        "refused": len(history.entries[REFUSED]),
    }


def reunion(history: History) -> Moment | None:
    """The first step at which all that are alive, two or more, search and have found each other."""
    return next((moment for moment in history.moments if _together(moment)), None)


def _together(moment: Moment) -> bool:
    everybody = set(moment.alive)
    told = [moment.told.get(robot) for robot in moment.alive]
    return len(told) > 1 and all(
        entry is not None and entry["searching"] and everybody <= set(entry["network"]) for entry in told
    )


def until(history: History, found: Moment | None) -> list[Moment]:
    """The search: from the end of the random phase until all have found each other, or the run ends."""
    return [
        moment
        for moment in history.moments
        if moment.step >= history.random_steps and (found is None or moment.step <= found.step)
    ]


def moves(history: History, search: Sequence[Moment]) -> dict[str, Any]:
    """How often robots have come to another vertex: `per_robot`, by id, and `total`."""
    count = [0] * len(history.robots)
    for before, after in pairwise(search):
        for robot, (was, now) in enumerate(zip(before.places, after.places, strict=True)):
            count[robot] += was != now
    return {"per_robot": dict(zip(history.robots, count, strict=True)), "total": sum(count)}


def _decisions(search: Sequence[Moment], history: History) -> list[Mapping[str, Any]]:
    """All but those of the last step, which nothing followed."""
    end = search[-1].step if search else 0
    return [data for _, _, data in history.entries[PLAN] if data["step"] < end]


def plans(decisions: Iterable[Mapping[str, Any]]) -> dict[str, Any] | None:
    """What was planned with beliefs: by robots `alone` and by `groups` of two or more.

    Each: `plans`, `nodes` (mean: how far the search looked), `contact` (mean: how likely contact within the
    horizon was held to be); `proven` of `groups`: the share of plans of which it was proved that none is
    better. None for other methods.
    """
    made = [data for data in decisions if data["contact"] is not None]
    if not made:
        return None
    alone, groups = ([data for data in made if (len(data["group"]) > 1) is many] for many in (False, True))
    return {
        "alone": _plans(alone),
        "groups": _plans(groups) | {"proven": mean([float(data["proven"]) for data in groups])},
    }


def _plans(made: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    return {
        "plans": len(made),
        "nodes": mean([data["nodes"] for data in made]),
        "contact": mean([data["contact"] for data in made]),
    }


def bytes_sent(history: History) -> dict[str, Any]:
    """Payload bytes by kind of message: `sent` (bytes) and `messages`.

    Kinds: `presences`, `facts` (pieces of what groups believe), `decisions`, and `other`, which robots of
    this behaviour do not send. `per_robot`: bytes by id; `per_robot_and_step`: their mean.
    """
    sent, messages = dict.fromkeys(KINDS.values(), 0), dict.fromkeys(KINDS.values(), 0)
    per_robot = [0] * len(history.robots)
    for (robot, tag), (count, size) in history.sent.items():
        messages[KINDS[tag]] += count
        sent[KINDS[tag]] += size
        per_robot[robot] += size
    robot_steps = sum(len(moment.alive) for moment in history.moments)
    return {
        "sent": sent,
        "messages": messages,
        "per_robot": dict(zip(history.robots, per_robot, strict=True)),
        "per_robot_and_step": sum(per_robot) / robot_steps if robot_steps else None,
    }
