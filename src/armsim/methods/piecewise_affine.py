"""Exact solution of piecewise-affine systems, mode by mode.

In each mode the system is linear, ż = A z + b, and its guards, linear functions of the state, stay
within their limits. So a run is a chain of pieces, each a sum of exponentials, glued where a guard
reaches a limit. Nothing is discretised: all that is searched for is the times of the events, by
steps that are proven not to pass any. The page "The exact solution" of the book derives every
formula, in the order of the functions below.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from armsim.methods.runge_kutta import IntegrationError

_OPTIONS = {"fastmath": {"contract"}, "error_model": "numpy", "nogil": True}
_compiled = njit(**_OPTIONS)

#: A sum is known to this many times the sum of its terms' sizes.
ROUNDING = 16 * float(np.finfo(float).eps)
#: Largest entry of the inverse of the eigenvectors with which the modal form is used.
WELL_CONDITIONED = 1e5
#: Terms of the Taylor series; while ‖A‖u ≤ 1 the next one is below rounding.
TERMS = 19
#: Pieces by Taylor series with a matrix before its eigenvectors are worth their cost.
SERIES_FIRST = 1
#: Events at one time after which the modes are taken to chase each other for ever.
AT_ONCE = 25

UNKNOWN, DEFECTIVE = -2, -1
FINISHED, MODES_CHASE, TOO_MANY_EVENTS, TOO_MANY_PIECES, NOT_FINITE = range(5)


class Mode(NamedTuple):
    """Equations and guards of a mode, as `System.equations` fills them in."""

    A: np.ndarray  #: (n, n)
    b: np.ndarray  #: (n,)
    normal: np.ndarray  #: (g, n) the guards' values are normal @ z
    lower: np.ndarray  #: (g,) they stay above this, which may be -inf
    upper: np.ndarray  #: (g,) and below this, which may be inf


class Matrices(NamedTuple):
    """The different matrices that a run has met, and their modal forms where it needed them."""

    A: np.ndarray  #: (k, n, n)
    unit: np.ndarray  #: (k, n) units of the states that balance it; 0 where no derivative feels one
    reach: np.ndarray  #: (k,) 1/‖A‖ in these units: longest piece for the Taylor series
    pieces: np.ndarray  #: (k,) number made by Taylor series
    modes: np.ndarray  #: (k,) number of modes kept; or `UNKNOWN`, `DEFECTIVE`
    rate: np.ndarray  #: (k, n) complex λ, slowest first; of a pair only the one with positive part
    column: np.ndarray  #: (k, n, n) complex: amplitudes to states, doubled for a pair
    row: np.ndarray  #: (k, n, n) complex: states to amplitudes


class Record(NamedTuple):
    """What a compiled run leaves: its pieces and its events."""

    status: int  #: `FINISHED` or why not
    start: np.ndarray  #: (p, 1 + 2n) of each piece: time, state, slope
    label: np.ndarray  #: (p, 3) of each piece: mode, place of its matrix, 1 if modal and 0 if series
    event_time: np.ndarray  #: (e, 1)
    event: np.ndarray  #: (e, 4) guard, side, mode before, mode after
    matrices: Matrices
    end: float  #: time that was reached


# --- a matrix: units, eigenvectors ------------------------------------------------------------


@_compiled
def _balance(A, unit):
    """Find units of the states, powers of two, that make rows and columns of `A` alike in size.

    A state that no derivative depends on is a mere integral of the others and gets the unit 0.
    Returns the norm of the matrix of the others in these units.
    """
    n = unit.size
    for j in range(n):
        unit[j] = 0.0
        for i in range(n):
            if A[i, j] != 0.0:
                unit[j] = 1.0
    for _ in range(20):
        changed = False
        for i in range(n):
            row = column = 0.0
            for j in range(n):
                if j != i and unit[i] * unit[j] > 0.0:
                    row += abs(A[i, j]) * unit[j]
                    column += abs(A[j, i]) / unit[j]
            if row > 0.0 and column > 0.0:
                better = 2.0 ** round(0.5 * math.log2(row / column))
                changed = changed or better != unit[i]
                unit[i] = better
        if not changed:
            break
    norm = 0.0
    for j in range(n):
        total = 0.0
        for i in range(n):
            if unit[i] > 0.0:
                total += abs(A[i, j]) * unit[j] / unit[i]
        norm = max(norm, total)
    return norm


@_compiled
def _find(A, m, count):
    """Place of `A` among the first `count` matrices, to which it is added if it is new."""
    n = A.shape[0]
    for place in range(count):
        same = True
        for i in range(n):
            for j in range(n):
                same = same and m.A[place, i, j] == A[i, j]
        if same:
            return place
    for i in range(n):
        for j in range(n):
            m.A[count, i, j] = A[i, j]
    m.reach[count] = 1.0 / _balance(A, m.unit[count])
    m.pieces[count], m.modes[count] = 0, UNKNOWN
    return count


@_compiled
def _invert(V, W):
    """Set `W` to the inverse of `V`, which is destroyed; return its largest entry."""
    n = V.shape[0]
    for i in range(n):
        for j in range(n):
            W[i, j] = 1.0 if i == j else 0.0
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(V[i, k]) > abs(V[pivot, k]):
                pivot = i
        if V[pivot, k] == 0.0:
            return math.inf
        for j in range(n):
            V[k, j], V[pivot, j] = V[pivot, j], V[k, j]
            W[k, j], W[pivot, j] = W[pivot, j], W[k, j]
        factor = 1.0 / V[k, k]
        for j in range(n):
            V[k, j] *= factor
            W[k, j] *= factor
        for i in range(n):
            factor = V[i, k]
            if i != k and factor != 0.0:
                for j in range(n):
                    V[i, j] -= factor * V[k, j]
                    W[i, j] -= factor * W[k, j]
    largest = 0.0
    for i in range(n):
        for j in range(n):
            largest = max(largest, abs(W[i, j]))
    return largest


@_compiled
def _product(A, B):
    """Product of two small matrices, which starts no library."""
    n = A.shape[0]
    product = np.zeros((n, n), np.complex128)
    for i in range(n):
        for k in range(n):
            for j in range(n):
                product[i, j] += A[i, k] * B[k, j]
    return product


@_compiled
def _decompose(m, place):
    """Find the modal form of a matrix, or mark it as near-defective."""
    A, unit, n = m.A[place], m.unit[place], m.unit.shape[1]
    core = [i for i in range(n) if unit[i] > 0.0]
    size = len(core)
    C = np.empty((size, size), np.complex128)
    W = np.empty((size, size), np.complex128)
    for i in range(size):
        for j in range(size):
            C[i, j] = A[core[i], core[j]] * unit[core[j]] / unit[core[i]]
    rate, V = np.linalg.eig(C)
    m.modes[place] = DEFECTIVE
    if not _invert(V.copy(), W) < WELL_CONDITIONED:
        return
    # One Newton step: eigenvalues come with an error of the largest one's rounding. W C V shows
    # what each still lacks, and how much of the other eigenvectors each has.
    D = _product(W, _product(C, V))
    X = np.zeros_like(D)
    for i in range(size):
        rate[i] = D[i, i]
    for i in range(size):
        for j in range(size):
            if i != j:
                X[i, j] = D[i, j] / (rate[j] - rate[i])
    V += _product(V, X)
    W -= _product(X, W)
    kept, total, real = 0, 0, 1e-10 / m.reach[place]
    for _ in range(size):
        k = 0
        for other in range(1, size):
            if abs(rate[other]) < abs(rate[k]):
                k = other
        value, rate[k] = rate[k], math.inf
        if value.imag < -real:
            continue
        weight = 2 if value.imag > real else 1
        m.rate[place, kept] = value if weight == 2 else complex(value.real)
        for i in range(n):
            m.row[place, kept, i] = m.column[place, i, kept] = 0.0
        for i in range(size):
            m.row[place, kept, core[i]] = W[k, i] / unit[core[i]]
            m.column[place, core[i], kept] = weight * V[i, k] * unit[core[i]]
        for i in range(n):
            if unit[i] == 0.0:  # an integral of the others
                for j in core:
                    m.column[place, i, kept] += A[i, j] * m.column[place, j, kept]
        kept, total = kept + 1, total + weight
    if total == size:
        m.modes[place] = kept


# --- a piece: its formula ---------------------------------------------------------------------


@_compiled
def _integrals(rate, t):
    """Return exp(λt) and its first and second integral over (0, t), accurate also as λt → 0."""
    x = rate * t
    if abs(x.real) + abs(x.imag) < 0.5:
        series = 1.0 + x * (1 / 16)
        for n in range(15, 2, -1):
            series = 1.0 + x * (1.0 / n) * series
        second = 0.5 * t * t * series
        first = t + rate * second
        return 1.0 + rate * first, first, second
    size, inverse = math.exp(x.real), 1.0 / rate
    power = complex(size * math.cos(x.imag), size * math.sin(x.imag))
    first = (power - 1.0) * inverse
    return power, first, (first - t) * inverse


@_compiled
def _set_amplitudes(m, place, slope, amplitude):
    """Amplitude of each mode in the slope at the start of a piece."""
    for k in range(m.modes[place]):
        total = 0j
        for i in range(slope.size):
            total += m.row[place, k, i] * slope[i]
        amplitude[k] = total


@_compiled
def _set_taylor(A, slope, taylor):
    """Coefficients of u, u², … in the state at a time u after the start of a piece."""
    n = slope.size
    for i in range(n):
        taylor[0, i] = slope[i]
    for j in range(1, TERMS):
        factor = 1.0 / (j + 1)
        for i in range(n):
            total = 0.0
            for k in range(n):
                total += A[i, k] * taylor[j - 1, k]
            taylor[j, i] = factor * total


@_compiled
def _advance(m, place, modal, state, slope, amplitude, taylor, u, out):
    """State `out` at a time `u` after the start of a piece."""
    n = out.size
    if not modal:
        for i in range(n):
            total = 0.0
            for j in range(TERMS - 1, -1, -1):
                total = (total + taylor[j, i]) * u
            out[i] = state[i] + total
        return
    for i in range(n):
        out[i] = state[i]
        if m.unit[place, i] == 0.0:
            out[i] += slope[i] * u
    for k in range(m.modes[place]):
        _, first, second = _integrals(m.rate[place, k], u)
        first, second = amplitude[k] * first, amplitude[k] * second
        for i in range(n):
            grown = first if m.unit[place, i] > 0.0 else second
            out[i] += (m.column[place, i, k] * grown).real


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


@_compiled
def _times(A, v):
    product = np.zeros(v.size)
    for i in range(v.size):
        for j in range(v.size):
            product[i] += A[i, j] * v[j]
    return product


@_compiled
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


@_compiled
def _resolve(normal, m, place, modal, w):
    """Set the formula of a guard's value in the piece; return its steady drift."""
    n, drift = normal.size, 0.0
    if not modal:
        for j in range(TERMS):
            w.change[j] = 0.0
            for i in range(n):
                w.change[j] += normal[i] * w.taylor[j, i]
        return drift
    for k in range(m.modes[place]):
        w.c[k] = w.d[k] = 0.0
    for i in range(n):
        if normal[i] != 0.0:
            integral = m.unit[place, i] == 0.0
            drift += normal[i] * w.slope[i] if integral else 0.0
            for k in range(m.modes[place]):
                term = normal[i] * m.column[place, i, k] * w.amplitude[k]
                if integral:
                    w.d[k] += term
                else:
                    w.c[k] += term
    return drift


@_compiled
def _gain_modal(rate, modes, drift, s, rest, w):
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
        power, first, second = _integrals(rate[k], s)
        one, two = w.c[k] * first, w.d[k] * second
        gain += one.real + two.real
        sizes += abs(one.real) + abs(one.imag) + abs(two.real) + abs(two.imag)
        slope[k + 1] = slope[k] + (w.c[k] * power + w.d[k] * first).real
        curvature = (w.c[k] * rate[k] + w.d[k]) * power
        size = math.sqrt(curvature.real**2 + curvature.imag**2)
        up[k], down[k], steady[k] = math.inf, math.inf, 0.0
        if rate[k].real > 0.0:
            reach = min(reach, 1.0 / rate[k].real)
            size *= math.exp(min(1.0, rate[k].real * rest))
        elif rate[k] != 0.0:
            inverse = 1.0 / rate[k]
            centre = (curvature * inverse * inverse).real
            radius = size * (inverse.real**2 + inverse.imag**2)
            if rate[k].imag == 0.0:  # it goes straight to its rest, not around it
                centre, radius = 0.5 * centre, 0.5 * radius
            up[k], down[k], steady[k] = radius - centre, radius + centre, -(w.d[k] * inverse).real
        bend[k + 1] = bend[k] + size
    return gain, slope[modes], sizes, reach


@_compiled
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


@_compiled
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


@_compiled
def _safe_step(above, below, modes, proof):
    """Longest time for which a guard provably keeps within the room above and below it.

    Each mode is either followed, by its slope and the bound of its second derivative, or boxed, by
    the farthest that it can move. Boxing the fastest modes, one more at a time, gives as many
    proofs; the best counts.
    """
    slope, bend, up, down, steady = proof
    boxed = 0.0
    step = min(_longest(above, slope[modes], bend[modes]),
               _longest(below, -slope[modes], bend[modes]))
    for k in range(modes - 1, -1, -1):
        above, below, boxed = above - up[k], below - down[k], boxed + steady[k]
        if not (above > 0.0 and below > 0.0):
            break
        tilt = slope[k] + boxed
        step = max(step, min(_longest(above, tilt, bend[k]), _longest(below, -tilt, bend[k])))
    return step


@_compiled
def _arrival(m, place, modal, drift, value, lower, upper, noise, s, end, w):
    """First time from `s` to `end` at which a guard reaches a limit, and its side; 0 for none."""
    modes = m.modes[place] if modal else 0
    step = 0.0
    while s < end:
        if modal:
            gain, slope, sizes, reach = _gain_modal(m.rate[place], modes, drift, s, end - s, w)
        else:
            gain, slope, sizes, reach = _gain_series(s, end, w)
        g, error = value + gain, noise + ROUNDING * (sizes + abs(slope) * s)
        if upper - g <= error or g - lower <= error:
            side = 1 if upper - g <= error else -1
            room = upper - g if side > 0 else g - lower
            if 0.0 < room < side * slope * step:  # one last step, by Newton
                s += room / abs(slope)
            return min(s, end), side
        step = min(_safe_step(upper - g + error, g - lower + error, modes, w.proof), reach)
        s += step
    return end, 0


@_compiled
def _clearance(m, place, modal, order, derivative, width, end, w):
    """Time by which a guard that turns inwards is clear of its limit, and not yet at the other.

    In g ≥ |D| uᵒ/o! - bound uᵒ⁺¹/(o+1)! the first derivative D that is not zero, of order o, keeps
    the upper hand for a while.
    """
    bound, u = 0.0, end
    if modal:
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
    if bound == 0.0:
        return u
    if order > w.slope.size:  # none is known from zero: go on a little, and look again
        return min(u, 1e-3 * m.reach[place])
    factorial = 1.0
    for factor in range(2, order + 1):
        factorial *= factor
    u = min(u, 0.5 * (order + 1) * derivative / bound)
    return min(u, (factorial * width / (3.0 * derivative)) ** (1.0 / order))


# --- a run ------------------------------------------------------------------------------------


@_compiled
def _first_arrival(here, m, place, modal, end, w):
    """How long the piece lasts, at most `end`; the guard that ends it, or -1; and its side."""
    first, side = -1, 0
    for g in range(here.lower.size):
        lower, upper, begin = here.lower[g], here.upper[g], 0.0
        drift = _resolve(here.normal[g], m, place, modal, w)
        if w.order[g] > 0:
            begin = _clearance(
                m, place, modal, w.order[g], w.derivative[g], upper - lower, end, w
            )
        s, hit = _arrival(
            m, place, modal, drift, w.value[g], lower, upper, w.noise[g], begin, end, w
        )
        if hit != 0:
            end, first, side = s, g, hit
    return end, first, side


@_compiled
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


@_compiled
def _run_piece(here, m, place, h, z, w):
    """Advance `z` to the end of the piece; return its length, the guard that ends it and its side.

    Where a guard leaves at once, the length is 0.
    """
    n = z.size
    guard, side = _stand(here, z, w)
    if guard >= 0:
        return 0.0, guard, side
    if m.modes[place] == UNKNOWN and m.pieces[place] >= SERIES_FIRST:
        _decompose(m, place)
    modal = m.modes[place] >= 0
    if modal:
        _set_amplitudes(m, place, w.slope, w.amplitude)
    else:
        m.pieces[place] += 1
        _set_taylor(here.A, w.slope, w.taylor)
        h = min(h, m.reach[place])
    h, guard, side = _first_arrival(here, m, place, modal, h, w)
    for i in range(n):
        w.state[i] = z[i]
    _advance(m, place, modal, w.state, w.slope, w.amplitude, w.taylor, h, z)
    if guard >= 0:
        _put_at_limit(here.normal[guard], here.upper[guard] if side > 0 else here.lower[guard], z)
    return h, guard, side


@_compiled
def _room(n, guards, matrices):
    """Arrays to work in."""
    k, number = matrices, np.complex128
    return (
        Mode(
            np.empty((n, n)), np.empty(n), np.empty((guards, n)), np.empty(guards), np.empty(guards)
        ),
        Matrices(
            np.empty((k, n, n)), np.empty((k, n)), np.empty(k), np.empty(k, np.int64),
            np.empty(k, np.int64), np.empty((k, n), number), np.empty((k, n, n), number),
            np.empty((k, n, n), number),
        ),
        Work(
            np.empty(n), np.empty(n), np.empty(n, number), np.empty((TERMS, n)), np.empty(guards),
            np.empty(guards), np.empty(guards, np.int64), np.empty(guards), np.empty(n, number),
            np.empty(n, number), np.empty(TERMS), np.empty((5, n + 1)),
        ),
    )  # fmt: skip


@_compiled
def _longer(rows):
    longer = np.empty((2 * rows.shape[0], rows.shape[1]), rows.dtype)
    for i in range(rows.shape[0]):
        for j in range(rows.shape[1]):
            longer[i, j] = rows[i, j]
    return longer


@njit(forceinline=True, **_OPTIONS)
def solve(equations, successor, constants, starts, inputs, end, z, mode, sizes, limits):
    """Run a piecewise-affine system: the compiled heart of `System`, to be called by compiled code.

    It is inlined into its caller, which numba then can keep on disk.

    Parameters
    ----------
    equations, successor, constants
        As for `System`.
    starts, inputs : (j,) and (j, …) arrays
        Times from which the inputs hold, the first the start of the run, and the inputs.
    end : float
        End of the run.
    z : (n,) array
        State at the start; at the return, at the end.
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
    here, m, w = _room(n, sizes[0], sizes[1])
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
            place = _find(here.A, m, known)
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
        if at_once > AT_ONCE or events == limits[0]:
            status = MODES_CHASE if at_once > AT_ONCE else TOO_MANY_EVENTS
            break
        if events == event.shape[0]:
            event_time, event = _longer(event_time), _longer(event)
        event_time[events, 0] = t
        event[events, 0], event[events, 1], event[events, 2] = guard, side, mode
        mode, new = successor(mode, guard, side, z, constants), True
        event[events, 3] = mode
        events += 1
    return Record(
        status, start[:pieces], label[:pieces], event_time[:events], event[:events], m, t
    )


@_compiled
def _set_slope(here, z, slope):
    """Set `slope` to A z + b; return whether it is finite."""
    finite = True
    for i in range(z.size):
        slope[i] = here.b[i]
        for j in range(z.size):
            slope[i] += here.A[i, j] * z[j]
        finite = finite and math.isfinite(slope[i])
    return finite


@_compiled
def sample(record, times, out):
    """Set `out` (n, k) to the states of a run at `times` (k,)."""
    n = out.shape[0]
    _, m, w = _room(n, 0, 0)
    m, z, last = record.matrices, np.empty(n), -1
    for j in range(times.size):
        p = max(np.searchsorted(record.start[:, 0], times[j], side="right") - 1, 0)
        state, slope = record.start[p, 1 : n + 1], record.start[p, n + 1 :]
        place, modal = record.label[p, 1], record.label[p, 2] == 1
        if p != last and modal:
            _set_amplitudes(m, place, slope, w.amplitude)
        elif p != last:
            _set_taylor(m.A[place], slope, w.taylor)
        last = p
        _advance(m, place, modal, state, slope, w.amplitude, w.taylor, times[j] - record.start[p, 0], z)
        for i in range(n):
            out[i, j] = z[i]
