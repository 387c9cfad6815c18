"""Identification of an axis from its measured motion: fit, confidence intervals, model check.

Parameters are fitted by weighted least squares in their logarithms. Bias and drift of the
accelerometer enter linearly and are eliminated by removing a straight line from the acceleration
residuals. The standard errors include their uncertainty.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy.optimize import OptimizeResult, brentq, least_squares
from scipy.stats import qmc

from armsim import parallel
from armsim.arm.measurement import Instrument, Measurement, implausible, signals
from armsim.arm.parameters import AxisParameters
from armsim.arm.simulate import simulate
from armsim.checks import checked_count, checked_type, reals
from armsim.methods.tableaux import Tableau
from armsim.parallel import Progress

#: Parameters fitted by default.
NAMES = ("V_L", "B_a", "b_g", "K_g", "F_0")
SIGNALS = ("position", "velocity", "acceleration")

#: Rise of χ² at the ends of the 95 % interval of one parameter.
RISE = 3.84
#: Default bounds are 1/3 and 3 times the axis' values.
_RANGE = 3.0
#: Relative steps of the finite differences. The exact solution is smooth down to rounding. A
#: fixed-step solution jumps when a switch moves from one step to the next. With a step of 1e-4 s,
#: differences over less than 1e-3 are useless; standard errors are off by 25 % at 1e-3 and by 4 %
#: at 1e-2.
_STEP_EXACT, _STEP_FIXED = 1e-6, 1e-2
#: Two starts have found the same minimum if their χ² differ by less than this.
_SAME = 0.1
#: Largest number of fixed steps that are stored at a time.
_STRETCH = 400_000
#: Residual checks pass up to this many standard deviations.
SURPRISE = 4.0


@dataclass(frozen=True, eq=False)
class Problem:
    """Least-squares problem: a record, its axis and the free parameters."""

    measurement: Measurement
    axis: AxisParameters  #: values of the fixed parameters, and starts of the free ones
    instrument: Instrument
    names: tuple[str, ...]
    low: np.ndarray = field(repr=False)  #: lower bounds of the logarithms
    high: np.ndarray = field(repr=False)  #: upper bounds of the logarithms
    method: Tableau | None = None
    step_size: float | None = None

    def parameters(self, x: np.ndarray) -> AxisParameters:
        """Axis with the logarithms `x` of the free parameters; the setting K_1 stays fixed."""
        values = zip(self.names, np.exp(x).tolist(), strict=True)
        return self.axis.replace(K_1=self.axis.K_1, **dict(values))

    def model(self, points: Sequence[np.ndarray]) -> np.ndarray:
        """Signals (r, 3, n) of an ideal instrument at r points, in noise standard deviations."""
        y = np.array([self._states(self.parameters(x)) for x in points])
        return signals(y, self.measurement.elapsed, self.axis) / self.instrument.deviations

    def _states(self, p: AxisParameters) -> np.ndarray:
        """States (7, n) at the samples, computed in stretches if there are many fixed steps."""
        t, changes = self.measurement.elapsed, np.array(self.measurement.schedule)
        y, size = np.zeros((7, t.size)), t.size
        if self.step_size is not None:
            size = max(1, int(_STRETCH * self.step_size / t[1]))
        run = partial(simulate, p, method=self.method, step_size=self.step_size)
        for first in range(0, t.size - 1, size):
            at = t[first : first + size + 1] - t[first]
            now = np.searchsorted(changes[:, 0], t[first], side="right") - 1
            volts = [(max(0.0, time - t[first]), u) for time, u in changes[now:].tolist()]
            y[:, first : first + size + 1] = run(volts, float(at[-1]), y0=y[:, first])(at)
        return y

    @cached_property
    def line(self) -> np.ndarray:
        """Effect (n, 2) of a bias of 1 m/s² and a drift of 1 m/s³, in noise standard deviations."""
        t = self.measurement.elapsed
        return np.column_stack([np.ones_like(t), t]) / self.instrument.acceleration

    def detrended(self, curves: np.ndarray) -> np.ndarray:
        """Curves (..., 3, n) with the best-fitting accelerometer bias and drift removed."""
        basis, _ = np.linalg.qr(self.line)
        out = curves.copy()
        out[..., 2, :] -= curves[..., 2, :] @ basis @ basis.T
        return out

    def misfit(self, x: np.ndarray) -> np.ndarray:
        """Model minus record (3, n) in noise standard deviations."""
        return self.model([x])[0] - self.measurement.signals / self.instrument.deviations

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """Misfit (3n,) with bias and drift eliminated."""
        return self.detrended(self.misfit(x)).ravel()

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Jacobian (3n, k) of the residuals by one-sided differences within the bounds."""
        step = _STEP_EXACT if self.method is None else _STEP_FIXED
        steps = np.where(x + step <= self.high, step, -step)
        model = self.model([x, *(x + np.diag(steps))])
        slopes = (model[1:] - model[0]) / steps[:, None, None]
        return self.detrended(slopes).reshape(len(x), -1).T

    def solve(self, start: np.ndarray, slopes: np.ndarray | None = None) -> OptimizeResult:
        """Minimise from one start; `slopes` is a Jacobian near enough to serve throughout."""
        if not self.names:
            return OptimizeResult(x=start, cost=np.sum(self.residuals(start) ** 2) / 2)
        x0 = np.clip(start, self.low + 1e-9, self.high - 1e-9)
        jacobian = self.jacobian if slopes is None else lambda _: slopes
        ftol = 1e-10 if self.method is None else 1e-7  # a fixed step makes χ² discontinuous
        how = {"x_scale": "jac", "ftol": ftol, "xtol": 1e-9, "gtol": 1e-9, "max_nfev": 200}
        return least_squares(self.residuals, x0, jacobian, (self.low, self.high), **how)


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """Result of a fit: estimates, covariance and residuals."""

    problem: Problem
    logarithms: np.ndarray  #: (k,) of the estimates
    covariance: np.ndarray  #: (k, k) of the logarithms
    residuals: np.ndarray  #: (3, n) model minus record in noise standard deviations, detrended
    bias: float  #: of the accelerometer at the first sample, m/s²
    drift: float  #: of the accelerometer, m/s³
    start_chi_squared: np.ndarray  #: χ² at which each start ended
    nfev: int  #: residual evaluations of all starts
    converged: bool  #: whether the best start met a tolerance within its evaluation limit

    def __repr__(self) -> str:
        values = zip(self.names, self.values, strict=True)
        return f"<Fit: {', '.join(f'{name} = {value:.6g}' for name, value in values)}>"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the fitted parameters, in the order of all arrays."""
        return self.problem.names

    @property
    def values(self) -> np.ndarray:
        """Estimates (k,) in SI units."""
        return np.exp(self.logarithms)

    @property
    def standard_errors(self) -> np.ndarray:
        """Standard errors (k,) from the Jacobian and the instrument noise."""
        return self.values * np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> np.ndarray:
        """Correlation matrix (k, k) of the estimates."""
        deviations = np.sqrt(np.diag(self.covariance))
        return self.covariance / np.outer(deviations, deviations)

    @property
    def parameters(self) -> AxisParameters:
        """Axis with the estimated parameters."""
        return self.problem.parameters(self.logarithms)

    @property
    def saturation_current(self) -> tuple[float, float]:
        """Saturation current K_i V_L in A and its standard error (0 if V_L was fixed)."""
        p, errors = self.parameters, dict(zip(self.names, self.standard_errors, strict=True))
        return p.K_i * p.V_L, float(p.K_i * errors.get("V_L", 0.0))

    @property
    def chi_squared(self) -> float:
        """Sum χ² of the squared residuals in noise standard deviations."""
        return float(np.sum(self.residuals**2))

    @property
    def degrees_of_freedom(self) -> int:
        """Number of residuals minus fitted parameters, bias and drift."""
        return self.residuals.size - len(self.names) - 2

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """Parameters at a bound, whose estimates and standard errors are not reliable."""
        near = np.minimum(self.logarithms - self.problem.low, self.problem.high - self.logarithms)
        return tuple(np.array(self.names)[near < 1e-6].tolist())

    @property
    def other_minima(self) -> int:
        """Number of starts that ended in a minimum other than the best."""
        return int(np.sum(self.start_chi_squared > self.start_chi_squared.min() + _SAME))


def fit(
    measurement: Measurement,
    axis: AxisParameters,
    instrument: Instrument,
    *,
    names: Sequence[str] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    method: Tableau | None = None,
    step_size: float | None = None,
    starts: int = 5,
    seed: int = 0,
) -> Fit:
    """Estimate parameters of an axis from its measured motion.

    Parameters
    ----------
    measurement : Measurement
        The record.
    axis : AxisParameters
        Values of all parameters, and starts of the fitted ones. ``K_1`` is a known setting and
        stays fixed.
    instrument : Instrument
        Noise of the signals, used to weight the residuals.
    names : sequence of str, optional
        Parameters to fit; by default those of `NAMES` that are not zero or have bounds.
    bounds : mapping of name to (low, high), optional
        Positive range of a parameter; default 1/3 to 3 times the axis' value.
    method, step_size : optional
        Runge-Kutta method and step in s, as for `armsim.arm.simulate`; exact by default.
    starts : int
        Number of starts: one at the axis' values, the others spread over the bounds.
    seed : int
        Random seed of the spread.

    Returns
    -------
    Fit
        The fit from the best start.

    Raises
    ------
    TypeError, ValueError
        If a name is unknown or repeated, a bound or the number of starts is invalid, the set
        velocity is zero throughout, or no values can explain the record; see `implausible`.
    IntegrationError
        If a run fails, for example because the step is too coarse.

    Examples
    --------
    >>> from armsim.arm.identify import fit
    >>> from armsim.arm.files import read_axis, read_measurement
    >>> from armsim.paths import DATA
    >>> record = read_measurement(DATA / "measurements" / "x_axis_test.csv")
    >>> found = fit(record, *read_axis(DATA / "axes" / "x.toml"))
    >>> print(f"K_g = {found.values[3]:.3g} N/m, give or take {found.standard_errors[3]:.1g}")
    K_g = 5.41e+06 N/m, give or take 3e+03
    """
    checked_count("starts", starts)
    problem = posed(measurement, axis, instrument, names, bounds, method, step_size)
    low, high = problem.low, problem.high
    spread = qmc.LatinHypercube(len(low), seed=np.random.default_rng(seed)).random(starts - 1)
    first = np.log([getattr(axis, name) or 1e-300 for name in problem.names])
    ends = [problem.solve(start) for start in [first, *(low + spread * (high - low))]]
    best = min(ends, key=lambda end: end.cost)
    bias, drift = np.linalg.lstsq(problem.line, -problem.misfit(best.x)[2], rcond=None)[0].tolist()
    covariance, residuals = _covariance(problem.jacobian(best.x)), best.fun.reshape(3, -1)
    ended, nfev = np.array([2 * end.cost for end in ends]), sum(end.nfev for end in ends)
    return Fit(problem, best.x, covariance, residuals, bias, drift, ended, nfev, best.status > 0)


def posed(
    record: Measurement, axis: AxisParameters, noise: Instrument, names: Any, bounds: Any, *how: Any
) -> Problem:
    """Check the arguments of `fit`, which explains them, and return its problem."""
    checked_type("measurement", record, Measurement)
    if not record.set_velocity.any():
        raise ValueError("the set velocity is 0 V all the time: there is no motion to fit")
    for reason in implausible(record, axis, noise):
        raise ValueError(f"record: {reason}")
    given, known = dict(bounds or {}), [item.name for item in dataclasses.fields(axis)][:-1]
    if names is None:
        names = [name for name in NAMES if name in given or getattr(axis, name) > 0]
    if not names or not set(names) <= set(known) or len(set(names)) < len(names):
        needed = f"one or more different parameters are needed, of {', '.join(known)}"
        raise ValueError(f"names = {names!r}: {needed}")
    if extra := [name for name in given if name not in names]:
        raise ValueError(f"bounds for {', '.join(extra)}, not among the fitted {', '.join(names)}")
    values = {name: getattr(axis, name) for name in names}
    rows: dict[str, Any] = {n: (value / _RANGE, value * _RANGE) for n, value in values.items()}
    rows |= given
    for name, pair in rows.items():
        rows[name] = ends = reals(f"bounds of {name}", pair)
        if ends.shape != (2,) or not 0 < ends[0] < ends[1] < math.inf:
            why = " (it is 0 in the axis)" * (values[name] == 0)
            raise ValueError(f"bounds of {name}: {pair}; 0 < low < high are needed{why}")
    return Problem(record, axis, noise, tuple(names), *np.log([*rows.values()]).T, *how)


def _covariance(slopes: np.ndarray) -> np.ndarray:
    """Inverse of the information matrix; large but finite where the data are uninformative."""
    scale = np.linalg.norm(slopes, axis=0)
    scale[scale == 0] = 1.0
    _, s, basis = np.linalg.svd(slopes / scale, full_matrices=False)
    root = basis.T / np.maximum(s, 1e-12) / scale[:, None]
    return root @ root.T


# --- identifiability ----------------------------------------------------------------------------


def profile(fit: Fit, name: str, values: Sequence[float] | np.ndarray) -> np.ndarray:
    """Profile likelihood: the rise of χ² when one parameter is fixed and the others are refitted.

    Parameters
    ----------
    fit : Fit
        The best fit.
    name : str
        Name of a fitted parameter.
    values : (m,) array_like
        Positive values at which to fix it.

    Returns
    -------
    (m,) array
        χ² minus that of the fit. It equals `RISE` at the ends of the 95 % interval.

    Raises
    ------
    ValueError
        If the parameter was not fitted or a value is not positive.
    """
    at = np.asarray(values, dtype=float)
    if name not in fit.names:
        raise ValueError(f"{name!r} was not fitted; allowed are {', '.join(fit.names)}")
    if at.ndim != 1 or not (at > 0).all():
        raise ValueError(f"values = {values!r}: a row of positive numbers is needed")
    n, whole = fit.names.index(name), fit.problem
    rows = whole.names, whole.low, whole.high, fit.logarithms
    names, low, high, others = (np.delete(row, n) for row in rows)
    rest = dataclasses.replace(whole, names=tuple(names), low=low, high=high)
    rise, middle = np.empty(at.size), fit.values[n]
    # Each side is scanned outwards, and each refit starts from the one before.
    for side in (at >= middle, at < middle):
        start = others
        for m in sorted(np.flatnonzero(side), key=lambda m: abs(at[m] - middle)):
            axis = whole.axis.replace(**{"K_1": whole.axis.K_1, name: at[m]})
            end = dataclasses.replace(rest, axis=axis).solve(start)
            start, rise[m] = end.x, 2 * end.cost - fit.chi_squared
    return rise


@dataclass(frozen=True)
class Identifiability:
    """Identifiability of one parameter, meaningful only if the model passes `check_model`."""

    name: str
    relative_error: float  #: standard error divided by the value
    correlation: float  #: largest in magnitude, with `partner`
    partner: str
    interval: tuple[float, float]  #: 95 %, by profile likelihood; NaN beyond the bounds
    verdict: str


def identifiability(fit: Fit) -> list[Identifiability]:
    """Assess whether the data identify each fitted parameter.

    A parameter is identified if both ends of its 95 % profile-likelihood interval lie within the
    bounds. The verdict also names a parameter whose correlation exceeds 0.95 in magnitude.

    Parameters
    ----------
    fit : Fit
        The best fit.

    Returns
    -------
    list of Identifiability
        One per parameter, in the order of ``fit.names``.
    """
    found, correlation = [], fit.correlation
    np.fill_diagonal(correlation, 0.0)
    for n, name in enumerate(fit.names):
        k = int(np.argmax(np.abs(correlation[n])))
        partner, strength = fit.names[k] if k != n else "", float(correlation[n, k])
        interval = _end(fit, n, -1), _end(fit, n, 1)
        sides = zip(("below", "above"), interval, strict=True)
        missing = [side for side, end in sides if math.isnan(end)]
        verdict = f"not bounded from {' and '.join(missing)}" if missing else "identified"
        if abs(strength) > 0.95:
            verdict += f", together with {partner}"
        error = float(fit.standard_errors[n] / fit.values[n])
        found.append(Identifiability(name, error, strength, partner, interval, verdict))
    return found


def _end(fit: Fit, n: int, side: int) -> float:
    """One end of the 95 % profile-likelihood interval; NaN if it lies beyond the bounds."""
    bounds = float(fit.problem.low[n]), float(fit.problem.high[n])
    reach = side * math.sqrt(RISE) * math.sqrt(fit.covariance[n, n])

    best = inner = outer = float(fit.logarithms[n])

    def excess(x: float) -> float:
        rise = 0.0 if x == best else float(profile(fit, fit.names[n], [math.exp(x)])[0])
        return rise - RISE

    while True:
        outer = min(max(outer + reach, bounds[0]), bounds[1])
        if excess(outer) > 0:
            return math.exp(brentq(excess, inner, outer, xtol=0.01 * abs(reach)))
        if outer in bounds:
            return math.nan
        inner, reach = outer, 2 * reach


def bootstrap(
    fit: Fit, n: int = 1000, seed: int = 0, progress: Progress = iter, own_slopes: bool = False
) -> np.ndarray:
    """Parametric bootstrap: refit simulated records of the fitted motion with fresh noise.

    Parameters
    ----------
    fit : Fit
        The best fit, from which each refit starts.
    n : int
        Number of refits, at least 2.
    seed : int
        Random seed of the noise. Each refit has its own random stream, so the results do not
        depend on the number of workers.
    progress
        As for `armsim.parallel.each`, which runs the refits.
    own_slopes : bool
        Whether each refit computes its own slopes, which takes several times as long. Those at the
        fit move an estimate by a few per cent of its standard error.

    Returns
    -------
    (n, k) array
        Estimates in SI units, in the order of the fit's names.

    Raises
    ------
    ValueError
        If `n` is less than 2.
    CaseError
        If a refit fails.
    """
    checked_count("n", n, least=2)
    problem, start = fit.problem, fit.logarithms
    # Bias and drift are eliminated from the residuals, so the records omit them.
    ideal = problem.model([start])[0]
    slopes = None if own_slopes else problem.jacobian(start)

    def refit(stream: np.random.SeedSequence) -> np.ndarray:
        noise = np.random.default_rng(stream).standard_normal(ideal.shape)
        seen = zip(SIGNALS, (ideal + noise) * problem.instrument.deviations, strict=True)
        record = dataclasses.replace(problem.measurement, **dict(seen))
        return np.exp(dataclasses.replace(problem, measurement=record).solve(start, slopes).x)

    return np.array(parallel.each(refit, np.random.SeedSequence(seed).spawn(n), progress))


# --- model check --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Check:
    """Residual check of one signal."""

    signal: str
    chi_squared: float  #: per sample, near 1 if the model and the noise are correct
    autocorrelation: float  #: at lag one, near 0 if the model is correct
    surprise: float  #: larger of the two deviations, in standard deviations

    @property
    def passed(self) -> bool:
        """Whether the residuals are consistent with chance."""
        return self.surprise <= SURPRISE


def check_model(fit: Fit) -> list[Check]:
    """Test the size and the lag-one autocorrelation of the residuals against white noise.

    Parameters
    ----------
    fit : Fit
        The best fit.

    Returns
    -------
    list of Check
        One each for position, velocity and acceleration.
    """
    checks = []
    for signal, row in zip(SIGNALS, fit.residuals, strict=True):
        chi_squared = float(np.mean(row**2))
        autocorrelation = float(np.sum(row[1:] * row[:-1]) / np.sum(row**2))
        # χ² of n samples has variance 2n; the autocorrelation of white noise has variance 1/n.
        deviations = abs(chi_squared - 1) / math.sqrt(2), abs(autocorrelation)
        surprise = math.sqrt(row.size) * max(deviations)
        checks.append(Check(signal, chi_squared, autocorrelation, surprise))
    return checks
