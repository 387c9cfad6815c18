"""The arm as a piecewise-affine system, for `armsim.methods.piecewise_affine`.

The equations of a mode are those of `dynamics.derivative` in a region, read off on the unit
vectors, in coordinates (y0, x, y1, y3, v, y5, y6) in which no digits cancel: the play of the gear
x = r_g y2 - y0, paper's eq. (13), is 1e-5 m where y0 reaches metres, and the preamplifier's output
before its limit, v = y4 + T_z y5, paper's eq. (11), is a few volts where y4 reaches thousands.

Where the paper's eq. (15) leaves the motion open, it is taken as follows. At y1 = 0 the arm sticks
while |f_g| ≤ F_0 and else starts in the direction of f_g. At y1 = ±v_s it passes; where both sides
lead away from it, a motion stays on its side, and one that starts there gains speed.
"""

import numpy as np
from numba import njit
from numba.np.unsafe.ndarray import to_fixed_tuple

from armsim.arm.dynamics import (
    STUCK,
    Constants,
    Region,
    derivative,
    gear_force,
    motor_voltage,
    preamplifier_output,
    region,
)
from armsim.methods import piecewise_affine

_compiled = njit(cache=True, error_model="numpy", nogil=True)

#: Guards: what switches the four parts of a `Region`.
GUARDS = Region("preamplifier", "power", "contact", "friction")  # type: ignore[arg-type]

_SIZE = len(Constants._fields)
_OFFSETS = tuple(Constants._fields.index(name) for name in ("V_L", "V_M", "H", "F_0"))
#: `Region.friction` by the speed's range: fast and slow backwards, at rest, slow and fast forwards
_FRICTION = (0, -1, STUCK, 1, 0)
_REST, _FAST = 2, 4


@_compiled
def _paper(z, k):
    """State y0 … y6 with pinion and rack in the place where y0 = 0: forces are the same there."""
    return 0.0, z[2], z[1] / k.r_g, z[3], z[4], z[5], z[6]


@_compiled
def _named(numbers):
    return Constants(*to_fixed_tuple(numbers, _SIZE))


@_compiled
def _branches(mode):
    """Return the region of a mode, and the range of speed in it."""
    speed = mode % 5
    return (
        Region(mode // 45 - 1, mode // 15 % 3 - 1, mode // 5 % 3 - 1, _FRICTION[speed]),
        speed,
    )


@_compiled
def _mode(where, speed):
    return ((where.preamplifier + 1) * 9 + (where.power + 1) * 3 + where.contact + 1) * 5 + speed


@_compiled
def _signals(z, where, k):
    """Values that decide on the branches: v_c, v_m before their limits, and the gear's force."""
    y = _paper(z, k)
    v_c = preamplifier_output(y, k, where.preamplifier)
    return (
        preamplifier_output(y, k, 0), motor_voltage(y, k, v_c, 0), gear_force(y, k, where.contact)
    )  # fmt: skip


@_compiled
def _between(branch, limit):
    """Range of a signal in a branch: beyond the limit on either side, or between."""
    if branch == 0:
        return -limit, limit
    return (limit, np.inf) if branch > 0 else (-np.inf, -limit)


@_compiled
def equations(mode, volts, numbers, out):
    """Fill in a mode's equations and guards; see `piecewise_affine.System`."""
    k, offsets = _named(numbers), numbers.copy()
    for i in _OFFSETS:
        offsets[i] = 0.0
    linear = _named(offsets)  # leaves no offset to subtract
    where, speed = _branches(mode)
    z = np.zeros(7)
    A, b, normal, lower, upper = out
    normal[:] = 0.0
    for j in range(1, 7):
        z[j] = 1.0
        _rates(derivative(_paper(z, k), 0.0, linear, where), k, A[:, j])
        normal[0, j], normal[1, j], force = _signals(z, where, linear)
        if speed == _REST:
            normal[3, j] = force
        z[j] = 0.0
    A[:, 0] = 0.0  # nothing depends on the position
    _rates(derivative(_paper(z, k), volts, k, where), k, b)
    _, v_m, force = _signals(z, where, k)
    lower[0], upper[0] = _between(where.preamplifier, k.V_L)
    lower[1], upper[1] = _between(where.power, k.V_M)
    lower[1] -= v_m
    upper[1] -= v_m
    normal[2, 1] = 1.0
    lower[2], upper[2] = _between(where.contact, k.H) if k.H > 0.0 else (-np.inf, np.inf)
    if speed == _REST:  # y1 = 0
        A[2, :] = A[:, 2] = normal[3, 2] = b[2] = 0.0
        lower[3], upper[3] = -k.F_0 - force, k.F_0 - force
        return
    normal[3, 2] = 1.0
    lower[3], upper[3] = _speeds(speed, k)


@_compiled
def _speeds(speed, k):
    """Range of y1."""
    if not _rubs(k):
        return -np.inf, np.inf
    if speed > _REST:
        return (k.v_s, np.inf) if speed == _FAST else (0.0, k.v_s)
    return (-np.inf, -k.v_s) if speed == 0 else (-k.v_s, 0.0)


@_compiled
def _rubs(k):
    return k.F_0 > 0.0 and k.v_s > 0.0


@_compiled
def _rates(slope, k, out):
    out[0], out[2], out[3], out[5], out[6] = slope[0], slope[1], slope[3], slope[5], slope[6]
    out[1] = k.r_g * slope[2] - slope[0]
    out[4] = slope[4]


@_compiled
def successor(mode, guard, side, z, numbers):
    """Return the mode after a guard has left on a side; see `piecewise_affine.System`."""
    if guard < 3:
        return mode + side * (45, 15, 5)[guard]
    where, speed = _branches(mode)
    if speed == _REST or speed + side == _REST:
        z[2] = 0.0
    if speed + side == _REST:
        k = _named(numbers)
        force = gear_force(_paper(z, k), k, where.contact)
        if side * force > k.F_0:  # too strong to be held: the arm turns round without rest
            return mode + 2 * side
    return mode + side


@_compiled
def start(y, numbers):
    """Return state and mode at a start `y` (7,), given in the paper's order y0 … y6."""
    k = _named(numbers)
    z = np.array(
        [y[0], k.r_g * y[2] - y[0], y[1], y[3], y[4], y[5], y[6]]
    )
    where = region(_paper(z, k), k)
    if k.H == 0.0:  # the two flanks are one
        where = Region(where.preamplifier, where.power, 1, where.friction)
    if not _rubs(k):
        return z, _mode(where, _FAST)
    if abs(z[2]) >= k.v_s:
        speed = _FAST if z[2] > 0.0 else 0
    elif where.friction != 0:
        speed = _REST + where.friction
    else:
        force = gear_force(_paper(z, k), k, where.contact)
        speed = _REST + (1 if force > k.F_0 else -1 if force < -k.F_0 else 0)
    return z, _mode(where, speed)


@_compiled
def run(numbers, starts, volts, t_end, y0, limits):
    """Run an axis from `y0` (7,) with `volts` (j,) from the times `starts` (j,) on.

    `numbers` are the values of `dynamics.Constants`. Returns a `piecewise_affine.Record`.
    """
    z, mode = start(y0, numbers)
    return piecewise_affine.solve(
        equations, successor, numbers, starts, volts, t_end, z, mode, (4, 16), limits
    )


@_compiled
def states(record, times, numbers):
    """States (7, n) of a run in the paper's order y0 … y6 at `times` (n,)."""
    k, y = _named(numbers), np.empty((7, times.size))
    piecewise_affine.sample(record, times, y)
    for j in range(times.size):
        x, y[1, j] = y[1, j], y[2, j]
        y[2, j] = (x + y[0, j]) / k.r_g
    return y
