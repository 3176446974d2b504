"""The robot's own light."""

from __future__ import annotations

from operator import index
from typing import Protocol

from agent.clock import Clock
from agent.outbox import Outbox
from channels.messages import LampCommand


class Ending(Protocol):
    """Anything that ends at an instant of the own clock, such as a step."""

    end_ns: int


class Lamp:
    """Off (0) or one of `colours` colours (1, 2, ...)."""

    def __init__(self, colours: int, outbox: Outbox, clock: Clock) -> None:
        self.colours = colours
        self._outbox = outbox
        self._clock = clock

    def show(self, colour: int) -> None:
        """Show a colour, or 0 for off, until told otherwise.

        Raises ValueError for a colour it has not, TypeError for what is no integer, TooMuchAtOnce
        past 10 000 commands at one instant.
        """
        self._command(self._clock.now_ns, colour)

    def on(self) -> None:
        """Show colour 1."""
        self.show(1)

    def off(self) -> None:
        """Go dark."""
        self.show(0)

    def flash(self, step: Ending, colour: int = 1) -> None:
        """Be lit from now to the end of a step. Raises as `show`."""
        self._command(self._clock.now_ns, colour)
        self._command(step.end_ns, 0)

    def _command(self, at_ns: int, colour: int) -> None:
        colour = index(colour)
        if not 0 <= colour <= self.colours:
            raise ValueError(f"the lamp shows colours 0 to {self.colours}, not {colour}; see lamp.colours")
        self._outbox.command_lamp(LampCommand(at_ns, colour))
