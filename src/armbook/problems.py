"""Initial value problems with known solutions: the linear arm, a step response, a move.

A `Problem` is a row of legs, between which the input or the equations change. Every solver gets
the same compiled right-hand side and is asked for states at the same times.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field
from functools import cache, wraps
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
from numba import njit

from armsim.arm import AxisParameters, LinearAxis, Trajectory, simulate
from armsim.arm.dynamics import constants, derivative, region_number, region_of_number, rhs
from armsim.arm.slave_control import MEMORY, put_out
from armsim.machine_code import kept
from armsim.methods import IntegrationError, integrate, tableaux

#: Evaluations after which a counted run is given up.
MAX_EVALUATIONS = 100_000


class Equations:
    """A right-hand side in the shapes that solvers ask for, all compiled from one function.

    Parameters
    ----------
    flow : compiled function
        ``flow(t, y, *inputs, *fixed)`` takes the components of `y` by index and returns a tuple.
    fixed : tuple
        Compiled into what the solvers call, so that no call from Python has to convert it.
    """

    def __init__(self, flow: Callable, fixed: tuple) -> None:
        @njit(error_model="numpy")
        def slope(t, y, *inputs):  # type: ignore[no-untyped-def]
            return np.array(flow(t, y, *(inputs + fixed)))

        @njit(error_model="numpy")
        def fill(t, y, out, inputs):  # type: ignore[no-untyped-def]
            for i, value in enumerate(flow(t, y, *(inputs + fixed))):
                out[i] = value

        self.flow: Callable = flow  #: for `armsim.methods.integrate`
        self.fixed = fixed  #: what `flow` takes after the inputs
        self.slope: Callable = slope  #: for SciPy: returns a new array
        self.fill: Callable = fill  #: for CVODE: fills an array
        self.count = 0  #: evaluations; of `slope` and `fill` only in a counting copy

    def counting(self) -> "Equations":
        """Return a copy that counts every evaluation, those for Jacobians included."""
        counter = copy(self)
        counter.count = 0

        def counted(function: Callable) -> Callable:
            @wraps(function)  # CVODE asks for the number of arguments
            def call(*args: Any) -> Any:
                counter.count += 1
                if counter.count > MAX_EVALUATIONS:
                    raise IntegrationError(f"more than {MAX_EVALUATIONS} evaluations")
                return function(*args)

            return call

        counter.slope, counter.fill = counted(self.slope), counted(self.fill)
        return counter


Solution: TypeAlias = tuple[np.ndarray, np.ndarray]  #: times (k,) and states (n, k)
#: ``solve(equations, times, y0, args)`` gives the states at some times, the last at times[-1].
Solve = Callable[[Equations, np.ndarray, np.ndarray, tuple], Solution]


@dataclass(frozen=True)
class Problem:
    """Initial value problem with a known solution."""

    equations: Equations
    y0: np.ndarray
    legs: tuple[tuple[np.ndarray, tuple], ...]  #: times, first to last; arguments after t and y
    exact: Callable[[np.ndarray], np.ndarray]
    size: np.ndarray  #: largest value of each state
    scale: np.ndarray  #: largest value of each component that is compared
    outputs: Callable[[np.ndarray], np.ndarray] = field(default=lambda y: y)  #: what is compared
    controlled: Trajectory | None = None  #: whose control puts out what the equations take first

    def run(self, solve: Solve, equations: Equations | None = None) -> Solution:
        """Times (k,) and states (n, k) that a solver finds, leg after leg."""
        t, states, y, sample, starts = [], [], self.y0, 0, np.empty(0)
        volts: tuple[float, ...] = ()
        if self.controlled is not None and (control := self.controlled.control) is not None:
            starts, track = control.samples(self.legs[-1][0][-1])
            memory, outputs, law = np.zeros(MEMORY), np.zeros(starts.size), control.law
            r_g = self.controlled.parameters.r_g
        for times, more in self.legs:
            while sample < starts.size and times[0] >= starts[sample] - 1e-12:
                volts = (float(put_out(sample, y[2], r_g, track, law, memory, outputs)),)
                sample += 1
            at, found = solve(equations or self.equations, times, y, (*volts, *more))
            t.append(at[1:])
            states.append(found[:, 1:])
            y = np.ascontiguousarray(found[:, -1])
        return np.concatenate(t), np.concatenate(states, axis=1)

    def errors(self, t: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Errors (m, k) at times (k,), relative to each component's largest value."""
        return np.abs(self.outputs(y) - self.exact(t)) / self.scale[:, None]

    def error(self, t: np.ndarray, y: np.ndarray) -> float:
        """Largest of the errors along the run; inf if not finite."""
        new = np.diff(t, prepend=-np.inf) > 0  # if steps are few, one of them serves several times
        value = float(self.errors(t[new], y[:, new]).max())
        return value if np.isfinite(value) else np.inf


@kept(fastmath={"contract"}, error_model="numpy")
def linear_flow(t, y, rows, drive):  # type: ignore[no-untyped-def]
    """Reduced linear arm, ẏ = A y + b."""
    a, b, c, d = rows
    return (
        a[0] * y[0] + a[1] * y[1] + a[2] * y[2] + a[3] * y[3] + drive[0],
        b[0] * y[0] + b[1] * y[1] + b[2] * y[2] + b[3] * y[3] + drive[1],
        c[0] * y[0] + c[1] * y[1] + c[2] * y[2] + c[3] * y[3] + drive[2],
        d[0] * y[0] + d[1] * y[1] + d[2] * y[2] + d[3] * y[3] + drive[3],
    )


@kept(fastmath={"contract"}, error_model="numpy")
def region_flow(t, y, volts, where, k):  # type: ignore[no-untyped-def]
    """Arm by the equations of the region with the number `where`: smooth, between two events."""
    return derivative(y, volts, k, region_of_number(where))


def linear_problem(p: AxisParameters, volts: float, t_end: float, points: int = 100) -> Problem:
    """Step response of the reduced linear arm; position, velocity and current are compared."""
    axis = LinearAxis(p)
    response, (A, B) = axis.step_response(volts), axis.state_space()
    fixed = tuple(map(tuple, A.tolist())), tuple((B * volts).tolist())

    def exact(t: np.ndarray) -> np.ndarray:
        return np.array([response.position(t), response.velocity(t), response.current(t)])

    def outputs(y: np.ndarray) -> np.ndarray:
        return np.array([p.r_g * y[0], p.r_g * y[1], p.K_i * (y[2] + p.T_z * y[3])])

    at_rest, legs = np.zeros(4), ((np.linspace(0.0, t_end, points + 1), ()),)
    fine = integrate(linear_flow, (0.0, t_end), at_rest, tableaux.RK6, t_end / 5000, args=fixed)
    size, scale = (np.abs(y).max(axis=1) for y in (fine.y, exact(fine.t)))
    return Problem(Equations(linear_flow, fixed), at_rest, legs, exact, size, scale, outputs)


@cache
def _arm_equations(flow: Callable, p: AxisParameters) -> Equations:
    return Equations(flow, (constants(p),))


def arm_problems(run: Trajectory, interval: float | np.ndarray = 5e-3) -> tuple[Problem, Problem]:
    """Return the problem of an exact run from rest, and the same restarted at its events.

    States are compared at equal intervals in s, or at the times (n,) given, from 0 to the end. The
    first problem has the right-hand side with all limits; in the second each leg has the equations
    of the region that the exact run is in. Under control both start anew at each sample.
    """
    grid, controlled = _grid(run, interval), run if run.control is not None else None
    cuts = grid if controlled else grid[[0, -1]]
    at = np.array([event.time for event in run.events])
    cuts_landed = np.unique(np.concatenate((cuts, at[(at > 0) & (at < grid[-1])])))
    where = run.regions(0.5 * (cuts_landed[1:] + cuts_landed[:-1]))
    volts = () if controlled else (float(run.set_velocity(0.0)),)

    def problem(flow: Callable, cuts: np.ndarray, more: list[tuple]) -> Problem:
        times = [(a, grid[(grid > a) & (grid < b)], b) for a, b in pairwise(cuts)]
        legs = tuple((np.hstack(t), (*volts, *args)) for t, args in zip(times, more, strict=True))
        size, equations = np.abs(run.y).max(axis=1), _arm_equations(flow, run.parameters)
        return Problem(equations, np.zeros(7), legs, run, size, size, controlled=controlled)

    landed = problem(region_flow, cuts_landed, [(region_number(region),) for region in where])
    return problem(rhs, cuts, [()] * (len(cuts) - 1)), landed


def exactly(run: Trajectory, interval: float = 5e-3) -> Callable[[], np.ndarray]:
    """Return a function that solves an exact run anew, with states at the same times."""
    grid = _grid(run, interval)
    volts = None if run.control is not None else float(run.set_velocity(0.0))
    return lambda: simulate(run.parameters, volts, run.t_end, control=run.control)(grid)


def _grid(run: Trajectory, interval: float | np.ndarray) -> np.ndarray:
    if isinstance(interval, np.ndarray):
        return interval
    return np.append(np.arange(0.0, run.t_end - 1e-9, interval), run.t_end)
