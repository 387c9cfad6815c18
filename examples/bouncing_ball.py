"""A bouncing ball that comes to rest."""

import numpy as np

from armsim.exact import System

FLIES, RESTS = 0, 1


def equations(mode, gravity, constants, out):
    if mode == FLIES:  # at rest nothing changes, and there is no guard
        out.A[0, 1] = 1.0
        out.b[1] = -gravity
        out.normal[0, 0] = 1.0  # the guard is the height
        out.lower[0] = 0.0


def successor(mode, guard, side, z, constants):
    restitution, slowest = constants
    z[1] = -restitution * z[1]
    if z[1] >= slowest:
        return FLIES
    z[:] = 0.0
    return RESTS


BALL = System(equations, successor, guards=1, matrices=2)


def solve(height, t_end, gravity, constants):
    """Drop the ball."""
    inputs = [(0.0, gravity)]
    return BALL.solve([height, 0.0], FLIES, (0.0, t_end), inputs, constants)


def impacts(height, gravity, constants):
    """Return times in s of all impacts, and speeds in m/s before them."""
    restitution, slowest = constants
    fall = np.sqrt(2 * height / gravity)
    count = 1 + int(np.log(slowest / (gravity * fall)) / np.log(restitution))
    speeds = gravity * fall * restitution ** np.arange(count)
    return fall + np.cumsum([0.0, *(2 * speeds[1:] / gravity)]), speeds
