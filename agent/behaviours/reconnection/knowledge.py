"""What a robot, and everybody it is connected to, knows of where the others are.

The order in a step: everybody moves; each group that was connected before advances its beliefs and observes,
together with all it is connected to now, that the absent are not heard (`ticked`); then what such groups know
is merged, one factor for each (`merged`); those who are connected are known exactly.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from agent.behaviours.reconnection import belief as beliefs
from agent.behaviours.reconnection.belief import Outcome
from agent.behaviours.reconnection.mixture import aligned, blended, willingness
from agent.behaviours.reconnection.model import Model, Ways, standing, walk_model
from agent.behaviours.reconnection.team import Motion, sinks, way_between
from channels.graphs import Bools, Floats, Graph


class Expectation:
    """How others are expected to move: a model, or two for robots that may be cooperative or neutral.

    `half_steps`: after how many steps without contact a robot cooperates with probability 1/2 (`mixture`).
    `still`: robots that search for nobody, and from step `still_from` on stay at the vertex they are at or
    come to. Raises ValueError where two models need one, or are of different graphs.
    """

    def __init__(
        self,
        cooperative: Model,
        neutral: Model | None = None,
        half_steps: float = 0.0,
        *,
        still: Collection[int] = (),
        still_from: int = 0,
    ) -> None:
        self._half_steps = half_steps
        self._still, self._still_from = still, still_from
        self._step = 0
        self._blends: dict[int, Model] = {}
        self._neutral: Model | None = None
        self._cooperative = cooperative
        if neutral is not None:
            if not half_steps > 0:
                raise ValueError(f"half_steps: must be more than 0, is {half_steps}")
            self._cooperative, self._neutral = aligned(cooperative, neutral)
        self._standing = standing(self._cooperative) if still else self._cooperative

    def begin(self, step: int) -> None:
        """A new step, which all that is asked from now on is about."""
        self._step = step

    @property
    def model(self) -> Model:
        """What numbers the states."""
        return self._cooperative

    def stepped(
        self, heard: Bools, belief: Floats, miss: float, since: int, robot: int = -1
    ) -> tuple[Floats, Outcome]:
        """From the step before to this one, and not heard (Eq. 7); `since`: steps since the last contact."""
        # This step was decided at the one before: at `still_from` - 1 all still wandered.
        if robot in self._still and self._step > self._still_from:
            return beliefs.step(self._standing, heard, belief, miss)
        if self._neutral is None:
            return beliefs.step(self._cooperative, heard, belief, miss)
        c = willingness(since, self._half_steps)
        after = beliefs.advanced_mixture(self._cooperative, self._neutral, c, belief)
        return beliefs.observed(self._cooperative, heard, after, miss)

    def planned(self, since: int, robot: int = -1) -> Model:
        """One model to plan with: for two, blended by a c rounded to tenths, so that few are made."""
        # A plan is about the steps that follow, of which the first is decided now.
        if robot in self._still and self._step >= self._still_from:
            return self._standing
        if self._neutral is None:
            return self._cooperative
        tenths = round(10 * willingness(since, self._half_steps))
        if tenths not in self._blends:
            self._blends[tenths] = blended(self._cooperative, self._neutral, tenths / 10)
        return self._blends[tenths]


def expectation(
    graph: Graph,
    ways: Ways,
    targets: Sequence[Sequence[int]],
    *,
    holding: str = "uniform",
    random_steps: int = 0,
    tasks: int = 0,
    task_steps: int = 1,
    half_steps: float = 0.0,
) -> Expectation:
    """What a team expects of its members, as `member.Member` and `methods.Rules` have them move.

    They go to any neighbour; `half_steps` > 0: or they may be busy with tasks of up to `task_steps`,
    anywhere.
    Who searches for nobody (`targets`) stands after the random steps, unless it has tasks.
    """
    cooperative = walk_model(graph, ways, holding=holding)
    still = frozenset() if tasks else sinks(targets)
    if half_steps == 0:
        return Expectation(cooperative, still=still, still_from=random_steps)
    dwell = dict.fromkeys(range(len(graph.vertices)), np.full(task_steps, 1.0 / task_steps))
    neutral = walk_model(graph, ways, holding=holding, dwell=dwell)
    return Expectation(cooperative, neutral, half_steps, still=still, still_from=random_steps)


@dataclass
class Knowledge:
    """Where each other robot is: certain for those connected at the last step, else believed."""

    certain: dict[int, Motion]
    believed: dict[int, Floats] = field(default_factory=dict)
    since: dict[int, int] = field(default_factory=dict)
    """Steps since the last contact with those believed."""

    def vector(self, model: Model, ways: Ways, robot: int) -> Floats:
        """The belief of one robot: (S,)."""
        if robot in self.believed:
            return self.believed[robot]
        return point(model, ways, self.certain[robot])

    def ticked(
        self, expected: Expectation, ways: Ways, absent: Iterable[int], heard: Bools, miss: float
    ) -> tuple[Knowledge, dict[int, Outcome]]:
        """What is known of the absent one step later, at which they are not heard; what became of it.

        `heard`: (V,), the places that any of those connected hears.
        """
        after, outcomes = Knowledge({}), {}
        for robot in absent:
            since = self.since.get(robot, 0) + 1
            vector = self.vector(expected.model, ways, robot)
            after.believed[robot], outcomes[robot] = expected.stepped(heard, vector, miss, since, robot)
            after.since[robot] = since
        return after, outcomes

    def completed(self, other: Knowledge) -> Knowledge:
        """The same, and of robots that this says nothing of what another believes."""
        return Knowledge(self.certain, other.believed | self.believed, other.since | self.since)


def point(model: Model, ways: Ways, motion: Motion) -> Floats:
    """Certainty; a robot that turns back counts as one at the place that it returns to."""
    if motion.free:
        return beliefs.at_vertex(model, motion.place, motion.elapsed + 1)
    if motion.towards == motion.place or motion.elapsed == 0:
        return beliefs.at_vertex(model, motion.place)
    return beliefs.on_way(model, way_between(ways, motion.place, motion.towards), motion.elapsed)


def merged(
    factors: Sequence[Knowledge], connected: Mapping[int, Motion]
) -> tuple[Knowledge, dict[int, Outcome]]:
    """What groups that have met know together of the absent (sec. III.D), and of each other.

    Of each robot that any of them takes for absent; by those that do.
    """
    after, outcomes = Knowledge(dict(connected)), {}
    for robot in sorted({robot for factor in factors for robot in factor.believed}):
        telling = [factor for factor in factors if robot in factor.believed]
        each = [factor.believed[robot] for factor in telling]
        after.believed[robot], outcomes[robot] = (
            beliefs.merged(each) if len(each) > 1 else (each[0], Outcome.usual)
        )
        after.since[robot] = min(factor.since[robot] for factor in telling)
    return after, outcomes


def heard_by(hearing: Bools, motions: Iterable[Motion]) -> Bools:
    """The places that any of these robots hears: (V,)."""
    return beliefs.heard_from(hearing, [motion.place for motion in motions])
