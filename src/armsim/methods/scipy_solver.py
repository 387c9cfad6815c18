"""Fixed-step solvers for `scipy.integrate.solve_ivp`, made from a tableau."""

import copyreg
import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import DenseOutput, OdeSolver

from armsim.checks import IntegrationError, checked_number, checked_type
from armsim.methods import runge_kutta
from armsim.methods.runge_kutta import Form, Problem
from armsim.methods.tableaux import Tableau


class _Hermite(DenseOutput):
    """Cubic Hermite interpolant of a step."""

    def __init__(self, times: list[float], states: list[np.ndarray], slopes: list) -> None:
        super().__init__(*times)
        self._ends = np.array([*states, *slopes])

    def _call_impl(self, t: np.ndarray) -> np.ndarray:
        h = self.t - self.t_old
        ends = self._ends if t.ndim == 0 else self._ends[:, :, None]
        return runge_kutta.hermite((t - self.t_old) / h, h, *ends)


class _Made(type):
    """Type of the classes that `fixed_step_solver` makes; they are pickled as its arguments."""

    arguments: tuple


def _how_made(made: _Made) -> Any:
    return fixed_step_solver, made.arguments


copyreg.pickle(_Made, _how_made)


def fixed_step_solver(
    tableau: Tableau, step_size: float, form: Form = "additive", shift: Any = None
) -> type[OdeSolver]:
    """Fixed-step solver class for the `method` argument of `scipy.integrate.solve_ivp`.

    Parameters
    ----------
    tableau : Tableau
        The method.
    step_size : float
        Positive; the last step is shortened to end with the interval. The options `first_step` and
        `max_step` of `solve_ivp` must agree with it; other options have no effect and warn.
    form, shift
        As in `armsim.methods.integrate`. In the additive form the state may be complex.

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
    step_size = checked_number("step_size", step_size, above=0.0)
    checked_type("tableau", tableau, Tableau, "tableaux.RK6")

    class FixedStep(OdeSolver, metaclass=_Made):
        """Fixed-step solver for one tableau, with cubic Hermite dense output."""

        arguments = tableau, step_size, form, shift
        t: float
        y: np.ndarray

        def __init__(self, fun: Callable, t0: float, y0: Any, t_bound: float, **given: Any) -> None:
            vectorized = given.pop("vectorized", False)
            first, longest = given.pop("first_step", None), given.pop("max_step", math.inf)
            if first not in (None, step_size) or not longest >= step_size:
                wrong = f"first_step = {first}, max_step = {longest}"
                raise ValueError(f"{wrong}: every step of this solver is {step_size}")
            if given:
                warnings.warn(f"a fixed-step solver ignores {', '.join(given)}", stacklevel=3)
            super().__init__(fun, t0, y0, t_bound, vectorized, support_complex=form == "additive")
            self.y_old, self.start, self.taken = self.y, t0, 0
            far = 2**50 * step_size  # an infinite end counts as one that is never reached
            bound = min(max(t_bound, t0 - far), t0 + far)
            self.steps = runge_kutta.step_count(t0, bound, step_size)
            s, setting = runge_kutta.checked_shift(shift, self.y, form), f"step size {step_size:g}"
            self.problem = Problem(self.fun, t0, t_bound, self.y, tableau, form, s, (), setting)
            self.loop, _ = runge_kutta.loop_for(self.problem)

        def _step_impl(self) -> tuple[bool, str | None]:
            n = self.taken + 1
            whole = self.start + self.direction * n * step_size
            times = np.array([self.t, self.t_bound if n >= self.steps else whole])
            out = np.empty((self.n, 2), self.y.dtype, "F")  # so that a state is contiguous
            with np.errstate(all="ignore"):
                self.loop(times, step_size, True, self.y, self.problem.shift, out, ())
            try:
                runge_kutta.raise_if_lost(self.problem, times[1:], out[:, 1:], n)
            except IntegrationError as error:
                return False, str(error)
            self.t, self.y_old, self.y, self.taken = times[1], self.y, out[:, 1], n
            return True, None

        def _dense_output_impl(self) -> DenseOutput:
            times, states = [self.t_old, self.t], [self.y_old, self.y]
            slopes = [self.fun(t, y) for t, y in zip(times, states, strict=True)]
            return _Hermite(times, states, slopes)

    return FixedStep
