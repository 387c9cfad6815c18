"""Simulation of one axis or of many, and the resulting trajectory."""

import os
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from armsim.arm import dynamics, modes
from armsim.arm.dynamics import Region, constants, rhs
from armsim.arm.parameters import AxisParameters
from armsim.arm.slave_control import MEMORY, SlaveControl, put_out
from armsim.checks import IntegrationError, checked_count, checked_number, checked_times, reals
from armsim.exact import crossing
from armsim.exact.piecewise_affine import Event, ExactSolution, require_finished
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


@dataclass(frozen=True)
class Trajectory:
    """Simulated motion; calling it returns the state (7,) at a time, or (7, n) at n times."""

    parameters: AxisParameters
    schedule: Schedule  #: pairs (time in s, set velocity in V from that time on)
    solution: "ExactSolution | Steps"
    control: SlaveControl | None = None  #: unit that produced the set velocity, if any

    @property
    def t(self) -> np.ndarray:
        """Times (n,) in s: the steps, or for an exact run a plotting grid with all events."""
        return self.solution.t

    @property
    def y(self) -> np.ndarray:
        """States (7, n) y0 … y6 of Table 1 at the times `t`."""
        return self.solution.y

    @property
    def t_end(self) -> float:
        """End of the run in s."""
        return self.solution.end

    @property
    def nfev(self) -> int:
        """Number of right-hand-side evaluations; 0 for an exact run."""
        return self.solution.nfev

    @property
    def events(self) -> tuple[Event, ...]:
        """Switching events of an exact run in time order, with their regions; otherwise empty."""
        return self.solution.events

    @property
    def initial_region(self) -> Region:
        """Region at the start, before any event."""
        return self.events[0].before if self.events else self.regions(self.t[:1])[0]

    def regions(self, t: np.ndarray) -> list[Region]:
        """Regions at the times `t` (n,); at an event of an exact run, the region after it."""
        times = checked_times(t, 0.0, self.t_end)
        if isinstance(self.solution, ExactSolution):
            return self.solution.modes(times)
        k = constants(self.parameters)
        return [dynamics.region(y, k) for y in self(times).T]

    def set_velocity(self, t: np.ndarray | float) -> np.ndarray:
        """Set velocity U in volts at the times `t`; at a switch, the new value."""
        return _set_velocity(self.schedule, t)

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
        times = self.t if t is None else reals("t", t)
        y = self.y if t is None else self(times)
        exact = isinstance(self.solution, ExactSolution)
        regions = self.regions(times) if exact else ()
        return dynamics.auxiliary_variables(self.parameters, y, regions)

    def __call__(self, t: np.ndarray | float) -> np.ndarray:
        """State at the times `t`: exact, or by cubic Hermite interpolation between steps.

        Raises
        ------
        ValueError
            If a time lies outside the run.
        """
        return self.solution(t)


@dataclass(frozen=True)
class Steps:
    """States at the steps of a Runge-Kutta method."""

    parameters: AxisParameters
    schedule: Schedule
    end: float  #: time of the last step in s
    t: np.ndarray
    y: np.ndarray
    nfev: int
    events: tuple = ()  #: a Runge-Kutta method detects none

    def __call__(self, t: np.ndarray | float) -> np.ndarray:
        """States at the times `t` by cubic Hermite interpolation."""
        times = checked_times(t, float(self.t[0]), self.end)
        left = np.searchsorted(self.t[1:-1], times, side="right")
        h = self.t[left + 1] - self.t[left]
        s = (times - self.t[left]) / h
        before, after = self.y[:, left], self.y[:, left + 1]
        volts, k = _set_velocity(self.schedule, self.t[left]), constants(self.parameters)
        slope, slope_after = (
            np.array([rhs(0.0, y, u, k) for y, u in zip(states.T, volts, strict=True)]).T
            for states in (before, after)
        )
        y = runge_kutta.hermite(s, h, before, after, slope, slope_after)
        return runge_kutta.finite_states(t, times, y)


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
    if method is not None:
        steps = _runge_kutta(p, task, method, step_size, form)
        return Trajectory(p, steps.schedule, steps, control)
    if step_size is not None or form != "additive":
        raise ValueError(
            f"step_size = {step_size!r} and form = {form!r} are for a Runge-Kutta method; "
            "give one as method, or leave them out"
        )
    _get_ready()
    solution = _exact(p, task)
    return Trajectory(p, task.schedule, solution, control)


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
    at = reals("times", [t_end] if times is None else times)
    if at.ndim != 1 or not ((at >= 0) & (at <= t_end)).all():
        raise ValueError(f"times = {times!r}: a row of numbers from 0 to t_end = {t_end} is needed")
    if threads is not None:
        checked_count("threads", threads)
    y = np.empty((len(axes), 7, at.size))

    def work(first: int) -> None:
        for n in range(first, min(first + _CHUNK, len(axes))):
            try:
                y[n] = _exact(axes[n], task.copy())(at)
            except IntegrationError as error:
                raise IntegrationError(f"parameters[{n}]: {error}") from None

    _get_ready()
    chunks = range(0, len(axes), _CHUNK)
    if len(chunks) < 2 or threads == 1:
        list(map(work, chunks))
    else:
        with ThreadPoolExecutor(threads or os.cpu_count()) as pool:
            list(pool.map(work, chunks))
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
    record = modes.run((k, dynamics.without_offsets(k)), *task, limits)
    require_finished(record, *_TO_NAMES)
    states = partial(modes.states, p.r_g)
    return ExactSolution(record, task.t_end, states, *_TO_NAMES, task.schedule)


@cache
def _get_ready() -> None:
    """Compile the solver or load it from disk; print a notice if this takes long."""
    with announced("the exact solver for the arm"):
        _exact(AxisParameters.paper_x_axis(), _checked(0.0, None, 1e-9, None))(0.0)


def _runge_kutta(
    p: AxisParameters, task: _Task, method: Tableau, step_size: float | None, form: Form
) -> Steps:
    starts, inputs, t_end, y0 = task
    k, t, y, nfev = constants(p), [np.zeros(1)], [y0[:, None]], 0
    spans, stored = list(pairwise([*starts[starts < t_end].tolist(), t_end])), 0
    if step_size is not None:
        step_size = checked_number("step_size", step_size, above=0.0)
        runge_kutta.step_count(0.0, t_end, step_size, runge_kutta.MAX_STORED // 8)
    for n, span in enumerate(spans):
        now = y[-1][:, -1]
        if inputs.track.size:
            put_out(n, now[2], p.r_g, inputs.track, inputs.law, inputs.memory, inputs.volts)
        args = float(inputs.volts[n]), k
        how = method, step_size, form, args
        run = runge_kutta.integrate(rhs, span, now, *how, max_steps=MAX_STEPS)
        t.append(run.t[1:])
        y.append(run.y[:, 1:])
        nfev, stored = nfev + run.nfev, stored + 8 * run.t.size
        if stored > runge_kutta.MAX_STORED:
            raise IntegrationError(f"{method.name}: at t = {span[1]:.12g} s the memory is full")
    steps = Steps(p, task.schedule, t_end, np.concatenate(t), np.concatenate(y, axis=1), nfev)
    size = "adaptive steps" if step_size is None else f"step size {step_size:g}"
    _raise_if_beyond_bound(steps, f"{method.name}, {size}")
    return steps


def _set_velocity(schedule: Schedule, t: np.ndarray | float) -> np.ndarray:
    starts, volts = np.array(schedule).T
    return volts[np.maximum(np.searchsorted(starts, t, side="right") - 1, 0)]


def _raise_if_beyond_bound(run: Steps, method: str) -> None:
    """Raise an error if the preamplifier has blown up but is still finite.

    Its two lags have a positive impulse response and unit gain, so y4 cannot exceed the largest
    input by more than the contribution of its initial state. The limits hide its growth from the
    other states.
    """
    p, (y4, y5) = run.parameters, run.y[4:6, 0]
    volts = max(abs(u) for _, u in run.schedule)
    largest = p.K_1 * volts + p.K_2 * p.K_t * np.abs(run.y[3]).max()
    bound = 2 * (largest + abs(y4) + (p.T_p + p.T_r) * abs(y5))  # 2 allows for a coarse step
    beyond = np.flatnonzero(np.abs(run.y[4]) > bound)
    if beyond.size:
        first = beyond[0]
        raise IntegrationError(
            f"{method}: the solution blew up; |y4| = {abs(run.y[4, first]):.3g} V at "
            f"t = {run.t[first]:.6g} s is more than the preamplifier can reach ({bound:.3g} V)"
        )


_NO_TRACK, _NO_LAW = np.empty((0, 2)), SlaveControl().law


def _checked(
    set_velocity: SetVelocity | None,
    control: SlaveControl | None,
    t_end: float,
    y0: Sequence[float] | np.ndarray | None,
) -> _Task:
    t_end = checked_number("t_end", t_end, above=0.0)
    state = np.zeros(7) if y0 is None else reals("y0", y0)
    if state.shape != (7,):
        raise ValueError(f"y0 has shape {state.shape}; the 7 states y0 … y6 are needed")
    if not np.isfinite(state).all():
        raise ValueError(f"y0 = {state}: every component must be finite")
    if control is None:
        schedule = _checked_schedule(10.0 if set_velocity is None else set_velocity)
        starts, volts = np.array(schedule).T.copy()
        inputs = modes.Inputs(volts, _NO_TRACK, _NO_LAW, np.zeros(MEMORY))
        return _Task(starts, inputs, t_end, state)
    if not isinstance(control, SlaveControl):
        raise TypeError(f"control = {control!r}: a SlaveControl is needed")
    if set_velocity is not None:
        raise ValueError(f"set_velocity = {set_velocity!r}: with control it must be left out")
    starts, track = control.samples(t_end)
    inputs = modes.Inputs(np.zeros(starts.size), track, control.law, np.zeros(MEMORY))
    return _Task(starts, inputs, t_end, state)


def _checked_schedule(set_velocity: SetVelocity) -> list[tuple[float, float]]:
    rows = getattr(set_velocity, "ndim", hasattr(set_velocity, "__iter__"))
    # Not a union of types, which would be built at every call.
    if isinstance(set_velocity, (float, str)) or not rows:
        return [(0.0, checked_number("set_velocity", set_velocity))]
    schedule: list[tuple[float, float]] = []
    for n, entry in enumerate(set_velocity):
        name = f"set_velocity[{n}]"
        try:
            time, volts = entry
        except (TypeError, ValueError) as error:
            raise ValueError(f"{name} = {entry!r}: a pair (time, volts) is needed") from error
        time = checked_number(f"{name} time", time)
        if time < 0 or (schedule and time <= schedule[-1][0]):
            raise ValueError(f"{name} time = {time}: times must not be negative and must rise")
        schedule.append((time, checked_number(f"{name} volts", volts)))
    if not schedule:
        raise ValueError("set_velocity is empty; at least one (time, volts) is needed")
    return schedule if schedule[0][0] == 0 else [(0.0, 0.0), *schedule]
