"""Numerical methods for ordinary differential equations, independent of the robot model."""

from armsim.checks import IntegrationError
from armsim.methods import tableaux
from armsim.methods.runge_kutta import Solution, integrate

__all__ = ["IntegrationError", "Solution", "integrate", "tableaux"]
