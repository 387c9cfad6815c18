"""Errors of two methods compared, in several norms."""

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from armbook.peers import fixed
from armbook.problems import Problem
from armsim.methods.tableaux import Tableau

#: Time in s after which the start of a run is over.
START = 2e-3


def root_mean_square(t: np.ndarray, errors: np.ndarray) -> float:
    """Root mean square over time of the worst component, from t = 0, where there is no error."""
    squares = np.insert(errors, 0, 0.0, axis=1) ** 2
    return float(np.sqrt(np.trapezoid(squares, np.append(0.0, t)) / t[-1]).max())


#: By key: a name, and the norm of relative errors (components, n) at times (n,).
NORMS: dict[str, tuple[str, Callable[[np.ndarray, np.ndarray], float]]] = {
    "whole": ("largest error of the run", lambda t, e: e.max()),
    "late": ("largest error after 2 ms", lambda t, e: e[:, t > START].max()),
    "rms": ("root mean square", root_mean_square),
    "motion": ("largest error of position and velocity", lambda t, e: e[:2].max()),
    "end": ("error at the end", lambda t, e: e[:, -1].max()),
}


def norms(
    problem: Problem, methods: Iterable[Tableau], step_sizes: Sequence[float] | np.ndarray
) -> dict[tuple[str, str], np.ndarray]:
    """Run methods with several step sizes: errors (n,) by the key of the norm and the method."""
    found = {}
    for method in methods:
        runs = [problem.run(fixed(method, h)) for h in step_sizes]
        errors = [(t, problem.errors(t, y)) for t, y in runs]
        for key, (_, norm) in NORMS.items():
            found[key, method.name] = np.array([norm(*pair) for pair in errors])
    return found


class Ratios(NamedTuple):
    """Errors of one method over those of another, at several step sizes."""

    each: np.ndarray  #: (n,), NaN where rounding decides
    size: int  #: step sizes that count
    median: float
    least: float
    most: float
    ahead: float  #: % of the step sizes at which the first method has the smaller error


def ratios(one: np.ndarray, other: np.ndarray, rounding: float = 0.0) -> Ratios:
    """Compare errors (n,) of two methods at the same step sizes.

    Sizes with an error not above `rounding` do not count; the numbers are NaN if none does.
    """
    each = np.where(np.minimum(one, other) > rounding, one / other, np.nan)
    known = each[~np.isnan(each)]
    if not known.size:
        return Ratios(each, 0, np.nan, np.nan, np.nan, np.nan)
    median, least, most = np.quantile(known, [0.5, 0.0, 1.0]).tolist()
    return Ratios(each, known.size, median, least, most, float(100 * (known < 1).mean()))
