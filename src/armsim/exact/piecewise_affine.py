"""Exact solution of piecewise-affine systems, mode by mode.

In each mode the system is affine, ż = A z + b, and its guards, linear functions of the state, stay
within their limits. A run is therefore a sequence of pieces, each in closed form
(`armsim.exact.modal`), joined where a guard reaches a limit (`armsim.exact.crossing`). Time is not
discretised: only the event times are searched for, by steps that are proven not to pass any. The
book's page "How the exact solver works" derives the formulas in the order of these functions.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from numba import typeof, types
from numba.core.errors import NumbaError, UnsupportedBytecodeError
from numba.extending import is_jitted

from armsim.checks import IntegrationError, checked_count, checked_row, checked_times
from armsim.exact import crossing, modal
from armsim.exact.crossing import Mode, is_finite, set_start
from armsim.exact.intrinsics import borrowed, keep_alive
from armsim.exact.modal import OPTIONS, Matrices, compiled, merged
from armsim.machine_code import announced, generated

#: Largest number of events at one time; more are taken as endless switching.
AT_ONCE = 25

# Why a run ends: it is done, or the equations are at fault, or a limit is exceeded.
FINISHED, NOT_FINITE, TOO_INEXACT, WRONG_MODE, MODES_CHASE = range(5)
NO_ROOM, TOO_MANY_EVENTS, TOO_MANY_PIECES, TOO_MANY_MATRICES, SEARCH_TOO_LONG = range(5, 10)
#: Rows of the first room for pieces and events, beside two for each input.
_ROWS = 2048


class Room(NamedTuple):
    """Where a compiled run puts its p pieces and e events."""

    start: np.ndarray  #: (p, 1 + 2n) time and state at the start of each piece, and its b
    label: np.ndarray  #: (p, 2) mode and place of the matrix of each piece
    event_time: np.ndarray  #: (e, 1)
    event: np.ndarray  #: (e, 4) guard, side, mode before, mode after
    here: Mode  #: as last filled in
    matrices: Matrices  #: of the modes, as labelled


# --- a run ------------------------------------------------------------------------------------


@merged
def _enter(equations, mode, u, constants, here, m, duration):
    """Fill in a mode for an input; return its status and the place of its matrix."""
    # `equations` sets only what differs from ż = 0 without limits.
    here.A[:] = here.b[:] = here.normal[:] = 0.0
    here.lower[:], here.upper[:] = -np.inf, np.inf
    equations(mode, u, constants, here)
    if not _is_allowed(here):
        return WRONG_MODE, 0
    place = modal.find(here.A, m, duration)
    if place < 0:
        return TOO_MANY_MATRICES, 0
    return FINISHED if m.loss[place] <= modal.TOLERATED else TOO_INEXACT, place


@compiled
def _is_allowed(here):
    """Whether a mode has finite entries and ordered limits, which may be infinite."""
    finite = is_finite(here.A) and is_finite(here.b) and is_finite(here.normal)
    return finite and (here.lower <= here.upper).all()


@merged
def _run_piece(here, m, place, h, longest_search, start, w, z):
    """Advance `z` to the end of a piece of at most the length `h`.

    Returns the status, the length, and the guard that ends the piece, or -1, with its side. The
    length is 0 if a guard leaves at once, and the time of failure if the status is one.
    """
    if not set_start(here.A, here.b, z, start):
        return NOT_FINITE, 0.0, -1, 0
    guard, side = crossing.stand(here, start, w)
    if guard >= 0:
        return FINISHED, 0.0, guard, side
    p = modal.piece(m, place, here.b, start)
    h = min(h, p.reach) if p.modes == 0 else h
    h, guard, side = crossing.first_crossing(here, p, h, longest_search, w)
    if guard == crossing.GIVEN_UP:
        return SEARCH_TOO_LONG, 0.0, guard, side
    modal.advance(p, h, z)
    if not is_finite(z):
        return NOT_FINITE, _finite_until(p, h, z), guard, side
    if guard >= 0:
        limit = here.upper[guard] if side > 0 else here.lower[guard]
        crossing.put_at_limit(here.normal[guard], limit, z)
    return FINISHED, h, guard, side


@compiled
def _finite_until(p, end, z):
    """Return the time in a piece from which on the state overflows, by bisection."""
    low, high = 0.0, end
    for _ in range(60):
        middle = 0.5 * (low + high)
        modal.advance(p, middle, z)
        low, high = (middle, high) if is_finite(z) else (low, middle)
    return high


@compiled
def given(interval, z, inputs, constants):
    """Return an input that is known in advance; see `solve`."""
    return inputs[interval]


# Merged into its caller, so that the machine code contains no address of `equations` or `successor`
# and numba can cache it on disk.
@merged
def solve(equations, successor, hold, constants, starts, inputs, end, z, mode, limits, room):
    """Run a piecewise-affine system; for `System.solve` and other compiled code.

    Parameters
    ----------
    equations, successor, constants
        As in `System`.
    hold : compiled function
        ``hold(interval, z, inputs, constants)`` returns the input from the time
        ``starts[interval]`` on, where the state is `z`: `given`, or a sampled controller.
    starts : (j,) array
        Times from which the inputs apply; the first is the start of the run.
    inputs
        Passed to `hold`; for `given` a (j, …) array of the inputs.
    end : float
        End of the run.
    z : (n,) array
        State at the start; overwritten with the state at the end.
    mode : int
        Mode at the start.
    limits : (int, int, int)
        Largest numbers of events, of pieces, and of steps of the search for an event.
    room : Room
        Filled in.

    Returns
    -------
    tuple
        Status, time and mode reached, numbers of pieces and events.
    """
    n, guards = z.size, room.here.lower.size
    owned = room, modal.start_room(n), crossing.work_room(n, guards)
    unowned = borrowed(owned)
    result = _follow(
        equations, successor, hold, constants, starts, inputs, end, z, mode, limits, unowned
    )
    keep_alive(owned)
    return result


@merged
def _follow(equations, successor, hold, constants, starts, inputs, end, z, mode, limits, rooms):
    """Follow a run from mode to mode; see `solve`."""
    (begin, label, event_time, event, here, m), start, w = rooms
    pieces = events = at_once = place = 0
    t, n = starts[0], z.size
    for interval in range(starts.size):
        until = end if interval + 1 == starts.size else min(end, starts[interval + 1])
        u, entered = hold(interval, z, inputs, constants), False
        while t < until:
            if max(pieces, events) == begin.shape[0]:
                return NO_ROOM, t, mode, pieces, events
            if not entered:
                status, place = _enter(equations, mode, u, constants, here, m, end - starts[0])
                if status != FINISHED:
                    return status, t, mode, pieces, events
                entered = True
            if pieces == limits[1]:
                return TOO_MANY_PIECES, t, mode, pieces, events
            begin[pieces, 0], begin[pieces, 1 : 1 + n], begin[pieces, 1 + n :] = t, z, here.b
            status, h, guard, side = _run_piece(here, m, place, until - t, limits[2], start, w, z)
            if status != FINISHED:
                return status, t + h, mode, pieces, events
            if h > 0.0:
                label[pieces, 0], label[pieces, 1] = mode, place
                pieces += 1
                at_once = at_once if t + h == t else 0
                t = until if guard < 0 and h == until - t else t + h
                continue
            event_time[events, 0] = t
            event[events, 0], event[events, 1], event[events, 2] = guard, side, mode
            mode, entered = successor(mode, guard, side, z, constants), False
            event[events, 3] = mode
            at_once, events = at_once + 1, events + 1
            if at_once > AT_ONCE:
                return MODES_CHASE, t, mode, pieces, events
            if events > limits[0]:
                return TOO_MANY_EVENTS, t, mode, pieces, events
    return FINISHED, t, mode, pieces, events


@compiled
def sample(room, times, out):
    """Set the rows of `out` (k, n) to the states of a run at `times` (k,)."""
    n, last = out.shape[1], -1
    owned = room.matrices, modal.start_room(n)
    m, start = borrowed(owned)
    pieces = np.searchsorted(room.start[:, 0].copy(), times, side="right") - 1
    for j in range(times.size):
        row, place = room.start[pieces[j]], room.label[pieces[j], 1]
        if pieces[j] != last:
            set_start(m.A[place], row[n + 1 :], row[1 : n + 1], start)
            p, last = modal.piece(m, place, row[n + 1 :], start), pieces[j]
        modal.advance(p, times[j] - row[0], out[j])
    keep_alive(owned)


_RUN = """\
def run(constants, starts, inputs, end, z, mode, limits, room):
    return solve(equations, successor, given, constants, starts, inputs, end, z, mode, limits, room)
"""


# --- called from Python -----------------------------------------------------------------------


class Event(NamedTuple):
    """Change of the mode at one time."""

    time: float  #: of the change
    before: Any  #: mode
    after: Any  #: mode
    causes: tuple[tuple[Any, int], ...]  #: guards that left; side -1 below, +1 above


def _itself(value: Any) -> Any:
    return value


@dataclass(frozen=True, eq=False, repr=False)
class ExactSolution:
    """Exact solution; calling it with times returns the states."""

    room: Room
    end: float
    sample: Callable[[Room, np.ndarray, np.ndarray], None]  #: see `sample`
    mode_name: Callable[[int], Any] = _itself
    guard_name: Callable[[int], Any] = _itself
    inputs: Sequence[tuple[float, Any]] = ()  #: (time, input from then on)
    nfev: int = 0  #: no right-hand side is evaluated

    def __repr__(self) -> str:
        pieces, columns = self.room.start.shape
        size = f"{columns // 2} states, {pieces} pieces, {len(self.events)} events"
        return f"<ExactSolution from t = {self.start:g} to {self.end:g}: {size}>"

    def __call__(self, t: float | np.ndarray) -> np.ndarray:
        """State (n,) at a time, or (n, k) at k times; at a jump, the state after the event.

        Raises
        ------
        ValueError
            If a time lies outside the run, or the times are no single row.
        """
        simple = isinstance(t, float) and self.start <= t <= self.end  # a fast path
        times = np.array([t]) if simple else checked_times(t, self.start, self.end)
        states = np.empty((times.size, self.room.start.shape[1] // 2))
        self.sample(self.room, times, states)
        return np.ascontiguousarray(states.T) if np.ndim(t) else states[0]

    @property
    def start(self) -> float:
        """Start of the run."""
        return float(self.room.start[0, 0])

    @property
    def loss(self) -> float:
        """Estimate, with a margin, of the relative error of any piece, from its matrix's modes."""
        return float(self.room.matrices.loss[self.room.label[:, 1]].max())

    def modes(self, t: np.ndarray) -> list:
        """Modes at the times `t` (k,); at an event, the mode after it."""
        times = checked_times(t, self.start, self.end)
        pieces = np.searchsorted(self.room.start[:, 0], times, side="right") - 1
        numbers, which = np.unique(self.room.label[pieces, 0], return_inverse=True)
        names = [self.mode_name(number) for number in numbers.tolist()]
        return [names[n] for n in which.tolist()]

    @cached_property
    def events(self) -> tuple[Event, ...]:
        """Switching events in time order; changes at the same time form one event."""
        rows = zip(self.room.event_time[:, 0].tolist(), self.room.event.tolist(), strict=True)
        found = []
        for time, same in groupby(rows, key=itemgetter(0)):
            changes = [change for _, change in same]
            causes = tuple((self.guard_name(guard), side) for guard, side, *_ in changes)
            before, after = self.mode_name(changes[0][2]), self.mode_name(changes[-1][3])
            found.append(Event(time, before, after, causes))
        return tuple(found)

    @cached_property
    def t(self) -> np.ndarray:
        """Times for a plot, a thousand equal intervals with the events and switches of input."""
        even = np.linspace(self.start, self.end, 1001)
        switches = [time for time, _ in self.inputs if time < self.end]
        return np.unique(np.concatenate((even, self.room.event_time[:, 0], switches)))

    @cached_property
    def y(self) -> np.ndarray:
        """States (n, k) at the times `t`."""
        return self(self.t)


def recorded(
    run: Callable, sizes: Sequence[int], inputs: int, names: Sequence[Callable] = (_itself, _itself)
) -> Room:
    """Return the pieces and events of ``run(room)``, a compiled `solve`.

    Python makes the arrays, so that the compiled code returns only numbers. Numba makes an array by
    calling Python, and a signal that raises an error there would leave numba with half a result.
    What does not fit is run again with eight times the room. The first room depends on the number
    of inputs, for a controller that is sampled often. Just above it, a run takes twice as long.

    Parameters
    ----------
    run : callable
        Fills in the room that it is given, and returns what `solve` does.
    sizes : (int, int, int)
        Numbers of states, guards and matrices.
    inputs : int
        Number of inputs.
    names : two callables
        Names of a mode and of a guard, for the message.

    Raises
    ------
    IntegrationError
        If the run does not reach its end; the message gives the time and the reason.
    """
    n, guards, matrices = sizes
    here = Mode(np.empty((n, n)), np.empty(n), np.empty((guards, n)), *np.empty((2, guards)))
    rows, known, status = _ROWS + 2 * inputs, modal.room_for(matrices, n), NO_ROOM
    while status == NO_ROOM:
        start, time = np.empty((rows, 1 + 2 * n)), np.empty((rows, 1))
        label, event = np.empty((rows, 2), np.int64), np.empty((rows, 4), np.int64)
        status, end, mode, p, e = run(Room(start, label, time, event, here, known))
        rows *= 8
    room = Room(start[:p].copy(), label[:p].copy(), time[:e].copy(), event[:e].copy(), here, known)
    if status != FINISHED:
        reason = _reason(status, mode, room, *names)
        raise IntegrationError(f"exact solution stopped at t = {end:.12g}: {reason}")
    return room


def _reason(status: int, mode: int, room: Room, mode_name: Callable, guard_name: Callable) -> str:
    """Say why a run stopped, and what its last events were."""
    last = ", ".join(
        f"guard {guard_name(guard)} {'above' if side > 0 else 'below'}: "
        f"{mode_name(before)} to {mode_name(after)}"
        for guard, side, before, after in room.event[-3:].tolist()
    )
    reason = {
        MODES_CHASE: f"more than {AT_ONCE} events at one time: they accumulate, or a mode to "
        "slide is missing",
        TOO_MANY_EVENTS: f"more than {len(room.event) - 1} events",
        TOO_MANY_PIECES: f"more than {len(room.start)} pieces",
        TOO_MANY_MATRICES: f"more than {len(room.matrices.reach)} different matrices",
        NOT_FINITE: "the solution is not finite",
        TOO_INEXACT: "the modes of this matrix are nearly dependent, so that more than "
        f"{modal.TOLERATED:g} of the solution would be lost",
        SEARCH_TOO_LONG: f"no next event found in {crossing.MAX_SEARCH} steps of search",
        WRONG_MODE: f"mode {mode_name(mode)} is not allowed with {_fault(room.here)}",
    }[status]
    return f"{reason} ({last})" if last else reason


def _fault(mode: Mode) -> str:
    """List the entries of a mode that are not allowed."""
    wrong = {name: ~np.isfinite(getattr(mode, name)) for name in ("A", "b", "normal")}
    wrong["lower"] = wrong["upper"] = ~(mode.lower <= mode.upper)
    return ", ".join(
        f"{name}{place} = {getattr(mode, name)[tuple(place)]}"
        for name in wrong
        for place in np.argwhere(wrong[name]).tolist()
    )


class _Uncompiled(Exception):
    """There is no machine code yet for arguments of these types."""


def _ask(signature: Any) -> None:
    """Stand in for the compilation that numba starts by itself, which announces nothing."""
    raise _Uncompiled


@dataclass(frozen=True)
class System:
    """A piecewise-affine system.

    Parameters
    ----------
    equations : function
        ``equations(mode, u, constants, out)`` fills in the `Mode` `out` for an input `u`. On entry
        A, b and the normals are zero and the limits infinite, so it sets only what differs. A must
        not depend on `u`.
    successor : function
        ``successor(mode, guard, side, z, constants)`` returns the mode that follows when a guard
        leaves past its upper limit (`side` 1) or its lower one (-1). It may change the state `z`,
        as at an impact. It must handle sliding: if the mode that it returns leaves by the same
        guard at once, it is called again, and a run in which this does not end is an error.
    guards : int
        Number of guards.
    matrices : int
        Largest number of different matrices A in a run.

    Notes
    -----
    A and b do not depend on time. What happens at given times needs a clock: a state with ż = 1
    and a guard on it, which `successor` may set back to zero.

    Numba compiles both functions, if they are not compiled already; functions that they call must
    be. This takes some ten seconds. The machine code is kept on disk for other processes, unless
    `constants` contains a named tuple that is defined in the script or notebook itself.
    """

    equations: Callable[..., None]
    successor: Callable[..., int]
    guards: int
    matrices: int

    @cached_property
    def _functions(self) -> dict[str, Any]:
        functions = {"equations": self.equations, "successor": self.successor}
        return {name: f if is_jitted(f) else compiled(f) for name, f in functions.items()}

    @cached_property
    def _run(self) -> Any:
        run: Any = generated(_RUN, self._functions | {"solve": solve, "given": given}, **OPTIONS)
        run.compile_now, run.compile = run.compile, _ask
        return run

    def _compile(self, *arguments: Any) -> None:
        """Compile for the types of the arguments."""
        functions = self.equations, self.successor
        name = " and ".join(getattr(function, "__name__", repr(function)) for function in functions)
        try:
            signature = tuple(map(typeof, arguments))
            with announced(f"the exact solver with {name}", self._run):
                self._check_successor(signature[0])
                self._run.compile_now(signature)
        except (NumbaError, UnsupportedBytecodeError, ValueError) as error:
            lines = re.findall(r"^ *(?!Failed in|During)(\S.*)", str(error), re.M)
            name = [name, *re.findall(r"<function (\S+) at", str(error))][-1]
            reason = f"{name}: {' '.join(lines[:2])}".rstrip(":")
            raise TypeError(f"numba cannot compile {reason}") from None

    def _check_successor(self, constants: types.Type) -> None:
        """Raise an error if numba would take modes for floats, as `successor` returns one."""
        function, number = self._functions["successor"], types.int64
        given = number, number, number, types.float64[::1], constants
        mode = types.Dispatcher(function).get_call_type(function.typingctx, given, {}).return_type
        if not isinstance(mode, types.Integer):
            name = function.py_func.__name__
            raise TypeError(f"{name} returns a {mode} as the next mode; an integer is needed")

    def solve(
        self,
        z0: Sequence[float] | np.ndarray,
        mode: int,
        t_span: tuple[float, float],
        inputs: Sequence[tuple[float, Any]] | None = None,
        constants: Any = (),
        max_events: int = 10_000,
    ) -> ExactSolution:
        """Solve from `z0` (n,) in `mode`.

        Parameters
        ----------
        z0 : (n,) array_like
            State at ``t_span[0]``.
        mode : int
            Mode there. If a guard is outside its limits, the first event is at this time.
        t_span : (float, float)
            First and last time.
        inputs : sequence of (time, input), optional
            Input from each time on; times increase from ``t_span[0]``. Default 0.
        constants
            Numbers, arrays and tuples of them, passed to `equations` and `successor`.
        max_events : int
            Largest number of events; more are an error.

        Returns
        -------
        ExactSolution

        Raises
        ------
        TypeError, ValueError
            If an argument is out of range, or a function cannot be compiled.
        IntegrationError
            If the modes switch endlessly at one time, there are too many events, the solution is
            not finite, or `equations` sets an entry that is not allowed. The message gives the
            time and the modes.
        """
        z, (start, end) = checked_row("z0", z0), checked_row("t_span", t_span, 2).tolist()
        if not start < end:
            raise ValueError(f"t_span = {t_span!r} is not allowed; it must rise")
        checked_mode = checked_count("mode", mode, -(2**63))
        try:
            schedule = [(start, 0.0)] if inputs is None else list(inputs)
            times, values = zip(*schedule, strict=True)
            given_inputs = np.array(values, dtype=float)
        except (TypeError, ValueError):
            raise ValueError(f"inputs = {inputs!r}: pairs (time, input) are needed") from None
        starts = checked_row("times of inputs", times)
        if starts[0] != start or not (np.diff(starts) > 0).all():
            raise ValueError(f"times of inputs = {times!r}: they must rise from {start}")
        sizes = checked_count("guards", self.guards, 0), checked_count("matrices", self.matrices)
        limits = checked_count("max_events", max_events, 0), modal.MAX_PIECES, crossing.MAX_SEARCH

        def run(room: Room) -> tuple:
            arguments = constants, starts, given_inputs, end, z.copy(), checked_mode, limits, room
            try:  # to find the types of the arguments takes as long as a hundred events
                return self._run(*arguments)
            except _Uncompiled:
                self._compile(*arguments)
            return self._run(*arguments)

        room = recorded(run, (z.size, *sizes), starts.size)
        return ExactSolution(room, end, sample, inputs=schedule)
