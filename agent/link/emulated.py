"""A robot process connected to the emulator: grants come in over Zenoh, reports go out."""

from __future__ import annotations

from pathlib import Path

import zenoh

from agent.host import RobotHost
from agent.link.session import channel, declare_publisher, robot_config
from agent.loading import BehaviourError, load_behaviour
from channels.keys import to_broker, to_robot
from channels.messages import (
    PROTOCOL,
    Hello,
    Ready,
    Report,
    decode_hello,
    encode,
)


def run_robot(endpoint: str, run: str, robot: str, password: str, folder: Path | None) -> None:
    """Be one robot until the run is over. Opens the process's only Zenoh session."""
    with zenoh.open(robot_config(endpoint, robot, password)) as session:
        subscriber = session.declare_subscriber(to_robot(run, robot), channel())
        publisher = declare_publisher(session, to_broker(run, robot))
        # Sent after the declaration on the same link, so whoever has this can reach us.
        publisher.put(encode(Ready(PROTOCOL)))
        hello = decode_hello(subscriber.recv().payload.to_bytes())
        host = _host(hello, folder, publisher)
        if host is not None:
            _serve(host, subscriber, publisher)


def _host(hello: Hello, folder: Path | None, publisher: zenoh.Publisher) -> RobotHost | None:
    try:
        behaviour = load_behaviour(hello.behaviour, folder)
    except BehaviourError as error:
        publisher.put(encode(Report(0, None, ended=str(error))))
        return None
    host = RobotHost(hello, behaviour)
    publisher.put(encode(Report(0, None)))
    return host


def _serve(
    host: RobotHost,
    subscriber: zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]],
    publisher: zenoh.Publisher,
) -> None:
    receive, send, exchange = subscriber.recv, publisher.put, host.exchange
    while (report := exchange(receive().payload.to_bytes())) is not None:
        send(report)
