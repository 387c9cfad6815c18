"""One call that runs an axis, and the trajectory that comes back."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from numbers import Real

import numpy as np

from armsim.arm.dynamics import auxiliary_variables, constants, rhs
from armsim.arm.parameters import AxisParameters
from armsim.methods.runge_kutta import Form, IntegrationError, integrate
from armsim.methods.tableaux import Tableau

#: Volts, or the volts from each time on.
SetVelocity = float | Iterable[tuple[float, float]]


@dataclass(frozen=True)
class Trajectory:
    """A simulated motion: states at the steps, and by interpolation at any time between.

    Calling it gives the state at a time (7,), or at n times (7, n).
    """

    parameters: AxisParameters
    schedule: tuple[tuple[float, float], ...]  #: set velocity: volts from each time on
    t: np.ndarray  #: (n,) times in s
    y: np.ndarray  #: (7, n) states y0 … y6 of Table 1
    nfev: int  #: right-hand-side evaluations
    events: tuple = field(default=())  #: switching events, where the method finds them

    def set_velocity(self, t: np.ndarray | float) -> np.ndarray:
        """Set velocity U in volts at the times `t`; at a switch, the new value."""
        starts, volts = np.array(self.schedule).T
        return volts[np.maximum(np.searchsorted(starts, t, side="right") - 1, 0)]

    def auxiliary(self) -> dict[str, np.ndarray]:
        """Auxiliary variables of Table 2 at the times `t`: f_g, F_s in N and v_m, v_c in V."""
        return auxiliary_variables(self.parameters, self.y)

    def __call__(self, t: np.ndarray | float) -> np.ndarray:
        """State at the times `t`, by cubic Hermite interpolation between steps.

        Raises
        ------
        ValueError
            If a time lies outside the run.
        """
        times = np.atleast_1d(np.asarray(t, dtype=float))
        outside = ~((times >= self.t[0]) & (times <= self.t[-1]))
        if outside.any():
            raise ValueError(
                f"t = {times[outside][0]} is outside the run; allowed is {self.t[0]} to {self.t[-1]}"
            )
        left = np.clip(np.searchsorted(self.t, times, side="right") - 1, 0, self.t.size - 2)
        h = self.t[left + 1] - self.t[left]
        s = (times - self.t[left]) / h
        before, after = self.y[:, left], self.y[:, left + 1]
        volts, k = self.set_velocity(self.t[left]), constants(self.parameters)
        slope = np.array([rhs(0.0, y, u, k) for y, u in zip(before.T, volts, strict=True)]).T
        slope_after = np.array([rhs(0.0, y, u, k) for y, u in zip(after.T, volts, strict=True)]).T
        y = (
            before * (1 + 2 * s) * (1 - s) ** 2
            + after * s**2 * (3 - 2 * s)
            + h * s * (1 - s) * (slope * (1 - s) - slope_after * s)
        )
        return y[:, 0] if np.ndim(t) == 0 else y


def simulate(
    p: AxisParameters,
    set_velocity: SetVelocity = 10.0,
    t_end: float = 1.0,
    *,
    method: Tableau,
    step_size: float,
    form: Form = "additive",
    y0: Sequence[float] | np.ndarray | None = None,
) -> Trajectory:
    """Run one axis of the arm, paper's eq. (10)-(15).

    Parameters
    ----------
    p : AxisParameters
        The axis.
    set_velocity : float or sequence of (time, volts)
        Input U: constant, or piecewise constant with each value from its time (s, rising, not
        negative) on, and 0 V before the first. Steps are shortened to end at the switches.
    t_end : float
        End of the run in s.
    method : Tableau
        Runge-Kutta method.
    step_size : float
        Fixed step in s.
    form : {"additive", "exponential"}
        See `armsim.methods.integrate`.
    y0 : (7,) array_like, optional
        Initial state; at rest if left out.

    Returns
    -------
    Trajectory
        With ``t`` (n,), ``y`` (7, n) and ``nfev``.

    Raises
    ------
    TypeError, ValueError
        If an argument is out of range; the message names it, its value and what is allowed.
    IntegrationError
        If the step is so large that the solution blows up.
    """
    schedule = _checked_schedule(set_velocity)
    t_end = _checked_number("t_end", t_end)
    if t_end <= 0:
        raise ValueError(f"t_end = {t_end} is not allowed; it must be positive")
    state = np.zeros(7) if y0 is None else np.asarray(y0, dtype=float)
    if state.shape != (7,):
        raise ValueError(f"y0 has shape {state.shape}; the 7 states y0 … y6 are needed")

    k = constants(p)
    t, y, nfev = [np.zeros(1)], [state[:, None]], 0
    ends = [*(start for start, _ in schedule[1:]), math.inf]
    for (start, volts), end in zip(schedule, ends, strict=True):
        if start >= t_end:
            break
        span = (start, min(end, t_end))
        run = integrate(rhs, span, y[-1][:, -1], method, step_size, form, args=(volts, k))
        t.append(run.t[1:])
        y.append(run.y[:, 1:])
        nfev += run.nfev
    trajectory = Trajectory(p, schedule, np.concatenate(t), np.concatenate(y, axis=1), nfev)
    _raise_if_beyond_bound(trajectory, f"{method.name}, step size {step_size:g}")
    return trajectory


def _raise_if_beyond_bound(run: Trajectory, method: str) -> None:
    """Report a blow-up of the preamplifier that has not yet reached infinity.

    Its two lags have positive impulse response and unit gain, so y4 cannot exceed the largest
    input by more than its initial state contributes. The limits hide its growth from the rest.
    """
    p, (y4, y5) = run.parameters, run.y[4:6, 0]
    volts = max(abs(u) for _, u in run.schedule)
    largest = p.K_1 * volts + p.K_2 * p.K_t * np.abs(run.y[3]).max()
    bound = 2 * (largest + abs(y4) + (p.T_p + p.T_r) * abs(y5))  # 2: room for a coarse step
    beyond = np.abs(run.y[4]) > bound
    if beyond.any():
        first = int(np.argmax(beyond))
        raise IntegrationError(
            f"{method}: the solution blew up; |y4| = {abs(run.y[4, first]):.3g} V at "
            f"t = {run.t[first]:.6g} s is more than the preamplifier can reach ({bound:.3g} V)"
        )


def _checked_schedule(set_velocity: SetVelocity) -> tuple[tuple[float, float], ...]:
    if isinstance(set_velocity, Real | str):
        return ((0.0, _checked_number("set_velocity", set_velocity)),)
    schedule: list[tuple[float, float]] = []
    for n, entry in enumerate(set_velocity):
        try:
            time, volts = entry
        except (TypeError, ValueError) as error:
            raise ValueError(f"set_velocity[{n}] = {entry!r}: a pair (time, volts) is needed") from error
        time = _checked_number(f"set_velocity[{n}] time", time)
        if time < 0 or (schedule and time <= schedule[-1][0]):
            raise ValueError(
                f"set_velocity[{n}] time = {time}: times must not be negative and must rise"
            )
        schedule.append((time, _checked_number(f"set_velocity[{n}] volts", volts)))
    if not schedule:
        raise ValueError("set_velocity is empty; at least one (time, volts) is needed")
    if schedule[0][0] > 0:
        schedule.insert(0, (0.0, 0.0))
    return tuple(schedule)


def _checked_number(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, Real):
        raise TypeError(f"{name} = {value!r} is a {type(value).__name__}; a real number is needed")
    if not math.isfinite(value):
        raise ValueError(f"{name} = {value!r} is not allowed; it must be finite")
    return float(value)
