"""Numerical methods for ordinary differential equations; nothing here knows of robots."""

from armsim.checks import IntegrationError
from armsim.methods import tableaux
from armsim.methods.runge_kutta import Solution, integrate

__all__ = ["IntegrationError", "Solution", "integrate", "tableaux"]
