"""Scenarios that between them use every feature that could disturb determinism."""

from __future__ import annotations

BEHAVIOUR = '''
"""Uses everything a robot has: timers, radio and camera waits, random draws, threads, motion, lamp."""

import asyncio

import numpy as np
from numpy.random import default_rng

from agent import Robot
from channels.graphs import Graph, neighbours, vertices_at


async def busybody(robot: Robot) -> None:
    async with asyncio.TaskGroup() as group:
        group.create_task(talk(robot))
        group.create_task(listen(robot))
        group.create_task(look(robot))
        if robot.params["drives"]:
            group.create_task(drive(robot))


async def talk(robot: Robot) -> None:
    while True:
        await asyncio.sleep(float(robot.rng.uniform(0.05, 0.3)))
        accepted = robot.radio.broadcast({"id": robot.id, "at": robot.now_ns, "draw": robot.rng.random(3)})
        robot.lamp.show(int(robot.rng.integers(0, 3)))
        robot.log("talk", {"accepted": accepted, "pose": list(robot.body.pose)})


async def listen(robot: Robot) -> None:
    async for message in robot.radio:
        weight = await asyncio.to_thread(sum, message.payload["draw"])
        robot.log("heard", {"from": message.sender, "at": message.received_ns, "weight": weight})


async def look(robot: Robot) -> None:
    while True:
        try:
            async with asyncio.timeout(0.4):
                frame = await robot.camera.frame()
        except TimeoutError:
            robot.log("dark", {"at": robot.now_ns})
            continue
        robot.log("seen", {"sightings": [list(sighting) for sighting in frame.sightings]})


async def drive(robot: Robot) -> None:
    for step in range(100):
        x, y = robot.rng.uniform(0.0, 30.0, 2)
        robot.body.go_to(float(x), float(y), 1.5)
        await asyncio.sleep(0.7)
        if step % 3 == 2:
            robot.body.stop()
            await asyncio.sleep(0.2)


async def reporter(robot: Robot) -> None:
    """Says in every own slot what it has heard since the last, in as many bytes as there are."""
    heard = [0] * robot.team_size
    async for slot in robot.radio.slots():
        for message in robot.radio.received():
            heard[message.raw[0]] += 1
        counts = bytes(min(count, 255) for count in heard)
        robot.radio.broadcast_bytes((bytes([robot.number]) + counts)[: slot.bytes])
        robot.log("slot", {"frame": slot.frame, "bytes": slot.bytes, "at": robot.now_ns, "heard": heard})


def ladder(rungs, seed):
    """A ladder with one rung missing, which is drawn from the seed."""
    missing = int(default_rng(seed).integers(1, rungs))
    sides = [(2 * i + k, 2 * i + k + 2, 1.0) for i in range(rungs - 1) for k in (0, 1)]
    return Graph(
        vertices=tuple((1.0 + i, 1.0 + k) for i in range(rungs) for k in (0, 1)),
        edges=(*sides, *((2 * i, 2 * i + 1, 1.0) for i in range(rungs) if i != missing)),
        obstacles=((1.2, 1.2, 1.8, 1.8),),
    )


async def walker(robot: Robot) -> None:
    """Along edges of the world's graph at random; some moves are given up half-way."""
    ways = neighbours(robot.graph)
    (here,) = vertices_at(robot.graph.vertices, np.array([robot.body.pose[:2]])).tolist()
    while True:
        there, length = ways[here][int(robot.rng.integers(len(ways[here])))]
        robot.body.go_to(*robot.graph.vertices[there], length / 0.25)
        robot.radio.broadcast({"at": here, "to": there})
        await asyncio.sleep(0.1)
        if robot.rng.random() < 0.3:
            robot.body.go_to(*robot.graph.vertices[here], length / 0.25)
            there = here
        await asyncio.sleep(0.2 + float(robot.rng.random()) / 10)
        here = there
        heard = [message.sender for message in robot.radio.received()]
        robot.log("heard", {"at": here, "from": heard, "pose": list(robot.body.pose)})
'''

_COMMON = """
title = "everything at once"
behaviour = "my_robot.py:busybody"
robots = 7
seed = 1

[run]
duration_s = 3.0

[lamp]
colours = 2
"""

_CAMERA = """
[camera]
range_m = 14.0
field_of_view_deg = 200.0
frame_rate_hz = 7.0
miss = 0.1
lamp_miss = 0.1
lamp_false = 0.05
range_noise_m = 0.2
bearing_noise_deg = 1.0
"""

_REPORTERS = """
behaviour = "my_robot.py:reporter"
robots = 20
[run]
duration_s = 3.0
[world]
neighbours = 5
motion = {{ kind = "bounce", speed_mps = 0.3 }}
[radio]
range_m = 10.0
access = "tdma"
bit_rate_bps = 20000
collisions = true
tdma = {{ units = 1, unit_bits = 240, guard_s = 0.002, order = "{order}", reuse = "{reuse}" }}
[clock]
drift_ppm = 100
[[group]]
name = "flying"
robots = 8
altitude_m = 6.0
"""
"""Robots that speak whenever it is their turn and move slowly out of the neighbourhoods they had."""


def _association(behaviour: str, params: str, *, radio: str = "", camera: str = "", more: str = "") -> str:
    """A team that associates; the rest are lines for those tables, and whole tables."""
    return f"""
behaviour = "agent.behaviours.association.{behaviour}"
robots = 20
[run]
duration_s = 6.0
[world]
area_m = [30.0, 30.0]
motion = {{ kind = "bounce", speed_mps = 0.0 }}
[radio]
range_m = 14.0
{radio}
[camera]
range_m = 18.0
{camera}
[lamp]
colours = 3
[params]
step_s = 0.5
{params}
{more}
"""


def _reconnection(method: str, params: str = "", *, radio: str = "", more: str = "") -> str:
    """A team that searches for itself."""
    return f"""
behaviour = "agent.behaviours.reconnection.reconnect:reconnect"
score = "scenarios.reconnection.score:score"
robots = 4
[run]
duration_s = 30.4
[world]
placement = "graph"
motion = {{ kind = "commanded", max_speed_mps = 1.0 }}
[world.graph]
generator = "agent.behaviours.reconnection.environments:environment"
args = {{ kind = "delaunay", vertices = 30 }}
[radio]
link = "graph"
max_payload_bytes = 1500
{radio}
[params]
method = "{method}"
random_steps = 5
log_beliefs_steps = 3
{params}
{more}
"""


SCENARIOS = {
    "lossy-jittery-radio": _COMMON
    + _CAMERA
    + """
[world]
area_m = [30.0, 30.0]
[radio]
range_m = 18.0
loss = 0.2
jitter_s = 0.05
[params]
drives = false
""",
    "slow-radio-with-queue": _COMMON
    + _CAMERA
    + """
[world]
area_m = [30.0, 30.0]
motion = { kind = "bounce", speed_mps = 3.0 }
[radio]
range_m = 18.0
bit_rate_bps = 1500
queue = 2
[params]
drives = false
""",
    "tdma-with-drifting-clocks": _COMMON
    + _CAMERA
    + """
[world]
area_m = [30.0, 30.0]
[radio]
range_m = 18.0
access = "tdma"
bit_rate_bps = 50000
max_payload_bytes = 100
tdma = { slot_s = 0.02, guard_s = 0.001, order = "drawn" }
[clock]
drift_ppm = 500
offset_s = 0.01
[params]
drives = false
""",
    "collisions-without-slots": _COMMON
    + _CAMERA
    + """
[world]
area_m = [30.0, 30.0]
motion = { kind = "bounce", speed_mps = 3.0 }
[radio]
range_m = 14.0
bit_rate_bps = 20000
collisions = true
jitter_s = 0.002
[params]
drives = false
[[group]]
name = "flying"
share = 0.5
altitude_m = 8.0
""",
    "slots-of-units-drawn-each-frame-in-bursts": _COMMON
    + _CAMERA
    + """
[world]
area_m = [30.0, 30.0]
[radio]
range_m = 18.0
access = "tdma"
bit_rate_bps = 100000
overhead_bits = 64
loss = 0.05
collisions = true
bursts = { enter = 0.1, leave = 0.3, loss = 0.8 }
tdma = { units = 4, unit_bits = 192, guard_s = 0.004, order = "drawn_each_frame" }
[clock]
drift_ppm = 900
offset_s = 0.002
[params]
drives = false
""",
    "shared-slots-and-altitudes": _REPORTERS.format(reuse="distance_two", order="fixed"),
    "slots-shared-by-too-many": _REPORTERS.format(reuse="distance_one", order="drawn_each_frame"),
    "commanded-motion": _COMMON
    + _CAMERA
    + """
[world]
area_m = [30.0, 30.0]
motion = { kind = "commanded", max_speed_mps = 2.0 }
[radio]
range_m = 18.0
[params]
drives = true
""",
    "walking-along-a-graph": """
behaviour = "my_robot.py:walker"
robots = 5
[run]
duration_s = 12.0
[world]
placement = "graph"
motion = { kind = "commanded", max_speed_mps = 10.0 }
[world.graph]
generator = "my_robot.py:ladder"
args = { rungs = 6 }
scale_m = 1.5
[radio]
link = "graph"
bit_rate_bps = 10000
collisions = true
loss = 0.1
""",
    "links-of-a-graph-by-sight-in-shared-slots": """
behaviour = "my_robot.py:reporter"
robots = 9
[run]
duration_s = 3.0
[world]
placement = "graph"
[world.graph]
generator = "my_robot.py:ladder"
args = { rungs = 5 }
heard_m = 1.8
[radio]
link = "graph"
access = "tdma"
bit_rate_bps = 20000
tdma = { units = 1, unit_bits = 120, reuse = "distance_two" }
""",
    "obstacles-in-the-line-of-sight": _COMMON
    + _CAMERA
    + """
[world]
area_m = [30.0, 30.0]
motion = { kind = "bounce", speed_mps = 3.0 }
obstacles = [[5.0, 5.0, 9.0, 20.0], [14.0, 10.0, 16.0, 30.0], [20.0, 3.0, 26.0, 4.0]]
[radio]
range_m = 18.0
line_of_sight = true
bit_rate_bps = 50000
collisions = true
[params]
drives = false
""",
    "no-cameras": _COMMON
    + """
[world]
neighbours = 4
placement = "grid"
[radio]
range_m = 18.0
[params]
drives = false
""",
    "association-naive": _association("naive:associate", "ids = 20"),
    "association-logarithmic": _association("logarithmic:associate", "ids = 20"),
    "association-coloured-without-inclusion": _association(
        "stationary:associate", "transmission_probability = 0.4\ncolours = 3\nchannel_inclusion = false"
    ),
    "association-noisy": _association(
        "noisy:associate",
        "transmission_probability = 0.5\nestimate_rates = true\nnobody = 0.2",
        radio="loss = 0.1",
        camera="lamp_miss = 0.05\nlamp_false = 0.02",
    ),
    "association-mobile": _association(
        "stationary:beacon",
        "transmission_probability = 0.5\nroll_call = false\ndrop_time = 3\nwireless_exceeds_visual = true",
        more="""
[[group]]
name = "mobile"
share = 0.5
behaviour = "agent.behaviours.association.mobile:associate"
placement = "jittered_grid"
speed_mps = 6.0
""",
    ),
    "reconnection-by-beliefs": _reconnection("semi-markov"),
    "reconnection-by-rounded-beliefs-on-a-bad-radio": _reconnection(
        "semi-markov",
        'exchange = "quantised"\nrepeats = 2\npatience = 2\nmiss = 0.2\nhalf_steps = 20.0\ntasks = 1',
        radio="loss = 0.2\nbit_rate_bps = 1000000\nqueue = 100",
        more="[clock]\ndrift_ppm = 50",
    ),
    "reconnection-persistent": _reconnection("persistent", "travel_steps = 1.5"),
    "reconnection-at-random": _reconnection("random"),
}
