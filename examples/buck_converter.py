"""A buck converter with pulse-width modulation, switched by a clock."""

import numpy as np
from scipy.linalg import expm

from armsim.exact import System

OFF, ON = 0, 1


def equations(mode, supply, constants, out):
    L, C, R, period, duty = constants  # H, F, Ω, s, 1
    out.A[0, 1] = -1.0 / L  # current in the coil
    out.A[1, 0], out.A[1, 1] = 1.0 / C, -1.0 / (R * C)  # voltage at the load
    out.b[0] = supply * mode / L
    out.b[2] = 1.0  # the clock
    out.normal[0, 2] = 1.0  # is the guard
    out.upper[0] = duty * period if mode == ON else period


def successor(mode, guard, side, z, constants):
    if mode == ON:
        return OFF
    z[2] = 0.0  # a new period
    return ON


CONVERTER = System(equations, successor, guards=1, matrices=1)


def solve(periods, supply, constants):
    """Switch the converter on, without current and voltage."""
    t_span, inputs = (0.0, periods * constants[3]), [(0.0, supply)]
    return CONVERTER.solve([0.0, 0.0, 0.0], ON, t_span, inputs, constants)


def after_periods(count, supply, constants):
    """Return i and v after 0 … `count` periods, and in steady state."""
    L, C, R, period, duty = constants
    A = np.array([[0.0, -1.0 / L], [1.0 / C, -1.0 / (R * C)]])
    on, off = expm(A * duty * period), expm(A * (1 - duty) * period)
    settled = [supply / R, supply]  # with the transistor on for ever
    gain = off @ (settled - on @ settled)  # of a period that begins at zero
    steady = np.linalg.solve(np.eye(2) - off @ on, gain)
    powers = [np.linalg.matrix_power(off @ on, n) for n in range(count + 1)]
    return np.transpose([steady - power @ steady for power in powers]), steady
