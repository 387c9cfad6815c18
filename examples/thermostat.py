"""A room with a thermostat, kept between two temperatures."""

from itertools import cycle, islice
from math import log

import numpy as np

from armsim.exact import System

OFF, ON = 0, 1


def equations(mode, outside, constants, out):
    loss, heating, low, high = constants  # 1/h, K/h, °C, °C
    out.A[0, 0] = -loss
    out.b[0] = loss * outside + heating * mode
    out.normal[0, 0] = 1.0  # the guard is the temperature itself
    if mode == ON:
        out.upper[0] = high
    else:
        out.lower[0] = low


def successor(mode, guard, side, z, constants):
    return OFF if mode == ON else ON


ROOM = System(equations, successor, guards=1, matrices=1)


def solve(start, hours, outside, constants):
    """Heat a room from a temperature `start`."""
    inputs = [(0.0, outside)]  # from time 0 on
    return ROOM.solve([start], ON, (0.0, hours), inputs, constants)


def switching_times(count, start, outside, constants):
    """Return the first switching times in h."""
    loss, heating, low, high = constants
    warm = outside + heating / loss  # the final value with the heating on
    first = log((warm - start) / (warm - high)) / loss
    cooling = log((high - outside) / (low - outside)) / loss
    heating_up = log((warm - low) / (warm - high)) / loss
    phases = islice(cycle((cooling, heating_up)), count - 1)
    return first + np.cumsum([0.0, *phases])
