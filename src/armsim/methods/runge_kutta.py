"""Integration with a Butcher tableau, in additive or exponential form, fixed-step or adaptive."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any, Literal, NamedTuple

import numpy as np
from numba.core.errors import TypingError
from numba.extending import is_jitted

from armsim import checks
from armsim.checks import IntegrationError, reals
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


@dataclass(frozen=True, eq=False, repr=False)
class Solution:
    """Result of `integrate`; calling an adaptive one evaluates its continuous extension."""

    t: np.ndarray  #: (n,) times from ``t_span[0]`` to ``t_span[1]``
    y: np.ndarray  #: (m, n) states
    nfev: int  #: right-hand-side evaluations
    rejected: int = 0  #: steps rejected by the error control
    _interpolate: Callable[[np.ndarray], np.ndarray] | None = None

    def __repr__(self) -> str:
        return f"<Solution: {len(self.y)} states, {self.t.size} times to t = {self.t[-1]:g}>"

    def __call__(self, t: float | np.ndarray) -> np.ndarray:
        """State (m,) at a time, or (m, k) at k times, from the continuous extension.

        Raises
        ------
        ValueError
            If a time lies outside the run, or the run has no continuous extension.
        IntegrationError
            If the extension is not finite at a time.
        """
        if self._interpolate is None:
            raise ValueError(f"t = {t!r}: only adaptive runs with an interpolant have such a state")
        times = checks.checked_times(t, float(self.t[0]), float(self.t[-1]))
        y = self._interpolate(times)
        if not (finite := np.isfinite(y).all(axis=0)).all():
            lost = times[~finite][0]
            raise IntegrationError(f"the interpolation is not finite at t = {lost:.12g}")
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
    max_steps: int = 100_000,
) -> Solution:
    r"""Integrate ẏ = f(t, y) with a fixed step, or with steps chosen by an embedded pair.

    Parameters
    ----------
    fun : callable
        ``fun(t, y, *args)`` returns the m derivatives, as for `scipy.integrate.solve_ivp`. A
        function compiled by numba runs inside a compiled loop; it is fastest if it accesses the
        components of `y` by index and returns a tuple.
    t_span : (float, float)
        First and last time. The last step is shortened to end there. So far from zero that the
        rounding of times counts, the length of each step is the difference of its rounded ends.
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
        components of ``error / (atol + rtol |y|)`` is at most 1. `rtol` is at least
        2.22e-14, a hundred roundings as in SciPy; `atol` may be an (m,) array.
    max_steps : int
        Largest number of accepted steps under error control. Each is stored with its stages.

    Returns
    -------
    Solution
        With ``t`` (n,), ``y`` (m, n) and ``nfev``.

    Raises
    ------
    ValueError, TypeError
        If an argument is out of range; the message gives its name, value and allowed range.
    IntegrationError
        If the solution blows up, reaches zero in the exponential form, needs a step too small to
        change the time, or more steps than `max_steps` or than can be stored; the message gives
        the method, the step and the time.

    Examples
    --------
    >>> from armsim.methods import integrate, tableaux
    >>> run = integrate(lambda t, y: -y, (0, 1), [1.0], tableaux.RK6, 0.1)
    >>> print(f"{run.y[0, -1]:.8f} after {run.nfev} evaluations")
    0.36787944 after 70 evaluations
    """
    checks.checked_type("tableau", tableau, Tableau, "tableaux.RK6")
    start, end = checks.checked_row("t_span", t_span, 2).tolist()
    y0 = checks.checked_row("y0", y0)
    if not math.isfinite(end - start):
        raise ValueError(f"t_span = {t_span!r}: the difference of the two is not finite")
    checks.checked_type("args", args, tuple, "({!r},)")
    s = checked_shift(shift, y0, form)
    if step_size is None:
        tolerances = _checked_tolerances(tableau, y0, rtol, atol)
        max_steps = checks.checked_count("max_steps", max_steps)
        setting = f"rtol {tolerances[0]:g}"
    else:
        step_size = checks.checked_number("step_size", step_size, above=0.0)
        setting = f"step size {step_size:g}"
    problem = Problem(fun, start, end, y0, tableau, form, s, args, setting)
    with np.errstate(all="ignore"):  # a blow-up is reported as an error
        if step_size is None:
            return _adaptive(problem, tolerances, max_steps)
        return _fixed(problem, step_size)


class Problem(NamedTuple):
    """Checked arguments of `integrate`."""

    fun: RightHandSide
    start: float
    end: float
    y0: np.ndarray
    tableau: Tableau
    form: str
    shift: np.ndarray
    args: tuple
    setting: str  #: step size or tolerance, for messages

    def error(self, text: str) -> IntegrationError:
        """Error that says which method failed, and how."""
        return IntegrationError(f"{self.tableau.name}, {self.form} form, {self.setting}: {text}")


def step_count(start: float, end: float, step_size: float, most: float = math.inf) -> int:
    """Number of fixed steps between two times, the last one shortened.

    Raises
    ------
    ValueError
        If there are more than `most`, or the step is smaller than the distance between floats.
    """
    span, spacing = abs(end - start), math.ulp(max(abs(start), abs(end)))
    if span <= step_size:
        return int(span > 0)
    if step_size < spacing:
        raise ValueError(f"step_size = {step_size!r} is below the spacing of times, {spacing:.3g}")
    # A remainder below rounding does not count as a step.
    steps = math.ceil(span / step_size - max(1e-9, spacing / step_size))
    if steps > most:
        told = f"step_size = {step_size!r} would take {steps:.3g} steps"
        raise ValueError(f"{told} from t = {start} to {end}; at most {most:.3g} can be stored")
    return steps


def _rounded(start: float, end: float) -> bool:
    """Whether the times are so large that their rounding counts beside their span."""
    return math.ulp(max(abs(start), abs(end))) > 2**-43 * abs(end - start)


def _fixed(problem: Problem, step_size: float) -> Solution:
    _, start, end, y0, tableau, *_ = problem
    steps = step_count(start, end, step_size, MAX_STORED // (y0.size + 1) - 1)
    step = math.copysign(step_size, end - start)
    t = start + step * np.arange(steps + 1.0)
    t[-1] = end
    y = np.empty((y0.size, steps + 1))
    y[:, 0] = y0
    loop, state = loop_for(problem)
    loop(t, step, _rounded(start, end), state(y0), state(problem.shift), y, problem.args)
    raise_if_lost(problem, t, y)
    return Solution(t, y, steps * len(tableau.evaluated_stages))


def _adaptive(problem: Problem, tolerances: Any, max_steps: int) -> Solution:
    """Integrate with steps chosen by the embedded pair; results are collected in chunks."""
    (_, t, end, y, tableau, _, s, args, _), (rtol, atol) = problem, tolerances
    m, stages, rounded = y.size, tableau.stages, _rounded(t, end)
    most = min(max_steps, MAX_STORED // (1 + m + m * stages))
    loop, state = loop_for(problem, adaptive=True)
    power = -0.5 / (_lower_order(tableau) + 1)
    h, nfev = _first_step(problem, atol + rtol * np.abs(y), 2 * power)
    times, states, slopes = [np.array([t])], [y[:, None]], [np.empty((0, stages, m))]
    taken = rejected = 0
    settings = state(s), rtol, state(atol), power
    while t != end:
        size = min(_CHUNK, most - taken)
        if size == 0:
            limit = f"max_steps = {max_steps}" if most == max_steps else "the limit of memory"
            raise problem.error(f"stopped at t = {t:.12g} after {most} steps, {limit}")
        room = np.empty(size), np.empty((m, size)), np.empty((size, stages, m))
        n, lost, t, h = loop(t, end, h, rounded, state(y), *settings, *room, args)
        times.append(room[0][:n])
        states.append(room[1][:, :n])
        slopes.append(room[2][:n])
        rejected += lost
        nfev += 1 + (n + lost) * (stages - 1) + (0 if tableau.fsal else n)
        if n:
            y = states[-1][:, -1].copy()
            raise_if_lost(problem, times[-1], states[-1], taken + 1)
        taken += n
        if t != end and n < size:
            fall = f"the step size fell to {h:.3g} at t = {t:.12g}"
            raise problem.error(f"{fall}, where the spacing of times is {math.ulp(t):.3g}")
    steps = np.concatenate(times), np.concatenate(states, axis=1)
    # Without the right-hand side, so that a solution can be pickled.
    extension = partial(_extended, tableau, s, problem.form, *steps, np.concatenate(slopes))
    return Solution(*steps, nfev, rejected, None if tableau.interpolant is None else extension)


@cache
def _lower_order(tableau: Tableau) -> int:
    """Lower order of an embedded pair; cached because the exact computation is slow."""
    return min(trees.order(tableau), trees.order(replace(tableau, b=tableau.b_embedded)))


def _first_step(problem: Problem, scale: np.ndarray, power: float) -> tuple[float, int]:
    """Starting step of Hairer, Nørsett and Wanner I, section II.4, and its evaluations of `fun`."""
    fun, t, end, y0, *_, args, _ = problem
    if t == end:
        return 0.0, 0

    def norm(v: np.ndarray) -> float:
        return float(np.sqrt(np.mean((v / scale) ** 2)))

    slope = _as_slope(fun(t, y0, *args), y0)
    if not math.isfinite(norm(slope)):
        raise problem.error(f"the right-hand side is too large or not finite at t = {t:.12g}")
    d0, d1 = norm(y0), norm(slope)
    h0 = 1e-6 if min(d0, d1) < 1e-5 else 0.01 * d0 / d1
    h0 = math.copysign(min(h0, abs(end - t)), end - t)
    change = norm(_as_slope(fun(t + h0, y0 + h0 * slope, *args), y0) - slope) / abs(h0)
    largest = max(d1, change if change < math.inf else 0.0)
    h1 = max(1e-6, abs(h0) * 1e-3) if largest <= 1e-15 else (0.01 / largest) ** -power
    h = max(min(100 * abs(h0), h1), 10 * math.ulp(t))
    return math.copysign(min(h, abs(end - t)), end - t), 2


def hermite(s: Any, h: Any, before: Any, after: Any, slope: Any, slope_after: Any) -> Any:
    """Cubic Hermite interpolation of a step of length h at the share s of it."""
    return (
        before * (1 + 2 * s) * (1 - s) ** 2
        + after * s**2 * (3 - 2 * s)
        + h * s * (1 - s) * (slope * (1 - s) - slope_after * s)
    )


@cache
def _interpolant(tableau: Tableau) -> np.ndarray:
    return np.array(tableau.interpolant, dtype=float)


def _extended(tableau: Any, shift: Any, form: str, t: Any, y: Any, slopes: Any, times: Any) -> Any:
    """Continuous extension y(t + θh): the left end of a step moved along Σ b_i(θ) k_i."""
    if t.size == 1:  # a run of no length
        return np.repeat(y, times.size, axis=1)
    P, s, direction = _interpolant(tableau), shift[:, None], np.sign(t[-1] - t[0])
    n = np.searchsorted(direction * t, direction * times, side="right") - 1
    n = np.clip(n, 0, t.size - 2)
    h, left = t[n + 1] - t[n], y[:, n]
    powers = ((times - t[n]) / h)[:, None] ** np.arange(1, P.shape[1] + 1)
    z = h * np.einsum("nsm,sq,nq->mn", slopes[n], P, powers)
    return left + z if form == "additive" else (left + s) * np.exp(z) - s


# --- checks of arguments and results ----------------------------------------------------------


def _per_component(name: str, value: Any, size: int) -> np.ndarray:
    """Return finite numbers, one for each component, from such a row or from one number."""
    numbers = reals(name, value)
    if numbers.ndim > 1 or numbers.size not in (1, size) or not np.isfinite(numbers).all():
        raise ValueError(f"{name} = {value!r}: a finite number is needed, or {size} of them")
    return np.full(size, numbers)


def checked_shift(shift: Any, y0: np.ndarray, form: str) -> np.ndarray:
    """Shift (m,) of the components, zero by default."""
    if form not in FORMS:
        raise ValueError(f"form = {form!r} is not known; allowed are {list(FORMS)}")
    if shift is not None and form == "additive":
        raise ValueError(f"shift = {shift!r}: the additive form has no shift")
    s = np.zeros(y0.size) if shift is None else _per_component("shift", shift, y0.size)
    if form.startswith("exponential") and (y0 + s <= 0).any():
        worst = int(np.argmin(y0 + s))
        found = f"y0[{worst}] = {y0[worst]:g} with shift {s[worst]:g}"
        raise ValueError(f"{found}: the exponential form needs y0 + shift > 0, for its logarithm")
    return s


def _checked_tolerances(tableau: Tableau, y0: np.ndarray, rtol: float, atol: Any) -> Any:
    """Return `rtol` and `atol` (m,), for a tableau that has an error estimate."""
    if tableau.b_embedded is None:
        raise ValueError(f"step_size is missing, and {tableau.name} has no embedded weights for it")
    if checks.checked_number("rtol", rtol) < 100 * 2.0**-52:  # rounding would choose the step
        raise ValueError(f"rtol = {rtol!r} is not allowed; it must be at least 2.22e-14")
    scale = _per_component("atol", atol, y0.size)
    if ((scale < 0) | (scale + np.abs(y0) == 0)).any():
        raise ValueError(f"atol = {atol!r}: it must not be negative, and not 0 where y0 is 0")
    return float(rtol), scale


def raise_if_lost(problem: Problem, t: np.ndarray, y: np.ndarray, first: int = 0) -> None:
    """Raise an error at the first state that is not finite or, if exponential, not positive.

    The first state given is the one after step number `first`.
    """
    # A lost state stays lost, because each is the one before plus a change, or times a factor. Only
    # y + shift may round to 0 for a while. To read all states took a fifth of a run of Euler's.
    last, positive = y[:, -1], problem.form.startswith("exponential")
    if np.isfinite(last).all() and not (positive and ((last <= 0).any() or problem.shift.any())):
        return
    lost = ~np.isfinite(y)
    if positive:
        lost |= y + problem.shift[:, None] <= 0
    if lost.any():
        n = int(np.argmax(lost.any(axis=0)))
        which = int(np.argmax(lost[:, n]))
        finite = np.isfinite(y[which, n])
        what = "reached zero, where the exponential form ends," if finite else "blew up"
        raise problem.error(f"component {which} {what} at t = {t[n]:.12g}, step {first + n}")


def _as_slope(value: Any, y: np.ndarray) -> np.ndarray:
    slope = np.asarray(value, dtype=y.dtype)
    if slope.shape != y.shape:
        raise ValueError(f"fun returned shape {slope.shape}; the state has {y.size} components")
    return slope


# --- choice of the loop -----------------------------------------------------------------------


def loop_for(problem: Problem, adaptive: bool = False) -> tuple[Callable, Callable]:
    """Return the loop for a right-hand side, and the conversion of an array to its state type."""
    fun, start, _, y0, tableau, form, _, args, _ = problem
    if not is_jitted(fun):
        checked = lambda t, y, *args: _as_slope(fun(t, y, *args), y)  # noqa: E731
        return python_loop(checked, tableau, form, adaptive), np.asarray
    if y0.size <= _UNROLLED and _takes_tuples(fun, start, tuple(y0.tolist()), args):
        return compiled_loop(fun, tableau, y0.size, form, adaptive), lambda y: tuple(y.tolist())
    slope = fun(start, y0, *args)
    _as_slope(slope, y0)
    if isinstance(slope, tuple):
        tuples = f"a tuple has to take one, which works up to {_UNROLLED} components"
        raise ValueError(f"a compiled right-hand side that returns {tuples}; return an array")
    return compiled_loop(fun, tableau, None, form, adaptive), np.asarray


def _takes_tuples(fun: RightHandSide, start: float, state: tuple[float, ...], args: tuple) -> bool:
    """Whether a compiled `fun` maps a tuple of scalars to a tuple of the same length."""
    try:
        slope = fun(start, state, *args)
    except (TypingError, TypeError):  # TypeError: compiled for fixed signatures
        return False
    return isinstance(slope, tuple) and len(slope) == len(state)
