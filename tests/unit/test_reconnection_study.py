"""The study of reconnection: exact means, pairs, teams that hold, searches that get stuck, sentences."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from scipy import stats

from agent.behaviours.reconnection import baselines, methods
from agent.behaviours.reconnection.environments import KINDS
from agent.behaviours.reconnection.graph_file import write_graph
from agent.behaviours.reconnection.member import drawn_tasks
from agent.behaviours.reconnection.team import Motion
from channels.graphs import Graph, hearing
from channels.randomness import Draws
from emulator.assemble import rng_seeds
from scenarios.reconnection import statistics
from scenarios.reconnection.simulation import Loss, Result, Search
from scenarios.reconnection.study_reconnection import (
    STUDY,
    Kind,
    ReconnectionParameters,
    check,
    graph_of,
    search_of,
)
from scenarios.study import run_study

SMALL = {"vertices": 40, "random_steps": 20}


@lru_cache
def result(samples: int, **parameters: Any) -> dict[str, Any]:
    return run_study(STUDY, ReconnectionParameters(**parameters), samples=samples, jobs=1)


def one_result(seed: int = 1, watch: Any = None, **parameters: Any) -> Result:
    chosen = ReconnectionParameters(**parameters)
    return search_of(chosen, seed).run(chosen.random_steps, chosen.limit, watch)


def path_graph(vertices: int, *, closed: bool = False) -> Graph:
    pairs = [(i, i + 1) for i in range(vertices - 1)] + ([(0, vertices - 1)] if closed else [])
    return Graph(tuple((float(i), 0.0) for i in range(vertices)), tuple((a, b, 1.0) for a, b in pairs))


def in_file(folder: Path, graph: Graph) -> str:
    path = folder / "graph.json"
    write_graph(path, graph)
    return str(path)


# --- what is known exactly -----------------------------------------------------------------------


def mean_meeting_time(graph: Graph, starts: tuple[int, int], tau: int) -> float:
    """Of two random walkers who move together, by the linear equations of pairs of vertices."""
    heard = hearing(graph)
    near = [[] for _ in graph.vertices]
    for a, b, _ in graph.edges:
        near[a].append(b)
        near[b].append(a)
    pairs = [(u, v) for u in range(len(near)) for v in range(len(near)) if not heard[u, v]]
    number = {pair: i for i, pair in enumerate(pairs)}
    matrix = np.eye(len(pairs))
    for (u, v), i in number.items():
        for after in [(a, b) for a in near[u] for b in near[v]]:
            if after in number:
                matrix[i, number[after]] -= 1 / len(near[u]) / len(near[v])
    return float((tau + 1) * np.linalg.solve(matrix, np.ones(len(pairs)))[number[starts]])


@pytest.mark.parametrize(
    ("graph", "starts", "tau", "mean"),
    [
        (path_graph(8, closed=True), (0, 4), 1, 16.0),
        (path_graph(7), (0, 6), 1, 20.769),
        (path_graph(7), (0, 6), 2, 31.154),
    ],
    ids=["ring", "path", "slow path"],
)
def test_random_walkers_meet_when_the_equations_say(
    graph: Graph, starts: tuple[int, int], tau: int, mean: float, tmp_path: Path
) -> None:
    assert mean_meeting_time(graph, starts, tau) == pytest.approx(mean, abs=5e-4)
    found = result(
        400, method="random", robots=2, graph=in_file(tmp_path, graph), random_steps=0,
        starts=",".join(map(str, starts)), travel_steps=float(tau),
    )  # fmt: skip
    assert abs(found["steps"]["mean"] - mean) < 3 * found["steps"]["se"]
    assert 0 < found["steps"]["se"] < 0.06 * mean
    assert found["censored"] == 0


def test_summary_is_of_the_times() -> None:
    found = result(20, method="persistent", **SMALL)
    times = found["times"]
    assert found["samples"] == len(times) == len(set(found["seeds"])) == 20
    assert found["steps"]["mean"] == pytest.approx(np.mean(times))
    assert found["steps"]["sd"] == pytest.approx(np.std(times, ddof=1))
    assert found["steps"]["se"] == pytest.approx(stats.sem(times))
    assert found["steps"]["median"] == np.median(times)
    assert found["plans"] is None
    assert found["beliefs"] is None
    single = result(1, method="persistent", **SMALL)
    assert single["times"] == times[:1]
    assert single["steps"]["se"] is None
    assert single["steps"]["sd"] is None


def test_seeds_are_the_same_for_all_and_repeat_a_run_exactly() -> None:
    persistent, random = (result(20, method=method, **SMALL) for method in ("persistent", "random"))
    larger = result(20, method="random", robots=4, environment="maze", **SMALL | {"limit": 1})
    assert persistent["seeds"] == random["seeds"] == larger["seeds"]
    for i in (0, 7, 19):
        assert one_result(random["seeds"][i], method="random", **SMALL).steps == random["times"][i]
    short = ReconnectionParameters(method="random", **SMALL | {"limit": 1})
    other = run_study(STUDY, short, samples=20, seed=2, jobs=1)
    assert not set(other["seeds"]) & set(random["seeds"])


def test_is_the_same_whoever_does_the_work() -> None:
    parameters = ReconnectionParameters(method="persistent", **SMALL)
    assert run_study(STUDY, parameters, samples=6, jobs=2) == run_study(STUDY, parameters, samples=6, jobs=1)


def test_wandering_is_the_same_for_all_methods() -> None:
    seen: dict[str, list[list[Motion]]] = {}
    for method in methods.METHODS:
        places: list[list[Motion]] = []

        def look(step: int, search: Search, places: list[list[Motion]] = places) -> None:
            if step <= 20:
                places.append([member.motion for member in search.members])

        one_result(3, look, method=method, **SMALL)
        seen[method] = places
    assert seen["random"] == seen["persistent"] == seen["semi-markov"]
    assert len(seen["random"]) == 21
    assert seen["random"][20] != seen["random"][0]


def test_robots_draw_what_robot_processes_draw() -> None:
    """A process draws the key of its draws first, from the generator whose seed it is given."""
    parameters = ReconnectionParameters(method="random", tasks=3, **SMALL)
    keys = [np.random.default_rng(seed).integers(2**63) for seed in rng_seeds(5, ["r00", "r01", "r02"])]
    search = search_of(parameters, 5)
    for member, key in zip(search.members, keys, strict=True):
        draws = Draws.of_key(int(key))
        assert [member.drawn(step) for step in range(3)] == [
            float(draws.uniform(step, 1)) for step in range(3)
        ]
        assert member._tasks == drawn_tasks(draws, 40, 3, 10)


# --- what teams do -------------------------------------------------------------------------------


class Witness:
    """Looks at every step whether robots that search as one network are within one a step later."""

    def __init__(self, graph: Graph) -> None:
        self._hearing = hearing(graph)
        self._before: list[set[int]] = []
        self.broken = self.groups = 0

    def __call__(self, step: int, search: Search) -> None:
        places = {i: member.motion.place for i, member in enumerate(search.members)}
        now = self._components(places)
        self.broken += sum(not any(team <= other for other in now) for team in self._before)
        self.groups += sum(len(team) > 1 for team in self._before)
        active = {i: place for i, place in places.items() if search.members[i].searching(step)}
        self._before = self._components(active)

    def _components(self, places: Mapping[int, int]) -> list[set[int]]:
        found: list[set[int]] = []
        for robot, place in places.items():
            near = [team for team in found if any(self._hearing[place, places[i]] for i in team)]
            found = [team for team in found if team not in near] + [{robot}.union(*near)]
        return found


@pytest.mark.parametrize("method", methods.METHODS)
@pytest.mark.parametrize("environment", get_args(Kind))
def test_no_team_ever_breaks_up(method: methods.Method, environment: Kind) -> None:
    chosen: dict[str, Any] = {
        "method": method, "environment": environment, "robots": 4, "vertices": 40, "budget": 50
    }  # fmt: skip
    groups = 0
    for seed in range(3):
        witness = Witness(graph_of(ReconnectionParameters(**chosen), seed))
        found = one_result(seed, witness, **chosen)
        assert witness.broken == found.broken == 0
        assert found.connected
        groups += witness.groups
    assert groups > 0
    assert set(get_args(Kind)) == set(KINDS)


@pytest.mark.parametrize("chosen", [{"tasks": 2}, {"loss": 0.5}, {"targets": "upwards"}])
def test_no_team_breaks_up_whatever_else_goes_on(chosen: dict[str, Any]) -> None:
    for method in ("persistent", "semi-markov"):
        seeds = [0] if "tasks" in chosen else [0, 1]
        parameters = {"method": method, "robots": 4, "vertices": 30, "budget": 20, **chosen}
        assert [one_result(seed, **parameters).broken for seed in seeds] == [0] * len(seeds)


def test_teams_that_break_up_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    def anywhere(ways: Any, _hearing: Any, motions: Any, u: float) -> Any:
        towards = [baselines.wander(ways, m.place, (u * 97 + i * 0.37) % 1) if m.free else -1
                   for i, m in enumerate(motions)]  # fmt: skip
        return np.array(towards)

    monkeypatch.setattr(methods, "random_moves", anywhere)
    chosen = {"method": "random", "robots": 3, "limit": 1000, **SMALL}
    witness = Witness(graph_of(ReconnectionParameters(**chosen), 1))
    found = one_result(1, witness, **chosen)
    assert found.broken > 0
    assert found.broken == witness.broken


def test_beliefs_find_the_others_sooner() -> None:
    chosen = {"robots": 2, "environment": "delaunay-thinned", "vertices": 80}
    semi, random = (result(30, method=method, **chosen) for method in ("semi-markov", "random"))
    found = statistics.compared(semi["times"], random["times"])
    assert found.ratio_interval[1] < 1
    assert found.mann_whitney < 0.01
    assert found.wins > 0.6
    assert semi["beliefs"]["asked"] > sum(semi["times"])


def test_silence_of_a_radio_that_misses_contacts_takes_longer() -> None:
    chosen = {"method": "random", "robots": 2, "vertices": 25, "random_steps": 20}
    sure, unsure = result(40, **chosen), result(40, loss=0.95, **chosen)
    assert unsure["steps"]["mean"] > 1.3 * sure["steps"]["mean"]
    # Wherever they meet, both searches have gone alike until then.
    assert all(late >= soon for soon, late in zip(sure["times"], unsure["times"], strict=True))


def test_contacts_are_missed_as_often_as_said() -> None:
    loss = Loss(0.3, Draws(7, "contacts"))
    missed = [loss.misses(step, 0, 1) for step in range(4000)]
    assert abs(np.mean(missed) - 0.3) < 4 * math.sqrt(0.3 * 0.7 / 4000)
    assert missed != [loss.misses(step, 0, 2) for step in range(4000)]


def test_whoever_has_tasks_searches_later() -> None:
    chosen = {"method": "persistent", "robots": 3, **SMALL}
    idle, busy = result(20, **chosen), result(20, tasks=4, **chosen)
    assert busy["steps"]["mean"] > idle["steps"]["mean"]
    assert min(busy["times"]) > 8  # nobody does four tasks in less


def test_robots_can_be_taken_for_neutral() -> None:
    chosen = {"robots": 2, "tasks": 2, **SMALL}
    certain, mixed = one_result(4, **chosen), one_result(4, half_steps=50.0, **chosen)
    assert certain.connected
    assert mixed.connected
    assert certain.steps != mixed.steps


# --- searches that do not end --------------------------------------------------------------------

STANDSTILL = {
    "robots": 2, "starts": "0,3", "travel_steps": 1.0, "random_steps": 0, "targets": "upwards", "limit": 5000
}  # fmt: skip
"""On a ring of six: robot 1 stands opposite of robot 0, which can be there within its horizon however it begins:
it begins over and over, and puts the rest off."""


def test_a_search_that_repeats_itself_is_stuck(tmp_path: Path) -> None:
    graph = in_file(tmp_path, path_graph(6, closed=True))
    found = result(3, graph=graph, deterministic=True, **STANDSTILL)
    assert found["stuck"] == found["censored"] == 3
    assert found["times"] == [5000] * 3
    assert found["moves"]["mean"] < 50  # it was not followed further


def test_a_choice_among_good_moves_gets_out_of_it(tmp_path: Path) -> None:
    found = result(10, graph=in_file(tmp_path, path_graph(6, closed=True)), **STANDSTILL)
    assert found["stuck"] == found["censored"] == 0


def test_what_is_called_stuck_never_ends(tmp_path: Path) -> None:
    """Without the proof the same search, followed for all its steps, ends no sooner."""
    graph = in_file(tmp_path, path_graph(6, closed=True))
    parameters = ReconnectionParameters(graph=graph, deterministic=True, **STANDSTILL)
    places = set()
    search = search_of(parameters, 1)
    search._repeats = lambda: False  # type: ignore[method-assign]
    found = search.run(0, 1500, lambda _step, it: places.add(it.members[0].motion))
    assert not found.connected
    assert not found.stuck
    assert found.moves > 500
    assert len(places) < 40


@pytest.mark.parametrize(
    "chosen",
    [{"method": "random"}, {"method": "persistent"}, {"loss": 0.5}, {"tasks": 1, "half_steps": 30.0}],
)
def test_nothing_is_called_stuck_that_depends_on_chance_or_time(chosen: dict[str, Any]) -> None:
    parameters = {"robots": 2, "deterministic": True, "vertices": 20, "environment": "maze", **chosen}
    assert not any(one_result(seed, **parameters).stuck for seed in range(4))


def test_runs_are_given_up_at_the_limit_and_counted() -> None:
    chosen = {"method": "random", **SMALL}
    whole = result(20, **chosen)
    limit = int(np.median(whole["times"]))
    cut = result(20, limit=limit, **chosen)
    assert cut["times"] == [min(time, limit) for time in whole["times"]]
    assert cut["censored"] == sum(time >= limit for time in whole["times"]) > 0
    assert cut["stuck"] == 0


# --- sentences -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("chosen", "sentence"),
    [
        ({"graph": "nowhere.json"}, "graph: nowhere.json: cannot be read"),
        ({"robots": 5, "vertices": 4}, "robots: 5 are more than there are vertices; set 4 or less"),
        ({"starts": "0,5"}, "starts: 0,5 are 2 vertices for 3 robots; name one for each"),
        ({"starts": "0,x,2"}, "starts: 0,x,2 are no vertices; write their numbers as 0,5"),
        ({"starts": "0,1,150"}, "starts: there is no vertex 150; they are 0 to 149"),
        ({"starts": "-1,0,1"}, "starts: -1,0,1 are no vertices"),
    ],
)
def test_what_does_not_go_together_is_said(chosen: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(sentence)}"):
        check(ReconnectionParameters(**chosen))


def test_a_graph_counts_not_what_would_be_drawn(tmp_path: Path) -> None:
    graph = path_graph(4)
    path = in_file(tmp_path, Graph(graph.vertices, graph.edges, None, (0, 3)))
    check(ReconnectionParameters(graph=path, robots=2))
    check(ReconnectionParameters(graph=path, robots=3, starts="0, 1,3"))
    with pytest.raises(ValueError, match="names 2 starts for 3 robots; set starts, or less robots"):
        check(ReconnectionParameters(graph=path, robots=3))
    with pytest.raises(ValueError, match="robots: 5 are more than there are vertices; set 4 or less"):
        check(ReconnectionParameters(graph=path, robots=5, starts="0,1,2,3,0"))


# --- statistics ----------------------------------------------------------------------------------


def test_tests_are_the_usual_ones() -> None:
    rng = np.random.default_rng(3)
    one, other = rng.exponential(10, 40), rng.exponential(20, 40)
    found = statistics.compared(one, other)
    mean, variance = (np.array([f(one), f(other)]) for f in (np.mean, lambda x: np.var(x, ddof=1) / 40))
    t = (mean[0] - mean[1]) / math.sqrt(variance.sum())
    freedom = variance.sum() ** 2 / (variance**2 / 39).sum()
    assert found.welch == pytest.approx(2 * stats.t.sf(abs(t), freedom))
    assert found.wins == pytest.approx(np.mean(one < other))
    assert found.ratio == pytest.approx(mean[0] / mean[1])
    assert found.ratio_interval[0] < found.ratio < found.ratio_interval[1]
    ranks = stats.rankdata(np.concatenate([one, other]))[:40].sum() - 40 * 41 / 2
    assert found.mann_whitney == pytest.approx(
        2 * stats.norm.sf((abs(ranks - 800) - 0.5) / math.sqrt(40 * 40 * 81 / 12)), rel=1e-6
    )


def test_ties_count_half_and_nothing_that_varies_is_no_error() -> None:
    assert statistics.compared([1, 2, 3, 4], [1, 3, 2, 4]).wins == 0.5
    assert statistics.compared([5, 5], [5, 5]).welch == 1
    assert statistics.compared([5, 5], [6, 6]).welch == 0
    with pytest.raises(ValueError, match="as many, and two or more"):
        statistics.compared([1, 2], [1, 2, 3])


def test_intervals_hold_the_mean_as_often_as_they_say() -> None:
    rng = np.random.default_rng(1)
    held = 0
    for _ in range(60):
        low, high = statistics.mean_interval(rng.normal(3, 1, 60))
        held += low < 3 < high
    assert 51 <= held <= 60
    times = rng.exponential(5, 50).tolist()
    assert statistics.mean_interval(times) == statistics.mean_interval(times)
    low, high = statistics.t_interval(times)
    interval = stats.t.interval(0.95, 49, np.mean(times), stats.sem(times))
    assert (low, high) == pytest.approx(interval)
    assert statistics.t_interval([4.0]) == (4.0, 4.0)
    low, high = statistics.share_interval(2, 100)
    assert 0 < low < 0.02 < high < 0.08
