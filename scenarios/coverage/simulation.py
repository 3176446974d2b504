"""A team that covers a square by what it hears, event by event (Julian et al. 2009, sec. 4).

Robots know their own true places and the others' last estimates; those never heard of do not exist for them,
and estimates are kept however old they are. Between control instants robots move straight on. Three kinds of
events, and in this order where they fall on one instant:

1. a slot ends: whoever is in range of its owner then has the packet;
2. all robots steer: the coverage controller, on each robot's own picture;
3. the next slot starts: its owner chooses what to send, and its packet is frozen.

Tables, selection and the law of motion are those that robots run; cells come from compiled code.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from itertools import count
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from agent.behaviours.coverage.controller import towards
from agent.behaviours.dissemination.distances import euclidean
from agent.behaviours.dissemination.estimates import Estimate, EstimateTable, News
from agent.behaviours.dissemination.selection import Selection, selection
from channels.units import airtime_ns, to_ns
from scenarios.coverage.kernels import centroids, lloyd_step
from scenarios.dissemination.parameters import Alpha, BitRate, Bits, NewEstimates, Order, Scheme, SlotLength

Floats = NDArray[np.float64]
Length = Annotated[float, Meta(gt=0, le=1e6)]

NS_PER_MS = 1_000_000


class CoverageParameters(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A team in a square, its radio, what it says and how it steers.

    The paper tells robots, alpha, bits, bit rate and m = 1, 3, 9 (own, location, flooding).
    """

    robots: Annotated[int, Meta(ge=1, le=100, description="robots, n")] = 9
    side: Annotated[Length, Meta(description="side of the square to cover [m]")] = 90.0
    range: Annotated[Length, Meta(description="how far a robot is heard [m]")] = 36.0
    m: SlotLength = 3
    scheme: Scheme = "location"
    alpha: Alpha = 1.0
    new_estimates: NewEstimates = "first"
    order: Order = "drawn"
    gain: Annotated[
        float, Meta(gt=0, le=1e3, description="speed per way to the centroid of the own cell [1/s]")
    ] = 0.5
    max_speed: Annotated[Length, Meta(description="speed limit [m/s]")] = 4.0
    start_box: Annotated[Length, Meta(description="side of the corner in which robots start [m]")] = 18.0
    duration: Annotated[float, Meta(gt=0, le=1e5, description="how long they have [s]")] = 240.0
    bit_rate: BitRate = 3000.0
    bits: Bits = 192
    control_period: Annotated[
        float, Meta(ge=0.001, le=1e4, description="time between two decisions where to go [s]")
    ] = 0.2
    sample_period: Annotated[
        float, Meta(ge=0.001, le=1e4, description="time between two looks at the cost [s]")
    ] = 1.0

    @property
    def slot_ns(self) -> int:
        """Length of a slot of m units."""
        return airtime_ns(self.m * self.bits, self.bit_rate)

    @property
    def times_ns(self) -> list[int]:
        """When the cost is looked at: every sample period from 0 on, and at the end."""
        end = to_ns(self.duration)
        return [*range(0, end, to_ns(self.sample_period)), end]


class Course(Struct, frozen=True):
    """One run."""

    costs: Floats
    """H at `times_ns`."""
    places: Floats
    """Where everybody is at the end; shape (n, 2)."""


def simulate_one(parameters: CoverageParameters, generator: np.random.Generator) -> Course:
    """One run. The starts and the drawn order are drawn first, and alike for all parameters but `robots`."""
    team = _Team(parameters, generator)
    costs = []
    for time_ns, event, number in _events(parameters):
        team.move_to(time_ns)
        if event == _END:
            team.deliver()
        elif event == _STEER:
            team.steer()
        elif event == _START:
            team.freeze(number)
        else:
            costs.append(lloyd_step(team.places, team.area)[1])
    return Course(np.array(costs), team.places)


_END, _STEER, _START, _LOOK = range(4)
_Event = tuple[int, int, int]
"""When [ns], what, and its number from 0 on. As they are sorted, they happen."""


def _events(parameters: CoverageParameters) -> Iterator[_Event]:
    """All events of a run."""
    end_ns = to_ns(parameters.duration)
    streams = [
        _regular(_START, parameters.slot_ns, 0),
        _regular(_END, parameters.slot_ns, parameters.slot_ns),
        _regular(_STEER, to_ns(parameters.control_period), 0),
        ((time_ns, _LOOK, number) for number, time_ns in enumerate(parameters.times_ns)),
    ]
    for event in heapq.merge(*streams):
        if event[0] > end_ns:
            return
        yield event


def _regular(event: int, period_ns: int, first_ns: int) -> Iterator[_Event]:
    for number in count():
        yield first_ns + number * period_ns, event, number


class _Team:
    """Everybody's place, knowledge and velocity, and the packet on the air."""

    def __init__(self, parameters: CoverageParameters, generator: np.random.Generator) -> None:
        n = parameters.robots
        self.area = np.array((parameters.side, parameters.side))
        self.places: Floats = generator.random((n, 2)) * parameters.start_box
        self._order = generator.permutation(n)
        self._frames, choices = generator.spawn(2)
        self._parameters = parameters
        self._now_ns = 0
        self._velocities = np.zeros((n, 2))
        self._tables = [EstimateTable(number, n) for number in range(n)]
        self._selections = [_selection(parameters, number, choices) for number in range(n)]
        self._pictures = np.full((n, n, 2), np.nan)
        if parameters.order == "fixed":
            self._order = np.arange(n)
        self._sender = 0
        self._packet: list[Estimate] = []

    def move_to(self, time_ns: int) -> None:
        """Straight on from the instant before."""
        self.places += self._velocities * ((time_ns - self._now_ns) / 1e9)
        self._now_ns = time_ns

    def steer(self) -> None:
        """Everybody decides where to go."""
        everybody = range(len(self.places))
        self._pictures[everybody, everybody] = self.places
        goals = centroids(self._pictures, self.area)
        gain, max_speed = self._parameters.gain, self._parameters.max_speed
        for number, (own, goal) in enumerate(zip(self.places.tolist(), goals.tolist(), strict=True)):
            self._velocities[number] = towards(own, goal, gain, max_speed)

    def freeze(self, slot: int) -> None:
        """The owner of this slot makes its packet."""
        n = len(self.places)
        if self._parameters.order == "drawn_each_frame" and slot % n == 0:
            self._order = self._frames.permutation(n)
        self._sender = sender = int(self._order[slot % n])
        table = self._tables[sender]
        x, y = self.places[sender].tolist()
        table.update_own(Estimate(sender, self._now_ns // NS_PER_MS, x, y, 0.0, 0.0))
        listed = table.listed()
        distances = euclidean(sender, listed)
        if self._parameters.new_estimates == "true-distance":
            distances = self._true_distances(sender).tolist()
        chosen = self._selections[sender].choose(self._parameters.m, distances, table.stamps())
        self._packet = [estimate for number in chosen if (estimate := listed[number]) is not None]

    def deliver(self) -> None:
        """Whoever is in range of the sender now has its packet."""
        hearing = np.flatnonzero(self._true_distances(self._sender) <= self._parameters.range)
        for receiver in hearing.tolist():
            for estimate in self._packet:
                self._take_in(receiver, estimate)

    def _take_in(self, receiver: int, estimate: Estimate) -> None:
        news = self._tables[receiver].receive(estimate)
        if news != News.nothing:
            self._pictures[receiver, estimate.number] = estimate.x_m, estimate.y_m
        if news == News.first:
            self._selections[receiver].heard_first(estimate.number)

    def _true_distances(self, number: int) -> Floats:
        """From one robot to all; shape (n,) [m]."""
        found: Floats = np.hypot(*(self.places - self.places[number]).T)
        return found


def _selection(parameters: CoverageParameters, number: int, generator: np.random.Generator) -> Selection:
    return selection(
        parameters.scheme,
        number,
        parameters.robots,
        alpha=parameters.alpha,
        new_estimates=parameters.new_estimates,
        generator=generator,
    )
