"""Integration with a Butcher tableau, in additive or exponential form, fixed-step or adaptive."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Literal, NamedTuple

import numpy as np
from numba.core.errors import TypingError
from numba.extending import is_jitted

from armsim.checks import IntegrationError, checked_number, checked_times
from armsim.methods import trees
from armsim.methods.loops import FORMS, compiled_loop, python_loop
from armsim.methods.tableaux import Tableau

RightHandSide = Callable[..., Any]
Form = Literal["additive", "exponential", "exponential product", "as printed"]

#: Largest number of stored values; larger solutions are rejected to protect the memory.
MAX_STORED = 2**29
#: Largest state that is unrolled into scalars; longer code would compile slowly.
_UNROLLED = 16
#: Largest number of accepted steps in one call of an adaptive loop.
_CHUNK = 256


@dataclass(frozen=True)
class Solution:
    """Result of `integrate`; calling an adaptive one evaluates its continuous extension."""

    t: np.ndarray  #: (n,) times from ``t_span[0]`` to ``t_span[1]``
    y: np.ndarray  #: (m, n) states
    nfev: int  #: right-hand-side evaluations
    rejected: int = 0  #: steps rejected by the error control
    _interpolate: Callable[[np.ndarray], np.ndarray] | None = None

    def __call__(self, t: float | np.ndarray) -> np.ndarray:
        """State (m,) at a time, or (m, k) at k times, from the continuous extension.

        Raises
        ------
        ValueError
            If a time lies outside the run, or the run has no continuous extension.
        """
        if self._interpolate is None:
            raise ValueError("this solution has fixed steps and no continuous extension")
        times = checked_times(t, float(self.t[0]), float(self.t[-1]))
        y = self._interpolate(times)
        return y[:, 0] if np.ndim(t) == 0 else y


def integrate(
    fun: RightHandSide,
    t_span: tuple[float, float],
    y0: Sequence[float] | np.ndarray,
    tableau: Tableau,
    step_size: float | None = None,
    form: Form = "additive",
    args: tuple = (),
    *,
    shift: float | Sequence[float] | np.ndarray | None = None,
    rtol: float = 1e-6,
    atol: float | Sequence[float] | np.ndarray = 1e-9,
) -> Solution:
    r"""Integrate ẏ = f(t, y) with a fixed step, or with steps chosen by an embedded pair.

    Parameters
    ----------
    fun : callable
        ``fun(t, y, *args)`` returns the m derivatives, as for `scipy.integrate.solve_ivp`. A
        function compiled by numba runs inside a compiled loop; it is fastest if it accesses the
        components of `y` by index and returns a tuple.
    t_span : (float, float)
        First and last time. The last step is shortened to end there.
    y0 : (m,) array_like
        State at ``t_span[0]``.
    tableau : Tableau
        The method, such as `armsim.methods.tableaux.RK6`.
    step_size : float, optional
        Positive, also for backward integration with ``t_span[1] < t_span[0]``. By default `rtol`
        and `atol` control the step, which requires embedded weights (DP5).
    form : {"additive", "exponential", "exponential product", "as printed"}
        ``"additive"`` is the ordinary method. ``"exponential"`` is the same method in the
        variable :math:`\ln(y + s)`: stages are :math:`(y + s) \exp(h \sum a_{ij} k_j) - s` with
        :math:`k = f/(y + s)`. ``"exponential product"`` multiplies one exponential per term.
        ``"as printed"`` is the paper's eq. (13)-(16) literally, without step size and division;
        it is not consistent.
    args : tuple
        Further arguments of `fun`.
    shift : float or (m,) array_like, optional
        Shift s of the exponential form, default 0. ``y + s`` must stay positive.
    rtol, atol : float
        Tolerances of the error control. A step is accepted if the root mean square over the
        components of ``error / (atol + rtol |y|)`` is at most 1. `atol` may be an (m,) array.

    Returns
    -------
    Solution
        With ``t`` (n,), ``y`` (m, n) and ``nfev``.

    Raises
    ------
    ValueError, TypeError
        If an argument is out of range; the message gives its name, value and allowed range.
    IntegrationError
        If the solution blows up, reaches zero in the exponential form, or needs a step too small
        to change the time; the message gives the method, the step and the time.

    Examples
    --------
    >>> from armsim.methods import integrate, tableaux
    >>> run = integrate(lambda t, y: -y, (0, 1), [1.0], tableaux.RK6, 0.1)
    >>> print(f"{run.y[0, -1]:.8f} after {run.nfev} evaluations")
    0.36787944 after 70 evaluations
    """
    if not isinstance(tableau, Tableau):
        raise TypeError(f"tableau = {tableau!r}: a Tableau is needed, such as tableaux.RK6")
    start, end, y0 = _checked_problem(t_span, y0)
    problem = _Problem(fun, start, end, y0, tableau, form, _checked_shift(shift, y0, form), args)
    if step_size is None:
        return _adaptive(problem, *_checked_tolerances(problem, rtol, atol))
    return _fixed(problem, checked_number("step_size", step_size, above=0.0))


class _Problem(NamedTuple):
    """Checked arguments of `integrate`."""

    fun: RightHandSide
    start: float
    end: float
    y0: np.ndarray
    tableau: Tableau
    form: str
    shift: np.ndarray
    args: tuple

    def told(self, setting: str) -> str:
        return f"{self.tableau.name}, {self.form} form, {setting}"


def _fixed(problem: _Problem, step_size: float) -> Solution:
    _, start, end, y0, tableau, *_ = problem
    steps = abs(end - start) / step_size - 1e-9
    if (steps + 1) * (y0.size + 1) > MAX_STORED:
        raise ValueError(
            f"step_size = {step_size!r} would take {steps:.3g} steps from t = {start} to {end}; "
            f"at most {MAX_STORED // (y0.size + 1) - 1:.3g} can be stored"
        )
    steps = max(math.ceil(steps), 0)
    t = np.arange(steps + 1.0)
    step = math.copysign(step_size, end - start)
    t *= step
    t += start
    t[-1] = end
    y = np.empty((y0.size, steps + 1))
    y[:, 0] = y0
    loop, state = _loop(problem)
    with np.errstate(all="ignore"):  # a blow-up is reported below, once
        loop(t, step, state(y0), state(problem.shift), y, problem.args)
    _raise_if_lost(problem, t, y, f"step size {step_size:g}")
    return Solution(t, y, steps * len(tableau.evaluated_stages))


def _adaptive(problem: _Problem, rtol: float, atol: np.ndarray) -> Solution:
    """Integrate with steps chosen by the embedded pair; results are collected in chunks."""
    _, t, end, y, tableau, _, s, args = problem
    m, stages, setting = y.size, tableau.stages, f"rtol {rtol:g}"
    loop, state = _loop(problem, adaptive=True)
    power = -0.5 / (_lower_order(tableau) + 1)
    h, nfev = _first_step(problem, atol + rtol * np.abs(y), 2 * power)
    times, states, slopes, rejected = [np.array([t])], [y[:, None]], [], 0
    tolerances = rtol, state(atol), power
    while t != end:
        room = np.empty(_CHUNK), np.empty((m, _CHUNK)), np.empty((_CHUNK, stages, m))
        with np.errstate(all="ignore"):
            n, lost, t, h = loop(t, end, h, state(y), state(s), *tolerances, *room, args)
        times.append(room[0][:n])
        states.append(room[1][:, :n])
        slopes.append(room[2][:n])
        rejected += lost
        nfev += 1 + (n + lost) * (stages - 1) + (0 if tableau.fsal else n)
        if n:
            y = states[-1][:, -1].copy()
            _raise_if_lost(problem, times[-1], states[-1], setting)
        if t != end and n < _CHUNK:
            raise IntegrationError(
                f"{problem.told(setting)}: the step size fell to {h:.3g} at t = {t:.6g}"
            )
    run = Solution(np.concatenate(times), np.concatenate(states, axis=1), nfev, rejected)
    if tableau.interpolant is None or len(run.t) == 1:
        return run
    return replace(run, _interpolate=_extension(problem, run, np.concatenate(slopes)))


@cache
def _lower_order(tableau: Tableau) -> int:
    """Lower order of an embedded pair; cached because the exact computation is slow."""
    embedded = Tableau(f"{tableau.name} embedded", tableau.A, tableau.b_embedded)
    return min(trees.order(tableau), trees.order(embedded))


def _first_step(problem: _Problem, scale: np.ndarray, power: float) -> tuple[float, int]:
    """Starting step of Hairer, Nørsett and Wanner I, section II.4, and its evaluations of `fun`."""
    fun, t, end, y0, *_, args = problem
    if t == end:
        return 0.0, 0

    def norm(v: np.ndarray) -> float:
        return float(np.sqrt(np.mean((v / scale) ** 2)))

    slope = _as_slope(fun(t, y0, *args), y0)
    d0, d1 = norm(y0), norm(slope)
    h0 = 1e-6 if min(d0, d1) < 1e-5 else 0.01 * d0 / d1
    h0 = math.copysign(min(h0, abs(end - t)), end - t)
    change = _as_slope(fun(t + h0, y0 + h0 * slope, *args), y0) - slope
    largest = max(d1, norm(change) / abs(h0))
    h1 = max(1e-6, abs(h0) * 1e-3) if largest <= 1e-15 else (0.01 / largest) ** -power
    return math.copysign(min(100 * abs(h0), h1, abs(end - t)), end - t), 2


@cache
def _interpolant(tableau: Tableau) -> np.ndarray:
    assert tableau.interpolant is not None
    return np.array(tableau.interpolant.tolist(), dtype=float)


def _extension(
    problem: _Problem, run: Solution, slopes: np.ndarray
) -> Callable[[np.ndarray], np.ndarray]:
    """Continuous extension y(t + θh): the left end of a step moved along Σ b_i(θ) k_i."""
    P, s = _interpolant(problem.tableau), problem.shift
    direction = 1 if run.t[-1] >= run.t[0] else -1

    def interpolate(times: np.ndarray) -> np.ndarray:
        n = np.searchsorted(direction * run.t, direction * times, side="right") - 1
        n = np.clip(n, 0, run.t.size - 2)
        h = run.t[n + 1] - run.t[n]
        powers = ((times - run.t[n]) / h)[:, None] ** np.arange(1, P.shape[1] + 1)
        z = h * np.einsum("nsm,sq,nq->mn", slopes[n], P, powers)
        left = run.y[:, n]
        return (
            left + z if problem.form == "additive" else (left + s[:, None]) * np.exp(z) - s[:, None]
        )

    return interpolate


# --- checks of arguments and results ----------------------------------------------------------


def _checked_problem(t_span: Any, y0: Any) -> tuple[float, float, np.ndarray]:
    try:
        start, end = map(float, t_span)
    except (TypeError, ValueError) as error:
        raise ValueError(f"t_span = {t_span!r}: two numbers are needed") from error
    if not (math.isfinite(start) and math.isfinite(end)):
        raise ValueError(f"t_span = {t_span!r}: both times must be finite")
    if np.iscomplexobj(y0):
        raise ValueError(f"y0 = {y0}: the components must be real")
    y0 = np.array(y0, dtype=float)
    if y0.ndim != 1 or y0.size == 0:
        raise ValueError(f"y0 has shape {y0.shape}; one row of at least one number is needed")
    if not np.isfinite(y0).all():
        raise ValueError(f"y0 = {y0}: every component must be finite")
    return start, end, y0


def _checked_shift(shift: Any, y0: np.ndarray, form: str) -> np.ndarray:
    """Shift (m,) of the components, zero by default."""
    if form not in FORMS:
        raise ValueError(f"form = {form!r} is not known; allowed are {list(FORMS)}")
    if shift is None:
        s = np.zeros(y0.size)
    elif form == "additive":
        raise ValueError(f"shift = {shift!r}: the additive form has no shift")
    else:
        s = np.array(shift, dtype=float)
        if s.ndim > 1 or s.size not in (1, y0.size) or not np.isfinite(s).all():
            raise ValueError(
                f"shift = {shift!r}: one finite number is needed, or {y0.size}, one a component"
            )
        s = np.broadcast_to(s, y0.shape).copy()
    if form.startswith("exponential") and (y0 + s <= 0).any():
        worst = int(np.argmin(y0 + s))
        raise ValueError(
            f"y0[{worst}] = {y0[worst]:g} with shift {s[worst]:g}: the exponential form needs "
            "y0 + shift > 0 in every component, since it takes its logarithm"
        )
    return s


def _checked_tolerances(
    problem: _Problem, rtol: float, atol: float | Sequence[float] | np.ndarray
) -> tuple[float, np.ndarray]:
    tableau = problem.tableau
    if tableau.b_embedded is None:
        raise ValueError(
            f"step_size is missing, and {tableau.name} has no embedded weights to control it with"
        )
    atol = np.broadcast_to(np.asarray(atol, dtype=float), problem.y0.shape).copy()
    if not (np.isfinite(atol).all() and (atol >= 0).all()):
        raise ValueError(f"atol = {atol}: every component must be finite and not negative")
    return checked_number("rtol", rtol, above=0.0), atol


def _raise_if_lost(problem: _Problem, t: np.ndarray, y: np.ndarray, setting: str) -> None:
    """Raise an error at the first state that is not finite or, if exponential, not positive."""
    positive, s = problem.form.startswith("exponential"), problem.shift
    last = y[:, -1]
    if np.isfinite(last).all() and not (positive and (last + s <= 0).any()):
        return  # a component that is not finite, or zero, remains so
    lost = ~np.isfinite(y)
    if positive:
        lost |= y + s[:, None] <= 0
    if lost.any():
        n = int(np.argmax(lost.any(axis=0)))
        which = int(np.argmax(lost[:, n]))
        finite = np.isfinite(y[which, n])
        what = "reached zero, where the exponential form ends," if finite else "blew up"
        raise IntegrationError(
            f"{problem.told(setting)}: component {which} {what} at t = {t[n]:.6g}, step {n}"
        )


def _as_slope(value: Any, y: np.ndarray) -> np.ndarray:
    slope = np.asarray(value, dtype=float)
    if slope.shape != y.shape:
        raise ValueError(
            f"the right-hand side returned an array of shape {slope.shape}; the state has "
            f"{y.shape[0]} components"
        )
    return slope


# --- choice of the loop -----------------------------------------------------------------------


def _loop(problem: _Problem, adaptive: bool = False) -> tuple[Callable, Callable]:
    """Return the loop for a right-hand side, and the conversion of an array to its state type."""
    fun, start, _, y0, tableau, form, _, args = problem
    if not is_jitted(fun):
        checked = lambda t, y, *args: _as_slope(fun(t, y, *args), y)  # noqa: E731
        return python_loop(checked, tableau, form, adaptive), np.asarray
    if y0.size <= _UNROLLED and _takes_tuples(fun, start, tuple(y0.tolist()), args):
        return compiled_loop(fun, tableau, y0.size, form, adaptive), lambda y: tuple(y.tolist())
    slope = fun(start, y0, *args)
    _as_slope(slope, y0)
    if isinstance(slope, tuple):
        raise ValueError(
            "the compiled right-hand side returns a tuple, so it has to take one, which works up "
            f"to {_UNROLLED} components; let it return an array"
        )
    return compiled_loop(fun, tableau, None, form, adaptive), np.asarray


def _takes_tuples(fun: RightHandSide, start: float, state: tuple[float, ...], args: tuple) -> bool:
    """Whether a compiled `fun` maps a tuple of scalars to a tuple of the same length."""
    try:
        slope = fun(start, state, *args)
    except (TypingError, TypeError):  # TypeError: compiled for fixed signatures
        return False
    return isinstance(slope, tuple) and len(slope) == len(state)
