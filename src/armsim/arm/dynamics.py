"""The seven state equations of one axis, paper's eq. (10)-(15), region by region.

Two limits together with backlash and static friction divide the state space into regions. In each
region the equations are affine in the state and the input. `region` returns the region of a state.
`derivative` evaluates the equations *of a given region* at any state, so the matrices of a region
come from the same code as a Runge-Kutta step.

Four misprints of the paper are corrected:

- eq. (10): the right-hand side of y5 is divided by T_p T_r; the paper multiplies.
- eq. (10): the motor's inertia is J_m; the text after it says "m".
- eq. (12): the forward gain is K_e; the text after it says "K_c".
- Table 5: the saturation current is K_i V_L; the paper says K_1 V_L.
"""

from collections import namedtuple
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from armsim.arm.parameters import AxisParameters
from armsim.machine_code import kept

# Fused multiply-add is allowed, as in C compilers; nothing is reordered.
_compiled = kept(fastmath={"contract"}, error_model="numpy")

#: Value of `Region.friction` while static friction holds the arm at rest.
STUCK = 2
#: `Region.friction` by range of speed: fast and slow backwards, at rest, slow and fast forwards.
FRICTION = (0, -1, STUCK, 1, 0)
REST, FAST = 2, 4


class Region(NamedTuple):
    """Active branch of each nonlinearity: -1 and +1 are the outer branches, 0 the middle one."""

    preamplifier: int  #: limit of v_c, eq. (11)
    power: int  #: limit of v_m, eq. (12)
    contact: int  #: flank of the gear tooth, eq. (14)
    friction: int  #: sign of the static friction, eq. (15), or `STUCK`


@_compiled
def region_number(where, speed=-1):
    """Return the number, from 0 to 134, of a region in a range of speed.

    Parameters
    ----------
    where : Region
    speed : int
        Place in `FRICTION`; left out, the one that `where` tells, forwards if it leaves both open.
    """
    if speed < 0:
        speed = (1, FAST, 3, REST)[where.friction + 1]
    return ((where.preamplifier + 1) * 9 + (where.power + 1) * 3 + where.contact + 1) * 5 + speed


@_compiled
def region_of_number(number):
    """Return the region with a number; what `region_number` makes of it, but for the speed."""
    sides = number // 45 - 1, number // 15 % 3 - 1, number // 5 % 3 - 1
    return Region(sides[0], sides[1], sides[2], FRICTION[number % 5])


#: Constants of the compiled equations, floats, with the divisions of `AxisParameters` done once.
Constants = namedtuple(
    "Constants",
    "B_a F_0 v_s per_M B_m r_g K_b per_J_m K_1 K_2_K_t T_p_plus_T_r per_T_p_T_r "
    "R_a per_L_a T_z V_L K_e per_K_i V_M H K_g b_g",
)


def constants(p: AxisParameters) -> Constants:
    """Return the constants that `rhs` takes as its last argument."""
    values = vars(p) | {f"per_{name}": 1 / getattr(p, name) for name in ("M", "J_m", "L_a", "K_i")}
    values |= {"K_2_K_t": p.K_2 * p.K_t, "T_p_plus_T_r": p.T_p + p.T_r}
    values["per_T_p_T_r"] = 1 / (p.T_p * p.T_r)
    return Constants(*[values[name] for name in Constants._fields])


def without_offsets(k: Constants) -> Constants:
    """Return constants with which `derivative` is linear in the state and the set velocity."""
    return k._replace(V_L=0.0, V_M=0.0, H=0.0, F_0=0.0)


# --- auxiliary variables, Table 2 -------------------------------------------------------------


@_compiled
def preamplifier_output(y, c, branch):
    """Controller preamplifier output v_c in volts, eq. (11)."""
    if branch == 0:
        return y[4] + c.T_z * y[5]
    return c.V_L if branch > 0 else -c.V_L


@_compiled
def motor_voltage(y, c, v_c, branch):
    """Motor voltage v_m in volts, eq. (12)."""
    if branch == 0:
        return c.K_e * (v_c - y[6] * c.per_K_i)
    return c.V_M if branch > 0 else -c.V_M


@_compiled
def gear_force(y, c, branch):
    """Force through the gear f_g in newtons, eq. (13) and (14)."""
    if branch == 0:
        return 0.0
    edge = branch * c.H
    return (c.r_g * y[2] - y[0] - edge) * c.K_g + (c.r_g * y[3] - y[1]) * c.b_g


@_compiled
def static_friction(y, c, f_g, branch):
    """Static friction F_s in newtons, eq. (15); while the arm sticks, the force that holds it."""
    if branch == STUCK:
        return f_g - c.B_a * y[1]
    return branch * c.F_0


# --- the state equations ----------------------------------------------------------------------


@_compiled
def branch_of(value, limit):
    """Return the branch of a signal: -1 below -limit, +1 above limit, 0 between."""
    if value > limit:
        return 1
    if value < -limit:
        return -1
    return 0


@_compiled
def region(y, c):
    """Return the region of a state; at rest F_s = 0, since sgn(0) = 0 in eq. (15)."""
    preamplifier = branch_of(preamplifier_output(y, c, 0), c.V_L)
    v_c = preamplifier_output(y, c, preamplifier)
    power = branch_of(motor_voltage(y, c, v_c, 0), c.V_M)
    contact = branch_of(c.r_g * y[2] - y[0], c.H)
    friction = branch_of(y[1], 0.0) if abs(y[1]) < c.v_s else 0
    return Region(preamplifier, power, contact, friction)


@_compiled
def auxiliary(y, c, where):
    """Return (f_g, F_s, v_m, v_c), Table 2, from the equations of the region `where`."""
    v_c = preamplifier_output(y, c, where.preamplifier)
    v_m = motor_voltage(y, c, v_c, where.power)
    f_g = gear_force(y, c, where.contact)
    return f_g, static_friction(y, c, f_g, where.friction), v_m, v_c


@_compiled
def derivative(y, set_velocity, c, where):
    """State derivative, eq. (10), from the equations of the region `where`.

    Parameters
    ----------
    y : sequence of 7 floats
        State y0 … y6 of Table 1.
    set_velocity : float
        Input U in volts.
    c : Constants
        From `constants`.
    where : Region
        Region whose equations are used, whether or not it contains `y`.

    Returns
    -------
    tuple of 7 floats
        Affine in `y` and `set_velocity`.
    """
    f_g, F_s, v_m, _ = auxiliary(y, c, where)
    return (
        y[1],
        (-c.B_a * y[1] - F_s + f_g) * c.per_M,
        y[3],
        (-c.B_m * y[3] - c.r_g * f_g + c.K_b * y[6]) * c.per_J_m,
        y[5],
        (-y[4] - c.T_p_plus_T_r * y[5] + c.K_1 * set_velocity - c.K_2_K_t * y[3]) * c.per_T_p_T_r,
        (v_m - c.R_a * y[6] - c.K_b * y[3]) * c.per_L_a,
    )


@_compiled
def rhs(t, y, set_velocity, c):
    """Right-hand side of eq. (10) with all limits, for `armsim.methods.integrate` and SciPy."""
    return derivative(y, set_velocity, c, region(y, c))


# --- evaluation along a run -------------------------------------------------------------------


@_compiled
def _auxiliary_columns(y, c, regions, out):
    for n in range(y.shape[1]):
        where = region(y[:, n], c)
        if regions.size > 0:
            where = Region(regions[n, 0], regions[n, 1], regions[n, 2], regions[n, 3])
        out[0, n], out[1, n], out[2, n], out[3, n] = auxiliary(y[:, n], c, where)


def auxiliary_variables(
    p: AxisParameters, y: np.ndarray, regions: Sequence[Region] = ()
) -> dict[str, np.ndarray]:
    """Auxiliary variables of Table 2 along a run.

    Parameters
    ----------
    p : AxisParameters
        Parameters of the axis.
    y : (7, n) array_like
        States.
    regions : sequence of n regions, optional
        Region of each state. By default it is computed from the state, which cannot detect
        sticking and may be wrong by rounding on a limit.

    Returns
    -------
    dict of (n,) arrays
        ``f_g`` and ``F_s`` in newtons, ``v_m`` and ``v_c`` in volts.
    """
    y = np.ascontiguousarray(y, dtype=float)
    out = np.empty((4, y.shape[1]))
    # For a list of tuples, np.array takes several times as long.
    rows = np.fromiter((part for where in regions for part in where), np.int64).reshape(-1, 4)
    _auxiliary_columns(y, constants(p), rows, out)
    return dict(zip(("f_g", "F_s", "v_m", "v_c"), out, strict=True))


def affine(p: AxisParameters, where: Sequence[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Matrices of a region, ẏ = A y + B U + c, from `derivative` at the unit vectors.

    Parameters
    ----------
    p : AxisParameters
        Parameters of the axis.
    where : Region
        The region.

    Returns
    -------
    A : (7, 7) array
    B : (7,) array
    c : (7,) array
    """
    k, where, origin = constants(p), Region(*where), np.zeros(7)
    linear = without_offsets(k)
    A = np.column_stack([derivative(unit, 0.0, linear, where) for unit in np.eye(7)])
    B = np.array(derivative(origin, 1.0, linear, where))
    return A, B, np.array(derivative(origin, 0.0, k, where))
