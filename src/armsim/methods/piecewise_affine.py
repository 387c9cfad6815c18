"""Exact solution of piecewise-affine systems, mode by mode.

In each mode the system is linear, ż = A z + b, and lives between limits of linear functions of the
state, its guards. So a run is a chain of pieces, each a sum of exponentials, glued where a guard
reaches a limit. Nothing is discretised: what is computed is the event times, each found by steps
that are proven not to pass it. The page "The exact solution" of the book derives every formula;
the functions below follow its order.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from armsim.methods.runge_kutta import IntegrationError

_compiled = njit(fastmath={"contract"}, error_model="numpy", nogil=True)

#: Rounding unit times the largest number of operations in one guard value.
_ROUNDING = 16 * np.finfo(float).eps
#: Largest condition number of the eigenvectors for which the modal form is used.
_WELL_CONDITIONED = 1e6
#: Pieces by Taylor series in a matrix before its eigenvectors are worth computing.
_SERIES_FIRST = 3
#: Terms of the Taylor series; with ‖A‖h ≤ 1 the next one is below rounding.
_TERMS = 20
#: Events at one time after which the modes are taken to chase each other for ever.
_AT_ONCE = 25

_FINISHED, _CHASE, _EVENTS, _PIECES, _INFINITE = range(5)


# --- the solution inside a mode ---------------------------------------------------------------


@_compiled
def _integrals(rate, t):
    """Return exp(λt) and its first and second integral from 0 to t, accurate also as λt → 0."""
    x = rate * t
    if abs(x.real) + abs(x.imag) < 0.5:
        series = 1.0 + x / 15
        for n in range(14, 2, -1):
            series = 1.0 + x / n * series
        second = 0.5 * t * t * series
        first = t + rate * second
        return 1.0 + rate * first, first, second
    size = math.exp(x.real)
    power = size * complex(math.cos(x.imag), math.sin(x.imag)) if size > 0.0 else 0j
    first = (power - 1.0) / rate
    return power, first, (first - t) / rate


@_compiled
def _balance(A):
    """Scale the states by powers of two so that rows and columns of `A` have like norms."""
    n = A.shape[0]
    scale = np.ones(n)
    for _ in range(10):
        done = True
        for i in range(n):
            row = column = 0.0
            for j in range(n):
                if j != i:
                    row += abs(A[i, j])
                    column += abs(A[j, i])
            if row == 0.0 or column == 0.0:
                continue
            factor = 2.0 ** round(0.5 * math.log2(row / column))
            if factor != 1.0:
                done = False
                scale[i] *= factor
                for j in range(n):
                    A[i, j] /= factor
                    A[j, i] *= factor
        if done:
            break
    return scale


@_compiled
def _norm(A):
    largest = 0.0
    for j in range(A.shape[1]):
        total = 0.0
        for i in range(A.shape[0]):
            total += abs(A[i, j])
        largest = max(largest, total)
    return largest


@_compiled
def _core(A):
    """Indices of the states that any derivative depends on; the others are mere integrals."""
    core = np.empty(A.shape[0], np.int64)
    m = 0
    for j in range(A.shape[0]):
        for i in range(A.shape[0]):
            if A[i, j] != 0.0:
                core[m] = j
                m += 1
                break
    return core[:m]


@_compiled
def _decompose(A, rates, columns, rows):
    """Modal form of `A`: eigenvalues, and what turns amplitudes into states and back.

    Fills `rates` (n,), `columns` (n, n) and `rows` (n, n), slowest mode first, and returns the
    number of modes: of a complex pair only one is kept, with doubled column. Returns -1 if the
    eigenvectors are too close to dependent.
    """
    core = _core(A)
    m = core.size
    if m == 0:
        return 0
    C = np.empty((m, m))
    for i in range(m):
        for j in range(m):
            C[i, j] = A[core[i], core[j]]
    scale = _balance(C)
    w, U = np.linalg.eig(C.astype(np.complex128))
    if not np.linalg.det(U) != 0.0:
        return -1
    W = np.linalg.inv(U)
    if not _norm(U) * _norm(W) < _WELL_CONDITIONED:
        return -1
    real = 1e-10 * _norm(C)
    count = kept = 0
    columns[:] = 0.0
    rows[:] = 0.0
    for k in np.argsort(np.abs(w)):
        if w[k].imag < -real:
            continue
        pair = w[k].imag > real
        count += 2 if pair else 1
        rates[kept] = w[k] if pair else w[k].real
        for i in range(m):
            columns[core[i], kept] = (2 if pair else 1) * scale[i] * U[i, k]
            rows[kept, core[i]] = W[k, i] / scale[i]
        kept += 1
    for q in range(A.shape[0]):
        if not (core == q).any():
            for k in range(kept):
                for i in core:
                    columns[q, k] += A[q, i] * columns[i, k]
    return kept if count == m else -1
