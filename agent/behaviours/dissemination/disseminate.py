"""Location-based dissemination of state estimates over TDMA (Julian et al. 2009).

In each of its slots a robot broadcasts its own state and as many estimates of others as fit beside it:
m = bytes of the slot / 24. Which they are is up to the scheme. The radio needs `access = "tdma"`.

Params, all optional: `scheme` ("location"), `alpha` (1.0), `new_estimates` ("first"): see `selection`;
`distance` ("euclidean"), `link_range_m` for "graph": see `distances`; `deployment_m`: everybody's true
place by number, for new_estimates = "true-distance"; `origin_deg` ([0.0, 0.0]): latitude and longitude of
the world's (0, 0); `joins_s` (0) and `leaves_s` (never): when the robot begins and when it ends.

Logs `dissemination` in every own slot: `frame`, `sent` (numbers, in order), `stamps_ms` (one per robot by
number, of what is known as the slot begins; null: unknown), `complete`: whether all are known; `joined`,
when it does so late; and `refused packet` with what was wrong with one that is none.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Sequence

from agent.behaviours.dissemination.distances import DISTANCES, distance_function
from agent.behaviours.dissemination.estimates import Estimate, EstimateTable, News
from agent.behaviours.dissemination.geodesy import TangentPlane
from agent.behaviours.dissemination.selection import NEW_ESTIMATES, SCHEMES, selection
from agent.behaviours.dissemination.wire import ESTIMATE_BYTES, PacketError, Wire
from agent.parameters import ParameterError, choice, not_negative, pair, pairs, positive
from agent.radio import Slot
from agent.robot import Robot

NS_PER_MS = 1_000_000


async def disseminate(robot: Robot) -> None:
    """Take part in the exchange of estimates, from `joins_s` to `leaves_s`."""
    exchange = Exchange(robot)
    await present(robot, exchange.run)


class Exchange:
    """One robot's table of estimates, fed by its radio and spoken in its slots.

    Raises ParameterError for params that make no sense, and `speak` for slots that do not hold enough.
    """

    def __init__(self, robot: Robot) -> None:
        params = robot.params
        self._robot = robot
        self.table = EstimateTable(robot.number, robot.team_size)
        self._scheme = choice(params, "scheme", SCHEMES, "location")
        link_range_m = positive(params, "link_range_m") if "link_range_m" in params else None
        try:
            plane = TangentPlane(pair(params, "origin_deg", (0.0, 0.0)))
            self._distances = distance_function(
                choice(params, "distance", DISTANCES, "euclidean"), link_range_m
            )
            self._selection = selection(
                self._scheme,
                robot.number,
                robot.team_size,
                alpha=not_negative(params, "alpha", 1.0),
                new_estimates=choice(params, "new_estimates", NEW_ESTIMATES, "first"),
                generator=robot.rng,
            )
        except ValueError as error:
            raise _of_params(error) from None
        self._wire = Wire(plane, robot.team_size)
        self._deployment = self._true_places()

    async def run(self) -> None:
        """Speak in every own slot."""
        async for slot in self._robot.radio.slots():
            self.hear()
            self.speak(slot)

    def hear(self) -> None:
        """Take in everything that has arrived."""
        for message in self._robot.radio.received():
            try:
                estimates = self._wire.unpack(message.raw)
            except PacketError as error:
                self._robot.log("refused packet", {"from": message.sender, "why": str(error)})
                continue
            for estimate in estimates:
                if self.table.receive(estimate) is News.first:
                    self._selection.heard_first(estimate.number)

    def speak(self, slot: Slot) -> None:
        """Broadcast what the scheme chooses, as it is known now. Raises ParameterError for short slots."""
        m = slot.bytes // ESTIMATE_BYTES
        if m < 1:
            raise ParameterError(
                f"radio.tdma: a slot holds {slot.bytes} bytes and an estimate has {ESTIMATE_BYTES}; set "
                f"units = 1 or more of unit_bits = {8 * ESTIMATE_BYTES}"
            )
        if self._scheme == "flooding" and m < self._robot.team_size:
            raise ParameterError(
                f"radio.tdma.units: flooding sends everything, so a slot must hold {self._robot.team_size} "
                f"estimates, not {m}; set units = {self._robot.team_size}, or another params.scheme"
            )
        self.table.update_own(self.state())
        stamps = self.table.stamps()
        chosen = self._selection.choose(m, self._known_distances(), stamps)
        estimates = [estimate for number in chosen if (estimate := self.table[number]) is not None]
        self._robot.radio.broadcast_bytes(self._wire.pack(estimates))
        entry = {"frame": slot.frame, "sent": chosen, "stamps_ms": stamps, "complete": self.table.complete}
        self._robot.log("dissemination", entry)

    def state(self) -> Estimate:
        """The robot's own state now."""
        robot, pose = self._robot, self._robot.body.pose
        now_ms = robot.now_ns // NS_PER_MS
        altitude_m = robot.body.altitude_m
        return Estimate(robot.number, now_ms, pose.x_m, pose.y_m, altitude_m, pose.heading_rad)

    def _known_distances(self) -> Sequence[float | None]:
        known = self.table.listed() if self._deployment is None else self._deployment
        return self._distances(self._robot.number, known)

    def _true_places(self) -> list[Estimate] | None:
        """Where everybody is, where the robot is told; needed where what is unknown has a distance."""
        params, team = self._robot.params, self._robot.team_size
        if params.get("new_estimates") != "true-distance":
            return None
        if params.get("distance") == "euclidean-3d":
            raise ParameterError(
                "params.distance: the true distances of true-distance are flat; use euclidean or graph"
            )
        places = pairs(params, "deployment_m", team)
        return [Estimate(number, 0, x, y, 0.0, 0.0) for number, (x, y) in enumerate(places)]


async def present(robot: Robot, work: Callable[[], Awaitable[None]]) -> None:
    """Work from `params.joins_s` to `params.leaves_s`, by the own clock; before, the radio is not heard."""
    joins_s = not_negative(robot.params, "joins_s", 0.0)
    leaves_s = positive(robot.params, "leaves_s") if "leaves_s" in robot.params else None
    if joins_s > robot.now_s:
        await asyncio.sleep(joins_s - robot.now_s)
        robot.radio.received()
        robot.log("joined", {})
    try:
        async with asyncio.timeout_at(leaves_s) as presence:
            await work()
    except TimeoutError:
        if not presence.expired():
            raise


def _of_params(error: ValueError) -> ParameterError:
    """The same, with the key as the scenario has it."""
    text = str(error)
    return ParameterError(text if text.startswith("params.") else f"params.{text}")
