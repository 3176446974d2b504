"""Zenoh sessions as Heliograph opens them: no scouting, no time stamps, nothing shared, one thread.

The settings are measured ones: a single runtime thread halves the CPU time of an exchange; a link
that cannot be written to is waited for instead of being closed; a channel is never so short that
the runtime would have to stop reading.
"""

from __future__ import annotations

import json
import os
from typing import Any

ONE_RUNTIME_THREAD = (
    "(rx:(handover:app),acc:(handover:app),tx:(handover:app),net:(handover:app),app:(worker_threads:1))"
)
# Read once, when the first session of a process opens.
os.environ.setdefault("ZENOH_RUNTIME", ONE_RUNTIME_THREAD)

import zenoh  # noqa: E402  (after the environment is set)

CHANNEL_CAPACITY = 1_000_000
"""Samples a subscriber's channel can hold; memory is only taken as it fills."""

_COMMON: dict[str, Any] = {
    "timestamping": {"enabled": False},
    "transport": {
        "shared_memory": {"enabled": False},
        "link": {
            "tx": {
                "lease": 60_000,
                # microseconds; the default of 5 s closes the link to a robot halted in a debugger
                "queue": {"congestion_control": {"block": {"wait_before_close": 600_000_000}}},
            }
        },
    },
}
_NO_SCOUTING: dict[str, Any] = {"multicast": {"enabled": False}, "gossip": {"enabled": False}}


def _config(settings: dict[str, Any], user: str, password: str, **auth: str) -> zenoh.Config:
    transport = {
        **_COMMON["transport"],
        "auth": {"usrpwd": {"user": user, "password": password, **auth}},
    }
    return zenoh.Config.from_json5(json.dumps({**_COMMON, **settings, "transport": transport}))


def robot_config(endpoint: str, robot: str, password: str) -> zenoh.Config:
    """A client of the broker at `endpoint` (a Zenoh locator), known to it by name and password."""
    return _config(
        {
            "mode": "client",
            "connect": {
                "endpoints": [endpoint],
                "timeout_ms": 20_000,
                "exit_on_failure": True,
                "retry": {"period_init_ms": 20, "period_max_ms": 200},
            },
            "listen": {"endpoints": []},
            "scouting": _NO_SCOUTING,
        },
        robot,
        password,
    )


def broker_config(
    endpoint: str, password: str, password_file: str, access_control: dict[str, Any]
) -> zenoh.Config:
    """The router that the broker hosts, listening at `endpoint`; only users in the file get in."""
    return _config(
        {
            "mode": "router",
            "listen": {"endpoints": [endpoint], "exit_on_failure": True},
            "connect": {"endpoints": []},
            "scouting": {**_NO_SCOUTING, "delay": 0},
            "access_control": access_control,
        },
        "_broker",
        password,
        dictionary_file=password_file,
    )


def channel() -> zenoh.handlers.FifoChannel[zenoh.Sample]:
    """The handler of every subscriber: a blocking channel, cheaper than any callback."""
    return zenoh.handlers.FifoChannel(CHANNEL_CAPACITY)


def declare_publisher(session: zenoh.Session, key: str) -> zenoh.Publisher:
    """A publisher that never drops; one priority everywhere, since priorities overtake each other."""
    return session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
