"""One axis of the robot arm: parameters, state equations, linear model, simulation."""

from armsim.arm.linear import LinearAxis
from armsim.arm.parameters import AxisParameters
from armsim.arm.simulate import Trajectory, simulate, simulate_many
from armsim.arm.slave_control import SlaveControl, Track

__all__ = [
    "AxisParameters",
    "LinearAxis",
    "SlaveControl",
    "Track",
    "Trajectory",
    "simulate",
    "simulate_many",
]
