"""Integration loops generated from a tableau, as plain Python or as machine code.

The source is straight-line: coefficients are literals, products with zero do not appear, and
stages that the weights never reach are not evaluated. One generator serves a state that is a
single array, for any right-hand side, and a state unrolled into scalars, where the whole loop with
its right-hand side inlined becomes machine code.
"""

import re
from collections.abc import Callable
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
    rule, shifted = FORMS[form], form != "additive"
    A, b, c = (part.tolist() for part in tableau.floats())
    parts = [("", ":")] if size is None else [(f"_{j}", str(j)) for j in range(size)]

    def each(text: str, **more: Any) -> list[str]:
        return [text.format(p=p, row=row, **more) for p, row in parts]

    def together(text: str) -> str:
        return ", ".join(each(text)) + ("" if size is None else ",")

    def joined(weights: list[float], p: str) -> str:
        return rule.joint.join(rule.term.format(a=a, i=i, p=p) for i, a in enumerate(weights) if a)

    def moved(weights: list[float], p: str) -> str:
        return rule.moved.format(y=f"y{p}", z=joined(weights, p)) if any(weights) else f"y{p}"

    def stage_state(i: int, p: str) -> str:
        if form != "additive":
            return moved(A[i], p)
        # Summed from y on with h*a made first: one operation between the newest slope and the
        # stage. The step itself keeps y + h*(...), which rounds less.
        return " + ".join([f"y{p}"] + [f"(h*{a})*k{j}{p}" for j, a in enumerate(A[i]) if a])

    def stage(i: int) -> list[str]:
        state = together("u{p} - s{p}" if shifted else "u{p}")
        return [
            *(f"u{p} = {stage_state(i, p)}" for p, _ in parts),
            f"{together('f{p}')} = fun(t + {c[i]!r}*h, ({state}), *args)",
            *each("k{i}{p} = " + rule.slope.format(f="f{p}", u="u{p}"), i=i),
        ]

    minus_s = " - s{p}" if shifted else ""
    blocks = {
        "start": [f"{together('y{p}')} = y", f"{together('s{p}')} = shift"]
        + (each("y{p} = y{p} + s{p}") if shifted else []),
        "move": [f"x{p} = {moved(b, p)}" for p, _ in parts],
        "accept": each("y{p} = x{p}"),
        "store": each("out[{row}, n] = x{p}" + minus_s),
    }
    if not adaptive:
        stages = [line for i in tableau.evaluated_stages for line in stage(i)]
        return _filled(_FIXED, blocks | {"stages": stages})

    if tableau.b_embedded is None:
        raise ValueError(f"tableau {tableau.name}: no embedded weights, so no error estimate")
    difference = [float(weight) for weight in tableau.b - tableau.b_embedded]
    square = "(w*w).sum()/w.size" if size is None else f"({' + '.join(each('w{p}*w{p}'))})/{size}"
    last = tableau.stages - 1
    blocks |= {
        "tolerances": [f"{together('a{p}')} = atol"],
        "first": stage(0),
        "stages": [line for i in range(1, last + 1) for line in stage(i)],
        "errors": [
            f"e{p} = {rule.error.format(x=f'x{p}', z=joined(difference, p))}" for p, _ in parts
        ]
        + each(
            f"w{{p}} = e{{p}}/(a{{p}} + rtol*maximum(fabs(y{{p}}{minus_s}), fabs(x{{p}}{minus_s})))"
        )
        + [f"error = {square}"],
        "slopes": [
            line for i in range(last + 1) for line in each("slopes[n, {i}, {row}] = k{i}{p}", i=i)
        ],
        "next": each("k0{p} = k{i}{p}", i=last) if tableau.fsal else stage(0),
    }
    return _filled(_ADAPTIVE, blocks)


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
