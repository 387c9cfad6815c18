"""Numerical methods for ordinary differential equations; nothing here knows of robots."""

from armsim.methods import tableaux
from armsim.methods.runge_kutta import IntegrationError, Solution, integrate

__all__ = ["IntegrationError", "Solution", "integrate", "tableaux"]
