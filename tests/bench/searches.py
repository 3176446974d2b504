"""What a search for each other costs: plans, in the situations of whole searches, beliefs, and compiling it all."""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field
from typing import Any, TypeVar
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from tests.bench.measure import Figures, Meter, SampleFailed

LONGEST = 300
"""Steps after which a search is given up here."""
RANDOM_STEPS = 50
WIDE = 2000
"""A budget of nodes, far above the default; plans should still take less than a second."""
SITUATIONS = 4
"""How many situations of each size of group are planned again with that."""
GROUPS = (2, 3, 4)
P = TypeVar("P")

# Compiled code is imported where it is used: other cells' processes do without a compiler in memory.


@dataclass
class _Plans:
    """Plans of one number of searchers and targets."""

    wall_ms: list[float] = field(default_factory=list)
    cpu_ms: list[float] = field(default_factory=list)
    nodes: list[int] = field(default_factory=list)
    proven: list[bool] = field(default_factory=list)
    tight: list[float] = field(default_factory=list)
    """What was found, as a share of the bound."""

    def figures(self) -> Figures:
        return {
            "plans": len(self.wall_ms),
            "wall_ms": float(np.median(self.wall_ms)),
            "wall_95_ms": float(np.quantile(self.wall_ms, 0.95)),
            "cpu_ms": float(np.median(self.cpu_ms)),
            "cpu_95_ms": float(np.quantile(self.cpu_ms, 0.95)),
            "nodes": float(np.median(self.nodes)),
            "proven": float(np.mean(self.proven)),
            "tight": float(np.median(self.tight)),
        }


class _Record:
    """Stands in for the planner: does what it does, and notes what that took."""

    def __init__(self) -> None:
        from agent.behaviours.reconnection import methods, planner

        self.plans: dict[tuple[int, int], _Plans] = defaultdict(_Plans)
        """By numbers of searchers and targets."""
        self.situations: dict[int, list[tuple[Any, ...]]] = defaultdict(list)
        """What `plan_team` was asked, by number of searchers."""
        self._methods = methods
        self._alone, self._team = planner.plan_alone, planner.plan_team

    def patched(self) -> AbstractContextManager[object]:
        stack = ExitStack()
        stack.enter_context(patch.object(self._methods, "plan_alone", self._of_one))
        stack.enter_context(patch.object(self._methods, "plan_team", self._of_group))
        return stack

    def _of_one(self, ground: Any, *asked: Any, **options: Any) -> Any:
        plans = self.plans[1, len(ground.ends) - 1]
        plan = _timed(plans, lambda: self._alone(ground, *asked, **options))
        plans.nodes.append(plan.nodes)
        plans.proven.append(True)
        plans.tight.append(1.0)
        return plan

    def _of_group(self, ground: Any, beliefs: Any, places: Any, *asked: Any, **options: Any) -> Any:
        self.situations[len(places)].append((ground, beliefs, places, *asked))
        plans = self.plans[len(places), len(ground.ends) - 1]
        plan = _timed(plans, lambda: self._team(ground, beliefs, places, *asked, **options))
        plans.nodes.append(plan.nodes)
        plans.proven.append(plan.proven)
        plans.tight.append(_share(plan.values.max(), plan.bound))
        return plan


def _share(part: float, whole: float) -> float:
    return float(part / whole) if whole > 0 else 1.0


def _timed(plans: _Plans, plan: Callable[[], P]) -> P:
    cpu_ns, wall_ns = time.process_time_ns(), time.perf_counter_ns()
    made = plan()
    plans.wall_ms.append((time.perf_counter_ns() - wall_ns) / 1e6)
    plans.cpu_ms.append((time.process_time_ns() - cpu_ns) / 1e6)
    return made


def _searched(kind: str, robots: int, searches: int) -> _Record:
    """What was planned in so many searches, at the defaults of the study."""
    from agent.behaviours.reconnection.warm import search_a_little
    from scenarios.reconnection.study_reconnection import ReconnectionParameters, search_of

    search_a_little()  # compiled, or loaded, once
    record = _Record()
    parameters = ReconnectionParameters(robots=robots, environment=kind)  # type: ignore[arg-type]
    with record.patched():
        for seed in range(searches):
            search_of(parameters, seed).run(RANDOM_STEPS, LONGEST)
    return record


def measure_search(kind: str, robots: int, searches: int) -> Figures:
    """Milliseconds, nodes and proofs of plans, by "searchers, targets"; where and when they are made."""
    meter = Meter([])
    meter.begin()
    record = _searched(kind, robots, searches)
    meter.end()
    return {"others_cores": meter.per_activation(1)["others_cores"]} | {
        f"{members}, {targets}: {name}": value
        for (members, targets), plans in sorted(record.plans.items())
        for name, value in plans.figures().items()
    }


def measure_wider(kind: str, robots: int, searches: int) -> Figures:
    """What groups miss: the same situations, planned with `WIDE` nodes; by number of searchers."""
    from agent.behaviours.reconnection.planner import plan_team

    figures: Figures = {}
    for members, situations in _searched(kind, robots, searches).situations.items():
        chosen = np.linspace(0, len(situations) - 1, SITUATIONS).astype(int)
        found, plans = [], _Plans()
        for asked in (situations[number] for number in np.unique(chosen)):
            usual = plan_team(*asked)
            wide = _timed(plans, lambda asked=asked: plan_team(*asked, budget=WIDE))  # type: ignore[misc]
            found.append(_share(usual.values.max(), wide.values.max()))
            plans.nodes.append(wide.nodes)
            plans.proven.append(wide.proven)
            plans.tight.append(_share(wide.values.max(), wide.bound))
        figures |= {f"{members}: {name}": value for name, value in plans.figures().items()}
        figures |= {f"{members}: found": float(np.mean(found)), f"{members}: least": min(found)}
    return figures


def measure_beliefs() -> Figures:
    """CPU microseconds of a step and of merging on 150 vertices; and of the same by dense tensors."""
    from agent.behaviours.reconnection import belief as beliefs
    from agent.behaviours.reconnection.environments import environment
    from agent.behaviours.reconnection.model import walk_model, ways_of
    from channels.graphs import hearing
    from tests import reconnection_dense as dense

    graph = environment("gridholes", 150, 1)
    model, heard = walk_model(graph, ways_of(graph, 2)), hearing(graph)[0]
    longest = int(np.diff(model.first).max())
    at = np.repeat(np.arange(len(model.place)), np.diff(model.first))
    where = at * longest + np.arange(model.states) - model.first[at]
    tensor = np.zeros((len(model.place) * longest,) * 2)
    for state, only in enumerate(np.eye(model.states)):
        tensor[where, where[state]] = beliefs.advanced(model, only)
    each = np.random.default_rng(1).dirichlet(np.full(model.states, 0.2), 5)
    padded = np.zeros((5, len(tensor)))
    padded[:, where] = each
    unheard = (~heard[model.place]).repeat(longest).astype(float)

    def dense_step() -> NDArray[np.float64]:
        after = (tensor @ padded[0]) * unheard
        return np.asarray(after / after.sum())

    if not np.allclose(dense_step()[where], beliefs.step(model, heard, each[0])[0], rtol=0, atol=1e-12):
        raise SampleFailed("beliefs: the dense tensor says something else")
    return {
        "states": model.states,
        "dense_mib": tensor.nbytes / 2**20,
        "step_us": _cost(lambda: beliefs.step(model, heard, each[0]), 20_000),
        "step_dense_us": _cost(dense_step, 200),
        "merge_2_us": _cost(lambda: beliefs.merged(list(each[:2])), 5000),
        "merge_2_dense_us": _cost(lambda: dense.merged(list(padded[:2])), 5000),
        "merge_5_us": _cost(lambda: beliefs.merged(list(each)), 2000),
        "merge_5_dense_us": _cost(lambda: dense.merged(list(padded)), 2000),
    }


def _cost(work: Callable[[], object], times: int) -> float:
    work()  # what is done once only is no part of it
    begun = time.process_time()
    for _ in range(times):
        work()
    return (time.process_time() - begun) / times * 1e6


def measure_compiling() -> Figures:
    """CPU seconds until everything is compiled for the first time, and until it is loaded.

    Raises SampleFailed where a compiler has been loaded before, which then has a place for what it keeps.
    """
    if "numba" in sys.modules:
        raise SampleFailed("compiled code is loaded already; measure this in a process of its own")
    with tempfile.TemporaryDirectory(prefix="heliograph-bench-") as kept:
        os.environ["NUMBA_CACHE_DIR"] = kept
        return {name: _in_child(_search_a_little) for name in ("compile_s", "load_s")}


def _search_a_little() -> float:
    begun = time.process_time()
    from agent.behaviours.reconnection.warm import search_a_little

    search_a_little()
    return time.process_time() - begun


def _in_child(function: Callable[[], float]) -> float:
    """The answer of a fork, which takes with it what it has loaded. Raises SampleFailed where it gives none."""
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        try:
            os.write(writing, repr(function()).encode())
        finally:
            os._exit(0)
    os.close(writing)
    with open(reading) as answer:
        text = answer.read()
    os.waitpid(child, 0)
    if not text:
        raise SampleFailed("the process that compiles died")
    return float(text)
