"""Compile ahead what several notebooks call: once, and on both processors.

What is missing here is compiled by the notebook that calls it; it only takes longer.
"""

import sys
from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np

from armbook.problems import linear_arguments, linear_flow, region_flow
from armsim import amplifier
from armsim.arm import AxisParameters, simulate
from armsim.arm.dynamics import Region, constants, region_number, rhs
from armsim.methods import IntegrationError, integrate, tableaux
from armsim.methods.runge_kutta import Form
from armsim.methods.tableaux import Tableau
from armsim.paper import PRINTED

_PAPER = (tableaux.RK6, tableaux.DP5, tableaux.DP4)
_ALL = (tableaux.EULER, tableaux.RK4_GILL, tableaux.RK5, *_PAPER)
_PRINTED = tuple(PRINTED.values())
_FIBRE = tuple(method for method in _ALL if method is not tableaux.DP4)


def _equations() -> dict[str, tuple[Callable, int, tuple]]:
    """Right-hand side, number of states and further arguments, by name."""
    p, fibre = AxisParameters.paper_x_axis(), amplifier.RamanAmplifier()
    k = constants(p)
    return {
        "arm": (rhs, 7, (10.0, k)),
        "region": (region_flow, 7, (10.0, region_number(Region(0, 0, 0, 0)), k)),
        "linear": (linear_flow, 4, linear_arguments(p, 10.0)),
        "fibre": (amplifier.rhs, len(fibre.input_power), fibre.args),
    }


def _loops() -> Iterator[tuple[str, Form, tuple[Tableau, ...], float | None]]:
    """Equations, form, methods and step size of the loops that notebooks call."""
    step = 1e-9
    for name in ("arm", "region", "linear"):
        yield name, "additive", (*_ALL, *_PRINTED), step
        yield name, "exponential", _PAPER, step
        yield name, "as printed", _PAPER, step
        yield name, "additive", (tableaux.DP5,), None
    yield "arm", "exponential product", _PAPER, step
    for form in ("additive", "exponential"):
        yield "fibre", form, _FIBRE, step
        yield "fibre", form, (tableaux.DP5,), None
    yield "fibre", "exponential product", (tableaux.DP5,), step


def loops() -> None:
    """Compile the integration loops, and what else the amplifier is solved with."""
    equations = _equations()
    for name, form, methods, step in _loops():
        fun, size, args = equations[name]
        for method in methods:
            with suppress(IntegrationError):  # as printed, none gets far
                integrate(fun, (0.0, 1e-9), np.ones(size), method, step, form, args)
    _, size, args = equations["fibre"]
    amplifier.log_rhs(0.0, np.zeros(size), *args)
    amplifier.average_power(np.ones(size), *args, 1e-9, 1, 2)


def solver() -> None:
    """Compile the exact solver, and what reads its runs."""
    run = simulate(AxisParameters.paper_x_axis(), t_end=0.1)
    run.auxiliary()


if __name__ == "__main__":
    {"solver": solver, "loops": loops}[sys.argv[1]]()
