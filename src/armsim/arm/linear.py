"""The reduced fourth-order linear system, paper's eq. (16), and its step response in closed form.

Without backlash, static friction and limits, with a stiff gear and large K_e, the power stage is a
current source y6 = K_i v_c, and motor and arm move as one body of inertia J and friction B. The
velocity loop is then of third order, and the position is the integral of the velocity.

The module also analyses the linear equations of the seven-state model within one region: their
eigenvalues, their oscillations, and steady motion.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from math import inf, nan, pi, sqrt
from typing import Any

import numpy as np

from armsim.arm import response
from armsim.arm.dynamics import Region, affine
from armsim.arm.parameters import AxisParameters
from armsim.checks import checked_number, reals

#: Region of steady forward motion, with no limit active, teeth engaged and no static friction.
ENGAGED = Region(preamplifier=0, power=0, contact=1, friction=0)
#: Changes of an axis that leave no play, no static friction and no limit in reach.
UNLIMITED = {"H": 0.0, "F_0": 0.0, "V_L": 1e9, "V_M": 1e9}
_ZERO = 1e-6  # 1/s; smaller eigenvalues are the zeros of the positions, up to rounding


@dataclass(frozen=True)
class LinearAxis:
    """Reduced linear model of an axis, paper's eq. (16).

    Parameters
    ----------
    parameters : AxisParameters
        Parameters of the full model, `K_1` included.
    """

    parameters: AxisParameters

    @property
    def J(self) -> float:
        """Inertia of motor and arm, referred to the motor shaft, kg m²."""
        return self.parameters.J_m + self.parameters.r_g**2 * self.parameters.M

    @property
    def B(self) -> float:
        """Viscous friction of motor and arm, referred to the motor shaft, N m s/rad."""
        return self.parameters.B_m + self.parameters.r_g**2 * self.parameters.B_a

    def state_space(self) -> tuple[np.ndarray, np.ndarray]:
        """Matrices of ẋ = A x + B U for x = (y2, y3, y4, y5).

        Returns
        -------
        A : (4, 4) array
        B : (4,) array
        """
        p, T2 = self.parameters, self.parameters.T_p * self.parameters.T_r
        torque = p.K_b * p.K_i / self.J
        motor = [0, -self.B / self.J, torque, torque * p.T_z]
        lags = [0, -p.K_2 * p.K_t / T2, -1 / T2, -(p.T_p + p.T_r) / T2]
        A = np.array([[0, 1, 0, 0], motor, [0, 0, 0, 1], lags])
        return A, np.array([0, 0, 0, p.K_1 / T2])

    @cached_property
    def transfer_function(self) -> tuple[np.ndarray, np.ndarray]:
        """Arm velocity over set velocity, y1(s)/U(s), as (numerator, denominator).

        Coefficients in falling powers of s, as in `scipy.signal.TransferFunction`.
        """
        p = self.parameters
        lead, gain = np.array([p.T_z, 1.0]), p.K_i * p.K_b
        lags = np.polymul([p.T_p, 1.0], [p.T_r, 1.0])
        loop = np.polymul([self.J, self.B], lags)
        return p.r_g * p.K_1 * gain * lead, np.polyadd(loop, p.K_2 * p.K_t * gain * lead)

    def step_response(self, set_velocity: float = 10.0) -> "StepResponse":
        """Response from rest to a step of the set velocity.

        Parameters
        ----------
        set_velocity : float
            Height of the step in volts.

        Raises
        ------
        TypeError, ValueError
            If `set_velocity` is not a finite number, if two poles of the loop nearly coincide,
            which makes the partial fractions ill-conditioned, or if a pole is 0, so that the
            velocity has no final value.
        """
        set_velocity = checked_number("set_velocity", set_velocity)
        numerator, denominator = self.transfer_function
        if denominator[-1] == 0:
            raise ValueError("K_2 = B_m = B_a = 0: the velocity grows without end; change one")
        poles = np.roots(denominator)
        gaps = np.abs(poles - np.roll(poles, 1))  # of three poles, these are all pairs
        if gaps.min() < 1e-7 * np.abs(poles).max():
            raise ValueError(f"poles {poles} nearly coincide: ill-conditioned; change T_p a little")
        slope = np.polyder(denominator)
        residues = set_velocity * np.polyval(numerator, poles) / (poles * np.polyval(slope, poles))
        final = set_velocity * numerator[-1] / denominator[-1]
        return StepResponse(self, poles, residues, final)


@dataclass(frozen=True, eq=False)
class StepResponse:
    """Step response as a sum of exponentials: y1(t) = final + Σ residue exp(pole t)."""

    axis: LinearAxis = field(repr=False)
    poles: np.ndarray  #: (3,) complex, 1/s
    residues: np.ndarray  #: (3,) complex, m/s
    final: float  #: steady-state velocity, m/s

    def velocity(self, t: np.ndarray | float) -> np.ndarray:
        """Arm velocity y1 in m/s at the times `t` in seconds."""
        return self.final + self._modes(np.exp, self.residues, t)

    def position(self, t: np.ndarray | float) -> np.ndarray:
        """Arm position y0 in m, the integral of the velocity."""
        return self.final * reals("t", t) + self._modes(np.expm1, self.residues / self.poles, t)

    def current(self, t: np.ndarray | float) -> np.ndarray:
        """Motor current y6 in A, from J ω̇ + B ω = K_b y6 with ω = y1/r_g."""
        p, J, B = self.axis.parameters, self.axis.J, self.axis.B
        modes = self._modes(np.exp, (J * self.poles + B) * self.residues, t)
        return (B * self.final + modes) / (p.K_b * p.r_g)

    def settling_time(self, criterion: float = 0.02) -> float:
        """Time in s after which the velocity stays within `criterion` times its final value.

        Raises
        ------
        ValueError
            If `criterion` is not between 0 and 1, or the loop is not stable.
        """
        from scipy.optimize import brentq  # slow to import

        if not 0 < criterion < 1:
            raise ValueError(f"criterion = {criterion!r} is not allowed; it must be in (0, 1)")
        band = criterion * abs(self.final)

        def excess(t: np.ndarray | float) -> np.ndarray:
            return np.abs(self.velocity(t) - self.final) - band

        t = self._grid(band)
        last = np.flatnonzero(excess(t) > 0)[-1]
        return float(brentq(excess, t[last], t[last + 1]))

    def arrival_time(self, criterion: float = 0.02) -> float:
        """Time in s at which the velocity first comes within `criterion` of its final value."""
        t = np.linspace(0, self.settling_time(criterion), 20_001)
        return response.arrival_time(t, self.velocity(t), (1 - criterion) * self.final)

    def peak_current(self) -> float:
        """Largest magnitude of the motor current in A."""
        from scipy.optimize import minimize_scalar  # slow to import

        t = self._grid(1e-6 * abs(self.final))
        top = int(np.argmax(np.abs(self.current(t))))
        ends, fine = (t[max(top - 1, 0)], t[min(top + 1, len(t) - 1)]), {"xatol": 1e-12}
        best = minimize_scalar(lambda s: -abs(self.current(s)), bounds=ends, options=fine)
        return -float(best.fun)

    def _modes(self, function: Callable, weights: np.ndarray, t: Any) -> np.ndarray:
        t = reals("t", t)
        return np.real(np.tensordot(weights, function(np.multiply.outer(self.poles, t)), axes=1))

    def _grid(self, rest: float) -> np.ndarray:
        """Times that resolve every mode, until the sum of all modes is below `rest`."""
        if (slowest := -self.poles.real.max()) <= 0:
            raise ValueError(f"the loop is not stable; its poles are {self.poles}")
        if rest == 0:
            raise ValueError("the response is 0 at all times; set velocity and K_1 must not be 0")
        end = np.log(max(np.abs(self.residues).sum() / rest, 2.0)) / slowest + 1e-9
        fastest = np.abs(self.poles).max()
        return np.union1d(np.linspace(0, end, 20001), np.geomspace(1e-3 / fastest, end, 2001))


def nearly_linear(p: AxisParameters, gain: float) -> AxisParameters:
    """Return an axis whose seven states follow eq. (16) up to a distance in proportion to 1/gain.

    Parameters
    ----------
    p : AxisParameters
        The axis; K_1 is computed anew by its rule.
    gain : float
        Forward gain K_e in V/V; the gear's stiffness and friction grow in proportion to it.
    """
    return p.replace(**UNLIMITED, K_e=gain, K_g=1e6 * gain, b_g=100 * gain)


# --- the seven-state model inside a region ------------------------------------------------------


def eigenvalues(p: AxisParameters, where: Region = ENGAGED) -> np.ndarray:
    """Eigenvalues of a region's equations in 1/s, without the zeros of the positions."""
    values = np.linalg.eigvals(affine(p, where)[0])
    return values[np.abs(values) > _ZERO]


def oscillation(
    p: AxisParameters, where: Region = ENGAGED, highest: float = inf
) -> tuple[float, float]:
    """Frequency and decay rate of the least damped oscillation in a region.

    Parameters
    ----------
    p, where
        The axis and the region.
    highest : float
        Upper limit of the frequency in Hz.

    Returns
    -------
    frequency, decay_rate : float
        In Hz and 1/s, comparable to `armsim.arm.response.ringing`; NaN if no mode oscillates.
    """
    values = eigenvalues(p, where)
    values = values[(values.imag > _ZERO) & (values.imag < 2 * pi * highest)]
    if values.size == 0:
        return nan, nan
    mode = values[np.argmax(values.real)]
    return float(mode.imag / (2 * pi)), float(-mode.real)


def growth_rate(p: AxisParameters, where: Region = ENGAGED) -> float:
    """Largest real part of a region's eigenvalues in 1/s; positive if the loop is unstable."""
    return float(eigenvalues(p, where).real.max())


def arm_mode(p: AxisParameters) -> tuple[float, float]:
    """Frequency and decay rate of the mode that dominates the arm's ringing: one below 200 Hz.

    NaN if the engaged loop is unstable.
    """
    return oscillation(p, highest=200) if growth_rate(p) < 0 else (nan, nan)


def fastest_decay(p: AxisParameters, lowest: float, highest: float) -> tuple[float, float]:
    """T_p in s between two limits for which the mode of `arm_mode` decays fastest, and its rate."""
    from scipy.optimize import minimize_scalar  # slow to import

    def growth(logarithm: float) -> float:
        return -arm_mode(p.replace(T_p=float(np.exp(logarithm))))[1]

    best = minimize_scalar(growth, bounds=np.log([lowest, highest]), options={"xatol": 1e-6})
    return float(np.exp(best.x)), -float(best.fun)


def unstable_below(p: AxisParameters, T_p: np.ndarray) -> float:
    """Largest T_p in s at which the engaged loop becomes unstable; NaN if there is none.

    It is searched for between the values of a grid; see `armsim.arm.response.crossings`.
    """
    roots, _ = response.crossings(lambda value: growth_rate(p.replace(T_p=value)), T_p)
    return max(roots, default=nan)


def gear_oscillation(p: AxisParameters) -> tuple[float, float]:
    """Frequency in Hz and damping ratio of motor and arm on the gear spring, otherwise free."""
    mass = 1 / (1 / p.M + p.r_g**2 / p.J_m)
    natural = sqrt(p.K_g / mass)
    return natural / (2 * pi), p.b_g / (2 * mass * natural)


def steady_motion(p: AxisParameters, velocity: float = 1.0) -> tuple[np.ndarray, float]:
    """State (7,) at position 0 and set velocity in V of steady motion.

    Parameters
    ----------
    p : AxisParameters
        The axis; no limit may be active at that velocity.
    velocity : float
        Arm velocity in m/s, positive and above the threshold of static friction.
    """
    A, B, c = affine(p, ENGAGED)
    slope = np.array([0, velocity / p.r_g, 0, 0, 0, 0])  # of y1 … y6
    unknown = np.column_stack([A[1:, 2:], B[1:]])  # y2 … y6 and the set velocity
    *rest, volts = np.linalg.solve(unknown, slope - velocity * A[1:, 1] - c[1:]).tolist()
    return np.array([0.0, velocity, *rest]), volts
