"""What has to hold between the world's graph, its obstacles, and the rest of a scenario."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from channels.graphs import Graph, Rectangle, in_sight, starts, vertices_at
from emulator.errors import InvalidError
from emulator.graphs import graph_of
from emulator.placement import Vector
from emulator.scenario import BounceMotion, Settings, team, team_ids


def check_link(settings: Settings) -> None:
    """Raises InvalidError where the radio's link model lacks what it needs."""
    radio, world = settings.radio, settings.world
    if radio.link == "disc":
        if radio.range_m is None:
            why = "missing key radio.range_m: must be a number of metres greater than 0"
            raise InvalidError("radio.range_m", why, names_key=True)
        return
    if world.graph is None:
        raise InvalidError("radio.link", 'is "graph", but the world has none; add [world.graph]')
    if radio.line_of_sight:
        raise InvalidError(
            "radio.line_of_sight",
            'goes with radio.link = "disc"; leave it out: with world.graph.heard_m, too, nobody is heard '
            "through an obstacle",
        )
    if isinstance(world.motion, BounceMotion):
        raise InvalidError(
            "radio.link",
            'is "graph", but robots that bounce stand at no vertex; set world.motion.kind to "commanded"',
        )


def check_obstacles(obstacles: Sequence[Rectangle]) -> None:
    """Raises InvalidError for a rectangle that is none."""
    for number, (x0, y0, x1, y1) in enumerate(obstacles):
        if not (x0 < x1 and y0 < y1):
            corners = ", ".join(f"{corner:.12g}" for corner in (x0, y0, x1, y1))
            why = f"must be [x0, y0, x1, y1] with x0 < x1 and y0 < y1, is [{corners}]"
            raise InvalidError(f"world.obstacles[{number}]", why)


def check_sight(graph: Graph, obstacles: Sequence[Rectangle]) -> None:
    """Raises InvalidError for an obstacle that holds vertices: nobody sees out of it, nor within it.

    `graph` in metres, with obstacles of its own; `obstacles`: those of the world.
    """
    points = np.array(graph.vertices)
    for key, rectangles in (("world.obstacles", obstacles), ("world.graph.obstacles", graph.obstacles)):
        x0, y0, x1, y1 = np.array(rectangles).reshape(-1, 4).T
        holds = np.zeros(len(rectangles), dtype=bool)
        for x, y in graph.vertices:
            # As `channels.graphs.in_sight` has it: at a side one still sees. It would take far longer here.
            holds |= (x0 < x) & (x < x1) & (y0 < y) & (y < y1)
        if holds.any():
            number = int(holds.argmax())
            held = np.flatnonzero(~in_sight(points, points, [rectangles[number]])).tolist()
            raise InvalidError(
                f"{key}[{number}]",
                f"holds {_vertices(held)} of world.graph, from where nobody elsewhere is heard; move it, "
                f"or leave {'this vertex' if len(held) == 1 else 'these vertices'} out",
            )


def _vertices(numbers: Sequence[int]) -> str:
    """The first of them by number, of many the others by how many there are."""
    if len(numbers) == 1:
        return f"vertex {numbers[0]}"
    if len(numbers) > 3:
        return f"vertices {numbers[0]}, {numbers[1]} and {len(numbers) - 2} more"
    return f"vertices {', '.join(map(str, numbers[:-1]))} and {numbers[-1]}"


def check_world_graph(settings: Settings, area_m: Vector) -> None:
    """Raises InvalidError where the area does not hold the graph, or the graph not the team."""
    check_obstacles(settings.world.obstacles)
    graph = graph_of(settings.world.graph)
    if graph is not None:
        x, y = np.max(graph.vertices, axis=0).tolist()
        if x > area_m[0] or y > area_m[1]:
            raise InvalidError(
                "world.area_m",
                f"[{area_m[0]:.12g}, {area_m[1]:.12g}] does not hold world.graph, which reaches to "
                f"[{x:.12g}, {y:.12g}]; leave it out, or enlarge it",
            )
        if settings.radio.line_of_sight:
            check_sight(graph, settings.world.obstacles)
    wanted = {"world.placement": settings.world.placement}
    wanted |= {
        f"group.{group.name}.placement": group.placement
        for group in settings.group
        if group.placement is not None
    }
    for key in (key for key, placement in wanted.items() if placement == "graph"):
        if graph is None:
            raise InvalidError(key, 'is "graph", but the world has none; add [world.graph]')
        try:
            starts(graph, len(team_ids(settings)))
        except ValueError as error:
            why = str(error)
            if why.startswith("starts: "):
                raise InvalidError("world.graph.starts", why.removeprefix("starts: ")) from None
            raise InvalidError(key, f"{why}; take fewer, or a larger graph") from None


def check_starts(settings: Settings) -> None:
    """Raises InvalidError where a robot's radio is bound to the graph, and the robot at no vertex of it."""
    graph = graph_of(settings.world.graph)
    if settings.radio.link != "graph" or graph is None:
        return
    specs = team(settings)
    places = vertices_at(graph.vertices, np.array([spec.position_m for spec in specs], dtype=np.float64))
    for spec, place in zip(specs, places.tolist(), strict=True):
        if place < 0:
            x, y = spec.position_m
            own = any(robot.id == spec.id and robot.position_m is not None for robot in settings.robot)
            remedy = "move it to one" if own else 'set world.placement = "graph"'
            raise InvalidError(
                f"robot.{spec.id}.position_m" if own else "world.placement",
                f'radio.link = "graph" needs robots that start at vertices; {spec.id} does so at '
                f"[{x:.12g}, {y:.12g}], where none is; {remedy}",
            )
