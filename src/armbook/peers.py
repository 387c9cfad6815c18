"""Solvers that a user would reach for instead, and ours, on the problems of `armbook.problems`."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.integrate import odeint, solve_ivp

from armbook.problems import Equations, Solve
from armsim.methods import IntegrationError, integrate, tableaux
from armsim.methods.runge_kutta import Form
from armsim.methods.tableaux import Tableau

try:
    from sksundae.cvode import CVODE
except ImportError:  # it comes with the development environment only
    CVODE = None


def fixed(
    tableau: Tableau, step_size: float, form: Form = "additive", shift: np.ndarray | None = None
) -> Solve:
    """Fixed steps; states are those of the first step at or after each time."""

    def solve(eq: Equations, times: np.ndarray, y0: np.ndarray, args: tuple) -> Any:
        span = (times[0], times[-1])
        run = integrate(eq.flow, span, y0, tableau, step_size, form, args + eq.fixed, shift=shift)
        eq.count += run.nfev
        at = np.searchsorted(run.t[:-1], times - 1e-6 * step_size)
        return run.t[at], run.y[:, at]

    return solve


def embedded(**tolerances: Any) -> Solve:
    """DP5(4) of this project with controlled steps."""

    def solve(eq: Equations, times: np.ndarray, y0: np.ndarray, args: tuple) -> Any:
        span = (times[0], times[-1])
        run = integrate(eq.flow, span, y0, tableaux.DP5, args=args + eq.fixed, **tolerances)
        eq.count += run.nfev
        return times, run(times)

    return solve


def of_scipy(method: str, **tolerances: Any) -> Solve:
    """One of `scipy.integrate.solve_ivp`."""

    def solve(eq: Equations, times: np.ndarray, y0: np.ndarray, args: tuple) -> Any:
        run = solve_ivp(eq.slope, times[[0, -1]], y0, method, times, args=args, **tolerances)
        if not run.success:
            raise IntegrationError(run.message)
        return times, run.y

    return solve


def of_odeint(**tolerances: Any) -> Solve:
    """LSODA by `scipy.integrate.odeint`."""
    options = {"mxstep": 100_000, "tfirst": True, "full_output": True} | tolerances

    def solve(eq: Equations, times: np.ndarray, y0: np.ndarray, args: tuple) -> Any:
        y, told = odeint(eq.slope, y0, times, args, **options)
        if told["message"] != "Integration successful.":
            raise IntegrationError(told["message"])
        return times, y.T

    return solve


def of_cvode(**options: Any) -> Solve:
    """CVODE of SUNDIALS, with the method ``"BDF"`` or ``"Adams"``."""

    def solve(eq: Equations, times: np.ndarray, y0: np.ndarray, args: tuple) -> Any:
        cvode = CVODE(eq.fill, max_num_steps=100_000, userdata=args, **options)
        run = cvode.solve(times, y0)
        if not run.success:
            raise IntegrationError(run.message)
        y = run.y if times.size > 2 else run.y[[0, -1]]  # between two times it gives every step
        return times, y.T

    return solve


def peers(rtol: float, atol: np.ndarray) -> Mapping[str, Solve | None]:
    """Solvers with error control by name; None for one that is not installed."""
    how = {"rtol": rtol, "atol": atol}
    of_ivp = ("RK45", "DOP853", "Radau", "BDF", "LSODA")
    return {
        "DP5(4)": embedded(**how),
        **{f"SciPy {method}": of_scipy(method, **how) for method in of_ivp},
        "SciPy odeint": of_odeint(**how),
        **{f"CVODE {m}": CVODE and of_cvode(method=m, **how) for m in ("BDF", "Adams")},
    }
