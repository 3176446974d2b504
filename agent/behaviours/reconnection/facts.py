"""What a group knows of robots that are absent, as it tells it to another group."""

from __future__ import annotations

from collections.abc import Collection

from agent.behaviours.reconnection.knowledge import Knowledge
from agent.behaviours.reconnection.messages import Fact, Facts, MessageError, decode_facts, encode
from agent.behaviours.reconnection.wire import WireError
from agent.behaviours.reconnection.wire import decode as decode_belief
from agent.behaviours.reconnection.wire import encode as encode_belief
from agent.behaviours.reconnection.wire import exact as encode_exactly


def told(known: Knowledge, *, exact: bool) -> bytes:
    """What is believed, to the last bit or rounded (`wire`)."""
    put = encode_exactly if exact else encode_belief
    facts = [Fact(robot, known.since[robot], put(belief)) for robot, belief in known.believed.items()]
    return encode(Facts(facts))


def longest(states: int, absent: int) -> int:
    """No less than the length of what `told` makes of beliefs of so many robots over these states [bytes]."""
    # A number for each state, or a level; a mark, or run, for each, twice at most; what is before them.
    return absent * (64 + 10 * states)


def understood(raw: bytes, states: int, absent: Collection[int]) -> Knowledge:
    """What another group believes, over so many states, of these, as far as it tells. Raises MessageError.

    Who still counts on a silent member does not take it for absent, as others may: so groups that meet need
    not tell of the same robots.
    """
    facts = decode_facts(raw).absent
    robots = [fact.robot for fact in facts]
    if robots != sorted(set(robots)):
        raise MessageError("tells of robots twice, or not in order")
    facts = [fact for fact in facts if fact.robot in absent]
    try:
        believed = {fact.robot: decode_belief(states, fact.belief) for fact in facts}
    except WireError as error:
        raise MessageError(str(error)) from None
    return Knowledge({}, believed, {fact.robot: fact.since for fact in facts})
