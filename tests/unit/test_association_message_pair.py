"""Message pairs: what a robot sends, and what it makes of what others send."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

from agent.behaviours.association.message_pair import MessagePairs
from agent.clock import Clock
from agent.drivers.camera import Frame
from agent.outbox import Outbox
from agent.robot import Observation, Robot, Step
from channels.messages import Hello, Message, RadioPlan, WireFrame, decode_payload, encode_payload

PERIOD_NS = 500_000_000


class StoppedClock(Clock):
    """Always at the start."""

    @property
    def now_ns(self) -> int:
        return 0


def robot(params: Mapping[str, Any], colours: int = 4) -> tuple[Robot, Outbox]:
    outbox = Outbox()
    hello = Hello("me", "", dict(params), 7, 0, (0.0, 0.0, 0.0), RadioPlan(100, 0, None, 10), colours)
    return Robot(hello, outbox, StoppedClock()), outbox


def sent(params: Mapping[str, Any]) -> tuple[Any, list[tuple[int, int]]]:
    """Payload and lamp commands (at [ns], colour) of one pair."""
    sender, outbox = robot(params)
    MessagePairs(sender).send(Step(sender, 0, PERIOD_NS))
    (transmission,) = outbox.transmissions
    return decode_payload(transmission.payload), [(command.at_ns, command.colour) for command in outbox.lamp]


def test_a_pair_is_a_broadcast_and_a_flash_as_long_as_the_step() -> None:
    assert sent({"transmission_probability": 0.5}) == ({"id": "me"}, [(0, 1), (PERIOD_NS, 0)])


def test_a_coloured_pair_names_what_it_shows() -> None:
    payload, lamp = sent({"transmission_probability": 0.5, "colours": 4})
    assert payload["id"] == "me"
    assert lamp == [(0, payload["colour"]), (PERIOD_NS, 0)]
    assert 1 <= payload["colour"] <= 4


@pytest.mark.parametrize("colours", [1, 2, 4])
def test_colours_are_uniform(colours: int) -> None:
    sender, outbox = robot({"transmission_probability": 0.5, "colours": colours})
    pairs = MessagePairs(sender)
    for _ in range(800):
        pairs.send(Step(sender, 0, PERIOD_NS))
    shown = [command.colour for command in outbox.lamp if command.colour]
    assert set(shown) == set(range(1, colours + 1))
    expected = 800 / colours
    # Chi-squared with up to three degrees of freedom exceeds 16.3 once in a thousand times.
    assert sum((shown.count(c) - expected) ** 2 / expected for c in range(1, colours + 1)) < 16.3


@pytest.mark.parametrize(("probability", "least", "most"), [(0.0, 0, 0), (1.0, 1000, 1000), (0.3, 240, 360)])
def test_pairs_are_sent_with_the_probability(probability: float, least: int, most: int) -> None:
    sender, outbox = robot({"transmission_probability": probability})
    pairs = MessagePairs(sender)
    told = sum(pairs.send_at_random(Step(sender, 0, PERIOD_NS)) for _ in range(1000))
    assert told == len(outbox.transmissions)
    assert least <= told <= most


def observation() -> Observation:
    payloads = {
        "named": {"id": "named", "colour": 3},
        "plain": {"id": "plain"},
        "text": "colour",
        "nonsense": {"colour": "red"},
        "dark": {"colour": 0},
        "true": {"colour": True},
    }
    heard = [Message(0, sender, encode_payload(payload)) for sender, payload in payloads.items()]
    heard.append(Message(0, "garbage", b"\xc1"))
    visual = b"".join(number.to_bytes(4, "little") for number in (5, 6, 7))
    return Observation(heard, [Frame(WireFrame(0, visual, bytes(12), bytes(12), b"\x00\x03\x01"))])


def test_activity_with_colours_takes_whatever_comes() -> None:
    pairs = MessagePairs(robot({"transmission_probability": 0.5, "colours": 4})[0])
    others = dict.fromkeys(["plain", "text", "nonsense", "dark", "true", "garbage"], 1)
    assert pairs.activity(observation()) == ({"named": 3} | others, {5: 0, 6: 3, 7: 1})


def test_activity_without_colours() -> None:
    pairs = MessagePairs(robot({"transmission_probability": 0.5})[0])
    heard, lit = pairs.activity(observation())
    assert list(heard) == ["named", "plain", "text", "nonsense", "dark", "true", "garbage"]
    assert list(lit) == [6, 7]
