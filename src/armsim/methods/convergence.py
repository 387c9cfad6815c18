r"""Errors of a method, and how fast they fall with the step: its observed order.

The test problem of this module is nonlinear, coupled and depends on time, and its solution stays
positive, as the exponential form needs:

.. math:: y_1 = \exp(\sin 2t), \quad y_2 = 2 + \cos 3t.
"""

from collections.abc import Callable, Iterable, Sequence
from math import ceil, inf, log10, nan

import numpy as np
from numpy.typing import ArrayLike

from armsim.checks import IntegrationError
from armsim.methods.runge_kutta import Form, integrate
from armsim.methods.tableaux import Tableau


def known_slope(t: float, y: np.ndarray) -> tuple[float, float]:
    """Right-hand side of the test problem; each quotient in it is 1 on the solution."""
    first, second = known_solution(t)
    return 2 * np.cos(2 * t) * y[0] * second / y[1], -3 * np.sin(3 * t) * y[0] / first


def known_solution(t: float) -> np.ndarray:
    """Solution (2,) of the test problem."""
    return np.array([np.exp(np.sin(2 * t)), 2 + np.cos(3 * t)])


def known_error(tableau: Tableau, step_size: float, form: Form = "additive") -> float:
    """Error of a method on the test problem at t = 1, started from the solution at t = 0."""
    run = integrate(known_slope, (0, 1), known_solution(0.0), tableau, step_size, form)
    return float(np.abs(run.y[:, -1] - known_solution(1.0)).max())


def relative_error(got: np.ndarray, exact: np.ndarray, largest: ArrayLike | None = None) -> float:
    """Largest error of any component, as a share of the largest value of that component.

    Parameters
    ----------
    got, exact : (m, n) or (n,) arrays
        Components, one a row, at the same n times.
    largest : (m,) array_like, optional
        Largest magnitude of each component; by default that of `exact`.
    """
    exact = np.atleast_2d(exact)
    scale = np.abs(exact).max(axis=1) if largest is None else np.asarray(largest)
    return float((np.abs(got - exact).max(axis=1) / scale).max())


def agreeing_digits(error: float) -> int:
    """Decimal digits that are right with a relative error; at most the 15 of a float."""
    return -ceil(log10(max(error, 2.0**-53)))


def error_curve(error: Callable[[float], float], values: Iterable[float]) -> np.ndarray:
    """Errors (n,) with n step sizes, or what else is varied; NaN where the integration fails."""

    def one(value: float) -> float:
        try:
            return error(value)
        except IntegrationError:
            return nan

    return np.array([one(value) for value in values])


def observed_order(
    steps: Sequence[float] | np.ndarray,
    errors: Sequence[float] | np.ndarray,
    *,
    smallest: float = 1e-12,
    largest: float = inf,
    finest: int | None = None,
) -> float:
    """Slope of the least-squares line through log(error) over log(step).

    Parameters
    ----------
    steps, errors : (n,) array_like
        Step sizes, positive, and the errors with them.
    smallest, largest : float
        Only errors between the two are used: below, an error is rounding; above, it says nothing
        of the limit. What is not finite is left out.
    finest : int, optional
        Use only so many of them, those with the smallest steps.

    Returns
    -------
    float
        NaN if fewer than two errors can be used.

    Examples
    --------
    >>> h = np.array([0.1, 0.05, 0.025])
    >>> observed_order(h, 3 * h**4)
    4.0
    """
    steps, errors = np.asarray(steps, dtype=float), np.asarray(errors, dtype=float)
    usable = np.flatnonzero((errors > smallest) & (errors < largest))
    usable = usable[np.argsort(steps[usable])][:finest]
    if usable.size < 2:
        return nan
    slope = np.polyfit(np.log(steps[usable]), np.log(errors[usable]), 1)[0]
    return round(float(slope), 12)
