"""The solvers that are compared on the fibre amplifier, and the fewest steps that they need."""

import math
from bisect import bisect_left
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from armsim.amplifier import RamanAmplifier, average_power, log_rhs, rhs
from armsim.checks import IntegrationError
from armsim.methods import integrate, tableaux
from armsim.methods.runge_kutta import Form
from armsim.methods.tableaux import Tableau


class Amplifier(RamanAmplifier):
    """A fibre amplifier with its solvers as methods; each gives the powers of the waves in W."""

    @np.errstate(over="ignore")
    def error(self, power: np.ndarray) -> float:
        """Largest relative error of powers computed for the end of the fibre, inf if too large."""
        return float(np.abs(power / self.output_power - 1).max())

    def run(self, method: Tableau, form: Form, steps: int) -> np.ndarray:
        """Powers (waves, steps + 1) in W after each step; NaN if the method breaks down."""
        span, step_size = (0.0, self.length), self.length / steps
        try:
            return integrate(rhs, span, self.input_power, method, step_size, form, self.args).y
        except IntegrationError:
            return np.full((self.input_power.size, steps + 1), np.nan)

    def averaged(self, sections: int) -> np.ndarray:
        """Output powers by `average_power` with two evaluations in each section."""
        return average_power(self.input_power, *self.args, self.length, sections, 2)

    def controlled(self, form: Form, rtol: float) -> tuple[int, np.ndarray]:
        """Evaluations and output powers of DP5(4) with adaptive steps."""
        span, start = (0.0, self.length), self.input_power
        run = integrate(rhs, span, start, tableaux.DP5, None, form, self.args, rtol=rtol, atol=0)
        return run.nfev, run.y[:, -1]

    def by_scipy(self, method: str, rtol: float) -> tuple[int, np.ndarray]:
        """Evaluations and output powers of `scipy.integrate.solve_ivp`."""
        run = self._solved(rhs, self.input_power, method, rtol=rtol, atol=0)
        return run.nfev, run.y[:, -1]

    def by_scipy_for_logarithms(self, method: str, rtol: float) -> tuple[int, np.ndarray]:
        """Same as `by_scipy` for ln P, where `rtol` is the absolute tolerance."""
        run = self._solved(log_rhs, np.log(self.input_power), method, rtol=1e-13, atol=rtol)
        return run.nfev, np.exp(run.y[:, -1])

    def _solved(self, function: Callable, start: np.ndarray, method: str, **options: Any) -> Any:
        return solve_ivp(function, (0.0, self.length), start, method, args=self.args, **options)

    def steps_for(self, target: float, method: Tableau, form: Form) -> float:
        """Fewest steps for which the relative error is at most `target`; see `fewest`."""
        return fewest(lambda n: self.error(self.run(method, form, n)[:, -1]) <= target, 2**12)

    def sections_for(self, target: float) -> float:
        """Fewest sections for which the relative error of `averaged` is at most `target`."""
        return fewest(lambda n: self.error(self.averaged(n)) <= target, 2**18)

    def positive_steps(self, method: Tableau, form: Form) -> float:
        """Fewest steps for which all powers stay positive; see `fewest`."""
        return fewest(lambda n: bool((self.run(method, form, n) > 0).all()), 2**12)


def fewest(succeeds: Callable[[int], bool], most: int) -> float:
    """Smallest number from which on every number succeeds.

    Parameters
    ----------
    succeeds : callable
        ``succeeds(n)`` for a positive integer n.
    most : int
        Largest number that is tried, at least 64.

    Returns
    -------
    float
        NaN if none succeeds. If success is not monotonic below 64, the result is one more than the
        largest failure; beyond 64 it is taken to be monotonic.
    """
    n = 64
    if succeeds(n):
        return float(next((m + 1 for m in range(n - 1, 0, -1) if not succeeds(m)), 1))
    while not succeeds(n := 2 * n):
        if 2 * n > most:
            return math.nan
    return float(bisect_left(range(n), True, n // 2 + 1, key=succeeds))
