"""Integration with a Butcher tableau at a fixed step, in additive or exponential form.

The loop is generated from the tableau as straight-line code: coefficients are literals, products
with zero do not appear, and stages that the weights never reach are not evaluated. The same
source serves a plain Python right-hand side, where the state is one array, and a compiled one,
where it is unrolled into scalars and the whole loop, right-hand side inlined, is machine code.
"""

import hashlib
import inspect
import math
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numba import njit
from numba.core.errors import TypingError
from numba.extending import is_jitted

from armsim.methods.tableaux import Tableau

Form = Literal["additive", "exponential"]

#: Solutions of more than this many numbers are refused rather than exhaust the memory.
MAX_STORED = 2**29


class IntegrationError(ArithmeticError):
    """The solution could not be continued."""


@dataclass(frozen=True)
class Solution:
    """Result of `integrate`."""

    t: np.ndarray  #: (n,) times, first and last those of ``t_span``
    y: np.ndarray  #: (m, n) states
    nfev: int  #: right-hand-side evaluations


def integrate(
    fun: Callable[..., Any],
    t_span: tuple[float, float],
    y0: Sequence[float] | np.ndarray,
    tableau: Tableau,
    step_size: float,
    form: Form = "additive",
    args: tuple = (),
) -> Solution:
    r"""Integrate ẏ = f(t, y) with a fixed step.

    Parameters
    ----------
    fun : callable
        ``fun(t, y, *args)`` gives the m derivatives, as for `scipy.integrate.solve_ivp`. A
        function compiled by numba is run inside a compiled loop; it is fastest if it takes the
        components of `y` by index and returns a tuple.
    t_span : (float, float)
        First and last time. The last step is shortened to end there.
    y0 : (m,) array_like
        State at ``t_span[0]``.
    tableau : Tableau
        The method, such as `armsim.methods.tableaux.RK6`.
    step_size : float
        Positive; time runs backwards if ``t_span[1] < t_span[0]``.
    form : {"additive", "exponential"}
        ``"additive"`` is the ordinary method. ``"exponential"`` applies it to :math:`\ln y`: the
        stages are :math:`y \exp(h \sum a_{ij} k_j)` with :math:`k = f/y`; every component has
        to be positive.
    args : tuple
        Further arguments of `fun`.

    Returns
    -------
    Solution
        With ``t`` (n,), ``y`` (m, n) and ``nfev``.

    Raises
    ------
    ValueError
        If an argument is out of range; the message names it, its value and what is allowed.
    IntegrationError
        If the solution blows up; the message names the method, the step and the time.

    Examples
    --------
    >>> from armsim.methods import integrate, tableaux
    >>> run = integrate(lambda t, y: -y, (0, 1), [1.0], tableaux.RK6, 0.1)
    >>> print(f"{run.y[0, -1]:.8f} after {run.nfev} evaluations")
    0.36787944 after 70 evaluations
    """
    start, end, y0 = _checked(t_span, y0, step_size, form)
    steps = max(math.ceil(abs(end - start) / step_size - 1e-9), 0)
    if (steps + 1) * (y0.size + 1) > MAX_STORED:
        raise ValueError(
            f"step_size = {step_size!r} would take {steps:.3g} steps from t = {start} to {end}; "
            f"at most {MAX_STORED // (y0.size + 1) - 1:.3g} can be stored"
        )
    t = start + math.copysign(step_size, end - start) * np.arange(steps + 1)
    t[-1] = end
    y = np.empty((y0.size, steps + 1))
    y[:, 0] = y0
    loop, state = _loop(fun, tableau, form, start, y0, args)
    with np.errstate(all="ignore"):  # a blow-up is reported below, once
        loop(t, state, y, args)
    _raise_if_not_finite(t, y, f"{tableau.name}, {form} form, step size {step_size:g}")
    return Solution(t, y, steps * len(tableau.evaluated_stages))


# --- input and output -------------------------------------------------------------------------


def _checked(t_span, y0, step_size, form) -> tuple[float, float, np.ndarray]:
    try:
        start, end = map(float, t_span)
    except (TypeError, ValueError) as error:
        raise ValueError(f"t_span = {t_span!r}: two numbers are needed") from error
    if not (math.isfinite(start) and math.isfinite(end)):
        raise ValueError(f"t_span = {t_span!r}: both times must be finite")
    if isinstance(step_size, bool) or not (math.isfinite(step_size) and step_size > 0):
        raise ValueError(f"step_size = {step_size!r} is not allowed; it must be finite and positive")
    y0 = np.asarray(y0, dtype=float)
    if y0.ndim != 1 or y0.size == 0:
        raise ValueError(f"y0 has shape {y0.shape}; one row of at least one number is needed")
    if not np.isfinite(y0).all():
        raise ValueError(f"y0 = {y0}: every component must be finite")
    if form not in _FORMS:
        raise ValueError(f"form = {form!r} is not known; allowed are {list(_FORMS)}")
    if form == "exponential" and (y0 <= 0).any():
        raise ValueError(
            f"y0[{np.argmin(y0)}] = {y0.min()}: the exponential form needs positive components, "
            "since it divides by them and takes their logarithm"
        )
    return start, end, y0


def _raise_if_not_finite(t: np.ndarray, y: np.ndarray, method: str) -> None:
    if np.isfinite(y[:, -1]).all():  # what is not finite once stays so
        return
    bad = ~np.isfinite(y)
    first = int(np.argmax(bad.any(axis=0)))
    raise IntegrationError(
        f"{method}: the solution blew up; component {int(np.argmax(bad[:, first]))} is not finite "
        f"at t = {t[first]:.6g}, after {first} steps"
    )


# --- the generated loop -----------------------------------------------------------------------

#: form: (state moved by z = h Σ a k, slope of that state)
_FORMS = {"additive": ("{y} + {z}", "{f}"), "exponential": ("{y}*exp({z})", "{f}/{u}")}


def loop_source(tableau: Tableau, size: int | None, form: Form = "additive") -> str:
    """Source of the fixed-step loop ``loop(t, y, out, args)``.

    Parameters
    ----------
    tableau : Tableau
        The method.
    size : int or None
        Number of components into which the state is unrolled; with None it stays one array.
    form : {"additive", "exponential"}
        See `integrate`.

    Returns
    -------
    str
        Python source that calls ``fun`` and, in the exponential form, ``exp``.
    """
    moved, slope = _FORMS[form]
    A, b, c = tableau.floats()
    parts = [""] if size is None else [f"_{j}" for j in range(size)]
    comma = "" if size is None else ","

    def names(letter: str) -> str:
        return ", ".join(f"{letter}{part}" for part in parts) + comma

    def combination(weights: np.ndarray, part: str) -> str:
        terms = [f"{w!r}*k{j}{part}" for j, w in enumerate(weights.tolist()) if w]
        z = f"h*({' + '.join(terms)})"
        return moved.format(y=f"y{part}", z=z) if terms else f"y{part}"

    lines = ["def loop(t, y, out, args):", f"    {names('y')} = y"]
    lines += ["    for n in range(t.size - 1):", "        h = t[n + 1] - t[n]"]
    for i in tableau.evaluated_stages:
        lines += [f"        u{part} = {combination(A[i], part)}" for part in parts]
        state = f"({names('u')})" if comma else "u"
        lines.append(f"        {names('f')} = fun(t[n] + {float(c[i])!r}*h, {state}, *args)")
        lines += [
            f"        k{i}{part} = {slope.format(f=f'f{part}', u=f'u{part}')}" for part in parts
        ]
    lines += [f"        y{part} = {combination(b, part)}" for part in parts]
    rows = [":"] if size is None else range(size)
    lines += [f"        out[{row}, n + 1] = y{part}" for row, part in zip(rows, parts, strict=True)]
    return "\n".join(lines) + "\n"


#: States of up to this many components are unrolled; longer code would compile slowly.
_UNROLLED = 16


def _loop(fun, tableau, form, start, y0, args) -> tuple[Callable[..., None], Any]:
    """Loop for this right-hand side, and the initial state as it takes it."""
    if not is_jitted(fun):
        return _python_loop(fun, tableau, form), y0
    unrolled = y0.size <= _UNROLLED and _takes_tuples(fun, start, tuple(y0.tolist()), args)
    if unrolled:
        return _compiled_loop(fun, tableau, y0.size, form), tuple(y0.tolist())
    _as_slope(fun(start, y0, *args), y0)
    return _compiled_loop(fun, tableau, None, form), y0


def _takes_tuples(fun, start, state, args) -> bool:
    """Whether a compiled `fun` maps a tuple of scalars to another, rather than needs arrays."""
    try:
        slope = fun(start, state, *args)
    except TypingError:
        return False
    return isinstance(slope, tuple) and len(slope) == len(state)


def _as_slope(value, y: np.ndarray) -> np.ndarray:
    slope = np.asarray(value, dtype=float)
    if slope.shape != y.shape:
        raise ValueError(
            f"the right-hand side returned an array of shape {slope.shape}; the state has "
            f"{y.shape[0]} components"
        )
    return slope


def _python_loop(fun, tableau, form) -> Callable[..., None]:
    namespace = {"exp": np.exp, "fun": lambda t, y, *args: _as_slope(fun(t, y, *args), y)}
    exec(_source(tableau, None, form), namespace)
    return namespace["loop"]


_source = cache(loop_source)


@cache
def _compiled_loop(fun, tableau, size, form) -> Callable[..., None]:
    source = _source(tableau, size, form)
    exp = np.exp if size is None else math.exp
    namespace = {"fun": fun, "exp": exp, "__name__": __name__}
    file = _source_file(source, fun)
    exec(compile(source, file or "<generated>", "exec"), namespace)
    decorate = njit(cache=file is not None, fastmath={"contract"}, error_model="numpy")
    return decorate(namespace["loop"])


def _source_file(source: str, fun) -> str | None:
    """File that holds generated source, so that numba keeps its machine code between runs.

    Its name is a digest of the source and of the module that `fun` comes from: a change of either
    makes a new file. A function that cannot be imported again, or a folder that cannot be
    written, means no file and a compilation in every process.
    """
    module = sys.modules.get(fun.py_func.__module__)
    if getattr(module, fun.py_func.__qualname__, None) is not fun or module.__name__ == "__main__":
        return None
    try:
        origin = Path(inspect.getfile(module)).read_bytes()
        name = f"{module.__name__}.{fun.py_func.__qualname__}"
        digest = hashlib.sha256(b"\0".join([source.encode(), name.encode(), origin])).hexdigest()
        file = Path(__file__).parent / "__pycache__" / f"loop_{digest[:16]}.py"
        if not file.exists():
            file.parent.mkdir(exist_ok=True)
            draft = file.with_suffix(f".{os.getpid()}")
            draft.write_text(f"# {name}\n{source}", encoding="utf-8")
            draft.replace(file)
    except (OSError, TypeError):
        return None
    return str(file)
