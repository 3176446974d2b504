"""How a group decides: by beliefs, persistently, or at random (Vandermeulen et al., secs. IV and V)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, TypeAlias

import numpy as np
from msgspec import Struct

from agent.behaviours.reconnection import kernels
from agent.behaviours.reconnection.baselines import Ages, persistent_moves, random_moves
from agent.behaviours.reconnection.knowledge import Expectation, Knowledge
from agent.behaviours.reconnection.model import Model, Ways
from agent.behaviours.reconnection.planner import BUDGET, SLACK, WIDTH, choose, plan_alone, plan_team
from agent.behaviours.reconnection.planner_arrays import Ground, ground_of
from agent.behaviours.reconnection.team import Motion, arrays, departed, turn_backs, turned_back
from channels.graphs import Bools, Ints

Method: TypeAlias = Literal["semi-markov", "persistent", "random"]
METHODS: tuple[Method, ...] = ("semi-markov", "persistent", "random")


class Rules(Struct, frozen=True):
    """What a method depends on."""

    method: Method = "semi-markov"
    horizon: int = 12
    """T_p, steps that are planned ahead."""
    deterministic: bool = False
    """Always the best first move; else one within 5 % of it, at random."""
    memory: int = 10
    """Of "persistent": how many moves back a visited vertex is avoided."""
    miss: float = 0.0
    """Probability that a robot in range is not heard for a whole step: how little silence proves."""
    width: int = WIDTH
    budget: int = BUDGET
    """How far a group's search looks: see `planner.plan_team`."""


class Plan(Struct, frozen=True):
    """What a group has decided."""

    motions: dict[int, Motion]
    """The members' motions from now on."""
    contact: float | None = None
    """Probability of contact within the horizon, by the best plan that was found; semi-markov only."""
    proven: bool | None = None
    """Whether no plan is better."""
    nodes: int = 0
    """How far the search has looked."""
    turned: tuple[int, ...] = ()
    """Who has been turned back."""


class Planner:
    """Decides for groups in one environment."""

    def __init__(self, ways: Ways, hearing: Bools, expected: Expectation, rules: Rules) -> None:
        self._ways, self._hearing, self._expected, self._rules = ways, hearing, expected, rules
        self._grounds: dict[tuple[int, ...], tuple[Ground, list[Model]]] = {}

    def united(self, motions: Mapping[int, Motion]) -> tuple[dict[int, Motion], tuple[int, ...]]:
        """Motions with which a connected group stays connected, and who has been turned back for that."""
        members = list(motions)
        if len(members) == 1 or kernels.safe(*arrays(motions.values()), self._hearing):
            return dict(motions), ()
        turned = tuple(members[i] for i in turn_backs(list(motions.values()), self._hearing))
        back = {robot: turned_back(motions[robot]) for robot in turned}
        return dict(motions) | back, turned

    def decided(
        self,
        motions: Mapping[int, Motion],
        targets: Sequence[int],
        knowledge: Knowledge,
        ages: Mapping[int, Ages],
        u: float,
        changed: bool = False,
    ) -> Plan:
        """What the members of one group, in order of their numbers, do now.

        `targets`: whom they search for; nobody: all wait. `knowledge` of these, for semi-markov; `ages` of
        those at a vertex, for persistent; `u`: a uniform draw; `changed`: the group is not what it was at
        the step before. A group decides when a member arrives, or it has changed, or nobody is on the way.
        """
        united, turned = self.united(motions)
        if not targets or not due(united, changed):
            return Plan(united, turned=turned)
        contact, proven, nodes = None, None, 0
        if self._rules.method == "semi-markov":
            moves, contact, proven, nodes = self._likeliest(united, targets, knowledge, u)
        elif self._rules.method == "persistent":
            of_each = [ages.get(robot, ()) for robot in united]
            moves = persistent_moves(
                self._ways, self._hearing, list(united.values()), of_each, self._rules.memory, u
            )
        else:
            moves = random_moves(self._ways, self._hearing, list(united.values()), u)
        after = {
            robot: departed(self._ways, motion, int(move)) if move >= 0 else motion
            for (robot, motion), move in zip(united.items(), moves, strict=True)
        }
        return Plan(after, contact, proven, nodes, turned)

    def _likeliest(
        self, motions: Mapping[int, Motion], targets: Sequence[int], knowledge: Knowledge, u: float
    ) -> tuple[Ints, float, bool, int]:
        rules = self._rules
        slack, u = (0.0, 0.0) if rules.deterministic else (SLACK, u)
        ground, models = self._ground([(knowledge.since.get(robot, 0), robot) for robot in targets])
        vectors = [
            knowledge.vector(model, self._ways, robot) for model, robot in zip(models, targets, strict=True)
        ]
        if len(motions) == 1:
            (motion,) = motions.values()
            alone = plan_alone(ground, vectors, motion.place, rules.horizon, miss=rules.miss, slack=slack)
            first = alone.first[choose(alone.values, slack, u)]
            return np.array([first]), float(alone.values.max()), True, alone.nodes
        plan = plan_team(
            ground,
            vectors,
            *arrays(motions.values()),
            rules.horizon,
            miss=rules.miss,
            slack=slack,
            width=rules.width,
            budget=rules.budget,
        )
        moves = plan.moves[choose(plan.values, slack, u)]
        return moves, float(plan.values.max()), plan.proven, plan.nodes

    def _ground(self, targets: Sequence[tuple[int, int]]) -> tuple[Ground, list[Model]]:
        models = [self._expected.planned(since, robot) for since, robot in targets]
        key = tuple(map(id, models))
        if key not in self._grounds:
            self._grounds[key] = ground_of(self._ways, self._hearing, models), models
        return self._grounds[key]


def due(motions: Mapping[int, Motion], changed: bool) -> bool:
    """Whether a group decides at this step."""
    if not any(motion.free for motion in motions.values()):
        return False
    arrived = any(motion.free and motion.elapsed == 0 for motion in motions.values())
    return arrived or changed or all(motion.free for motion in motions.values())
