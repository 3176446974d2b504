"""Who may say what to whom: Zenoh's access control for one run.

A router passes messages from client to client by itself, which would be a way round the medium.
Therefore everything is denied but: robot a publishes on its own tx key, subscribes to its own rx
key, and is sent what the broker publishes there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from channels.keys import from_all_robots, to_broker, to_robot


def access_control(run: str, robots: Sequence[str]) -> dict[str, Any]:
    """The `access_control` section of the broker's Zenoh configuration."""
    rules: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    for robot in robots:
        own = _rules(run, robot)
        rules += own
        policies.append({"id": robot, "rules": [rule["id"] for rule in own], "subjects": [robot]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": robot, "usernames": [robot]} for robot in robots],
        "policies": policies,
    }


def _rules(run: str, robot: str) -> list[dict[str, Any]]:
    tx, rx = to_broker(run, robot), to_robot(run, robot)
    return [
        _allow(f"{robot}-reports", "ingress", "put", tx),
        _allow(f"{robot}-listens", "ingress", "declare_subscriber", rx),
        _allow(f"{robot}-is-granted", "egress", "put", rx),
        # it must learn that the broker listens, or its client would not even send
        _allow(f"{robot}-finds-broker", "egress", "declare_subscriber", tx, from_all_robots(run)),
    ]


def _allow(name: str, flow: str, message: str, *keys: str) -> dict[str, Any]:
    return {
        "id": name,
        "permission": "allow",
        "flows": [flow],
        "messages": [message],
        "key_exprs": list(keys),
    }
