"""A block on a moving belt, held by a spring: it sticks and slips."""

from itertools import cycle, islice
from math import atan, pi, sqrt

import numpy as np

from armsim.exact import System

STICKS, SLIPS = 0, 1


def equations(mode, u, constants, out):
    mass, stiffness, belt, holds, drags = constants  # kg, N/m, m/s, N, N
    if mode == STICKS:
        out.b[0] = belt
        out.normal[0, 0] = stiffness  # the guard is the force of the spring
        out.lower[0], out.upper[0] = -holds, holds
    else:
        out.A[0, 1] = 1.0
        out.A[1, 0], out.b[1] = -stiffness / mass, drags / mass
        out.normal[0, 1] = 1.0  # the guard is the speed
        out.upper[0] = belt


def successor(mode, guard, side, z, constants):
    return SLIPS if mode == STICKS else STICKS


BLOCK = System(equations, successor, guards=1, matrices=2)


def solve(t_end, constants):
    """Put the block on the belt with the spring relaxed."""
    start = [0.0, constants[2]]  # at the speed of the belt
    return BLOCK.solve(start, STICKS, (0.0, t_end), constants=constants)


def switching_times(count, constants):
    """Return the first times in s at which slipping starts or stops."""
    mass, stiffness, belt, holds, drags = constants
    rate, stretch = sqrt(stiffness / mass), (holds - drags) / stiffness
    slip = 2 * (pi - atan(rate * stretch / belt)) / rate
    phases = islice(cycle((slip, 2 * stretch / belt)), count - 1)
    return holds / (stiffness * belt) + np.cumsum([0.0, *phases])
