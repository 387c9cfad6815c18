"""Solvers compared: all on every problem, two by several norms, one where it goes on with a run."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import product
from math import inf
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from tqdm import tqdm

from armbook import styles
from armbook.peers import fixed, peers
from armbook.problems import MAX_EVALUATIONS, Problem, Solve
from armsim.arm.dynamics import auxiliary_variables, constants, rhs
from armsim.arm.simulate import Trajectory
from armsim.methods import IntegrationError, integrate, tableaux
from armsim.methods.tableaux import Tableau
from armsim.paper import PRINTED
from reportkit.timing import Timing

#: Methods that are run in the exponential forms as well.
EXPONENTIAL = (tableaux.RK6, tableaux.DP5, tableaux.DP4)


class Candidate(NamedTuple):
    """A solver with one setting."""

    method: str
    setting: float  #: step size in s or relative tolerance
    solve: Solve
    tableau: Tableau | None = None  #: of a method with fixed steps
    exponentials: int = 0  #: for each state in a step; counted for the shifted origin only


def candidates(
    problem: Problem, step_sizes: Sequence[float], tolerances: Sequence[float]
) -> Iterator[Candidate]:
    """Yield the paper's methods, corrected and as printed, and the solvers with error control.

    The exponential form is tried as it stands, and with the origin shifted to ten times each
    state's largest value below zero.
    """
    forms: dict[str, tuple] = {
        "exponential, shifted": ("exponential", 10 * problem.size),
        "exponential form": ("exponential",),
        "exponential form without step size": ("as printed",),
    }
    for h in step_sizes:
        for method in (*styles.METHODS, *PRINTED.values()):
            yield Candidate(method.name, h, fixed(method, h), method)
        for (name, form), method in product(forms.items(), EXPONENTIAL):
            counted = method.exponentials() if "shifted" in name else 0
            yield Candidate(f"{method.name}, {name}", h, fixed(method, h, *form), method, counted)
    for tolerance in tolerances:
        for name, peer in peers(tolerance, tolerance * problem.size).items():
            yield Candidate(name, tolerance, peer)


def compare(
    problems: Mapping[str, Problem], step_sizes: Sequence[float], tolerances: Sequence[float]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Run every candidate on every problem once.

    Returns
    -------
    runs : DataFrame
        With the columns ``problem``, ``method``, ``setting``, ``error`` (see `Problem.error`),
        ``evaluations``, ``end / mm`` (by how much the position at the end is off), ``steps`` (NaN
        if a solver does not tell them), ``exponentials`` and ``solver``.
    failures : DataFrame
        With the columns ``method``, ``problem``, ``setting`` and ``reason``.
    """
    runs, failures = [], []
    settings = step_sizes, tolerances
    listed = [(name, one) for name in problems for one in candidates(problems[name], *settings)]
    for name, (method, setting, solve, tableau, exponentials) in tqdm(listed, unit="runs"):
        problem = problems[name]
        counter = problem.equations.counting()
        try:
            t, y = problem.run(solve, counter)
        except (IntegrationError, ValueError) as error:
            failures.append([method, name, setting, str(error).strip().splitlines()[0]])
            continue
        missed = 1e3 * abs(problem.outputs(y)[0, -1] - problem.exact(t[-1:])[0, 0])
        steps = counter.count // len(tableau.evaluated_stages) if tableau else np.nan
        work = [counter.count, missed, steps, steps * exponentials * y.shape[0] if tableau else 0]
        runs.append([name, method, setting, problem.error(t, y), *work, solve])
    columns = ["problem", "method", "setting", "error", "evaluations", "end / mm"]
    found = pd.DataFrame(runs, columns=[*columns, "steps", "exponentials", "solver"])
    return found, pd.DataFrame(failures, columns=["method", "problem", "setting", "reason"])


#: What failures say, in short, by a part of their messages.
SHORT = {
    "blew up": "blows up",
    "with shift 0": "cannot start from rest, where states are zero",
    "evaluations": f"needs more than {MAX_EVALUATIONS} evaluations",
}


def reasons(failures: pd.DataFrame, problems: Sequence[str]) -> list[list[str]]:
    """Rows of methods, problems, settings and reason; failures that are alike are one row.

    Parameters
    ----------
    failures
        As `compare` returns them.
    problems
        Names of all problems; a row that has them all says "all".
    """

    def short(told: str) -> str:
        return next((SHORT[part] for part in SHORT if part in told), told)

    def where(names: pd.Series) -> str:
        found = list(dict.fromkeys(names))
        return "all" if found == list(problems) else "; ".join(found)

    def span(settings: pd.Series) -> str:
        return " to ".join(
            map(np.format_float_scientific, sorted({settings.min(), settings.max()}))
        )

    told = failures.assign(reason=failures["reason"].map(short))
    of_methods = told.groupby(["reason", "method"], sort=False)
    alike = of_methods.agg(where=("problem", where), settings=("setting", span)).reset_index()
    rows = alike.groupby(["reason", "where", "settings"], sort=False)["method"].agg("; ".join)
    return rows.reset_index()[["method", "where", "settings", "reason"]].to_numpy().tolist()


def cheapest(runs: pd.DataFrame, target: float, by: str) -> pd.DataFrame:
    """Return of each method on each problem the run with the least of `by` that errs at most so."""
    met = runs[runs["error"] <= target]
    return met.loc[met.groupby(["problem", "method"], sort=False)[by].idxmin()]


def cpu_change(timing: Timing, new: str, prior: str) -> np.ndarray:
    """Return the paper's metric, |CPU new - CPU prior| / CPU prior in per cent: quartiles, median.

    In the order of `Timing.ratios`, over the repetitions.
    """
    change = 100 * np.abs(timing.of(new) / timing.of(prior) - 1)
    return np.quantile(change, [0.25, 0.5, 0.75])


def steps_for(target: float, steps: np.ndarray, errors: np.ndarray) -> float:
    """Return the number of steps from which on every larger one meets an error.

    Parameters
    ----------
    target : float
        The error.
    steps, errors : (n,) arrays
        Increasing numbers of steps and their errors; a NaN does not meet any.

    Returns
    -------
    float
        NaN if the largest number does not meet it.
    """
    all_from_here = np.cumprod((errors <= target)[::-1])[::-1]
    return float(min(steps[all_from_here == 1], default=np.nan))


def step_size_for(target: float, step_sizes: np.ndarray, errors: np.ndarray) -> float:
    """Step size with which an error is met, read off between two steps on logarithmic scales.

    Parameters
    ----------
    target : float
        The error.
    step_sizes, errors : (n,) arrays
        Both falling.

    Returns
    -------
    float
        NaN if the error is not between the largest and the smallest.
    """
    error, step = np.log(errors[::-1]), np.log(step_sizes[::-1])
    return float(np.exp(np.interp(np.log(target), error, step, left=np.nan, right=np.nan)))


# --- two methods ---------------------------------------------------------------------------------

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
        runs = [problem.run(fixed(method, h)) for h in tqdm(step_sizes, unit="runs")]
        errors = [(t, problem.errors(t, y)) for t, y in runs]
        for key, (_, norm) in NORMS.items():
            found[key, method.name] = np.array([norm(*pair) for pair in errors])
    return found


def ratios(one: np.ndarray, other: np.ndarray, rounding: float = 0.0) -> np.ndarray:
    """Return the errors (n,) of one method over those of another.

    NaN where one of them is not above `rounding`, and rounding decides.
    """
    return np.where(np.minimum(one, other) > rounding, one / other, np.nan)


def spread(ratios: np.ndarray) -> dict[str, float]:
    """Summarise ratios of errors (n,), NaN left out.

    Returns
    -------
    dict
        Their ``median``, ``least`` and ``most``, and ``ahead``, the per cent of them below 1; NaN
        if nothing is left.
    """
    known = pd.Series(ratios).dropna()
    numbers = known.median(), known.min(), known.max(), 100 * (known < 1).mean()
    return dict(zip(("median", "least", "most", "ahead"), map(float, numbers), strict=True))


def voltage_error(
    run: Trajectory, method: Tableau, step_size: float, begin: float, **options: Any
) -> float:
    """Error of the motor voltage when a method continues an exact run.

    Parameters
    ----------
    run : Trajectory
        Exact run with a constant set velocity.
    method, step_size
        The Runge-Kutta method and its step in s.
    begin : float
        Time in s at which the method starts from the exact state.
    **options
        Further arguments of `integrate`: a form and its shift.

    Returns
    -------
    float
        Largest error in V in the last tenth of a second; inf if the method blows up.
    """
    p, args = run.parameters, (float(run.set_velocity(begin)), constants(run.parameters))
    problem = rhs, (begin, run.t[-1]), run(begin)
    try:
        steps = integrate(*problem, method, step_size, args=args, **options)
    except IntegrationError:
        return inf
    last = steps.t > run.t[-1] - 0.1
    states = steps.y[:, last], run(steps.t[last])
    got, exact = (auxiliary_variables(p, y)["v_m"] for y in states)
    return float(np.abs(got - exact).max())
