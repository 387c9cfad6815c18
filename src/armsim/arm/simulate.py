"""Simulation of one axis or of many, and the resulting trajectory."""

import os
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from armsim import checks
from armsim.arm import dynamics, modes
from armsim.arm.dynamics import Constants, Region, constants, rhs
from armsim.arm.parameters import AxisParameters
from armsim.arm.slave_control import MEMORY, SlaveControl, put_out
from armsim.checks import IntegrationError, reals
from armsim.exact import crossing
from armsim.exact.piecewise_affine import Event, ExactSolution, Room, recorded
from armsim.machine_code import announced
from armsim.methods import runge_kutta
from armsim.methods.runge_kutta import Form
from armsim.methods.tableaux import Tableau

#: A constant voltage, or pairs (time in s, volts from that time on).
SetVelocity = float | Iterable[tuple[float, float]]
Schedule = tuple[tuple[float, float], ...]

#: Largest numbers of events and of pieces in an exact run; more are an error.
MAX_EVENTS, MAX_PIECES = 100_000, 1_000_000
#: Largest number of adaptive steps of a Runge-Kutta method between two switches.
MAX_STEPS = 1_000_000
#: Number of runs handed to a thread at a time.
_CHUNK = 64
#: Names of modes and guards, for events and error messages.
_TO_NAMES = dynamics.region_of_number, Region._fields.__getitem__


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Simulated motion; calling it returns the state (7,) at a time, or (7, n) at n times."""

    parameters: AxisParameters = field(repr=False)
    #: Pairs (time in s, set velocity in V from that time on).
    schedule: Schedule = field(repr=False)
    solution: ExactSolution | runge_kutta.Solution
    t_end: float  #: end of the run in s
    #: Unit that produced the set velocity, if any.
    control: SlaveControl | None = field(default=None, repr=False)

    @property
    def t(self) -> np.ndarray:
        """Times (n,) in s, the steps or for an exact run a plotting grid with all events."""
        return self.solution.t

    @property
    def y(self) -> np.ndarray:
        """States (7, n) y0 … y6 of Table 1 at the times `t`."""
        return self.solution.y

    @property
    def nfev(self) -> int:
        """Number of right-hand-side evaluations; 0 for an exact run."""
        return self.solution.nfev

    @property
    def events(self) -> tuple[Event, ...]:
        """Switching events of an exact run in time order, with their regions; otherwise empty."""
        return self.solution.events if isinstance(self.solution, ExactSolution) else ()

    def regions(self, t: np.ndarray) -> list[Region]:
        """Regions at the times `t` (n,); at an event of an exact run, the region after it."""
        times = checks.checked_times(t, 0.0, self.t_end)
        if isinstance(self.solution, ExactSolution):
            return self.solution.modes(times)
        k = constants(self.parameters)
        return [dynamics.region(y, k) for y in self(times).T]

    def set_velocity(self, t: np.ndarray | float) -> np.ndarray:
        """Set velocity U in volts at the times `t`; at a switch, the new value."""
        return _set_velocity(self.schedule, reals("t", t))

    def auxiliary(self, t: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Auxiliary variables of Table 2: f_g, F_s in N and v_m, v_c in V.

        Parameters
        ----------
        t : (n,) array_like, optional
            Times in s; default ``run.t``.

        Raises
        ------
        ValueError
            If a time lies outside the run.
        """
        times, y = (self.t, self.y) if t is None else (reals("t", t), self(t))
        regions = self.regions(times) if isinstance(self.solution, ExactSolution) else ()
        return dynamics.auxiliary_variables(self.parameters, y, regions)

    def __call__(self, t: np.ndarray | float) -> np.ndarray:
        """State at the times `t`: exact, or by cubic Hermite interpolation between steps.

        Raises
        ------
        ValueError
            If a time lies outside the run.
        """
        return self.solution(t)


def simulate(
    p: AxisParameters,
    set_velocity: SetVelocity | None = None,
    t_end: float = 1.0,
    *,
    control: SlaveControl | None = None,
    method: Tableau | None = None,
    step_size: float | None = None,
    form: Form = "additive",
    y0: Sequence[float] | np.ndarray | None = None,
) -> Trajectory:
    """Simulate one axis of the arm, the paper's eq. (10)-(15).

    Parameters
    ----------
    p : AxisParameters
        The axis.
    set_velocity : float or sequence of (time, volts), optional
        Input U, constant or piecewise constant. Each value applies from its time in s on; times
        are nonnegative and increase, and U is 0 V before the first. Every method switches exactly
        at these times. The default is 10 V, or the output of `control`.
    t_end : float
        End of the run in s.
    control : SlaveControl, optional
        Slave control unit that closes the loop. Its output becomes the run's `schedule`.
    method : Tableau, optional
        Runge-Kutta method. By default the run is exact up to rounding: linear pieces are solved
        in closed form from event to event; see `armsim.exact.piecewise_affine`.
    step_size : float, optional
        Fixed step in s of a Runge-Kutta method. By default the step is adaptive, which requires
        embedded weights.
    form : {"additive", "exponential"}
        See `armsim.methods.integrate`.
    y0 : (7,) array_like, optional
        Initial state; default zero. With y1 = 0 the arm sticks if static friction can hold it.

    Returns
    -------
    Trajectory
        With ``t`` (n,), ``y`` (7, n), ``events`` and ``nfev``.

    Raises
    ------
    TypeError, ValueError
        If an argument is out of range; the message gives its name, value and allowed range.
    IntegrationError
        If too large a step makes the solution blow up, an exact run has more than `MAX_EVENTS`
        events, or adaptive steps are more than `MAX_STEPS` or than can be stored; the message
        gives the time.

    Examples
    --------
    >>> from armsim.arm import AxisParameters, simulate
    >>> run = simulate(AxisParameters.paper_x_axis(), set_velocity=10.0, t_end=1.0)
    >>> event = run.events[-1]
    >>> print(f"{event.time:.9f} s: preamplifier from {event.before[0]} to {event.after[0]}")
    0.845527127 s: preamplifier from 1 to 0
    """
    task = _checked(set_velocity, control, t_end, y0)
    solution: ExactSolution | runge_kutta.Solution
    if method is not None:
        solution = _runge_kutta(p, task, method, step_size, form)
    elif step_size is not None or form != "additive":
        given = f"step_size = {step_size!r} and form = {form!r}"
        raise ValueError(f"{given} are for a Runge-Kutta method; give one, or leave them out")
    else:
        _get_ready()
        solution = _exact(p, task)
    return Trajectory(p, task.schedule, solution, task.t_end, control)


def simulate_many(
    parameters: Iterable[AxisParameters],
    set_velocity: SetVelocity | None = None,
    t_end: float = 1.0,
    times: Sequence[float] | np.ndarray | None = None,
    *,
    control: SlaveControl | None = None,
    y0: Sequence[float] | np.ndarray | None = None,
    threads: int | None = None,
) -> np.ndarray:
    """Simulate many axes exactly on all processors, as for a fit or a parameter study.

    Parameters
    ----------
    parameters : iterable of r AxisParameters
        The axes.
    set_velocity, t_end, control, y0
        As for `simulate`, shared by all runs.
    times : (n,) array_like, optional
        Times in s, from 0 to `t_end`; default `t_end` only.
    threads : int, optional
        Number of threads, by default one per processor. The results do not depend on it.

    Returns
    -------
    (r, 7, n) array
        States y0 … y6 of each run at the times.

    Raises
    ------
    TypeError, ValueError
        If an argument is out of range; the message gives its name, value and allowed range.
    IntegrationError
        If a run fails; the message gives its index in `parameters`.
    """
    task, axes = _checked(set_velocity, control, t_end, y0), list(parameters)
    at = checks.checked_times(task.t_end if times is None else times, 0.0, task.t_end, "times")
    workers = os.cpu_count() if threads is None else checks.checked_count("threads", threads)
    y = np.empty((len(axes), 7, at.size))

    def work(first: int) -> None:
        for n in range(first, min(first + _CHUNK, len(axes))):
            try:
                y[n] = _exact(axes[n], task.copy())(at)
            except IntegrationError as error:
                raise IntegrationError(f"parameters[{n}]: {error}") from None

    _get_ready()
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(work, range(0, len(axes), _CHUNK)))
    return y


class _Task(NamedTuple):
    """Checked arguments of a run, as `modes.run` takes them."""

    starts: np.ndarray
    inputs: modes.Inputs
    t_end: float
    y0: np.ndarray

    def copy(self) -> "_Task":
        """Return a copy for another run, with its own arrays for a control unit to fill in."""
        volts, memory = self.inputs.volts.copy(), np.zeros(MEMORY)
        return self._replace(inputs=self.inputs._replace(volts=volts, memory=memory))

    @property
    def schedule(self) -> Schedule:
        """Set velocity; with a control unit, known after the run."""
        return tuple(zip(self.starts.tolist(), self.inputs.volts.tolist(), strict=True))


def _exact(p: AxisParameters, task: _Task) -> ExactSolution:
    k, limits = constants(p), (MAX_EVENTS, MAX_PIECES, crossing.MAX_SEARCH)

    def run(room: Room) -> tuple:
        task.inputs.memory[:] = 0.0  # of the control unit, if this is a second attempt
        return modes.run((k, dynamics.without_offsets(k)), *task, limits, room)

    room = recorded(run, (7, modes.GUARDS, modes.MATRICES), task.starts.size, _TO_NAMES)
    sample = partial(modes.sample, p.r_g)
    return ExactSolution(room, task.t_end, sample, *_TO_NAMES, task.schedule)


@cache
def _get_ready() -> None:
    """Compile the solver or load it from disk; print a notice if this takes long."""
    with announced("the exact solver for the arm", modes.run):
        _exact(AxisParameters.paper_x_axis(), _checked(0.0, None, 1e-9, None))(0.0)


def _runge_kutta(
    p: AxisParameters, task: _Task, method: Tableau, step_size: float | None, form: Form
) -> runge_kutta.Solution:
    starts, inputs, t_end, y0 = task
    k, times, states, nfev, stored = constants(p), [np.zeros(1)], [y0[:, None]], 0, 0
    if step_size is not None:
        step_size = checks.checked_number("step_size", step_size, above=0.0)
        runge_kutta.step_count(0.0, t_end, step_size, runge_kutta.MAX_STORED // 8)
    for n, span in enumerate(pairwise([*starts[starts < t_end].tolist(), t_end])):
        now = states[-1][:, -1]
        if inputs.track.size:
            put_out(n, now[2], p.r_g, inputs.track, inputs.law, inputs.memory, inputs.volts)
        how = method, step_size, form, (float(inputs.volts[n]), k)
        run = runge_kutta.integrate(rhs, span, now, *how, max_steps=MAX_STEPS)
        times.append(run.t[1:])
        states.append(run.y[:, 1:])
        nfev, stored = nfev + run.nfev, stored + 8 * run.t.size
        if stored > runge_kutta.MAX_STORED:
            raise IntegrationError(f"{method.name}: at t = {span[1]:.12g} s the memory is full")
    t, y = np.concatenate(times), np.concatenate(states, axis=1)
    size = "adaptive steps" if step_size is None else f"step size {step_size:g}"
    _raise_if_beyond_bound(p, inputs.volts, t, y, f"{method.name}, {size}")
    between = partial(_between_steps, k, task.schedule, t, y)
    return runge_kutta.Solution(t, y, nfev, _interpolate=between)


def _between_steps(
    k: Constants, schedule: Schedule, t: np.ndarray, y: np.ndarray, at: np.ndarray
) -> np.ndarray:
    """States at the times `at` by cubic Hermite interpolation, with the slopes of the step."""
    left = np.searchsorted(t[1:-1], at, side="right")
    h, volts = t[left + 1] - t[left], _set_velocity(schedule, t[left])
    ends = y[:, left], y[:, left + 1]
    slopes = [
        np.array([rhs(0.0, *pair, k) for pair in zip(end.T, volts, strict=True)]).T for end in ends
    ]
    return runge_kutta.hermite((at - t[left]) / h, h, *ends, *slopes)


def _set_velocity(schedule: Schedule, t: np.ndarray | float) -> np.ndarray:
    starts, volts = np.array(schedule).T
    return volts[np.maximum(np.searchsorted(starts, t, side="right") - 1, 0)]


def _raise_if_beyond_bound(
    p: AxisParameters, volts: np.ndarray, t: np.ndarray, y: np.ndarray, method: str
) -> None:
    """Raise an error if the preamplifier has blown up but is still finite.

    Its two lags have a positive impulse response and unit gain, so y4 cannot exceed the largest
    input by more than the contribution of its initial state. The limits hide its growth from the
    other states.
    """
    y4, y5 = np.abs(y[4:6])
    largest = p.K_1 * np.abs(volts).max() + p.K_2 * p.K_t * np.abs(y[3]).max()
    bound = 2 * (largest + y4[0] + (p.T_p + p.T_r) * y5[0])  # 2 allows for a coarse step
    if (beyond := y4 > bound).any():
        first = np.argmax(beyond)
        found = f"|y4| = {y4[first]:.3g} V at t = {t[first]:.6g} s; {bound:.3g} V are possible"
        raise IntegrationError(f"{method}: the solution blew up; {found}")


_NO_TRACK, _NO_LAW = np.empty((0, 2)), SlaveControl().law


def _checked(set_velocity: Any, control: Any, t_end: Any, y0: Any) -> _Task:
    t_end = checks.checked_number("t_end", t_end, above=0.0)
    state = np.zeros(7) if y0 is None else checks.checked_row("y0", y0, 7)
    if control is None:
        schedule = _checked_schedule(10.0 if set_velocity is None else set_velocity)
        (starts, volts), track, law = np.array(schedule).T.copy(), _NO_TRACK, _NO_LAW
    else:
        checks.checked_type("control", control, SlaveControl)
        if set_velocity is not None:
            raise ValueError(f"set_velocity = {set_velocity!r}: with control it must be left out")
        starts, track = control.samples(t_end)
        volts, law = np.zeros(starts.size), control.law
    return _Task(starts, modes.Inputs(volts, track, law, np.zeros(MEMORY)), t_end, state)


def _checked_schedule(set_velocity: SetVelocity) -> list[tuple[float, float]]:
    rows = getattr(set_velocity, "ndim", hasattr(set_velocity, "__iter__"))
    # Not a union of types, which would be built at every call.
    if isinstance(set_velocity, (float, str)) or not rows:
        return [(0.0, checks.checked_number("set_velocity", set_velocity))]
    schedule: list[tuple[float, float]] = []
    for n, entry in enumerate(set_velocity):
        name = f"set_velocity[{n}]"
        try:
            time, volts = entry
        except (TypeError, ValueError) as error:
            raise ValueError(f"{name} = {entry!r}: a pair (time, volts) is needed") from error
        time = checks.checked_number(f"{name} time", time)
        if time < 0 or (schedule and time <= schedule[-1][0]):
            raise ValueError(f"{name} time = {time}: times must not be negative and must rise")
        schedule.append((time, checks.checked_number(f"{name} volts", volts)))
    if not schedule:
        raise ValueError("set_velocity is empty; at least one (time, volts) is needed")
    return schedule if schedule[0][0] == 0 else [(0.0, 0.0), *schedule]
