"""What a robot has done since it last reported: the one place where its commands gather."""

from __future__ import annotations

from channels.messages import (
    MAX_ENTRIES,
    MAX_TRANSMISSIONS,
    LampCommand,
    LogEntry,
    MotionCommand,
    Transmission,
)


class TooMuchAtOnce(RuntimeError):
    """A behaviour did more at one instant than any robot could; usually a loop without `await`."""


class Outbox:
    """Lists of commands in the order they were given; emptied by every report."""

    __slots__ = ("entries", "lamp", "motion", "transmissions")

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget what has been reported."""
        self.transmissions: list[Transmission] = []
        self.lamp: list[LampCommand] = []
        self.motion: list[MotionCommand] = []
        self.entries: list[LogEntry] = []

    def transmit(self, transmission: Transmission) -> None:
        """Raises TooMuchAtOnce past the limit of messages at one instant."""
        if len(self.transmissions) >= MAX_TRANSMISSIONS:
            raise TooMuchAtOnce(
                f"more than {MAX_TRANSMISSIONS} radio messages at one instant; await between broadcasts"
            )
        self.transmissions.append(transmission)

    def command_lamp(self, command: LampCommand) -> None:
        """Raises TooMuchAtOnce past the limit of commands at one instant."""
        _limit(len(self.lamp), "lamp commands")
        self.lamp.append(command)

    def command_motion(self, command: MotionCommand) -> None:
        """Raises TooMuchAtOnce past the limit of commands at one instant."""
        _limit(len(self.motion), "motion commands")
        self.motion.append(command)

    def log(self, entry: LogEntry) -> None:
        """Raises TooMuchAtOnce past the limit of entries at one instant."""
        _limit(len(self.entries), "log entries")
        self.entries.append(entry)


def _limit(count: int, what: str) -> None:
    if count >= MAX_ENTRIES:
        raise TooMuchAtOnce(f"more than {MAX_ENTRIES} {what} at one instant; await between them")
