"""Fixed-step solvers for `scipy.integrate.solve_ivp`, made from a tableau."""

from collections.abc import Callable
from itertools import chain
from typing import Any

import numpy as np
from scipy.integrate import DenseOutput, OdeSolver
from scipy.interpolate import CubicHermiteSpline

from armsim.checks import IntegrationError, checked_number
from armsim.methods.runge_kutta import Form, integrate
from armsim.methods.tableaux import Tableau


class _Hermite(DenseOutput):
    """Cubic Hermite interpolant of a step."""

    def __init__(self, times: list[float], states: list[np.ndarray], slopes: list) -> None:
        super().__init__(*times)
        ends = slice(None, None, 1 if times[1] > times[0] else -1)
        self._spline = CubicHermiteSpline(times[ends], states[ends], slopes[ends])

    def _call_impl(self, t: np.ndarray) -> np.ndarray:
        return self._spline(t).T


def fixed_step_solver(
    tableau: Tableau, step_size: float, form: Form = "additive", shift: Any = None
) -> type[OdeSolver]:
    """Fixed-step solver class for the `method` argument of `scipy.integrate.solve_ivp`.

    Parameters
    ----------
    tableau : Tableau
        The method.
    step_size : float
        Positive; the last step is shortened to end with the interval.
    form, shift
        As in `armsim.methods.integrate`.

    Returns
    -------
    subclass of scipy.integrate.OdeSolver

    Examples
    --------
    >>> from scipy.integrate import solve_ivp
    >>> from armsim.methods import tableaux
    >>> rk6 = fixed_step_solver(tableaux.RK6, step_size=0.1)
    >>> run = solve_ivp(lambda t, y: [y[1], -y[0]], (0, 3), [0, 1], method=rk6)
    >>> print(f"{run.y[0, -1]:.6f} after {run.nfev} evaluations")
    0.141120 after 210 evaluations
    """
    checked_number("step_size", step_size, above=0.0)

    class FixedStep(OdeSolver):
        """Fixed-step solver for one tableau, with cubic Hermite dense output."""

        t: float
        y: np.ndarray

        def __init__(self, fun: Callable, t0: float, y0: Any, t_bound: float, **given: Any) -> None:
            vectorized = given.pop("vectorized", False)
            if given:
                raise ValueError(f"options {sorted(given)}: a fixed-step solver has none")
            super().__init__(fun, t0, y0, t_bound, vectorized)
            self.y_old = self.y
            # The last step is shortened; a remainder below rounding does not count as a step.
            steps = range(1, int(np.ceil(abs(t_bound - t0) / step_size - 1e-9)))
            self.ends = chain((t0 + self.direction * n * step_size for n in steps), [t_bound])

        def _step_impl(self) -> tuple[bool, str | None]:
            end = next(self.ends)
            once = abs(end - self.t) * (1 + 1e-6)  # one step despite rounding
            try:
                run = integrate(self.fun, (self.t, end), self.y, tableau, once, form, shift=shift)
            except IntegrationError as error:
                return False, str(error)
            self.t, self.y_old, self.y = end, self.y, run.y[:, -1]
            return True, None

        def _dense_output_impl(self) -> DenseOutput:
            times, states = [self.t_old, self.t], [self.y_old, self.y]
            slopes = [self.fun(t, y) for t, y in zip(times, states, strict=True)]
            return _Hermite(times, states, slopes)

    return FixedStep
