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
        at = np.searchsorted(run.t, times - 1e-6 * step_size)
        at = np.minimum(at, run.t.size - 1)
        return run.t[at], run.y[:, at]

    return solve


def embedded(rtol: float, atol: np.ndarray) -> Solve:
    """DP5(4) of this project with controlled steps."""

    def solve(eq: Equations, times: np.ndarray, y0: np.ndarray, args: tuple) -> Any:
        span = (times[0], times[-1])
        args = args + eq.fixed
        run = integrate(eq.flow, span, y0, tableaux.DP5, args=args, rtol=rtol, atol=atol)
        eq.count += run.nfev
        return times, run(times)

    return solve


def of_scipy(method: str, rtol: float, atol: np.ndarray) -> Solve:
    """One of `scipy.integrate.solve_ivp`."""

    def solve(eq: Equations, times: np.ndarray, y0: np.ndarray, args: tuple) -> Any:
        span, how = (times[0], times[-1]), {"rtol": rtol, "atol": atol}
        run = solve_ivp(eq.slope, span, y0, method, times, args=args, **how)
        if not run.success:
            raise IntegrationError(run.message)
        return times, run.y

    return solve


def of_odeint(rtol: float, atol: np.ndarray) -> Solve:
    """LSODA by `scipy.integrate.odeint`."""

    def solve(eq: Equations, times: np.ndarray, y0: np.ndarray, args: tuple) -> Any:
        how = {"rtol": rtol, "atol": atol, "mxstep": 100_000, "tfirst": True}
        y, told = odeint(eq.slope, y0, times, args, full_output=True, **how)
        if told["message"] != "Integration successful.":
            raise IntegrationError(told["message"])
        return times, y.T

    return solve


def of_cvode(method: str, rtol: float, atol: np.ndarray) -> Solve:
    """CVODE of SUNDIALS, with the method ``"BDF"`` or ``"Adams"``."""

    def solve(eq: Equations, times: np.ndarray, y0: np.ndarray, args: tuple) -> Any:
        options = {"rtol": rtol, "atol": atol, "max_num_steps": 100_000, "userdata": args}
        run = CVODE(eq.fill, method=method, **options).solve(times, y0)
        if not run.success:
            raise IntegrationError(run.message)
        y = run.y if times.size > 2 else run.y[[0, -1]]  # between two times it gives every step
        return times, y.T

    return solve


def peers(rtol: float, atol: np.ndarray) -> Mapping[str, Solve | None]:
    """Solvers with error control by name; None for one that is not installed."""
    found: dict[str, Solve | None] = {"DP5(4)": embedded(rtol, atol)}
    for method in ("RK45", "DOP853", "Radau", "BDF", "LSODA"):
        found[f"SciPy {method}"] = of_scipy(method, rtol, atol)
    found["SciPy odeint"] = of_odeint(rtol, atol)
    for method in ("BDF", "Adams"):
        found[f"CVODE {method}"] = None if CVODE is None else of_cvode(method, rtol, atol)
    return found
