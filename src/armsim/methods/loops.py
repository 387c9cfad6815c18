"""Integration loops generated from a tableau, as plain Python or as machine code.

The source is straight-line: coefficients are literals, products with zero do not appear, and
stages that the weights never reach are not evaluated. One generator serves a state that is a
single array, for any right-hand side, and a state unrolled into scalars, where the whole loop with
its right-hand side inlined becomes machine code.
"""

import re
from collections.abc import Callable, Iterable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from armsim import machine_code
from armsim.machine_code import label
from armsim.methods.tableaux import Tableau


class Rule(NamedTuple):
    """How the state y is moved along slopes k; `u` is the moved state, `f` the right-hand side."""

    term: str  #: of one stage
    joint: str  #: between terms
    moved: str  #: the state moved by the joined terms z
    error: str  #: what the terms of b - b_embedded make of the new state x
    slope: str


FORMS = {
    # + copies an array, since a right-hand side may return the same one every time
    "additive": Rule("{a}*k{i}{p}", " + ", "{y} + h*({z})", "h*({z})", "+{f}"),
    "exponential": Rule("{a}*k{i}{p}", " + ", "{y}*exp(h*({z}))", "{x}*expm1(-h*({z}))", "{f}/{u}"),
    # the same, with the exponentials multiplied one by one as the paper writes them
    "exponential product": Rule(
        "exp(h*({a}*k{i}{p}))", "*", "{y}*{z}", "{x} - {x}/({z})", "{f}/{u}"
    ),
    # eq. (13)-(16) to the letter: no step size, and no division by the state
    "as printed": Rule("exp({a}*k{i}{p})", "*", "{y}*{z}", "{x} - {x}/({z})", "+{f}"),
}

# All steps but the last have one h, so that products with it are made once, before the loop.
_FIXED = """\
def loop(times, step, y, shift, out, args):
    <start>
    last = times.size - 1
    for first, end, h in ((1, last, step), (last, last + 1, times[last] - times[last - 1])):
        for n in range(max(first, 1), end):
            t = times[n - 1]
            <stages>
            <move>
            <accept>
            <store>
"""

# Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I, section II.4; `error` is
# the mean square, so `power` is half of theirs. A NaN is no number below anything: it rejects.
_ADAPTIVE = """\
def loop(t, end, h, y, shift, rtol, atol, power, times, out, slopes, args):
    <start>
    <tolerances>
    <first>
    n = 0
    rejected = 0
    grow = 5.0
    while n < times.size and t != end and abs(h) > 1e-15*abs(t):
        last = abs(end - t) <= abs(h)
        h = end - t if last else h
        <stages>
        <move>
        <errors>
        factor = 0.9*error**power if error < 1e6 else 0.2
        if error <= 1.0:
            t = end if last else t + h
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


def loop_source(tableau: Tableau, size: int | None, form: str, adaptive: bool = False) -> str:
    """Source of the function ``loop`` that integrates with a tableau.

    Parameters
    ----------
    tableau : Tableau
        The method; with embedded weights, if the loop is to be adaptive.
    size : int or None
        Number of components into which the state is unrolled; with None it stays one array.
    form : str
        A key of `FORMS`. In all but the additive form y is the state plus the shift.
    adaptive : bool
        Whether the loop chooses its steps by the embedded weights, or takes given ones.

    Returns
    -------
    str
        Python source that calls ``fun``, ``exp``, ``expm1``, ``fabs`` and ``maximum``.
    """
    if adaptive and tableau.b_embedded is None:
        raise ValueError(f"tableau {tableau.name}: no embedded weights, so no error estimate")
    lines = _Lines(tableau, size, form)
    if adaptive:
        return _filled(_ADAPTIVE, lines.common() | lines.adaptive())
    return _filled(_FIXED, lines.common() | lines.fixed())


class _Lines:
    """Lines of a loop. In a pattern ``{p}`` is the suffix of a component, ``{row}`` its index."""

    def __init__(self, tableau: Tableau, size: int | None, form: str) -> None:
        self.tableau, self.size = tableau, size
        self.rule, self.additive = FORMS[form], form == "additive"
        self.A, self.b, self.c = (part.tolist() for part in tableau.floats())
        self.parts = [("", ":")] if size is None else [(f"_{j}", str(j)) for j in range(size)]
        self.unshifted = "" if self.additive else " - s{p}"

    def each(self, pattern: str, **more: Any) -> list[str]:
        """One line a component."""
        return [pattern.format(p=p, row=row, **more) for p, row in self.parts]

    def together(self, pattern: str) -> str:
        """All components as a tuple, or the one array."""
        return ", ".join(self.each(pattern)) + ("" if self.size is None else ",")

    def joined(self, weights: list[float], p: str) -> str:
        terms = [self.rule.term.format(a=a, i=i, p=p) for i, a in enumerate(weights) if a]
        return self.rule.joint.join(terms)

    def moved(self, weights: list[float], p: str) -> str:
        """Component moved along the slopes by a whole step."""
        if not any(weights):
            return f"y{p}"
        return self.rule.moved.format(y=f"y{p}", z=self.joined(weights, p))

    def stage_state(self, i: int, p: str) -> str:
        """Component at which stage i takes its slope."""
        if not self.additive:
            return self.moved(self.A[i], p)
        # Summed from y on with h*a made first: one operation between the newest slope and the
        # stage. The step itself keeps y + h*(...), which rounds less.
        return " + ".join([f"y{p}"] + [f"(h*{a})*k{j}{p}" for j, a in enumerate(self.A[i]) if a])

    def stage(self, i: int) -> list[str]:
        state = self.together("u{p}" + self.unshifted)
        return [
            *(f"u{p} = {self.stage_state(i, p)}" for p, _ in self.parts),
            f"{self.together('f{p}')} = fun(t + {self.c[i]!r}*h, ({state}), *args)",
            *self.each("k{i}{p} = " + self.rule.slope.format(f="f{p}", u="u{p}"), i=i),
        ]

    def stages(self, which: Iterable[int]) -> list[str]:
        return [line for i in which for line in self.stage(i)]

    def common(self) -> dict[str, list[str]]:
        """Blocks that both templates have."""
        shifted = [] if self.additive else self.each("y{p} = y{p} + s{p}")
        return {
            "start": [f"{self.together('y{p}')} = y", f"{self.together('s{p}')} = shift", *shifted],
            "move": [f"x{p} = {self.moved(self.b, p)}" for p, _ in self.parts],
            "accept": self.each("y{p} = x{p}"),
            "store": self.each("out[{row}, n] = x{p}" + self.unshifted),
        }

    def fixed(self) -> dict[str, list[str]]:
        return {"stages": self.stages(self.tableau.evaluated_stages)}

    def adaptive(self) -> dict[str, list[str]]:
        last = self.tableau.stages - 1
        all_stages = range(last + 1)
        slopes = "slopes[n, {i}, {row}] = k{i}{p}"
        return {
            "tolerances": [f"{self.together('a{p}')} = atol"],
            "first": self.stage(0),
            "stages": self.stages(all_stages[1:]),
            "errors": self.errors(),
            "slopes": [line for i in all_stages for line in self.each(slopes, i=i)],
            "next": self.each("k0{p} = k{i}{p}", i=last) if self.tableau.fsal else self.stage(0),
        }

    def errors(self) -> list[str]:
        """Mean square of the estimated errors in units of what is tolerated."""
        weights = [float(weight) for weight in self.tableau.b - self.tableau.b_embedded]
        largest = f"maximum(fabs(y{{p}}{self.unshifted}), fabs(x{{p}}{self.unshifted}))"
        lines = []
        for p, _ in self.parts:
            lines.append(f"e{p} = {self.rule.error.format(x=f'x{p}', z=self.joined(weights, p))}")
        lines += self.each(f"w{{p}} = e{{p}}/(a{{p}} + rtol*{largest})")
        if self.size is None:
            return [*lines, "error = (w*w).sum()/w.size"]
        return [*lines, f"error = ({' + '.join(self.each('w{p}*w{p}'))})/{self.size}"]


def _filled(template: str, blocks: dict[str, list[str]]) -> str:
    """Put each block in the place of its name, at the same indentation."""

    def block(match: re.Match) -> str:
        return "".join(f"{match[1]}{line}\n" for line in blocks[match[2]])

    return re.sub(r"^( *)<(\w+)>\n", block, template, flags=re.MULTILINE)


# --- from source to a function ----------------------------------------------------------------

_NAMES = {"exp": np.exp, "expm1": np.expm1, "fabs": np.fabs, "maximum": np.maximum}
_source = cache(loop_source)


def python_loop(fun: Callable, tableau: Tableau, form: str, adaptive: bool) -> Callable:
    """Loop that calls `fun` as plain Python, on arrays."""
    namespace: dict[str, Any] = _NAMES | {"fun": fun}
    exec(_source(tableau, None, form, adaptive), namespace)
    return namespace["loop"]


@cache
def compiled_loop(
    fun: Callable, tableau: Tableau, size: int | None, form: str, adaptive: bool
) -> Callable:
    """Machine code of the loop around a compiled `fun`, kept on disk where that is possible."""
    source = _source(tableau, size, form, adaptive)
    return machine_code.generated(
        source, label(fun), _NAMES | {"fun": fun}, fastmath={"contract"}, error_model="numpy"
    )
