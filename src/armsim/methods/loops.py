"""Integration loops generated from a tableau, as plain Python or as machine code.

The source is straight-line code: coefficients are literals, products with zero are omitted, and
stages that do not affect the weights are not evaluated. One generator serves two kinds of state. A
single array works with any right-hand side. For a state unrolled into scalars, the loop and its
inlined right-hand side are compiled together.
"""

import re
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from armsim import machine_code
from armsim.methods.tableaux import Tableau


class Rule(NamedTuple):
    """Patterns to move the state y along slopes k; u is the moved state, f the right-hand side."""

    term: str  #: term of one stage
    joint: str  #: separator of terms
    moved: str  #: state moved by the joined terms z
    error: str  #: error estimate, from the new state x and the joined terms z of b - b_embedded
    slope: str


FORMS = {
    # The + copies an array, since a right-hand side may return the same one every time.
    "additive": Rule("{a}*k{i}{p}", " + ", "{y} + h*({z})", "h*({z})", "+{f}"),
    "exponential": Rule("{a}*k{i}{p}", " + ", "{y}*exp(h*({z}))", "{x}*expm1(-h*({z}))", "{f}/{u}"),
    # The exponential form with one exponential per term, multiplied together as in the paper.
    "exponential product": Rule(
        "exp(h*({a}*k{i}{p}))", "*", "{y}*{z}", "{x} - {x}/({z})", "{f}/{u}"
    ),
    # Eq. (13)-(16) as printed, without the step size and the division by the state.
    "as printed": Rule("exp({a}*k{i}{p})", "*", "{y}*{z}", "{x} - {x}/({z})", "+{f}"),
}

# All steps but the last have the same h, so its products are computed once, before the inner loop.
# If the rounding of the times counts, each step has the length between its rounded ends instead.
_FIXED = """\
def loop(times, step, rounded, y, shift, out, args):
    <start>
    last = times.size - 1
    first = 1
    while first <= last:
        single = rounded or first == last
        h = float(times[first] - times[first - 1]) if single else step
        end = first + 1 if single else last
        for n in range(first, end):
            t = times[n - 1]
            <stages>
            <move>
            <accept>
            <store>
        first = end
"""

# Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I, section II.4; `error` is
# the mean square, so `power` is half of theirs. A NaN compares false, so the step is rejected. A
# step that reaches the end may be shorter than the spacing of the times.
_ADAPTIVE = """\
def loop(t, end, h, rounded, y, shift, rtol, atol, power, times, out, slopes, args):
    <start>
    <tolerances>
    <first>
    n = 0
    rejected = 0
    grow = 5.0
    while n < times.size and t != end and (abs(h) > 1e-15*abs(t) or abs(end - t) <= abs(h)):
        last = abs(end - t) <= abs(h)
        h = end - t if last else h
        new = end if last else t + h
        h = new - t if rounded else h
        <stages>
        <move>
        <errors>
        factor = 0.9*error**power if error < 1e6 else 0.2
        if error <= 1.0:
            t = new
            times[n] = t
            <store>
            <slopes>
            <accept>
            <next>
            n += 1
            h *= min(grow, factor)
            grow = 5.0
        else:
            rejected += 1
            h *= factor
            grow = 1.0
    return n, rejected, t, h
"""


@cache
def loop_source(tableau: Tableau, size: int | None, form: str, adaptive: bool = False) -> str:
    """Generate the source of a function ``loop`` that integrates with a tableau.

    Parameters
    ----------
    tableau : Tableau
        The method, with embedded weights if the loop is adaptive.
    size : int or None
        Number of scalars into which the state is unrolled; None keeps it as one array.
    form : str
        A key of `FORMS`. In all but the additive form y is the state plus the shift.
    adaptive : bool
        Whether the loop chooses its steps by the embedded weights or takes given ones.

    Returns
    -------
    str
        Python source that calls ``fun``, ``exp``, ``expm1``, ``fabs`` and ``maximum``.
    """
    lines = _Lines(tableau, size, form)
    if adaptive:
        return _filled(_ADAPTIVE, lines.common() | lines.adaptive())
    stages = [line for i in tableau.evaluated_stages for line in lines.stage(i)]
    return _filled(_FIXED, lines.common() | {"stages": stages})


class _Lines:
    """Lines of a loop. In patterns, ``{p}`` is the suffix of a component, ``{row}`` its index."""

    def __init__(self, tableau: Tableau, size: int | None, form: str) -> None:
        self.tableau, self.size = tableau, size
        self.rule, self.additive = FORMS[form], form == "additive"
        self.A, self.b, self.c = (part.tolist() for part in tableau.floats())
        self.parts = [("", ":")] if size is None else [(f"_{j}", str(j)) for j in range(size)]
        self.unshifted = "" if self.additive else " - s{p}"

    def each(self, pattern: str, **more: Any) -> list[str]:
        """One line per component."""
        return [pattern.format(p=p, row=row, **more) for p, row in self.parts]

    def together(self, pattern: str) -> str:
        """All components as a tuple, or the single array."""
        return ", ".join(self.each(pattern)) + ("" if self.size is None else ",")

    def joined(self, weights: list[float]) -> str:
        terms = [self.rule.term.format(a=a, i=i, p="{p}") for i, a in enumerate(weights) if a]
        return self.rule.joint.join(terms)

    def moved(self, weights: list[float]) -> str:
        """Component moved along the slopes by a full step."""
        return self.rule.moved.format(y="y{p}", z=self.joined(weights)) if any(weights) else "y{p}"

    def stage(self, i: int) -> list[str]:
        moved, state = self.moved(self.A[i]), self.together("u{p}" + self.unshifted)
        if self.additive:
            # The sum starts at y and uses precomputed h*a, so one operation separates the newest
            # slope from the stage. The step itself uses y + h*(...), whose rounding error is less.
            terms = [f"(h*{a})*k{j}{{p}}" for j, a in enumerate(self.A[i]) if a]
            moved = " + ".join(["y{p}", *terms])
        return [
            *self.each(f"u{{p}} = {moved}"),
            f"{self.together('f{p}')} = fun(t + {self.c[i]!r}*h, ({state}), *args)",
            *self.each("k{i}{p} = " + self.rule.slope.format(f="f{p}", u="u{p}"), i=i),
        ]

    def common(self) -> dict[str, list[str]]:
        """Blocks common to both templates."""
        shifted = [] if self.additive else self.each("y{p} = y{p} + s{p}")
        return {
            "start": [f"{self.together('y{p}')} = y", f"{self.together('s{p}')} = shift", *shifted],
            "move": self.each(f"x{{p}} = {self.moved(self.b)}"),
            "accept": self.each("y{p} = x{p}"),
            "store": self.each("out[{row}, n] = x{p}" + self.unshifted),
        }

    def adaptive(self) -> dict[str, list[str]]:
        slopes, last = "slopes[n, {i}, {row}] = k{i}{p}", self.tableau.stages - 1
        return {
            "tolerances": [f"{self.together('a{p}')} = atol"],
            "first": self.stage(0),
            "stages": [line for i in range(1, last + 1) for line in self.stage(i)],
            "errors": self.errors(),
            "slopes": [line for i in range(last + 1) for line in self.each(slopes, i=i)],
            "next": self.each("k0{p} = k{i}{p}", i=last) if self.tableau.fsal else self.stage(0),
        }

    def errors(self) -> list[str]:
        """Mean square of the estimated errors relative to the tolerances."""
        weights = [float(weight) for weight in self.tableau.b - self.tableau.b_embedded]
        error = self.rule.error.format(x="x{p}", z=self.joined(weights))
        largest = f"maximum(fabs(y{{p}}{self.unshifted}), fabs(x{{p}}{self.unshifted}))"
        lines = self.each(f"e{{p}} = {error}")
        lines += self.each(f"w{{p}} = e{{p}}/(a{{p}} + rtol*{largest})")
        if self.size is None:
            return [*lines, "error = (w*w).sum()/w.size"]
        return [*lines, f"error = ({' + '.join(self.each('w{p}*w{p}'))})/{self.size}"]


def _filled(template: str, blocks: dict[str, list[str]]) -> str:
    """Replace each placeholder by its block, at the same indentation."""

    def block(match: re.Match) -> str:
        return "".join(f"{match[1]}{line}\n" for line in blocks[match[2]])

    return re.sub(r"^( *)<(\w+)>\n", block, template, flags=re.MULTILINE)


# --- from source to a function ----------------------------------------------------------------

_NAMES = {"exp": np.exp, "expm1": np.expm1, "fabs": np.fabs, "maximum": np.maximum}


def python_loop(fun: Callable, tableau: Tableau, form: str, adaptive: bool) -> Callable:
    """Return a loop in plain Python that calls `fun` with arrays."""
    namespace: dict[str, Any] = _NAMES | {"fun": fun}
    exec(loop_source(tableau, None, form, adaptive), namespace)
    return namespace["loop"]


@cache
def compiled_loop(
    fun: Callable, tableau: Tableau, size: int | None, form: str, adaptive: bool
) -> Callable:
    """Compile the loop around a compiled `fun`; the code is cached on disk where possible."""
    source, names = loop_source(tableau, size, form, adaptive), _NAMES | {"fun": fun}
    options: dict[str, Any] = {"fastmath": {"contract"}, "error_model": "numpy", "nogil": True}
    return machine_code.generated(source, names, **options)
