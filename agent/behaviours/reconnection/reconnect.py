"""Robots that search for each other until all are one network (Vandermeulen et al.).

Time goes in steps of `step_s`, common to all. At the beginning of each, robots tell that they are there, and
thereby find out with whom they are connected (first phase); groups that have met tell each other what they
know (second phase); the lowest number of each group plans for it, and tells the others (third phase). Which
of these phases there are depends on what was heard. Then those at a vertex leave it, so as to arrive at the
neighbouring one shortly before the step at which they are expected there.

When the planner of a group dies, the next lowest number does its work, from the next step on. A member that
does not hear what was decided stays; at the next step the planner sees it, and turns back whom the team
would lose.

The world needs `graph` and `motion.kind = "commanded"`, fast enough for the ways. Params, steps and
probabilities as in `methods.Rules` and `member`: `method` ("semi-markov"); `travel_steps` (2.0) [1/m], steps
per metre of way; `random_steps` (50); `horizon` (12); `deterministic` (false); `memory` (10); `targets`
("all" or "upwards"); `holding` ("uniform" or "normal"); `miss` (0.0); `tasks` (0) and `task_steps` (10), the
longest; `half_steps` (0: others are cooperative); `exchange` ("exact" or "quantised", see `wire`);
`step_s` (1.0), `phase_s` (0.1); `repeats` (1), how often all is told in each phase; `patience` (0), for how
many steps a member that is not heard counts as being there; `log_beliefs_steps` (10; 0: never); `enough`, how
many robots are the whole team (0: all of them): less, but more than half, where some are to die.

Joint decisions of a group are enumerated, (degree + 1)^members of them: a team has 12 robots at most.

Logs at every step `reconnection`: `step`, `place`, `towards` (-1: nowhere), `network` (numbers), `searching`,
and `whole`: all (`enough`) have been heard, are one network, and search. Planners log `plan`: see
`methods.Plan`. The lowest number of a network logs `belief`: of each robot that is absent, its likely places;
and `merge`: whose beliefs were merged (`of`), how many of these were `heard`, of whom they were `wrong`, and
how (`belief.Outcome`). The lowest of those who were one network before logs `outcome`: of whom their beliefs
were `wrong`.
"""

from __future__ import annotations

from typing import Any

from agent.behaviours.reconnection import belief as beliefs
from agent.behaviours.reconnection import facts
from agent.behaviours.reconnection.baselines import Ages
from agent.behaviours.reconnection.belief import Outcome
from agent.behaviours.reconnection.exchange import Exchange, least_payload
from agent.behaviours.reconnection.knowledge import Expectation, Knowledge, heard_by, merged
from agent.behaviours.reconnection.messages import (
    MOST_STEPS,
    Course,
    Decision,
    MessageError,
    Presence,
    follows,
)
from agent.behaviours.reconnection.methods import Plan, Planner
from agent.behaviours.reconnection.model import Model, check_model
from agent.behaviours.reconnection.settings import (
    MOST_REPEATS,
    enough_of,
    expectation_of,
    graph_of,
    member_of,
    phase_ns_of,
    rules_of,
    step_s_of,
    ways_for,
)
from agent.behaviours.reconnection.team import TARGETS, Motion, moved, networks, targets_of
from agent.behaviours.reconnection.warm import search_a_little
from agent.parameters import ParameterError, choice, whole_number
from agent.robot import Robot, Step
from agent.warm_up import before_forks
from channels.graphs import hearing, starts

EXCHANGES = ("exact", "quantised")

ARRIVE_EARLY = 0.1
"""Which share of a step before the step's beginning a robot arrives: rounding must not make it late."""
THERE_M = 1e-3

before_forks(search_a_little)


async def reconnect(robot: Robot, expected: Expectation | None = None) -> None:
    """Wander, work, and search. `expected`: see `Reconnection`."""
    search = Reconnection(robot, expected)
    try:
        async for step in robot.steps(search.step_s):
            await search.take(step)
    finally:
        robot.body.stop()


class Reconnection:
    """The search of one robot. Raises ParameterError for params that make no sense.

    `expected`: how others are expected to move, the same for all robots, and over the ways that
    `ways_of(robot.graph, travel_steps)` has; None: as params say. Raises ValueError where it is of others.
    """

    def __init__(self, robot: Robot, expected: Expectation | None = None) -> None:
        params = robot.params
        self._robot = robot
        self._graph = graph = graph_of(robot)
        self.step_s = step_s_of(params)
        self._phase_ns = phase_ns_of(params, self.step_s)
        self._ways, self._hearing = ways_for(params, graph), hearing(graph)
        self._rules = rules_of(params)
        self._believes = self._rules.method == "semi-markov"
        self._targets = TARGETS[choice(params, "targets", tuple(TARGETS), "all")](robot.team_size)
        self._expected = expected or expectation_of(params, graph, self._ways, self._targets)
        check_model(self._expected.model, self._ways)
        self._planner = Planner(self._ways, self._hearing, self._expected, self._rules)
        self._member = member_of(robot, graph, self._ways)
        self._exact = choice(params, "exchange", EXCHANGES, "exact") == "exact"
        self._patience = whole_number(params, "patience", 0, least=0)
        self._log_every = whole_number(params, "log_beliefs_steps", 10, least=0)
        self._enough = enough_of(params, robot.team_size)
        self._exchange = Exchange(
            robot, self._ways, whole_number(params, "repeats", 1, most=MOST_REPEATS), self._payload()
        )
        at = starts(graph, robot.team_size)
        self._known = Knowledge({number: Motion(vertex) for number, vertex in enumerate(at)})
        self._network: dict[int, Presence] = {}
        self._missing: dict[int, int] = {}
        self._decided: dict[int, Course] = {}
        self._group: tuple[int, ...] = ()
        self._step = -1

    def _payload(self) -> int:
        """How many bytes the longest message of the team has."""
        absent = self._robot.team_size - 1
        blob = facts.longest(self._expected.model.states, absent) if self._believes else 0
        oldest = min(self._rules.memory, MOST_STEPS) if self._rules.method == "persistent" else None
        return least_payload(self._robot.team_size, self._ways, blob, oldest)

    async def take(self, step: Step) -> None:
        """One step."""
        for _ in range(step.index - max(self._step, 0)):
            self._member.advance()
        first, self._step = self._step < 0, step.index
        self._expected.begin(step.index)
        before = self._member.motion
        self._check_arrival(before)
        self._exchange.begin(step.index)
        self._exchange.tell_presence(self._presence())
        await self._exchange.listen(step.start_ns + self._phase_ns)
        self._network = self._connected()
        if self._believes and not first:
            await self._learn(step)
        self._log_beliefs()
        self._member.mind_own_business(step.index)
        await self._decide(step)
        self._drive(before, step)
        self._log_step()

    def _check_arrival(self, motion: Motion) -> None:
        if not motion.free or motion.elapsed:
            return
        x_m, y_m = self._graph.vertices[motion.place]
        pose = self._robot.body.pose
        if max(abs(x_m - pose.x_m), abs(y_m - pose.y_m)) > THERE_M:
            raise ParameterError(
                f"world.motion.max_speed_mps: {self._robot.id} comes too late to vertex {motion.place}; "
                "set more, or more params.travel_steps"
            )

    def _presence(self) -> Presence:
        robot, member = self._robot, self._member
        searching = member.searching(self._step)
        persistent = self._rules.method == "persistent" and searching
        ages = member.ages(self._rules.memory) if persistent else ()
        former = tuple(sorted(self._network)) or (robot.number,)
        return Presence(robot.number, Course(*member.motion), searching, former, ages)

    def _connected(self) -> dict[int, Presence]:
        """Who is there: those heard, and those given the benefit of the doubt."""
        heard = self._exchange.presences
        missing = {}
        for number, presence in self._network.items():
            count = self._missing.get(number, 0) + 1
            if number not in heard and count <= self._patience:
                # What it told was where it is, before the group decided where it goes.
                course = Course(*moved(self._decided.get(number, presence.course).motion()))
                heard[number] = Presence(number, course, presence.searching, presence.former)
                missing[number] = count
        self._missing = missing
        return {number: heard[number] for number in sorted(heard)}

    def _motions(self) -> dict[int, Motion]:
        return {number: presence.course.motion() for number, presence in self._network.items()}

    async def _learn(self, step: Step) -> None:
        """Observe, and merge with what others know that have been met."""
        connected = self._motions()
        absent = [number for number in range(self._robot.team_size) if number not in connected]
        heard = heard_by(self._hearing, connected.values())
        own, outcomes = self._known.ticked(self._expected, self._ways, absent, heard, self._rules.miss)
        factors = [own]
        tellers = self._tellers()
        if self._robot.number in tellers:
            self._log_outcomes(outcomes)
        if len(tellers) > 1:
            if self._robot.number in tellers:
                self._exchange.tell_facts(facts.told(own, exact=self._exact))
            await self._exchange.listen(step.start_ns + 2 * self._phase_ns)
            factors = [told for teller in tellers if (told := self._told(teller, absent)) is not None]
        known, disjoint = merged(factors or [own], connected)
        self._known = known.completed(own)
        if len(tellers) > 1:
            self._log_merge(tellers, len(factors), disjoint)

    def _tellers(self) -> list[int]:
        """The lowest number of each group that was connected before and is here now."""
        lowest: dict[tuple[int, ...], int] = {}
        for number, presence in self._network.items():
            if number not in self._missing:
                lowest.setdefault(presence.former, number)
        return list(lowest.values())

    def _told(self, teller: int, absent: list[int]) -> Knowledge | None:
        """What a group knows, as everybody decodes it; None where it was not heard, or makes no sense."""
        raw = self._exchange.facts(teller)
        if raw is None:
            return None
        try:
            return facts.understood(raw, self._expected.model.states, absent)
        except MessageError as error:
            self._robot.log("refused message", {"from": teller, "why": str(error)})
            return None

    async def _decide(self, step: Step) -> None:
        """Do what the group decides; its lowest number decides for it."""
        number, member = self._robot.number, self._member
        self._decided = {}
        if not member.searching(step.index):
            self._group = ()
            return
        places = {robot: each.course.place for robot, each in self._network.items() if each.searching}
        group = next(group for group in networks(places, self._hearing) if number in group)
        changed, self._group = group != self._group, group
        present = [robot for robot in group if robot not in self._missing]
        if present[0] == number:
            plan = self._planned(step.index, group, changed)
            member.motion = plan.motions[number]
            if len(group) == 1:
                return
            courses = {robot: Course(*motion) for robot, motion in plan.motions.items()}
            self._decided = courses
            self._exchange.tell_decision(Decision(step.index, number, courses))
        await self._exchange.listen(step.start_ns + 3 * self._phase_ns)
        decision = self._exchange.decisions.get(present[0])
        if decision is None or number not in decision.courses:
            return
        self._decided = decision.courses
        motion = decision.courses[number].motion()
        if follows(self._ways, member.motion, motion):
            member.motion = motion
        else:
            why = f"has robot {number} do what it cannot"
            self._robot.log("refused message", {"from": present[0], "why": why})

    def _planned(self, step: int, group: tuple[int, ...], changed: bool) -> Plan:
        motions = self._motions()
        plan = self._planner.decided(
            {robot: motions[robot] for robot in group},
            targets_of(group, self._network, self._targets),
            self._known,
            {robot: self._ages(robot) for robot in group},
            self._member.drawn(step),
            changed,
        )
        if plan.contact is not None or plan.turned:
            entry = {
                "step": step,
                "group": group,
                "contact": plan.contact,
                "proven": plan.proven,
                "nodes": plan.nodes,
                "turned": plan.turned,
            }
            self._robot.log("plan", entry)
        return plan

    def _ages(self, robot: int) -> Ages:
        """What a member told of where it has been; as if it had just been everywhere, where it did not."""
        presence = self._network[robot]
        start, end = self._ways.start[presence.course.place :][:2].tolist()
        return presence.ages if len(presence.ages) == end - start else (0,) * (end - start)

    def _drive(self, before: Motion, step: Step) -> None:
        """Set out, or turn round, so as to be there in time."""
        motion = self._member.motion
        if motion == before or motion.free:
            return
        x_m, y_m = self._graph.vertices[motion.towards]
        pose = self._robot.body.pose
        arrival_s = (step.index + motion.left - ARRIVE_EARLY) * self.step_s
        way_m = ((x_m - pose.x_m) ** 2 + (y_m - pose.y_m) ** 2) ** 0.5
        self._robot.body.go_to(x_m, y_m, way_m / (arrival_s - self._robot.now_s))

    def _log_step(self) -> None:
        motion = self._member.motion
        network = tuple(self._network)
        heard = [presence for number, presence in self._network.items() if number not in self._missing]
        whole = len(heard) >= self._enough and all(presence.searching for presence in heard)
        entry: dict[str, Any] = {
            "step": self._step,
            "place": motion.place,
            "towards": motion.towards,
            "network": network,
            "searching": self._member.searching(self._step),
            "whole": whole,
        }
        self._robot.log("reconnection", entry)

    def _log_outcomes(self, outcomes: dict[int, Outcome]) -> None:
        wrong = _unusual(outcomes)
        if wrong:
            self._robot.log("outcome", {"step": self._step, "wrong": wrong})

    def _log_merge(self, tellers: list[int], heard: int, outcomes: dict[int, Outcome]) -> None:
        if min(self._network) == self._robot.number:
            entry = {"step": self._step, "of": tellers, "heard": heard, "wrong": _unusual(outcomes)}
            self._robot.log("merge", entry)

    def _log_beliefs(self) -> None:
        due = self._believes and self._log_every > 0 and self._step % self._log_every == 0
        if not due or min(self._network) != self._robot.number:
            return
        model: Model = self._expected.model
        for robot, belief in self._known.believed.items():
            mass = beliefs.by_place(model, belief)
            places = [[int(place), float(f"{mass[place]:.6g}")] for place in mass.nonzero()[0]]
            self._robot.log("belief", {"step": self._step, "of": robot, "places": places})


def _unusual(outcomes: dict[int, Outcome]) -> list[tuple[int, str]]:
    return [(robot, outcome.name) for robot, outcome in outcomes.items() if outcome is not Outcome.usual]
