"""Closed-form solution of a linear system ż = A z + b with constant input.

The change of the state since the start is a sum over the eigenvalues λ of A. Each term vanishes as
the elapsed time goes to zero, so short times cause no cancellation. If the eigenvectors are nearly
dependent, a Taylor series of limited reach replaces the sum. Everything is compiled and intended
for matrices of about ten rows.
"""

# mypy: disable-error-code="no-untyped-def"

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from armsim.exact.intrinsics import eigen, fma
from armsim.machine_code import kept

OPTIONS: dict[str, Any] = {"fastmath": {"contract"}, "error_model": "numpy", "nogil": True}
#: Kept on disk, so that a new system compiles only what is its own.
compiled = kept(**OPTIONS)
#: For sums in twice the working precision: no product is merged with a sum.
strict = njit(error_model="numpy", nogil=True)
#: For functions that are small or called from several places.
inlined = njit(forceinline=True, **OPTIONS)
#: For functions called from one place: merged into the caller before optimisation.
merged = njit(inline="always", **OPTIONS)

#: Relative error up to which the modal form is preferred to the Taylor series, and up to which it
#: is used where the series would need too many pieces.
PRECISE, TOLERATED = 1e-12, 1e-9
#: Condition up to which the eigenvectors are trusted whatever the units of the states.
WELL_CONDITIONED = 100.0
#: Relative rounding error.
EPS = float(np.finfo(float).eps)
#: Terms of the Taylor series; for ‖A‖u ≤ 1 the next term is below rounding.
TERMS = 19

#: Largest number of pieces for which the Taylor series is used.
MAX_PIECES = 1_000_000

#: A state that has decayed by this many time constants is computed from its equilibrium.
SETTLED = 7.0

UNKNOWN, DEFECTIVE = -2, -1


class Matrices(NamedTuple):
    """Storage for k matrices of n rows and their modal forms."""

    A: np.ndarray  #: (k, n, n)
    unit: np.ndarray  #: (k, n) balancing units of the states; 0 if no derivative depends on it
    reach: np.ndarray  #: (k,) longest time for the Taylor series, 1/‖A‖ in these units
    loss: np.ndarray  #: (k,) estimate, with a margin, of the relative error of a piece
    modes: np.ndarray  #: (k,) number of modes kept, 0 for A = 0; or `UNKNOWN`, `DEFECTIVE`
    rate: np.ndarray  #: (k, n) complex λ, slowest first; of a pair, the one with Im λ > 0
    inverse: np.ndarray  #: (k, n) complex 1/λ
    speed: np.ndarray  #: (k, n) |λ|
    column: np.ndarray  #: (k, n, n) complex, maps amplitudes to states; doubled for a pair
    row: np.ndarray  #: (k, n, n) complex, maps slopes to amplitudes


def room_for(k: int, n: int) -> Matrices:
    """Allocate storage for `k` matrices of `n` rows."""
    (column, row), (rate, inverse) = np.empty((2, k, n, n), complex), np.empty((2, k, n), complex)
    (unit, speed), (reach, loss) = np.empty((2, k, n)), np.empty((2, k))
    A, modes = np.empty((k, n, n)), np.full(k, UNKNOWN)
    return Matrices(A, unit, reach, loss, modes, rate, inverse, speed, column, row)


# --- exp(λt) and its integrals ----------------------------------------------------------------


@inlined
def _reciprocal(value):
    """1/λ, or 0 for λ = 0, which no formula asks for."""
    return 1.0 / value if value != 0.0 else value


@inlined
def _integrals(x, t, inverse):
    """Return exp(x), (exp(x) - 1) t / x and (exp(x) - 1 - x) t² / x² for x = λt."""
    if abs(x.real) + abs(x.imag) < 0.5:
        series = 1.0 + x * (1 / 16)
        for n in range(15, 2, -1):
            series = 1.0 + x * (1.0 / n) * series
        second = 0.5 * t * series
        first = 1.0 + x / t * second
        return 1.0 + x * first, t * first, t * second
    power = np.exp(x)
    first = (power - 1.0) * inverse
    return power, first, (first - t) * inverse


@inlined
def integrals(rate, inverse, t):
    """Return exp(λt) and its first and second integrals over (0, t), accurate also as λt → 0.

    `inverse` is 1/λ.
    """
    if t == 0.0:
        return 1.0 + 0j, 0j, 0j
    if rate.imag == 0.0:
        power, first, second = _integrals(rate.real * t, t, inverse.real)
        return complex(power), complex(first), complex(second)
    return _integrals(rate * t, t, inverse)


# --- a matrix: units, eigenvectors ------------------------------------------------------------


@compiled
def _balance(A, unit):
    """Set power-of-two units of the states that balance the rows and columns of `A`.

    A state on which no derivative depends is a pure integral of the others and gets the unit 0. The
    diagonal counts: without it, scaling could hide that a matrix is nearly defective.
    """
    n = unit.size
    for j in range(n):
        unit[j] = 1.0 if (A[:, j] != 0.0).any() else 0.0
    for _ in range(20):
        changed = False
        for i in range(n):
            row = column = 0.0
            for j in range(n):
                if unit[i] * unit[j] > 0.0:
                    row += abs(A[i, j]) * unit[j] / unit[i]
                    column += abs(A[j, i]) * unit[i] / unit[j]
            if row > 0.0 and column > 0.0:
                power = round(0.5 * math.log2(row / column))
                changed = changed or power != 0
                unit[i] = math.ldexp(unit[i], min(max(power, -300), 300))
        if not changed:
            break


@inlined
def _equal(A, B):
    for i in range(A.shape[0]):
        for j in range(A.shape[0]):
            if A[i, j] != B[i, j]:
                return False
    return True


@compiled
def _solution(A, B):
    """Solution of A X = B for matrices; infinite if A is singular."""
    try:
        return np.ascontiguousarray(np.linalg.solve(A, B))
    except Exception:  # numba knows no narrower one here
        return np.full_like(B, np.inf)


@merged
def _influence(C):
    """Matrix whose entry [i, j] is true if state j acts on state i, directly or through others."""
    acts = C != 0.0
    for k in range(C.shape[0]):
        acts[k, k] = True
        for i in range(C.shape[0]):
            for j in range(C.shape[0]):
                acts[i, j] |= acts[i, k] and acts[k, j]
    return acts


@merged
def _blockwise(C, rate, V):
    """Set eigenvalues and eigenvectors of `C`, block by block; return whether this succeeded.

    States that are coupled in a loop form a block. The eigenvectors of a block are extended to the
    states that it drives so that (C - λ) v = 0 there too. Small blocks cost less than the whole
    matrix, and what a mode does not reach stays exactly zero.
    """
    n, done, acts = C.shape[0], 0, _influence(C)
    for first in range(n):
        block = np.flatnonzero(acts[:, first] & acts[first, :])
        driven = np.flatnonzero(acts[:, first] & ~acts[first, :])
        if block[0] < first:
            continue
        values, vectors, failed = eigen(C[block][:, block])
        if failed:
            return False
        drive, rest = C[driven][:, block] + 0j, C[driven][:, driven] + 0j
        for k in range(block.size):
            v, vector = np.zeros(n, np.complex128), vectors[:, k].copy()
            v[block] = vector
            if driven.size > 0:
                pull = (drive @ vector).reshape(-1, 1)
                v[driven] = _solution(values[k] * np.eye(driven.size) - rest, pull)[:, 0]
            rate[done], V[:, done], done = values[k], v / np.abs(v).max(), done + 1
    return True


@strict
def _add_product(total, rest, a, b):
    """Add a b to an unevaluated sum total + rest of twice the working precision."""
    product = a * b
    grown = total + product
    kept = grown - total
    return grown, rest + (fma(a, b, -product) + ((total - (grown - kept)) + (product - kept)))


@strict
def _difference(P, Q, F, d):
    """P Q - F diag(d), summed in twice the working precision.

    Dot2 of Ogita, Rump and Oishi, doi 10.1137/030601818, for complex numbers.
    """
    n, out = d.size, np.empty_like(Q)
    for i in range(n):
        for j in range(n):
            real = more_real = imag = more_imag = 0.0
            for k in range(n + 1):
                p, q = (P[i, k], Q[k, j]) if k < n else (F[i, j], -d[j])
                real, more_real = _add_product(real, more_real, p.real, q.real)
                imag, more_imag = _add_product(imag, more_imag, p.real, q.imag)
                if p.imag != 0.0:
                    real, more_real = _add_product(real, more_real, -p.imag, q.imag)
                    imag, more_imag = _add_product(imag, more_imag, p.imag, q.real)
            out[i, j] = complex(real + more_real, imag + more_imag)
    return out


@merged
def _refine(C, V, rate):
    """Refine eigenvalues and eigenvectors by Newton's method.

    Returns the inverse of `V`, and an estimate for the relative error of a sum over the modes. With
    E = V⁻¹ (C V - V Λ), the corrections are E_ii of an eigenvalue and E_ij / (λ_j - λ_i) of an
    eigenvector. Where the gap does not exceed E_ij, the eigenvalues count as equal.
    """
    n, one = rate.size, np.eye(rate.size) + 0j
    floor = EPS * np.abs(C).max()
    for _ in range(6):
        E = _solution(V, _difference(C, V, V, rate))
        X, largest, left = np.zeros_like(E), 0.0, 0.0
        for i in range(n):
            for j in range(n):
                gap, size = rate[j] - rate[i], abs(E[i, j])
                if i == j or size <= EPS**2 * abs(gap):
                    continue
                if size < 0.3 * abs(gap):
                    X[i, j] = E[i, j] / gap
                    largest = max(largest, abs(X[i, j]))
                else:
                    left = max(left, size / (floor + max(abs(rate[i]), abs(rate[j]))))
        for i in range(n):
            rate[i] += E[i, i]
        V += V @ X
        if largest < 1e-8:
            break
    W = _solution(V, one)
    W -= _difference(W, V, one, np.ones(n) + 0j) @ W
    condition = (np.abs(V) @ np.abs(W)).sum(axis=1).max()
    if not condition < WELL_CONDITIONED:
        condition = _cancellation(V, W, rate)
    return W, condition * (4 * (n + 2) * EPS + largest**2 + left)


@merged
def _cancellation(V, W, rate):
    """By how much the terms of a sum over the modes exceed the sum, for the worst state.

    Compared are the largest values in time of the responses to all slopes. Unlike the condition of
    the eigenvectors, which is never less, this hardly depends on the units of the states.
    """
    n, first = rate.size, np.empty_like(rate)
    sums, terms, longest = np.zeros(n), np.zeros(n), 1.0 / max(0.0, rate.real.max())
    for time in 1.0 / np.abs(rate[rate != 0.0]):
        for k in range(n):
            first[k] = integrals(rate[k], _reciprocal(rate[k]), min(time, longest))[1]
        response, size = np.abs((V * first) @ W), np.abs(V * first) @ np.abs(W)
        sums, terms = np.maximum(sums, response.sum(axis=1)), np.maximum(terms, size.sum(axis=1))
    return (terms / sums).max()


@merged
def _keep(m, place, slot, value, weight, v, w, core):
    """Store a mode: its rate, and the maps from slopes to its amplitude and on to the states."""
    A, unit = m.A[place], m.unit[place]
    m.rate[place, slot], m.inverse[place, slot] = value, _reciprocal(value)
    m.speed[place, slot] = abs(value)
    for i in range(unit.size):
        m.row[place, slot, i] = m.column[place, i, slot] = 0.0
    for i in range(core.size):
        if abs(w[i]) > EPS**2:  # a zero that rounding has blurred costs time later
            m.row[place, slot, core[i]] = w[i] / unit[core[i]]
        m.column[place, core[i], slot] = weight * v[i] * unit[core[i]]
    for i in range(unit.size):
        if unit[i] == 0.0:  # an integral of the others; amplitude in its second derivative
            for j in core:
                m.column[place, i, slot] += A[i, j] * m.column[place, j, slot]


@merged
def _decompose(m, place, duration):
    """Compute the modal form of a matrix, or mark it as near-defective.

    If the Taylor series would need too many pieces for the duration, and the eigenvectors are
    nearly dependent as well, the loss is above what is tolerated.
    """
    A, unit = m.A[place], m.unit[place]
    _balance(A, unit)
    core = np.flatnonzero(unit > 0.0)
    size = core.size
    if size == 0:  # the states are integrals alone
        m.modes[place], m.loss[place], m.reach[place] = 0, 0.0, math.inf
        return
    C = A[core][:, core] * unit[core] / unit[core].reshape(-1, 1)
    norm = 0.0
    for j in range(size):
        norm = max(norm, np.abs(C[:, j]).sum())
    m.reach[place], short = 1.0 / norm, duration * norm < MAX_PIECES
    V, rate = np.empty((size, size), np.complex128), np.empty(size, np.complex128)
    m.modes[place], m.loss[place] = DEFECTIVE, 4 * (size + 2) * EPS if short else math.inf
    if not _blockwise(C, rate, V):
        return
    W, loss = _refine(C + 0j, V, rate)
    if not loss < (PRECISE if short else TOLERATED):
        return
    m.loss[place], speed = loss, np.abs(rate)
    kept = total = 0
    for _ in range(size):
        k = np.argmin(speed)
        speed[k] = math.inf
        # The weight of a pair is 2. Its eigenvector is independent of its conjugate and therefore
        # far from real, whereas eigenvectors of real eigenvalues are computed as real.
        weight = 2 if np.abs(V[:, k].imag).max() > 1e-7 else 1
        if weight == 1 or rate[k].imag > 0.0:
            value = rate[k] if weight == 2 else complex(rate[k].real)
            _keep(m, place, kept, value, weight, V[:, k], W[k], core)
            kept, total = kept + 1, total + weight
    if total == size:
        m.modes[place] = kept


@compiled
def find(A, m, duration):
    """Return the place of `A` among the matrices, with its modal form; -1 if there is no room.

    `duration` is that of the run.
    """
    for place in range(m.modes.size):
        if m.modes[place] == UNKNOWN:
            m.A[place] = A
            _decompose(m, place, duration)
            return place
        if _equal(m.A[place], A):
            return place
    return -1


# --- a piece: its formula ---------------------------------------------------------------------


class Start(NamedTuple):
    """What the start of a piece adds to its matrix."""

    state: np.ndarray  #: (n,) z
    slope: np.ndarray  #: (n,) ż
    slope_size: np.ndarray  #: (n,) sum of the magnitudes of its terms
    amplitude: np.ndarray  #: (n,) complex amplitude of each mode in ż
    taylor: np.ndarray  #: (TERMS, n) coefficients of u, u², …
    rest: np.ndarray  #: (n,) equilibrium
    rest_size: np.ndarray  #: (n,) sum of the magnitudes of its terms
    decay: np.ndarray  #: (n,) least rate at which a state decays to it; 0 if it does not


class Piece(NamedTuple):
    """Closed form of a piece with n states, as a function of the time u since its start."""

    modes: int  #: number of modes, or 0 for a Taylor series
    reach: float  #: this and all down to `column`: of the matrix, as in `Matrices`
    loss: float
    unit: np.ndarray
    rate: np.ndarray
    inverse: np.ndarray
    speed: np.ndarray
    column: np.ndarray
    start: Start


@compiled
def start_room(n):
    """Allocate what describes the start of a piece."""
    r, amplitude, taylor = np.empty((6, n)), np.empty(n, np.complex128), np.empty((TERMS, n))
    return Start(r[0], r[1], r[2], amplitude, taylor, r[3], r[4], r[5])


@compiled
def piece(m, place, b, start):
    """Return the closed form of a piece of ż = A z + b whose state and slope `start` holds."""
    modes, row, column = max(m.modes[place], 0), m.row[place], m.column[place]
    rate, inverse, unit = m.rate[place], m.inverse[place], m.unit[place]
    if modes == 0:
        start.taylor[0] = start.slope
        for j in range(1, TERMS):
            start.taylor[j] = m.A[place] @ start.taylor[j - 1] / (j + 1)
    for i in range(b.size):
        start.rest[i] = start.rest_size[i] = 0.0
        start.decay[i] = math.inf if modes > 0 and unit[i] > 0.0 else 0.0
    for k in range(modes):
        amplitude = push = 0j
        for i in range(b.size):
            amplitude += row[k, i] * start.slope[i]
            push += row[k, i] * b[i]
        start.amplitude[k] = amplitude
        if rate[k] != 0.0 and amplitude == 0.0 and push == 0.0:
            continue
        push *= inverse[k]
        for i in range(b.size):
            if column[i, k] != 0.0:
                term = (column[i, k] * push).real
                start.rest[i] -= term
                start.rest_size[i] += abs(term)
                start.decay[i] = min(start.decay[i], max(0.0, -rate[k].real))
    known = m.reach[place], m.loss[place], unit, rate, inverse, m.speed[place], column
    return Piece(modes, *known, start)


@compiled
def advance(p, u, out):
    """Set `out` to the state at a time `u` after the start of a piece.

    It is the change since the start that is added up, so that a short time costs no digits; or,
    for a state that has decayed, what is left of the way to its equilibrium.
    """
    start, n = p.start, out.size
    if p.modes == 0:
        for i in range(n):
            total = 0.0
            for j in range(TERMS - 1, -1, -1):
                total = (total + start.taylor[j, i]) * u
            out[i] = start.state[i] + total
        return
    for i in range(n):
        out[i] = start.rest[i] if start.decay[i] * u > SETTLED else start.state[i]
        if p.unit[i] == 0.0:
            out[i] += start.slope[i] * u
    for k in range(p.modes):
        amplitude = start.amplitude[k]
        if amplitude == 0.0:  # the mode itself may overflow, and 0 · inf is NaN
            continue
        power, first, second = integrals(p.rate[k], p.inverse[k], u)
        left = power * p.inverse[k] * amplitude
        first, second = first * amplitude, second * amplitude
        for i in range(n):
            settled = start.decay[i] * u > SETTLED
            grown = second if p.unit[i] == 0.0 else left if settled else first
            out[i] += (p.column[i, k] * grown).real
