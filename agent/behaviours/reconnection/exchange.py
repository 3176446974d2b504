"""Flooding within the steps of a team's common time: what one robot tells, its whole network hears."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable, Sequence

from agent.behaviours.reconnection import messages
from agent.behaviours.reconnection.messages import Decision, MessageError, Piece, Presence, Presences
from agent.behaviours.reconnection.model import Ways
from agent.behaviours.reconnection.pieces import PieceError, joined, least_limit, piece_of, split
from agent.parameters import ParameterError
from agent.robot import Robot
from channels.messages import Message
from channels.units import to_s


class Exchange:
    """One robot's side. What it hears for the first time it passes on at once.

    `ways`: of the environment; `repeats`: how often everything is told in each phase, for radios that lose;
    `payload`: the least that the radio must take [bytes], `least_payload`. Raises ParameterError where it
    does not.
    """

    def __init__(self, robot: Robot, ways: Ways, repeats: int, payload: int = 0) -> None:
        if robot.radio.max_payload_bytes < payload:
            raise ParameterError(
                f"radio.max_payload_bytes: {robot.radio.max_payload_bytes} are too few for what "
                f"{robot.team_size} robots tell each other; set {payload} or more"
            )
        self._robot, self._ways, self._repeats = robot, ways, repeats
        self._step = -1
        self._early: list[messages.Message] = []
        self.presences: dict[int, Presence] = {}
        """Who is there, at this step."""
        self._pieces: dict[int, dict[int, Piece]] = {}
        self.decisions: dict[int, Decision] = {}
        """By planner."""
        self._told: list[messages.Message] = []

    def begin(self, step: int) -> None:
        """Forget the step before; what others, whose clocks are ahead, have told of this one counts."""
        self._step = step
        self.presences, self._pieces, self.decisions = {}, {}, {}
        early, self._early = self._early, []
        self._told = []
        self._pass_on(early)

    def tell_presence(self, presence: Presence) -> None:
        """That the robot is there."""
        self._pass_on([Presences(self._step, [presence])])

    def tell_facts(self, blob: bytes) -> None:
        """What its group knows, encoded `Facts`."""
        room = self._robot.radio.max_payload_bytes - _PIECE_OVERHEAD
        pieces = split(blob, room)
        self._pass_on([Piece(self._step, self._robot.number, piece) for piece in pieces])

    def tell_decision(self, decision: Decision) -> None:
        """What its group does."""
        self._pass_on([decision])

    def facts(self, teller: int) -> bytes | None:
        """What a group knows, told by this member; None: not all of it has been heard."""
        try:
            return joined(piece.piece for piece in self._pieces.get(teller, {}).values())
        except PieceError:
            return None

    async def listen(self, until_ns: int) -> None:
        """Hear, and pass on, until an instant of the own clock; then begin to tell something else."""
        begin_ns = self._robot.now_ns
        for repeat in range(1, self._repeats):
            await self._hear(begin_ns + (until_ns - begin_ns) * repeat // self._repeats)
            for message in self._told:
                self._broadcast(message)
        await self._hear(until_ns)
        self._told = []

    async def _hear(self, until_ns: int) -> None:
        radio = self._robot.radio
        try:
            async with asyncio.timeout_at(to_s(until_ns)):
                while True:
                    first = await radio.receive()
                    self._take([first, *radio.received()])
        except TimeoutError:
            self._take(radio.received())

    def _take(self, heard: Sequence[Message]) -> None:
        found = []
        for message in heard:
            try:
                found.append(messages.decode(message.raw, self._robot.team_size, self._ways))
            except MessageError as error:
                self._robot.log("refused message", {"from": message.sender, "why": str(error)})
        self._pass_on(found)

    def _pass_on(self, found: Iterable[messages.Message]) -> None:
        """Note what is new, and tell it; all presences in one message."""
        presences: list[Presence] = []
        for message in found:
            if message.step == self._step + 1:
                self._early.append(message)
            elif message.step == self._step:
                if isinstance(message, Presences):
                    presences += self._new_presences(message)
                elif self._is_new(message):
                    self._told.append(message)
                    self._broadcast(message)
        if presences:
            together = Presences(self._step, presences)
            self._told.append(together)
            self._broadcast(together)

    def _new_presences(self, message: Presences) -> list[Presence]:
        new = [each for each in message.robots if each.number not in self.presences]
        self.presences |= {each.number: each for each in new}
        return new

    def _is_new(self, message: Piece | Decision) -> bool:
        if isinstance(message, Decision):
            return self.decisions.setdefault(message.planner, message) is message
        pieces = self._pieces.setdefault(message.teller, {})
        try:
            part, _, _ = piece_of(message.piece)
        except PieceError as error:
            self._robot.log("refused message", {"from": message.teller, "why": str(error)})
            return False
        return pieces.setdefault(part, message) is message

    def _broadcast(self, message: messages.Message) -> None:
        self._robot.radio.broadcast_bytes(messages.encode(message))


def least_payload(members: int, ways: Ways, blob: int = 0, oldest: int | None = None) -> int:
    """The least limit of a radio with which nothing that such a team tells is too long [bytes].

    `blob`: length of the longest `Facts` [bytes], 0 where none are told; `oldest`: see `messages.largest`.
    """
    pieces = least_limit(blob) + _PIECE_OVERHEAD if blob else 0
    return max(messages.largest(members, ways, oldest), pieces)


_PIECE_OVERHEAD = 16
"""What msgpack adds to a piece: tag, step, teller and the length, at most."""
