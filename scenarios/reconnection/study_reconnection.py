"""How long teams take to find themselves again: many searches (Vandermeulen et al., sec. V, Fig. 3)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta, Struct

from agent.behaviours.reconnection.environments import KINDS, environment
from agent.behaviours.reconnection.graph_file import read_graph
from agent.behaviours.reconnection.knowledge import Expectation, expectation
from agent.behaviours.reconnection.member import Member, begun
from agent.behaviours.reconnection.methods import Method, Rules
from agent.behaviours.reconnection.model import Ways, ways_of
from agent.behaviours.reconnection.planner import BUDGET, WIDTH
from agent.behaviours.reconnection.settings import (
    LONGEST_STEPS,
    MOST_HALF_STEPS,
    MOST_HORIZON,
    MOST_TASK_STEPS,
    MOST_TASKS,
    MOST_TRAVEL_STEPS,
)
from agent.behaviours.reconnection.team import TARGETS
from agent.behaviours.reconnection.warm import search_a_little
from channels.graphs import Graph, hearing
from channels.graphs import starts as starts_of
from channels.randomness import Draws
from emulator.assemble import rng_seeds
from emulator.scenario import numbered_ids
from scenarios.reconnection.simulation import Loss, Result, Search
from scenarios.study import Study, described, one_each, spread

Kind = Literal["gridholes", "gabriel", "delaunay", "delaunay-thinned", "maze"]
"""`environments.KINDS`."""
Steps = Annotated[int, Meta(ge=0, le=LONGEST_STEPS)]

MOST_STUDY_VERTICES = 1000
"""The communication graph is a matrix, and beliefs have a number for each way and step."""


class ReconnectionParameters(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A team, its environment and its search. The paper tells robots, vertices, random_steps and horizon."""

    robots: Annotated[int, Meta(ge=2, le=8, description="robots, n")] = 3
    method: Annotated[Method, Meta(description="how they search: semi-markov, persistent or random")] = (
        "semi-markov"
    )
    environment: Annotated[
        Kind, Meta(description="kind of environment, a new one for each run: " + ", ".join(KINDS))
    ] = "gridholes"
    vertices: Annotated[
        int, Meta(ge=2, le=MOST_STUDY_VERTICES, description="vertices of the environment, n_e")
    ] = 150
    graph: Annotated[str | None, Meta(description="file of a graph, in place of drawn environments")] = None
    starts: Annotated[
        str | None, Meta(description="where robots start, as 0,5; else in corners and the centre")
    ] = None
    travel_steps: Annotated[
        float,
        Meta(gt=0, le=MOST_TRAVEL_STEPS, description="steps that a robot is on the way per unit of length"),
    ] = 2.0
    random_steps: Annotated[Steps, Meta(description="steps for which all wander before they search")] = 50
    horizon: Annotated[int, Meta(ge=1, le=MOST_HORIZON, description="steps planned ahead, T_p")] = 12
    memory: Annotated[
        int, Meta(ge=1, le=LONGEST_STEPS, description="persistent: for how many moves a vertex is avoided")
    ] = 10
    deterministic: Annotated[
        bool, Meta(description="semi-markov: always the best move, not one within 5 % of it")
    ] = False
    targets: Annotated[
        Literal["all", "upwards"],
        Meta(description="who searches for whom: all for all, or for those of higher numbers only"),
    ] = "all"
    miss: Annotated[
        float,
        Meta(ge=0, lt=1, description="semi-markov: probability that silence is believed to mean nothing"),
    ] = 0.0
    loss: Annotated[
        float, Meta(ge=0, lt=1, description="probability per step that a new contact is missed")
    ] = 0.0
    limit: Annotated[
        int, Meta(ge=1, le=10_000_000, description="steps of search after which a run is given up")
    ] = 20_000
    width: Annotated[
        int, Meta(ge=1, le=4096, description="joint states that a group's plan first keeps per step")
    ] = WIDTH
    budget: Annotated[
        int, Meta(ge=0, le=100_000_000, description="joint states that a group's plan may go on from")
    ] = BUDGET
    tasks: Annotated[
        int, Meta(ge=0, le=MOST_TASKS, description="tasks that each robot does before it searches")
    ] = 0
    task_steps: Annotated[int, Meta(ge=1, le=MOST_TASK_STEPS, description="longest task [steps]")] = 10
    half_steps: Annotated[
        float,
        Meta(ge=0, le=MOST_HALF_STEPS, description="steps without contact after which a robot is believed to "
             "have no tasks left with probability 1/2; 0: it never had any"),
    ] = 0.0  # fmt: skip
    holding: Annotated[
        Literal["uniform", "normal"], Meta(description="believed distribution of steps on a way")
    ] = "uniform"


class Run(Struct, frozen=True):
    """One run, and the seed that makes it what it is."""

    seed: int
    result: Result


def check(parameters: ReconnectionParameters) -> None:
    """Raises ValueError for parameters that do not go together, naming the key."""
    vertices = parameters.vertices
    if parameters.graph is not None:
        graph = _read(parameters.graph)
        vertices = len(graph.vertices)
        ways_of(graph, parameters.travel_steps)
        if vertices > MOST_STUDY_VERTICES:
            raise ValueError(
                f"graph: {parameters.graph} has {vertices} vertices; "
                f"a study takes {MOST_STUDY_VERTICES} or less"
            )
        if parameters.starts is None and graph.starts is not None and len(graph.starts) < parameters.robots:
            raise ValueError(
                f"graph: {parameters.graph} names {len(graph.starts)} starts for {parameters.robots} robots; "
                "set starts, or less robots"
            )
    if parameters.robots > vertices:
        raise ValueError(
            f"robots: {parameters.robots} are more than there are vertices; set {vertices} or less"
        )
    _check_starts(parameters, vertices)


def _check_starts(parameters: ReconnectionParameters, vertices: int) -> None:
    if parameters.starts is None:
        return
    if not re.fullmatch(r"\s*(0|[1-9]\d{0,8})\s*(,\s*(0|[1-9]\d{0,8})\s*)*", parameters.starts, re.ASCII):
        raise ValueError(f"starts: {parameters.starts} are no vertices; write their numbers as 0,5")
    starts = _numbers(parameters.starts)
    if len(starts) != parameters.robots:
        raise ValueError(
            f"starts: {parameters.starts} are {len(starts)} vertices for {parameters.robots} robots; "
            "name one for each"
        )
    for start in starts:
        if start >= vertices:
            raise ValueError(f"starts: there is no vertex {start}; they are 0 to {vertices - 1}")


def _read(path: str) -> Graph:
    try:
        return read_graph(path)
    except ValueError as error:
        raise ValueError(f"graph: {error}") from None


def _numbers(text: str) -> tuple[int, ...]:
    return tuple(map(int, text.split(",")))


# --- one run -------------------------------------------------------------------------------------


def simulate(parameters: ReconnectionParameters, generator: np.random.Generator, samples: int) -> list[Run]:
    """So many runs."""
    return [_run(parameters, int(generator.integers(2**31))) for _ in range(samples)]


def _run(parameters: ReconnectionParameters, seed: int) -> Run:
    search = search_of(parameters, seed)
    return Run(seed, search.run(parameters.random_steps, parameters.limit))


def graph_of(parameters: ReconnectionParameters, seed: int) -> Graph:
    """The environment of the run of a seed, its starts those of the team."""
    if parameters.graph is not None:
        graph = _read(parameters.graph)
    else:
        graph = environment(parameters.environment, parameters.vertices, seed)
    given = parameters.starts
    starts = starts_of(graph, parameters.robots) if given is None else _numbers(given)
    return Graph(graph.vertices, graph.edges, graph.links, starts, graph.obstacles)


def search_of(parameters: ReconnectionParameters, seed: int, graph: Graph | None = None) -> Search:
    """The search of a seed's run, about to begin; `graph` of `graph_of`, if it is known already."""
    graph = graph_of(parameters, seed) if graph is None else graph
    ways = ways_of(graph, parameters.travel_steps)
    robots = parameters.robots
    rules = Rules(
        method=parameters.method,
        horizon=parameters.horizon,
        deterministic=parameters.deterministic,
        memory=parameters.memory,
        miss=parameters.miss,
        width=parameters.width,
        budget=parameters.budget,
    )
    return Search(
        ways,
        hearing(graph),
        _expected(parameters, graph, ways),
        rules,
        _members(parameters, graph, ways, seed),
        TARGETS[parameters.targets](robots),
        Loss(parameters.loss, Draws(seed, "contacts")) if parameters.loss else None,
    )


def _members(parameters: ReconnectionParameters, graph: Graph, ways: Ways, seed: int) -> list[Member]:
    """The team, each with the generator that a robot of the emulator has for the same seed."""
    assert graph.starts is not None
    return [
        begun(
            ways,
            start,
            np.random.default_rng(own),
            random_steps=parameters.random_steps,
            tasks=parameters.tasks,
            task_steps=parameters.task_steps,
        )
        for start, own in zip(graph.starts, rng_seeds(seed, numbered_ids(parameters.robots)), strict=True)
    ]


def _expected(parameters: ReconnectionParameters, graph: Graph, ways: Ways) -> Expectation:
    return expectation(
        graph,
        ways,
        TARGETS[parameters.targets](parameters.robots),
        holding=parameters.holding,
        random_steps=parameters.random_steps,
        tasks=parameters.tasks,
        task_steps=parameters.task_steps,
        half_steps=parameters.half_steps,
    )


# --- many ----------------------------------------------------------------------------------------


def summarise(parameters: ReconnectionParameters, partials: Sequence[list[Run]]) -> dict[str, Any]:
    """Steps from the end of the random phase until the team is one network.

    - `steps`: `mean`, `sd`, `se` and `median` of them; `times`: each, in the order of the runs, and `seeds`:
      what makes each run what it is, the same for all parameters: runs can be compared one by one;
    - `censored`: how many did not end before the limit. They count with the limit among all of the above,
      where nothing else does, which makes means lower bounds; `stuck`: how many of these never would, since
      they came back to where they had been, or no group could move, and were not followed further;
    - `moves` to another vertex, and how often a robot was `turned` back, by all robots of a run: `mean` and
      `se`;
    - `plans`: those that groups of two or more made (`teams`), and how many were `proven` best; None but for
      semi-markov;
    - `beliefs`: how often one was `asked` where a robot was, and held the truth for impossible (`zero`); how
      often an observation left no place but those not heard (`nothing_left`) or none at all
      (`everything_heard`), and beliefs had nothing in common (`disjoint`); None but for semi-markov;
    - `broken`: how often robots that searched as one network were not within one network a step later;
    - `samples`.

    `sd`, `se` are None for a single run.
    """
    runs = [run for partial in partials for run in partial]
    results = [run.result for run in runs]
    times = [result.steps for result in results]
    believes = parameters.method == "semi-markov"
    return {
        "steps": middle(times),
        "times": times,
        "seeds": [run.seed for run in runs],
        "censored": sum(not result.connected for result in results),
        "stuck": sum(result.stuck for result in results),
        "moves": described(result.moves for result in results),
        "turned": described(result.turned for result in results),
        "plans": _plans(results) if believes else None,
        "beliefs": _beliefs(results) if believes else None,
        "broken": sum(result.broken for result in results),
        "samples": len(runs),
    }


def middle(times: Sequence[int]) -> dict[str, float | None]:
    """`mean`, `sd`, `se` and `median`; `sd` and `se` are None for a single time."""
    return spread(times) | {"median": float(np.median(times))}


def _plans(results: Sequence[Result]) -> dict[str, int]:
    return {
        "teams": sum(result.plans for result in results),
        "proven": sum(result.proven for result in results),
    }


def _beliefs(results: Sequence[Result]) -> dict[str, int]:
    wrong = ("nothing_left", "everything_heard", "disjoint")
    return {
        "asked": sum(result.beliefs for result in results),
        "zero": sum(result.zero for result in results),
        **{name: sum(result.outcomes[name] for result in results) for name in wrong},
    }


STUDY = Study(
    name="reconnection",
    title="Reconnection: steps until a team that has lost contact is one network again",
    parameters=ReconnectionParameters,
    samples=100,
    unit="runs",
    chunk=one_each,
    simulate=simulate,
    summarise=summarise,
    check=check,
    prepare=search_a_little,
)
