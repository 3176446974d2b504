"""Voronoi coverage by robots that know of each other what the radio carries (Julian et al. 2009, sec. 4).

Each robot drives towards the centroid of its Voronoi cell, computed from the newest estimates it has; the
exchange of estimates is that of `dissemination`, whose params and log entries it shares, and whatever its
scheme is, the controller is the same. The world needs `motion.kind = "commanded"`.

Params besides: `area_m`, the rectangle to cover, from (0, 0); `gain` (0.5) [1/s]; `max_speed_mps` (4.0);
`control_s` (0.2), between commands; `density` ("uniform"): see `density`.

Logs `coverage` at every command: `goal_m`, the centroid, and `known`, how many others it reckons with.
"""

from __future__ import annotations

import asyncio

from agent.behaviours.coverage.controller import centroid, towards
from agent.behaviours.coverage.density import density_from
from agent.behaviours.dissemination.disseminate import Exchange, present
from agent.parameters import ParameterError, pair, positive
from agent.robot import Robot


async def cover(robot: Robot) -> None:
    """Exchange estimates and drive to where they say a robot is missing."""
    exchange = Exchange(robot)
    control = Control(robot, exchange)

    async def work() -> None:
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(exchange.run())
            tasks.create_task(control.run())

    try:
        await present(robot, work)
    finally:
        robot.body.stop()


class Control:
    """The coverage controller of one robot. Raises ParameterError for params that make no sense."""

    def __init__(self, robot: Robot, exchange: Exchange) -> None:
        params = robot.params
        self._robot = robot
        self._exchange = exchange
        self._area_m = pair(params, "area_m")
        if not min(self._area_m) > 0:
            raise ParameterError(f"params.area_m: must be greater than 0 both ways, is {list(self._area_m)}")
        try:
            self._density = density_from(params, self._area_m)
        except ValueError as error:
            raise ParameterError(str(error)) from None
        self._gain = positive(params, "gain", 0.5)
        self._max_speed = positive(params, "max_speed_mps", 4.0)
        self._period_s = positive(params, "control_s", 0.2)

    async def run(self) -> None:
        """Command the body at every step."""
        async for _ in self._robot.steps(self._period_s):
            self._exchange.hear()
            others = [(estimate.x_m, estimate.y_m) for estimate in self._exchange.table.others()]
            pose = self._robot.body.pose
            here = pose.x_m, pose.y_m
            goal = centroid(here, others, self._area_m, self._density)
            self._robot.body.drive(*towards(here, goal, self._gain, self._max_speed))
            self._robot.log("coverage", {"goal_m": goal, "known": len(others)})
