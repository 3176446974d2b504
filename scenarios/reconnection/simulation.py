"""A team that searches for itself, step by step, without radio: what the paper simulates (sec. V).

The same members, knowledge and methods as robots have; only that whoever is connected shares its knowledge by
sharing the object, instead of by messages.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np
from msgspec import Struct

from agent.behaviours.reconnection.belief import Outcome, mass_at
from agent.behaviours.reconnection.knowledge import Expectation, Knowledge, heard_by, merged
from agent.behaviours.reconnection.member import Member
from agent.behaviours.reconnection.methods import Plan, Planner, Rules, due
from agent.behaviours.reconnection.model import Model, Ways
from agent.behaviours.reconnection.team import Motion, networks, targets_of
from channels.graphs import Bools
from channels.randomness import Draws


class Result(Struct, frozen=True):
    """How one search went. Steps count from the end of the random phase."""

    steps: int
    """When the team was one network; the limit if it was not before that."""
    connected: bool
    """Whether it ever was."""
    stuck: bool
    """Whether it never would be: no group can move without breaking up (links that are no ways), or a
    deterministic search came back to where it was, and to what it believed, to nine digits. Beliefs that go
    round approach a cycle, and may never reach its last bits."""
    moves: int
    """How often robots have come to another vertex while searching."""
    turned: int
    """How often robots have been turned back."""
    broken: int
    """How often robots that searched as one network were not within one network a step later."""
    plans: int
    proven: int
    """How many plans groups of two or more have made, and how many of them were proven best."""
    outcomes: dict[str, int]
    """How often beliefs turned out wrong in each way of `belief.Outcome`."""
    beliefs: int
    """How often a belief was asked for the true place of a robot."""
    zero: int
    """How often it held it for impossible."""


class Loss(Struct, frozen=True):
    """How contacts are missed: that two hear each other, who were not connected at the step before."""

    probability: float
    draws: Draws

    def misses(self, step: int, one: int, other: int) -> bool:
        """Whether these two, the lower number first, miss each other at this step."""
        return bool(self.draws.uniform(step, one, other) < self.probability)


_DIGITS = 9

Watch = Callable[[int, "Search"], None]


class Search:
    """One team in one environment; `run` once."""

    def __init__(
        self,
        ways: Ways,
        hearing: Bools,
        expected: Expectation,
        rules: Rules,
        members: Sequence[Member],
        targets: Sequence[Sequence[int]],
        loss: Loss | None = None,
    ) -> None:
        self.members = members
        self.groups: list[tuple[int, ...]] = []
        """Who is connected, at this step."""
        self.known: list[Knowledge] = []
        """What each robot knows; the same object for all that are connected."""
        self._ways, self._hearing, self._expected, self._rules = ways, hearing, expected, rules
        self._planner = Planner(ways, hearing, expected, rules)
        self._targets, self._loss = targets, loss
        self._believes = rules.method == "semi-markov"
        self._count = dict.fromkeys(("moves", "turned", "broken", "plans", "proven", "beliefs", "zero"), 0)
        self._outcomes = dict.fromkeys(Outcome, 0)
        everybody = {robot: member.motion for robot, member in enumerate(members)}
        self.known = [Knowledge(everybody)] * len(members)
        self._places: list[int] = []
        self._sought_by: dict[tuple[tuple[int, ...], tuple[int, ...]], tuple[int, ...]] = {}
        self._decided_in: list[tuple[int, ...]] = []
        self._subgroups: list[tuple[int, ...]] = []

    @property
    def model(self) -> Model:
        """What numbers the states of beliefs."""
        return self._expected.model

    def run(self, random_steps: int, limit: int, watch: Watch | None = None) -> Result:
        """Wander, then search, until the team is one network, or for `limit` steps."""
        step, seen = 0, _Recurrence() if self._repeats() else None
        while True:
            self._meet(step)
            if watch is not None:
                watch(step, self)
            searched = step - random_steps
            ready = searched >= 0 and all(member.searching(step) for member in self.members)
            done = ready and searched < limit and len(self.groups) == 1
            stuck = not done and ready and seen is not None and seen.again(self._state())
            if done or stuck or searched >= limit:
                return self._result(searched if done else limit, done, stuck)
            self._decide(step, random_steps)
            if ready and self._loss is None and all(member.motion.free for member in self.members):
                return self._result(limit, False, True)  # no group has a safe move, nor ever will
            if watch is None:
                begins = step < random_steps
                step += self._skipped((random_steps if begins else random_steps + limit) - step)
            for member in self.members:
                place = member.motion.place
                member.advance()
                self._count["moves"] += searched >= 0 and member.motion.place != place
            step += 1

    def _skipped(self, most: int) -> int:
        """How many steps, fewer than `most`, are skipped: robots only come nearer to where they go."""
        motions = [member.motion for member in self.members]
        if self._believes or self._loss is not None or any(motion.free for motion in motions):
            return 0
        steps = min(most, *(motion.left for motion in motions)) - 1
        if steps > 0:
            for member, motion in zip(self.members, motions, strict=True):
                member.motion = motion._replace(elapsed=motion.elapsed + steps, left=motion.left - steps)
        return steps

    def _repeats(self) -> bool:
        """Whether what follows depends on `_state` alone, once all search: nothing is drawn."""
        one_model = self._expected.planned(since=0) is self._expected.model  # not one for each time
        return self._believes and self._rules.deterministic and self._loss is None and one_model

    def _meet(self, step: int) -> None:
        """Who is connected now, and what they know together."""
        self._expected.begin(step)
        first = not self.groups
        places = [member.motion.place for member in self.members]
        if places != self._places or self._loss is not None:
            before, self._places = self.groups, places
            self.groups = self._networks(step, places)
            if self.groups != before:
                self._count["broken"] += sum(not _within(each, self.groups) for each in self._subgroups)
        if not self._believes:
            return
        motions = [member.motion for member in self.members]
        known = list(self.known)
        for group in self.groups:
            # Where everybody starts, everybody knows; but each group by itself.
            together = Knowledge(dict(enumerate(motions))) if first else self._learnt(group, motions)
            for robot in group:
                known[robot] = together
        self.known = known

    def _networks(self, step: int, places: Sequence[int]) -> list[tuple[int, ...]]:
        if self._loss is None:
            return networks(dict(enumerate(places)), self._hearing)
        near = self._hearing[np.ix_(places, places)]
        for one, other in combinations(range(len(places)), 2):
            together = _within((one, other), self.groups)
            if near[one, other] and not together and self._loss.misses(step, one, other):
                near[one, other] = near[other, one] = False
        return networks({robot: robot for robot in range(len(places))}, near)

    def _learnt(self, group: tuple[int, ...], motions: Sequence[Motion]) -> Knowledge:
        connected = {robot: motions[robot] for robot in group}
        absent = [robot for robot in range(len(motions)) if robot not in connected]
        heard = heard_by(self._hearing, connected.values())
        factors = []
        for before in {id(self.known[robot]): self.known[robot] for robot in group}.values():
            factor, outcomes = before.ticked(self._expected, self._ways, absent, heard, self._rules.miss)
            self._note(outcomes)
            factors.append(factor)
        together, outcomes = merged(factors, connected)
        self._note(outcomes)
        model = self._expected.model
        for robot in absent:
            self._count["beliefs"] += 1
            self._count["zero"] += mass_at(model, together.believed[robot], motions[robot].place) == 0
        return together

    def _note(self, outcomes: dict[int, Outcome]) -> None:
        for outcome in outcomes.values():
            self._outcomes[outcome] += 1

    def _decide(self, step: int, random_steps: int) -> None:
        members, before, now = self.members, self._subgroups, []
        same = self.groups == self._decided_in and step != random_steps
        if same and not any(member.motion.free for member in members):
            return  # everybody does what is decided, and nobody begins to search
        self._decided_in = self.groups
        for member in members:
            member.mind_own_business(step)
        for group in self.groups:
            places = {robot: members[robot].motion.place for robot in group if members[robot].searching(step)}
            for subgroup in networks(places, self._hearing):
                self._decide_together(step, subgroup, group, subgroup not in before)
                now.append(subgroup)
        self._subgroups = now

    def _decide_together(
        self, step: int, subgroup: tuple[int, ...], group: tuple[int, ...], changed: bool
    ) -> None:
        members = [self.members[robot] for robot in subgroup]
        motions = {robot: self.members[robot].motion for robot in subgroup}
        if not changed and not due(motions, changed):  # and what they do stays safe, as it was decided
            return
        memory = self._rules.memory
        persistent = self._rules.method == "persistent"
        plan = self._planner.decided(
            motions,
            self._sought(subgroup, group),
            self.known[subgroup[0]],
            {robot: self.members[robot].ages(memory) for robot in subgroup} if persistent else {},
            members[0].drawn(step),
            changed,
        )
        for robot, member in zip(subgroup, members, strict=True):
            member.motion = plan.motions[robot]
        self._note_plan(plan, len(subgroup))

    def _sought(self, subgroup: tuple[int, ...], group: tuple[int, ...]) -> tuple[int, ...]:
        key = subgroup, group
        if key not in self._sought_by:
            self._sought_by[key] = targets_of(subgroup, group, self._targets)
        return self._sought_by[key]

    def _note_plan(self, plan: Plan, members: int) -> None:
        self._count["turned"] += len(plan.turned)
        if members > 1 and plan.contact is not None:
            self._count["plans"] += 1
            self._count["proven"] += bool(plan.proven)

    def _state(self) -> bytes:
        """All that what follows depends on, where nothing is drawn."""
        # How long a robot has waited only matters as it begins to.
        motions = [
            m._replace(elapsed=min(m.elapsed, 1)) if m.free else m
            for m in (each.motion for each in self.members)
        ]
        digest = hashlib.blake2b(repr((motions, self.groups, self._subgroups)).encode(), digest_size=16)
        for group in self.groups:
            for belief in self.known[group[0]].believed.values():
                digest.update(belief.round(_DIGITS).tobytes())
        return digest.digest()

    def _result(self, steps: int, connected: bool, stuck: bool) -> Result:
        outcomes = {outcome.name: count for outcome, count in self._outcomes.items()}
        return Result(steps=steps, connected=connected, stuck=stuck, outcomes=outcomes, **self._count)


class _Recurrence:
    """Whether a state has been there before, in constant room (Brent 1980)."""

    def __init__(self) -> None:
        self._kept, self._since, self._power = b"", 0, 1

    def again(self, state: bytes) -> bool:
        if state == self._kept:
            return True
        self._since += 1
        if self._since == self._power:
            self._kept, self._since, self._power = state, 0, 2 * self._power
        return False


def _within(robots: Sequence[int], groups: Sequence[Sequence[int]]) -> bool:
    """Whether one group has them all."""
    return any(set(robots) <= set(group) for group in groups)
