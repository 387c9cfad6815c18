"""One axis of the robot arm: parameters, state equations, linear model, simulation."""

from armsim.arm.linear import LinearAxis
from armsim.arm.parameters import AxisParameters
from armsim.arm.simulate import Trajectory, simulate, simulate_many

__all__ = ["AxisParameters", "LinearAxis", "Trajectory", "simulate", "simulate_many"]
