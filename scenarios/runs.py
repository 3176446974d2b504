"""What a log says of its run, whatever the robots did."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import orjson
from foxglove_schemas_protobuf.Log_pb2 import Log
from msgspec import Struct

from logs.reader import LogReader

Record = tuple[int, Mapping[str, Any]]
"""(log time [ns], record)"""

_RETURNED = "behaviour returned"


class Run(Struct, frozen=True, kw_only=True):
    """The team, where it was, and when each robot ended."""

    robots: list[str]
    """Ids, by number."""
    truth: list[Record]
    """All of /truth."""
    ended_ns: list[int]
    """When each robot's behaviour returned; the end of the run for all others."""
    end_ns: int
    settings: Mapping[str, Any]
    """The scenario as it was run."""

    @property
    def params(self) -> Mapping[str, Any]:
        """What all robots share of [params]."""
        params: Mapping[str, Any] = self.settings.get("params", {})
        return params


def read_run(log: LogReader) -> Run:
    """All this of a log. Raises ValueError for one that does not say what was run."""
    if "resolved" not in log.run:
        raise ValueError(f"{log.path}: does not say what was run; record the run again")
    truth: list[Record] = list(log.records("/truth"))
    robots = team_of(truth)
    end_ns = int((log.result or {}).get("virtual_ns", log.end_ns))
    return Run(
        robots=robots,
        truth=truth,
        ended_ns=_ended(log, robots, end_ns),
        end_ns=end_ns,
        settings=orjson.loads(log.run["resolved"]),
    )


def team_of(truth: Iterable[Record]) -> list[str]:
    """Ids of all robots, by number, from /truth. Raises ValueError where it does not begin."""
    return [robot["robot"] for robot in start_of(truth)["robots"]]


def start_of(truth: Iterable[Record]) -> Mapping[str, Any]:
    """The record of /truth with which a run starts. Raises ValueError where there is none."""
    for _, record in truth:
        if record["kind"] == "start":
            return record
    raise ValueError("/truth: holds no record of the start, so nobody knows the team; record the run again")


def _ended(log: LogReader, robots: Sequence[str], end_ns: int) -> list[int]:
    ended = dict.fromkeys(robots, end_ns)
    for name, time_ns in _returned(log):
        if name in ended:
            ended[name] = time_ns
    return list(ended.values())


def _returned(log: LogReader) -> Iterator[tuple[str, int]]:
    for _, _, time_ns, data in log.raw(["/log"]):
        line = Log.FromString(data)
        if line.message == _RETURNED:
            yield line.name, time_ns
