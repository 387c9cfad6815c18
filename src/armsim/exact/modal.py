"""Closed-form solution of a linear system ż = A z + b with constant input.

The change of the state since the start is a sum over the eigenvalues λ of A. Each term vanishes as
the elapsed time goes to zero, so short times cause no cancellation. If the eigenvectors are nearly
dependent, a Taylor series of limited reach replaces the sum. Everything is compiled and intended
for matrices of about ten rows.
"""

# mypy: disable-error-code="no-untyped-def"

import math
from typing import Any, NamedTuple

import llvmlite.binding  # type: ignore[import-untyped]
import numpy as np
from numba import njit, types
from numba.extending import get_cython_function_address

OPTIONS: dict[str, Any] = {"fastmath": {"contract"}, "error_model": "numpy", "nogil": True}
compiled = njit(**OPTIONS)
#: For functions that are small or called from several places.
inlined = njit(forceinline=True, **OPTIONS)
#: For functions called from one place: merged into the caller before optimisation.
merged = njit(inline="always", **OPTIONS)

#: Largest entry of the inverse eigenvector matrix for which the modal form is used.
WELL_CONDITIONED = 1e5
#: Terms of the Taylor series; for ‖A‖u ≤ 1 the next term is below rounding.
TERMS = 19

UNKNOWN, DEFECTIVE = -2, -1


class Matrices(NamedTuple):
    """Storage for k matrices of n rows and their modal forms."""

    A: np.ndarray  #: (k, n, n)
    unit: np.ndarray  #: (k, n) balancing units of the states; 0 if no derivative depends on it
    reach: np.ndarray  #: (k,) longest time for the Taylor series, 1/‖A‖ in these units
    modes: np.ndarray  #: (k,) number of modes kept, 0 for A = 0; or `UNKNOWN`, `DEFECTIVE`
    rate: np.ndarray  #: (k, n) complex λ, slowest first; of a pair, the one with Im λ > 0
    inverse: np.ndarray  #: (k, n) complex 1/λ
    speed: np.ndarray  #: (k, n) |λ|
    column: np.ndarray  #: (k, n, n) complex, maps amplitudes to states; doubled for a pair
    row: np.ndarray  #: (k, n, n) complex, maps slopes to amplitudes


@compiled
def room_for(k, n):
    """Allocate storage for `k` matrices of `n` rows."""
    number = np.complex128
    return Matrices(
        np.empty((k, n, n)),
        np.empty((k, n)),
        np.empty(k),
        np.empty(k, np.int64),
        np.empty((k, n), number),
        np.empty((k, n), number),
        np.empty((k, n)),
        np.empty((k, n, n), number),
        np.empty((k, n, n), number),
    )


# --- a matrix: units, eigenvectors ------------------------------------------------------------


@compiled
def _balance(A, unit):
    """Set power-of-two units of the states that balance the rows and columns of `A`.

    A state on which no derivative depends is a pure integral of the others and gets the unit 0.
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
                power = round(0.5 * math.log2(row / column))
                better = math.ldexp(1.0, min(max(power, -300), 300))
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


@compiled
def find(A, m, count):
    """Return the place of `A` among `count` matrices, adding it if new; -1 if storage is full."""
    for place in range(count):
        if (m.A[place] == A).all():
            return place
    if count == m.reach.size:
        return -1
    m.A[count] = A
    m.reach[count] = 1.0 / _balance(A, m.unit[count])
    m.modes[count] = UNKNOWN
    return count


@compiled
def _size(z):
    """Squared modulus, which avoids a square root."""
    return z.real * z.real + z.imag * z.imag


@compiled
def _invert(V, W):
    """Set `W` to the inverse of `V`, which is destroyed; return its largest entry squared."""
    n = V.shape[0]
    for i in range(n):
        for j in range(n):
            W[i, j] = 1.0 if i == j else 0.0
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if _size(V[i, k]) > _size(V[pivot, k]):
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
    return (W.real**2 + W.imag**2).max() if n > 0 else 0.0  # of integrals alone, nothing is left


@compiled
def _part(C, rows, columns):
    return C[rows][:, columns]


# LAPACK's solver for real matrices, from SciPy. If eigenvalues are complex, numba's np.linalg.eig
# accepts only complex matrices, at twice the cost.
llvmlite.binding.add_symbol(
    "armsim_dgeev", get_cython_function_address("scipy.linalg.cython_lapack", "dgeev")
)
_integers, _numbers = types.CPointer(types.int32), types.CPointer(types.float64)
_dgeev = types.ExternalFunction(
    "armsim_dgeev",
    types.void(
        *(_integers, _integers, _integers, _numbers, _integers, _numbers, _numbers),
        *(_numbers, _integers, _numbers, _integers, _numbers, _integers, _integers),
    ),
)


@compiled
def eigen(A):
    """Complex eigenvalues (n,) and eigenvectors (n, n) of a real matrix, and a failure flag."""
    n = A.shape[0]
    # Two arrays hold all that LAPACK reads and writes. Both are read after the call, since numba
    # might otherwise free them too early. 78 and 86 are the letters N and V, for no left but right
    # eigenvectors.
    whole = np.array([78, 86, n, 1, 8 * n, 0], np.int32)
    left, right, size, one, length, info = 0, 1, 2, 3, 4, 5
    real = np.empty(2 * n * n + 10 * n)
    matrix, v, w = real, real[n * n :], real[2 * n * n :]
    for i in range(n):
        for j in range(n):
            matrix[j * n + i] = A[i, j]
    _dgeev(
        whole[left:].ctypes, whole[right:].ctypes, whole[size:].ctypes, matrix.ctypes,
        whole[size:].ctypes, w.ctypes, w[n:].ctypes, v.ctypes, whole[one:].ctypes, v.ctypes,
        whole[size:].ctypes, w[2 * n :].ctypes, whole[length:].ctypes, whole[info:].ctypes,
    )  # fmt: skip
    rate, V = np.empty(n, np.complex128), np.empty((n, n), np.complex128)
    for k in range(n):
        rate[k] = complex(w[k], w[n + k])
        first = k if w[n + k] >= 0.0 else k - 1  # a pair is stored as real and imaginary part
        for i in range(n):
            imaginary = v[(first + 1) * n + i] if w[n + k] != 0.0 else 0.0
            V[i, k] = complex(v[first * n + i], imaginary if w[n + k] >= 0.0 else -imaginary)
    return rate, V, whole[info] != 0


@compiled
def _influence(C):
    """Matrix whose entry [i, j] is true if state j acts on state i, directly or through others."""
    acts = C != 0.0
    for k in range(C.shape[0]):
        acts[k, k] = True
        acts |= acts[:, k : k + 1] & acts[k : k + 1, :]
    return acts


@compiled
def _extend(C, block, driven, value, v):
    """Extend an eigenvector of a block to the states that it drives; return whether it exists."""
    rest = _part(C, driven, driven)
    for i in range(driven.size):
        rest[i, i] -= value
    inverse = np.empty_like(rest)
    if _invert(rest, inverse) == math.inf:
        return False
    for j in range(driven.size):
        drive = 0j
        for k in block:
            drive += C[driven[j], k] * v[k]
        for i in range(driven.size):
            v[driven[i]] -= inverse[i, j] * drive
    return True


@compiled
def _blockwise(C, rate, V):
    """Set eigenvalues and eigenvectors of `C`, block by block; return whether this succeeded.

    States that are coupled in a loop form a block. The eigenvectors of a block are extended to the
    states that it drives so that (C - λ) v = 0 there too. Small blocks cost less than the whole
    matrix and lose fewer digits.
    """
    n, done, acts = C.shape[0], 0, _influence(C)
    for first in range(n):
        block = np.flatnonzero(acts[:, first] & acts[first, :])
        driven = np.flatnonzero(acts[:, first] & ~acts[first, :])
        if block[0] < first:
            continue
        values, vectors, failed = eigen(_part(C, block, block).real)
        if failed:
            return False
        for k in range(block.size):
            v = np.zeros(n, np.complex128)
            for i in range(block.size):
                v[block[i]] = vectors[i, k]
            if driven.size > 0 and not _extend(C, block, driven, values[k], v):
                return False
            rate[done], V[:, done] = values[k], v / np.abs(v).max()
            done += 1
    return True


@compiled
def _polish(C, V, W, rate, noise):
    """Refine the eigenvalues, the eigenvectors and their inverse `W` by a Newton step.

    All eigenvalues initially have the rounding error of the largest. The diagonal of W C V gives
    refined eigenvalues; the other entries give the corrections of the eigenvectors. Eigenvectors
    are not corrected for gaps between eigenvalues below `noise`.
    """
    D = W @ (C @ V)
    X = np.zeros_like(D)
    for i in range(rate.size):
        rate[i] = D[i, i]
        for j in range(rate.size):
            gap = D[j, j] - D[i, i]
            if _size(gap) > noise * noise and _size(D[i, j]) < 1e-6 * _size(gap):
                X[i, j] = D[i, j] / gap
    V += V @ X
    W -= X @ W


@compiled
def _keep(m, place, slot, value, weight, v, w, core):
    """Store a mode: its rate, and the maps from slopes to its amplitude and on to the states."""
    A, unit = m.A[place], m.unit[place]
    m.rate[place, slot] = value
    m.inverse[place, slot] = 1.0 / value if value != 0.0 else value
    m.speed[place, slot] = abs(value)
    for i in range(unit.size):
        m.row[place, slot, i] = m.column[place, i, slot] = 0.0
    for i in range(core.size):
        m.row[place, slot, core[i]] = w[i] / unit[core[i]]
        m.column[place, core[i], slot] = weight * v[i] * unit[core[i]]
    for i in range(unit.size):
        if unit[i] == 0.0:  # an integral of the others; amplitude in its second derivative
            for j in core:
                m.column[place, i, slot] += A[i, j] * m.column[place, j, slot]


@compiled
def decompose(m, place):
    """Compute the modal form of a matrix, or mark it as near-defective."""
    A, unit = m.A[place], m.unit[place]
    core = np.flatnonzero(unit > 0.0)
    size = core.size
    C = np.empty((size, size), np.complex128)
    V, W, rate = np.empty_like(C), np.empty_like(C), np.empty(size, np.complex128)
    for i in range(size):
        for j in range(size):
            C[i, j] = A[core[i], core[j]] * unit[core[j]] / unit[core[i]]
    m.modes[place] = DEFECTIVE
    if not _blockwise(C, rate, V) or not _invert(V.copy(), W) < WELL_CONDITIONED**2:
        return
    _polish(C, V, W, rate, 1e-13 / m.reach[place])
    kept = total = 0
    for _ in range(size):
        k = 0
        for other in range(1, size):
            if _size(rate[other]) < _size(rate[k]):
                k = other
        value, rate[k] = rate[k], math.inf
        # The weight of a pair is 2. Its eigenvector is independent of its conjugate and therefore
        # far from real, whereas eigenvectors of real eigenvalues are computed as real.
        weight = 1
        for i in range(size):
            weight = 2 if abs(V[i, k].imag) > 1e-7 else weight
        if weight == 2 and value.imag < 0.0:
            continue
        value = value if weight == 2 else complex(value.real)
        _keep(m, place, kept, value, weight, V[:, k], W[k], core)
        kept, total = kept + 1, total + weight
    if total == size:
        m.modes[place] = kept


# --- a piece: its formula ---------------------------------------------------------------------


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


@compiled
def set_amplitudes(m, place, slope, amplitude):
    """Set the amplitude of each mode in the slope at the start of a piece."""
    for k in range(m.modes[place]):
        total = 0j
        for i in range(slope.size):
            total += m.row[place, k, i] * slope[i]
        amplitude[k] = total


@compiled
def set_taylor(A, slope, taylor):
    """Set the coefficients of u, u², … in the state at a time u after the start of a piece."""
    taylor[0] = slope
    for j in range(1, TERMS):
        taylor[j] = A @ taylor[j - 1] / (j + 1)


@compiled
def advance(m, place, state, slope, amplitude, taylor, u, out):
    """Set `out` to the state at a time `u` after the start of a piece."""
    n = out.size
    if m.modes[place] <= 0:
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
        if amplitude[k] == 0.0:  # the mode itself may overflow, and 0 · inf is NaN
            continue
        _, first, second = integrals(m.rate[place, k], m.inverse[place, k], u)
        first, second = amplitude[k] * first, amplitude[k] * second
        for i in range(n):
            grown = first if m.unit[place, i] > 0.0 else second
            out[i] += (m.column[place, i, k] * grown).real
