"""Standard solvers and ours, on the problems of `armbook.problems`."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import odeint, solve_ivp

from armbook.problems import Equations, Solve
from armsim.methods import IntegrationError, integrate, tableaux
from armsim.methods.runge_kutta import Form
from armsim.methods.tableaux import Tableau

try:
    from sksundae.cvode import CVODE
except ModuleNotFoundError:  # there is no wheel of it for Linux on ARM
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


def embedded(eq: Equations, times: np.ndarray, y0: np.ndarray, args: tuple, **how: Any) -> Any:
    """DP5(4) of this project with controlled steps."""
    span = (times[0], times[-1])
    run = integrate(eq.flow, span, y0, tableaux.DP5, args=args + eq.fixed, **how)
    eq.count += run.nfev
    return times, run(times)


def of_scipy(eq: Equations, times: np.ndarray, y0: np.ndarray, args: tuple, **how: Any) -> Any:
    """One of `scipy.integrate.solve_ivp`."""
    run = solve_ivp(eq.slope, times[[0, -1]], y0, t_eval=times, args=args, **how)
    if not run.success:
        raise IntegrationError(run.message)
    return times, run.y


def of_odeint(eq: Equations, times: np.ndarray, y0: np.ndarray, args: tuple, **how: Any) -> Any:
    """LSODA by `scipy.integrate.odeint`."""
    options = {"mxstep": 100_000, "tfirst": True, "full_output": True} | how
    y, told = odeint(eq.slope, y0, times, args, **options)
    if told["message"] != "Integration successful.":
        raise IntegrationError(told["message"])
    return times, y.T


def of_cvode(eq: Equations, times: np.ndarray, y0: np.ndarray, args: tuple, **how: Any) -> Any:
    """CVODE of SUNDIALS, with the method ``"BDF"`` or ``"Adams"``."""
    run = CVODE(eq.fill, max_num_steps=100_000, userdata=args, **how).solve(times, y0)
    if not run.success:
        raise IntegrationError(run.message)
    y = run.y if times.size > 2 else run.y[[0, -1]]  # between two times it gives every step
    return times, y.T


def peers(rtol: float, atol: np.ndarray) -> Mapping[str, Solve]:
    """Solvers with error control by name, CVODE among them if scikit-sundae is installed."""
    how: dict[str, Any] = {"rtol": rtol, "atol": atol}
    of_ivp = ("RK45", "DOP853", "Radau", "BDF", "LSODA")
    of_sundials = ("BDF", "Adams") if CVODE else ()
    return {
        "DP5(4)": partial(embedded, **how),
        **{f"SciPy {method}": partial(of_scipy, method=method, **how) for method in of_ivp},
        "SciPy odeint": partial(of_odeint, **how),
        **{f"CVODE {method}": partial(of_cvode, method=method, **how) for method in of_sundials},
    }
