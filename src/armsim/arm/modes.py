"""The arm as a piecewise-affine system, for `armsim.exact.piecewise_affine`.

The matrices of a mode come from `dynamics.derivative` in a region, evaluated at the unit vectors.
The coordinates are (y0, x, y1, y3, y4, y5, y6). The difference x = r_g y2 - y0 between pinion and
rack, paper's eq. (13), is a state of its own. It is of the order of 1e-5 m and would lose digits
as a difference of positions near 1 m. No derivative depends on y0, which is a pure integral.

Where the paper's eq. (15) leaves the motion undefined, the following rules apply. At y1 = 0 the
arm sticks while |f_g| ≤ F_0 and otherwise moves in the direction of f_g. At y1 = ±v_s the motion
passes through. If both sides lead away from there, a motion stays on its side, and one that
starts there gains speed. If F_0 or v_s is zero, there is no static friction. If H = 0, the two
gear flanks coincide and have the branch +1.
"""

from typing import NamedTuple

import numpy as np

from armsim.arm import dynamics
from armsim.arm.dynamics import FAST, REST, Region, region_number, region_of_number
from armsim.arm.slave_control import Law, put_out
from armsim.exact import piecewise_affine
from armsim.exact.modal import compiled
from armsim.exact.piecewise_affine import Room

#: Four guards, the fields of `Region`; 2⁴ matrices, since A is independent of the branch signs.
GUARDS, MATRICES = 4, 16


@compiled
def _paper(z, k):
    """State y0 … y6 shifted to y0 = 0, since no derivative depends on the position."""
    return 0.0, z[2], z[1] / k.r_g, z[3], z[4], z[5], z[6]


@compiled
def _set_slope(slope, k, out):
    out[0], out[1] = slope[0], k.r_g * slope[2] - slope[0]
    out[2], out[3], out[4], out[5], out[6] = slope[1], slope[3], slope[4], slope[5], slope[6]


@compiled
def _signals(z, where, k):
    """Signals that determine the branches: v_c and v_m before limiting, and f_g."""
    y = _paper(z, k)
    v_c = dynamics.preamplifier_output(y, k, where.preamplifier)
    v_m = dynamics.motor_voltage(y, k, v_c, 0)
    return dynamics.preamplifier_output(y, k, 0), v_m, dynamics.gear_force(y, k, where.contact)


@compiled
def _range(branch, limit):
    """Range of a signal in a branch: between the limits, or beyond one of them."""
    edges = -np.inf, -limit, limit, np.inf
    return edges[branch + 1], edges[branch + 2]


@compiled
def _speed_range(speed, k):
    if k.F_0 == 0.0 or k.v_s == 0.0:
        return -np.inf, np.inf
    edges = -np.inf, -k.v_s, 0.0, 0.0, k.v_s, np.inf
    return edges[speed], edges[speed + 1]


@compiled
def equations(mode, volts, constants, out):
    """Fill in a mode; see `piecewise_affine.System`."""
    A, b, normal, lower, upper = out
    k, linear = constants
    where, speed = region_of_number(mode), mode % 5
    z, normal[:] = np.zeros(7), 0.0
    for j in range(7):
        z[j] = 1.0
        _set_slope(dynamics.derivative(_paper(z, k), 0.0, linear, where), k, A[:, j])
        normal[0, j], normal[1, j], normal[3, j] = _signals(z, where, linear)
        z[j] = 0.0
    _set_slope(dynamics.derivative(_paper(z, k), volts, k, where), k, b)
    _, v_m, f_g = _signals(z, where, k)
    normal[2, 1] = 1.0
    lower[0], upper[0] = _range(where.preamplifier, k.V_L)
    lower[1], upper[1] = _range(where.power, k.V_M)
    lower[2], upper[2] = _range(where.contact, k.H) if k.H > 0.0 else (-np.inf, np.inf)
    lower[1] -= v_m
    upper[1] -= v_m
    if speed == REST:  # y1 is zero and stays so
        A[2, :] = A[:, 2] = normal[3, 2] = b[2] = 0.0
        lower[3], upper[3] = -k.F_0 - f_g, k.F_0 - f_g
    else:
        normal[3, :] = 0.0
        normal[3, 2] = 1.0
        lower[3], upper[3] = _speed_range(speed, k)


@compiled
def successor(mode, guard, side, z, constants):
    """Return the mode that follows when a guard leaves; see `piecewise_affine.System`."""
    if guard < 3:
        return mode + side * (45, 15, 5)[guard]
    speed = mode % 5
    if speed == REST or speed + side == REST:
        z[2] = 0.0
    if speed + side == REST:
        k, _ = constants
        if side * dynamics.gear_force(_paper(z, k), k, region_of_number(mode).contact) > k.F_0:
            return mode + 2 * side  # f_g exceeds F_0, so the arm reverses without sticking
    return mode + side


class Inputs(NamedTuple):
    """Set velocity, either given or produced by the slave control unit."""

    volts: np.ndarray  #: (j,) from each time on; filled in by the unit, if any
    track: np.ndarray  #: (j, 2) position in m and speed in m/s at the unit's samples; or (0, 2)
    law: Law
    memory: np.ndarray  #: (MEMORY,) of the unit


@compiled
def hold(interval, z, inputs, constants):
    """Return the set velocity in an interval; see `piecewise_affine.solve`."""
    if inputs.track.shape[0] == 0:
        return inputs.volts[interval]
    r_g, track, law = constants[0].r_g, inputs.track, inputs.law
    angle = (z[1] + z[0]) / r_g
    return put_out(interval, angle, r_g, track, law, inputs.memory, inputs.volts)


@compiled
def start(y, k):
    """State and mode for the initial state `y` (7,), the paper's y0 … y6."""
    z = np.array([y[0], k.r_g * y[2] - y[0], y[1], y[3], y[4], y[5], y[6]])
    where = dynamics.region(_paper(z, k), k)
    if k.H == 0.0:
        where = Region(where.preamplifier, where.power, 1, where.friction)
    if k.F_0 == 0.0 or k.v_s == 0.0:
        return z, region_number(where, FAST)
    if where.friction != 0:
        return z, region_number(where, REST + where.friction)
    if z[2] != 0.0:
        return z, region_number(where, FAST if z[2] > 0.0 else 0)
    f_g = dynamics.gear_force(_paper(z, k), k, where.contact)
    return z, region_number(where, REST + dynamics.branch_of(f_g, k.F_0))


# --- called from Python -------------------------------------------------------------------------


@compiled
def run(constants, starts, inputs, t_end, y0, limits, room):
    """Run an axis from `y0` (7,) with the `inputs` that apply from the times `starts` (j,) on.

    `constants` are `dynamics.constants` with and without offsets; the rest is as in
    `piecewise_affine.solve`.
    """
    z, mode = start(y0, constants[0])
    return piecewise_affine.solve(
        equations, successor, hold, constants, starts, inputs, t_end, z, mode, limits, room
    )


def sample(r_g: float, room: Room, times: np.ndarray, y: np.ndarray) -> None:
    """Set the rows of `y` (n, 7) to the states y0 … y6 of a run at `times` (n,)."""
    piecewise_affine.sample(room, times, y)
    y[:, 1], y[:, 2] = y[:, 2], (y[:, 1] + y[:, 0]) / r_g
