"""What searching robots tell each other by radio, as msgpack arrays.

Within each step of the team's common time, messages are flooded: whoever hears something for the first time
passes it on at once, so that it reaches everybody in the network. `Presences` first; where groups have met,
what each of them knows (`Piece`, of `Facts`); and what the planner of a group has decided (`Decision`).
"""

from __future__ import annotations

from typing import Annotated, TypeAlias

from msgspec import Meta, Struct, msgpack

from agent.behaviours.reconnection.model import Ways
from agent.behaviours.reconnection.team import Motion, departed, turned_back
from channels.graphs import MOST_VERTICES

MOST_MEMBERS = 62
"""Compiled code keeps sets of members in the bits of one number."""
MOST_STEPS = 2**31 - 1

Number: TypeAlias = Annotated[int, Meta(ge=0, lt=MOST_MEMBERS)]
Vertex: TypeAlias = Annotated[int, Meta(ge=0, lt=MOST_VERTICES)]
Towards: TypeAlias = Annotated[int, Meta(ge=-1, lt=MOST_VERTICES)]
Count: TypeAlias = Annotated[int, Meta(ge=0, le=MOST_STEPS)]


class Course(Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """A `team.Motion` on its way."""

    place: Vertex
    towards: Towards
    elapsed: Count
    left: Count

    def motion(self) -> Motion:
        """As members compute with it."""
        return Motion(self.place, self.towards, self.elapsed, self.left)


class Presence(Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """One robot, at one step."""

    number: Number
    course: Course
    searching: bool
    """Whether it has nothing else to do."""
    former: Annotated[tuple[Number, ...], Meta(max_length=MOST_MEMBERS)]
    """Whom it was connected to at the step before, itself included: those share what it knows."""
    ages: Annotated[tuple[Count, ...], Meta(max_length=MOST_VERTICES)] = ()
    """For "persistent": see `baselines.Visits.ages`."""


class Presences(Struct, frozen=True, array_like=True, forbid_unknown_fields=True, tag="p"):
    """Who is there."""

    step: Count
    robots: Annotated[list[Presence], Meta(max_length=MOST_MEMBERS)]


class Piece(Struct, frozen=True, array_like=True, forbid_unknown_fields=True, tag="k"):
    """A piece of what a group knows, told by its lowest number: `pieces`, of `Facts`."""

    step: Count
    teller: Number
    piece: bytes


class Decision(Struct, frozen=True, array_like=True, forbid_unknown_fields=True, tag="d"):
    """What a group does from now on, as decided by its lowest number."""

    step: Count
    planner: Number
    courses: Annotated[dict[Number, Course], Meta(max_length=MOST_MEMBERS)]


class Fact(Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """What a group believes of one robot."""

    robot: Number
    since: Count
    """Steps since the last contact."""
    belief: bytes
    """As of `wire.encode` or `wire.exact`."""


class Facts(Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """What a group knows of all that are absent, after this step's observation."""

    absent: Annotated[list[Fact], Meta(max_length=MOST_MEMBERS)]


Message: TypeAlias = Presences | Piece | Decision

encode = msgpack.Encoder().encode
_messages = msgpack.Decoder(Presences | Piece | Decision)
_facts = msgpack.Decoder(Facts)


def largest(members: int, ways: Ways, oldest: int | None = None) -> int:
    """Length of the longest `Presences` or `Decision` that a team of so many can tell [bytes].

    `oldest`: the highest of `ages`, where there are any.
    """
    everybody = tuple(range(members))
    degrees = [end - start for start, end in zip(ways.start, ways.start[1:], strict=False)]
    ages = () if oldest is None else (oldest,) * int(max(degrees))
    vertex = len(degrees) - 1
    course = Course(vertex, vertex, MOST_STEPS, MOST_STEPS)
    presences = Presences(
        MOST_STEPS, [Presence(number, course, True, everybody, ages) for number in everybody]
    )
    decision = Decision(MOST_STEPS, everybody[-1], dict.fromkeys(everybody, course))
    return max(len(encode(presences)), len(encode(decision)))


class MessageError(ValueError):
    """What nobody of the team can have sent."""


def decode(raw: bytes, members: int, ways: Ways) -> Message:
    """A message of a team of so many, in an environment of these ways. Raises MessageError."""
    try:
        message: Message = _messages.decode(raw)
    except ValueError as error:  # msgspec's errors, and that of text that is no UTF-8
        raise MessageError(str(error)) from None
    if isinstance(message, Presences):
        numbers = [number for each in message.robots for number in (each.number, *each.former)]
        courses = [each.course for each in message.robots]
    elif isinstance(message, Piece):
        numbers, courses = [message.teller], []
    else:
        numbers, courses = [message.planner, *message.courses], list(message.courses.values())
    if any(number >= members for number in numbers):
        raise MessageError(f"names robot {max(numbers)} of a team of {members}")
    for course in courses:
        _check_course(course, ways)
    return message


def _check_course(course: Course, ways: Ways) -> None:
    """Raises MessageError for a motion that no robot can be in."""
    place, towards, vertices = course.place, course.towards, len(ways.start) - 1
    if max(place, towards) >= vertices:
        raise MessageError(f"names vertex {max(place, towards)} of {vertices}")
    if (towards >= 0) != (course.left > 0):
        raise MessageError("has a robot that is on the way to nowhere, or has no way left")
    if towards < 0:
        return
    steps = ways.steps[ways.start[place] : ways.start[place + 1]]
    if towards == place:
        fits = course.left <= course.elapsed and course.left + course.elapsed <= 2 * int(steps.max(initial=0))
    else:
        here = ways.head[ways.start[place] : ways.start[place + 1]] == towards
        fits = course.left + course.elapsed - 1 in steps[here].tolist()
    if not fits:
        raise MessageError(f"has a robot on a way from vertex {place} to {towards} that there is not")


def follows(ways: Ways, motion: Motion, decided: Motion) -> bool:
    """Whether a robot in this motion can do what has been decided: go on, turn back, or set out."""
    if decided in (motion, turned_back(motion)):
        return True
    sets_out = motion.free and not decided.free and decided.towards != motion.place
    return sets_out and decided.place == motion.place and decided == departed(ways, motion, decided.towards)


def decode_facts(raw: bytes) -> Facts:
    """What a group knows. Raises MessageError."""
    try:
        facts: Facts = _facts.decode(raw)
    except ValueError as error:  # msgspec's errors, and that of text that is no UTF-8
        raise MessageError(str(error)) from None
    return facts
