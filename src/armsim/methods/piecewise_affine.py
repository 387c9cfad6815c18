"""Exact solution of piecewise-affine systems, mode by mode.

In each mode the system is linear, ż = A z + b, and its guards, linear functions of the state, stay
within their limits. So a run is a chain of pieces, each in closed form (`armsim.methods.modal`),
glued where a guard reaches a limit. Nothing is discretised: all that is searched for is the times
of the events, by steps that are proven not to pass any. The page "How the exact solver works" of
the book derives every formula, in the order of the functions here.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from armsim.methods import modal
from armsim.methods.modal import TERMS, UNKNOWN, Matrices, compiled
from armsim.methods.runge_kutta import IntegrationError

#: A sum is known to this many times the sum of its terms' sizes.
ROUNDING = 16 * float(np.finfo(float).eps)
#: Pieces by Taylor series with a matrix before its eigenvectors are worth their cost.
SERIES_FIRST = 1
#: Events at one time after which the modes are taken to chase each other for ever.
AT_ONCE = 25

FINISHED, MODES_CHASE, TOO_MANY_EVENTS, TOO_MANY_PIECES, NOT_FINITE = range(5)


class Mode(NamedTuple):
    """Equations and guards of a mode, as `System.equations` fills them in."""

    A: np.ndarray  #: (n, n)
    b: np.ndarray  #: (n,)
    normal: np.ndarray  #: (g, n) the guards' values are normal @ z
    lower: np.ndarray  #: (g,) they stay above this, which may be -inf
    upper: np.ndarray  #: (g,) and below this, which may be inf


class Record(NamedTuple):
    """What a compiled run leaves: its p pieces and its e events."""

    status: int  #: `FINISHED` or why not
    start: np.ndarray  #: (p, 1 + 2n) of each piece: time, state, slope
    label: (
        np.ndarray
    )  #: (p, 3) of each piece: mode, place of its matrix, 1 for modal or 0 for series
    event_time: np.ndarray  #: (e, 1)
    event: np.ndarray  #: (e, 4) guard, side, mode before, mode after
    matrices: Matrices
    end: float  #: time that was reached


# --- a guard: when it reaches a limit ---------------------------------------------------------


class Work(NamedTuple):
    """Room for the calculation of a piece; n states, g guards."""

    state: np.ndarray  #: (n,) z at the start
    slope: np.ndarray  #: (n,) ż at the start
    amplitude: np.ndarray  #: (n,) complex, of each mode in ż
    taylor: np.ndarray  #: (TERMS, n)
    value: np.ndarray  #: (g,) of each guard at the start
    noise: np.ndarray  #: (g,) what the value is known to
    order: np.ndarray  #: (g,) 0 between the limits; at one, order of the first derivative not zero
    derivative: np.ndarray  #: (g,) size of that derivative
    c: np.ndarray  #: (n,) complex, of each mode in the slope of the guard in hand
    d: np.ndarray  #: (n,) complex, and in the slope of its slope, by way of integrals
    change: np.ndarray  #: (TERMS,) its Taylor coefficients
    proof: np.ndarray  #: (5, n + 1) see `_gain_modal`


@compiled
def _times(A, v):
    product = np.zeros(v.size)
    for i in range(v.size):
        for j in range(v.size):
            product[i] += A[i, j] * v[j]
    return product


@compiled
def _stand(here, z, w):
    """Note how each guard stands at the start of a piece; return what leaves, and past which side.

    A guard at a limit leaves or turns inwards as the first of its derivatives says that is not
    zero to within rounding.
    """
    n = z.size
    for g in range(here.lower.size):
        lower, upper, value, sizes = here.lower[g], here.upper[g], 0.0, 0.0
        for i in range(n):
            value += here.normal[g, i] * z[i]
            sizes += abs(here.normal[g, i] * z[i])
        near = upper if abs(upper - value) < abs(value - lower) else lower
        noise = ROUNDING * (sizes + abs(near)) if math.isfinite(near) else ROUNDING * sizes
        w.value[g], w.noise[g], w.order[g] = value, noise, 0
        side = 1 if value >= upper - noise else -1 if value <= lower + noise else 0
        if side == 0:
            continue
        if value > upper + noise or value < lower - noise:
            return g, side
        v, size = w.slope, _times(np.abs(here.A), np.abs(z)) + np.abs(here.b)
        while w.order[g] <= n:
            w.order[g] += 1
            derivative = sizes = 0.0
            for i in range(n):
                derivative += here.normal[g, i] * v[i]
                sizes += abs(here.normal[g, i]) * size[i]
            if abs(derivative) > ROUNDING * sizes:
                if side * derivative > 0.0:
                    return g, side
                break
            v, size = _times(here.A, v), _times(np.abs(here.A), size)
        w.derivative[g] = abs(derivative)
    return -1, 0


@compiled
def _resolve(normal, m, place, by_modes, w):
    """Set the formula of a guard's value in the piece; return its steady drift."""
    drift, modes = 0.0, m.modes[place] if by_modes else 0
    for k in range(modes):
        w.c[k] = w.d[k] = 0.0
    if not by_modes:
        w.change[:] = 0.0
    for i in range(normal.size):
        if normal[i] == 0.0:
            continue
        integral = m.unit[place, i] == 0.0
        if not by_modes:
            for j in range(TERMS):
                w.change[j] += normal[i] * w.taylor[j, i]
        elif integral:
            drift += normal[i] * w.slope[i]
        for k in range(modes):
            term = normal[i] * m.column[place, i, k] * w.amplitude[k]
            if integral:
                w.d[k] += term
            else:
                w.c[k] += term
    return drift


@compiled
def _gain_modal(rate, inverse, modes, drift, s, rest, w):
    """Return gain and slope of a guard at `s`, the sizes of its terms, and how far `proof` reaches.

    The gain is drift s + Σ Re(c E₁(λ, s) + d E₂(λ, s)). For the proof, `w.proof` keeps: slope and
    bound of the second derivative of the k slowest modes together; and of each mode alone, how far
    it can still lift and lower the guard, and the steady slope that it tends to. `rest` is what
    remains of the piece.
    """
    slope, bend, up, down, steady = w.proof
    gain, sizes, reach = drift * s, abs(drift * s), rest
    slope[0], bend[0] = drift, 0.0
    for k in range(modes):
        up[k], down[k], steady[k] = math.inf, math.inf, 0.0
        if w.c[k] == 0.0 and w.d[k] == 0.0:
            up[k] = down[k] = 0.0
            slope[k + 1], bend[k + 1] = slope[k], bend[k]
            continue
        power, first, second = modal.integrals(rate[k], inverse[k], s)
        one, two = w.c[k] * first, w.d[k] * second
        gain += one.real + two.real
        sizes += abs(one.real) + abs(one.imag) + abs(two.real) + abs(two.imag)
        slope[k + 1] = slope[k] + (w.c[k] * power + w.d[k] * first).real
        curvature = (w.c[k] * rate[k] + w.d[k]) * power
        size = math.sqrt(curvature.real**2 + curvature.imag**2)
        if rate[k].real > 0.0:
            reach = min(reach, 1.0 / rate[k].real)
            size *= math.exp(min(1.0, rate[k].real * rest))
        elif rate[k] != 0.0:
            square = inverse[k] * inverse[k]
            centre = (curvature * square).real
            radius = size * (inverse[k].real ** 2 + inverse[k].imag ** 2)
            if rate[k].imag == 0.0:  # it goes straight to its rest, not around it
                centre, radius = 0.5 * centre, 0.5 * radius
            up[k], down[k], steady[k] = (
                radius - centre,
                radius + centre,
                -(w.d[k] * inverse[k]).real,
            )
        bend[k + 1] = bend[k] + size
    return gain, slope[modes], sizes, reach


@compiled
def _gain_series(s, end, w):
    """As `_gain_modal`; all is in one bound of the second derivative, as of no mode at all."""
    gain = slope = sizes = bend = 0.0
    for j in range(TERMS - 1, -1, -1):
        gain = (gain + w.change[j]) * s
        sizes = (sizes + abs(w.change[j])) * s
        slope = slope * s + (j + 1) * w.change[j]
        if j > 0:
            bend = bend * end + (j + 1) * j * abs(w.change[j])
    w.proof[0, 0], w.proof[1, 0] = slope, bend
    return gain, slope, sizes, end - s


@compiled
def _longest(room, slope, bend):
    """Return the largest u for which slope u + bend u²/2 ≤ room."""
    if room == math.inf:
        return math.inf
    if room <= 0.0:
        return 0.0
    root = math.sqrt(slope * slope + 2.0 * bend * room)
    if slope > 0.0:
        return 2.0 * room / (slope + root)
    return (root - slope) / bend if bend > 0.0 else math.inf


@compiled
def _safe_step(above, below, modes, rest, proof):
    """Longest time for which a guard provably keeps within the room above and below it.

    Each mode is either followed, by its slope and the bound of its second derivative, or boxed, by
    the farthest that it can move. Boxing the fastest modes, one more at a time, gives as many
    proofs; the best counts.
    """
    slope, bend, up, down, steady = proof
    step, boxed = 0.0, 0.0
    for k in range(modes, -1, -1):
        if k < modes:
            above, below, boxed = above - up[k], below - down[k], boxed + steady[k]
            if not (above > 0.0 and below > 0.0):
                break
        tilt = slope[k] + boxed
        longest = min(_longest(above, tilt, bend[k]), _longest(below, -tilt, bend[k]))
        step = max(step, longest)
        if step >= rest:
            break
    return min(step, rest)


@compiled
def _arrival(m, place, by_modes, drift, value, lower, upper, noise, s, end, w):
    """First time from `s` to `end` at which a guard reaches a limit, and its side; 0 for none."""
    modes = m.modes[place] if by_modes else 0
    step = 0.0
    while s < end:
        if by_modes:
            gain, slope, sizes, reach = _gain_modal(
                m.rate[place], m.inverse[place], modes, drift, s, end - s, w
            )
        else:
            gain, slope, sizes, reach = _gain_series(s, end, w)
        g, error = value + gain, noise + ROUNDING * (sizes + abs(slope) * s)
        if upper - g <= error or g - lower <= error:
            side = 1 if upper - g <= error else -1
            room = upper - g if side > 0 else g - lower
            if abs(room) < side * slope * step:  # one last step, by Newton
                s += room / abs(slope)
            return min(s, end), side
        step = _safe_step(upper - g + error, g - lower + error, modes, reach, w.proof)
        s += step
    return end, 0


@compiled
def _clearance(m, place, by_modes, order, derivative, width, end, w):
    """Time by which a guard that turns inwards is clear of its limit, and not yet at the other.

    In g ≥ |D| uᵒ/o! - bound uᵒ⁺¹/(o+1)! the first derivative D that is not zero, of order o, keeps
    the upper hand for a while.
    """
    bound, u = 0.0, end
    if by_modes:
        for k in range(m.modes[place]):
            rate = m.rate[place, k]
            size = abs(w.c[k] * rate + w.d[k]) * abs(rate) ** (order - 1)
            if rate.real > 0.0:
                u = min(u, 1.0 / rate.real)
                size *= math.exp(min(1.0, rate.real * end))
            bound += size
    else:
        for j in range(TERMS - 1, order - 1, -1):
            size = abs(w.change[j])
            for factor in range(j - order + 1, j + 2):
                size *= factor
            bound = bound * end + size
    if derivative == 0.0 and bound == 0.0:
        return u
    if order > w.slope.size:  # none is known from zero: go on a little, and look again
        return min(u, 1e-3 * m.reach[place])
    factorial = 1.0
    for factor in range(2, order + 1):
        factorial *= factor
    if bound > 0.0:
        u = min(u, 0.5 * (order + 1) * derivative / bound)
    return min(u, (factorial * width / (3.0 * derivative)) ** (1.0 / order))


# --- a run ------------------------------------------------------------------------------------


@compiled
def _first_arrival(here, m, place, by_modes, end, w):
    """How long the piece lasts, at most `end`; the guard that ends it, or -1; and its side."""
    first, side = -1, 0
    for g in range(here.lower.size):
        lower, upper, begin = here.lower[g], here.upper[g], 0.0
        drift = _resolve(here.normal[g], m, place, by_modes, w)
        if not by_modes:
            farthest = 0.0
            for j in range(TERMS - 1, -1, -1):
                farthest = (farthest + abs(w.change[j])) * end
            if lower + farthest < w.value[g] < upper - farthest:
                continue
        if w.order[g] > 0:
            begin = _clearance(
                m, place, by_modes, w.order[g], w.derivative[g], upper - lower, end, w
            )
        s, hit = _arrival(
            m, place, by_modes, drift, w.value[g], lower, upper, w.noise[g], begin, end, w
        )
        if hit != 0:
            end, first, side = s, g, hit
    return end, first, side


@compiled
def _put_at_limit(normal, limit, z):
    """Remove the rounding error of a guard that has just reached its limit.

    Each state changes in proportion to its share in the guard; a zero stays zero.
    """
    excess, total = -limit, 0.0
    for i in range(z.size):
        excess += normal[i] * z[i]
        total += (normal[i] * z[i]) ** 2
    if total > 0.0:
        for i in range(z.size):
            z[i] -= excess * normal[i] * z[i] ** 2 / total


@compiled
def _run_piece(here, m, place, h, z, w):
    """Advance `z` to the end of the piece; return its length, the guard that ends it and its side.

    Where a guard leaves at once, the length is 0.
    """
    n = z.size
    guard, side = _stand(here, z, w)
    if guard >= 0:
        return 0.0, guard, side
    if m.modes[place] == UNKNOWN and m.pieces[place] >= SERIES_FIRST:
        modal.decompose(m, place)
    by_modes = m.modes[place] >= 0
    if by_modes:
        modal.set_amplitudes(m, place, w.slope, w.amplitude)
    else:
        m.pieces[place] += 1
        modal.set_taylor(here.A, w.slope, w.taylor)
        h = min(h, m.reach[place])
    h, guard, side = _first_arrival(here, m, place, by_modes, h, w)
    for i in range(n):
        w.state[i] = z[i]
    modal.advance(m, place, by_modes, w.state, w.slope, w.amplitude, w.taylor, h, z)
    if guard >= 0:
        _put_at_limit(here.normal[guard], here.upper[guard] if side > 0 else here.lower[guard], z)
    return h, guard, side


@compiled
def _work_room(n, guards):
    number = np.complex128
    return Work(
        np.empty(n),
        np.empty(n),
        np.empty(n, number),
        np.empty((TERMS, n)),
        np.empty(guards),
        np.empty(guards),
        np.empty(guards, np.int64),
        np.empty(guards),
        np.empty(n, number),
        np.empty(n, number),
        np.empty(TERMS),
        np.empty((5, n + 1)),
    )


@compiled
def _longer(rows):
    longer = np.empty((2 * rows.shape[0], rows.shape[1]), rows.dtype)
    for i in range(rows.shape[0]):
        for j in range(rows.shape[1]):
            longer[i, j] = rows[i, j]
    return longer


@compiled
def _set_slope(here, z, slope):
    """Set `slope` to A z + b; return whether it is finite."""
    finite = True
    for i in range(z.size):
        slope[i] = here.b[i]
        for j in range(z.size):
            slope[i] += here.A[i, j] * z[j]
        finite = finite and math.isfinite(slope[i])
    return finite


# Inlined into its caller: so its caller's machine code holds no address of `equations` and
# `successor`, and numba can keep it on disk.
@njit(fastmath={"contract"}, error_model="numpy", nogil=True, forceinline=True)
def solve(equations, successor, constants, starts, inputs, end, z, mode, sizes, limits):
    """Run a piecewise-affine system: what `System.solve` calls, for use in other compiled code.

    Parameters
    ----------
    equations, successor, constants
        As in `System`.
    starts, inputs : (j,) and (j, …) arrays
        Times from which the inputs hold, the first being the start of the run; and the inputs.
    end : float
        End of the run.
    z : (n,) array
        State at the start, and when it returns, at the end.
    mode : int
        Mode at the start.
    sizes : (int, int)
        Number of guards, and of different matrices at most.
    limits : (int, int)
        Largest number of events and of pieces.

    Returns
    -------
    Record
    """
    n = z.size
    here = Mode(
        np.empty((n, n)),
        np.empty(n),
        np.empty((sizes[0], n)),
        np.empty(sizes[0]),
        np.empty(sizes[0]),
    )
    m, w = modal.room_for(sizes[1], n), _work_room(n, sizes[0])
    start, label = np.empty((32, 1 + 2 * n)), np.empty((32, 3), np.int64)
    event_time, event = np.empty((32, 1)), np.empty((32, 4), np.int64)
    pieces = events = at_once = known = interval = place = 0
    t, status, new = starts[0], FINISHED, True
    while t < end:
        until = end if interval + 1 == starts.size else min(end, starts[interval + 1])
        if t == until:
            interval, new = interval + 1, True
            continue
        if new:
            equations(mode, inputs[interval], constants, here)
            place = modal.find(here.A, m, known)
            known, new = max(known, place + 1), False
        if not _set_slope(here, z, w.slope):
            status = NOT_FINITE
            break
        if pieces == limits[1]:
            status = TOO_MANY_PIECES
            break
        if pieces == start.shape[0]:
            start, label = _longer(start), _longer(label)
        start[pieces, 0] = t
        for i in range(n):
            start[pieces, 1 + i], start[pieces, 1 + n + i] = z[i], w.slope[i]
        h, guard, side = _run_piece(here, m, place, until - t, z, w)
        if h > 0.0:
            label[pieces, 0], label[pieces, 1], label[pieces, 2] = mode, place, m.modes[place] >= 0
            pieces += 1
            at_once = at_once if t + h == t else 0
            t = until if guard < 0 and h == until - t else t + h
            continue
        at_once += 1
        if events == event.shape[0]:
            event_time, event = _longer(event_time), _longer(event)
        event_time[events, 0] = t
        event[events, 0], event[events, 1], event[events, 2] = guard, side, mode
        mode, new = successor(mode, guard, side, z, constants), True
        event[events, 3] = mode
        events += 1
        if at_once > AT_ONCE or events > limits[0]:
            status = MODES_CHASE if at_once > AT_ONCE else TOO_MANY_EVENTS
            break
    return Record(status, start[:pieces], label[:pieces], event_time[:events], event[:events], m, t)


@compiled
def sample(record, times, out):
    """Set `out` (n, k) to the states of a run at `times` (k,)."""
    n, last, m = out.shape[0], -1, record.matrices
    w = _work_room(n, 0)
    for j in range(times.size):
        piece = _piece_at(record, times[j])
        place, by_modes = record.label[piece, 1], record.label[piece, 2] == 1
        state, slope = record.start[piece, 1 : n + 1], record.start[piece, n + 1 :]
        if piece != last and by_modes:
            modal.set_amplitudes(m, place, slope, w.amplitude)
        elif piece != last:
            modal.set_taylor(m.A[place], slope, w.taylor)
        last, u = piece, times[j] - record.start[piece, 0]
        modal.advance(m, place, by_modes, state, slope, w.amplitude, w.taylor, u, w.state)
        for i in range(n):
            out[i, j] = w.state[i]


@compiled
def _piece_at(record, t):
    """Index of the piece that holds a time; where two meet, the later."""
    low, high = 0, record.start.shape[0]
    while high - low > 1:
        middle = (low + high) // 2
        if record.start[middle, 0] <= t:
            low = middle
        else:
            high = middle
    return low


@compiled
def modes_at(record, times, out):
    """Set `out` (k,) to the modes of a run at `times` (k,)."""
    for j in range(times.size):
        out[j] = record.label[_piece_at(record, times[j]), 0]


# --- for users --------------------------------------------------------------------------------


class Event(NamedTuple):
    """A time at which the mode changes."""

    time: float
    before: Any  #: mode
    after: Any  #: mode
    causes: tuple[tuple[Any, int], ...]  #: guards that left, with the side: -1 below, +1 above


def _itself(value: Any) -> Any:
    return value


@dataclass(frozen=True)
class ExactSolution:
    """Exact solution: call it with times for the states, and read off its events."""

    record: Record
    end: float
    states: Callable[[Record, np.ndarray], np.ndarray]  #: from a record and times (k,): (n, k)
    mode_name: Callable[[int], Any] = _itself
    guard_name: Callable[[int], Any] = _itself
    grid: tuple[float, ...] = ()  #: times that `t` has besides the events
    nfev: int = 0  #: no right-hand side is evaluated

    def __call__(self, t: float | np.ndarray) -> np.ndarray:
        """State (n,) at a time, or (n, k) at k times; where it jumps, that after the event.

        Raises
        ------
        ValueError
            If a time lies outside the run.
        """
        times = np.atleast_1d(np.asarray(t, dtype=float))
        outside = ~((times >= self.start) & (times <= self.end))
        if outside.any():
            raise ValueError(
                f"t = {times[outside][0]} is outside the run; allowed is {self.start} to {self.end}"
            )
        states = self.states(self.record, times)
        return states[:, 0] if np.ndim(t) == 0 else states

    @property
    def start(self) -> float:
        """Start of the run."""
        return float(self.record.start[0, 0])

    def modes(self, t: np.ndarray) -> list:
        """Modes at the times `t` (k,); at an event, the mode after it."""
        out = np.empty(len(t), np.int64)
        modes_at(self.record, np.asarray(t, dtype=float), out)
        return [self.mode_name(mode) for mode in out.tolist()]

    @cached_property
    def events(self) -> tuple[Event, ...]:
        """Switching events in the order of time; what happens at one time is one event."""
        found: list[Event] = []
        rows = zip(self.record.event_time[:, 0].tolist(), self.record.event.tolist(), strict=True)
        for time, (guard, side, before, after) in rows:
            cause = (self.guard_name(guard), side)
            if found and found[-1].time == time:
                last = found.pop()
                found.append(Event(time, last.before, self.mode_name(after), (*last.causes, cause)))
            else:
                found.append(Event(time, self.mode_name(before), self.mode_name(after), (cause,)))
        return tuple(found)

    @cached_property
    def t(self) -> np.ndarray:
        """Times for a drawing: a thousand equal intervals, the events and the switches of input."""
        even = np.linspace(self.start, self.end, 1001)
        return np.unique(np.concatenate((even, self.record.event_time[:, 0], self.grid)))

    @cached_property
    def y(self) -> np.ndarray:
        """States (n, k) at the times `t`."""
        return self(self.t)


def require_finished(record: Record, mode_name: Callable = _itself, guard_name=_itself) -> None:
    """Raise an `IntegrationError` that says where and why, if a run did not reach its end."""
    if record.status == FINISHED:
        return
    last = ", ".join(
        f"guard {guard_name(guard)} {'above' if side > 0 else 'below'}: "
        f"{mode_name(before)} to {mode_name(after)}"
        for guard, side, before, after in record.event[-3:].tolist()
    )
    reason = {
        MODES_CHASE: f"more than {AT_ONCE} events at one time: they accumulate, or a mode to "
        "slide is missing",
        TOO_MANY_EVENTS: f"more than {len(record.event) - 1} events",
        TOO_MANY_PIECES: f"more than {len(record.start)} pieces",
        NOT_FINITE: "the solution is not finite",
    }[record.status]
    raise IntegrationError(
        f"exact solution stopped at t = {record.end:.12g}: {reason}"
        + (f" ({last})" if last else "")
    )


@dataclass(frozen=True)
class System:
    """A piecewise-affine system.

    Parameters
    ----------
    equations : compiled function
        ``equations(mode, u, constants, out)`` fills in the `Mode` `out` for an input `u`: every
        entry of its arrays, which hold what an earlier call left.
    successor : compiled function
        ``successor(mode, guard, side, z, constants)`` returns the mode that follows when a guard
        leaves past its upper limit (`side` 1) or its lower one (-1). It may change the state `z`,
        as an impact does. It has to decide on sliding: if the mode that it returns leaves by the
        same guard at once, it is asked again, and a run in which this does not end is an error.
    guards : int
        Number of guards.
    matrices : int
        Number of different matrices A that can occur in a run, at most.
    """

    equations: Callable[..., None]
    successor: Callable[..., int]
    guards: int
    matrices: int

    @cached_property
    def _run(self) -> Callable[..., Record]:
        equations, successor, sizes = self.equations, self.successor, (self.guards, self.matrices)

        @compiled
        def run(constants, starts, inputs, end, z, mode, limits):
            return solve(
                equations, successor, constants, starts, inputs, end, z, mode, sizes, limits
            )

        return run

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
            Mode there. If a guard says otherwise, the first event is at this time.
        t_span : (float, float)
            First and last time.
        inputs : sequence of (time, input), optional
            Input from each time on, rising from ``t_span[0]``; 0 if left out.
        constants
            Handed to the compiled functions.
        max_events : int
            More events than these are an error.

        Returns
        -------
        ExactSolution

        Raises
        ------
        ValueError
            If an argument is out of range.
        IntegrationError
            If the modes chase each other at one time, there are too many events, or the solution
            is not finite; the message says when, and names the modes.
        """
        start, end = map(float, t_span)
        z = np.array(z0, dtype=float)
        if not (math.isfinite(start) and math.isfinite(end) and start < end):
            raise ValueError(f"t_span = {t_span!r} is not allowed; it must be finite and rise")
        if z.ndim != 1 or not np.isfinite(z).all():
            raise ValueError(f"z0 = {z0!r}: one row of finite numbers is needed")
        times, values = zip(*(inputs or [(start, 0.0)]), strict=True)
        starts = np.array(times, dtype=float)
        if starts[0] != start or not (np.diff(starts) > 0).all():
            raise ValueError(f"times of inputs = {times!r}: they must rise from {start}")
        record = self._run(
            constants, starts, np.array(values, float), end, z, mode, (max_events, 10**6)
        )
        require_finished(record)
        return ExactSolution(record, end, states, grid=times)


def states(record: Record, times: np.ndarray) -> np.ndarray:
    """States (n, k) of a run at `times` (k,)."""
    out = np.empty((record.start.shape[1] // 2, len(times)))
    sample(record, times, out)
    return out
