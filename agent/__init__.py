"""The robot: behaviours and what they see. `from agent import Robot` is all a behaviour needs."""

from agent.parameters import ParameterError
from agent.radio import Slot
from agent.robot import Observation, Robot, Step

__all__ = ["Observation", "ParameterError", "Robot", "Slot", "Step"]
