r"""Linear stability of explicit Runge-Kutta methods.

For y' = λy one step of length h multiplies y by :math:`R(h\lambda)`, where

.. math:: R(z) = 1 + z b^T (I - zA)^{-1} e = 1 + \sum_{k=1}^{s} (b^T A^{k-1} e) z^k

is a polynomial for an explicit method (Hairer and Wanner, *Solving Ordinary Differential
Equations II*, section IV.2). The solution does not grow where :math:`|R(h\lambda)| \le 1`.

This theory says nothing about the exponential form of a method. It integrates
:math:`z = \ln y`, and y' = λy becomes z' = λ, which every consistent tableau solves exactly:
R(z) = exp(z) at any step. That is a property of this one problem and not stability: already for
y' = λ(y - g) the transformed equation z' = λ(1 - g exp(-z)) is nonlinear, and near its steady
state z = ln g its derivative is again λ, so the form is there as limited as the additive one.
"""

from fractions import Fraction
from functools import cache
from math import frexp, inf

import numpy as np
import sympy
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from armsim.methods.tableaux import Tableau


@cache
def stability_function(tableau: Tableau) -> sympy.Poly:
    """R(z), exactly.

    Examples
    --------
    >>> from armsim.methods import tableaux
    >>> stability_function(tableaux.RK4_GILL).as_expr()
    z**4/24 + z**3/6 + z**2/2 + z + 1
    """
    A, row = sympy.Matrix(tableau.A), sympy.Matrix([tableau.b])
    coefficients = [sympy.Integer(1)]
    for _ in range(tableau.stages):
        coefficients.append(sympy.expand(sum(row)))
        row = row * A
    return sympy.Poly(coefficients[::-1], sympy.Symbol("z"))


def real_limit(tableau: Tableau) -> float:
    """Largest x such that ``|R| ≤ 1`` on the interval [-x, 0] of the real axis.

    Examples
    --------
    >>> from armsim.methods import tableaux
    >>> real_limit(tableaux.EULER)
    2.0
    """
    return largest_step(tableau, [-1.0])


def imaginary_limit(tableau: Tableau) -> float:
    """Largest y such that ``|R| ≤ 1`` on the interval [-iy, iy] of the imaginary axis."""
    return largest_step(tableau, [1j])


def largest_step(tableau: Tableau, eigenvalues: ArrayLike, zero: float = 0.0) -> float:
    """Largest h such that ``|R(hλ)| ≤ 1`` up to it for every eigenvalue.

    Parameters
    ----------
    tableau : Tableau
        Its stability function must have rational coefficients.
    eigenvalues : (n,) array_like of complex
        In 1/s for a step in s. An eigenvalue 0 does not restrict the step; one with a positive
        real part, whose solution grows, allows no step.
    zero : float
        Eigenvalues of at most this magnitude count as 0: a computed one is rarely exact.

    Returns
    -------
    float
        0 if no step is stable, infinity if all are.

    Raises
    ------
    ValueError
        If an eigenvalue is not finite, or R has irrational coefficients.
    """
    values = np.atleast_1d(np.asarray(eigenvalues, dtype=complex)).ravel()
    if not np.isfinite(values).all():
        raise ValueError(f"eigenvalues = {eigenvalues!r}: all must be finite")
    coefficients = stability_function(tableau).all_coeffs()[::-1]
    if not all(r.is_Rational for r in coefficients):
        raise ValueError(f"tableau {tableau.name}: R has irrational coefficients, {coefficients}")
    exact = [Fraction(int(r.p), int(r.q)) for r in coefficients]
    return min((_reach(exact, complex(v)) for v in values if abs(v) > zero), default=inf)


def _reach(coefficients: list[Fraction], eigenvalue: complex) -> float:
    """Where |R(h λ)| first exceeds 1.

    |R|² - 1 is formed exactly, as a polynomial in h: near the imaginary axis its low coefficients
    vanish or nearly do, and rounded ones would show a limit where there is none.
    """
    scale = 2.0 ** frexp(abs(eigenvalue))[1]  # a power of two, so that dividing by it is exact
    # R(0) = 1, so the constant vanishes. Divide by h as often as possible: h = 0 is no limit.
    excess = np.trim_zeros(-_squared(coefficients, eigenvalue / scale)[1:], "f")
    margin = Polynomial(excess.astype(float)).trim() if excess.size else Polynomial([1.0])
    roots = margin.roots()
    near_real = abs(roots.imag) <= 1e-6 * abs(roots)  # a double root may come out as a pair
    places = np.unique(roots.real[near_real & (roots.real > 0)])
    edges = np.concatenate([[0.0], places])
    # Roots only cut the axis; the sign behind each tells whether steps are still stable there.
    unstable = margin((edges + np.append(places, 2 * edges[-1] + 1)) / 2) < 0
    if not unstable.any():
        return inf
    reach = float(edges[unstable][0])
    if reach > 0 and (slope := margin.deriv()(reach)) != 0:  # one Newton step, exact residual
        reach -= float(sum(c * Fraction(reach) ** k for k, c in enumerate(excess))) / slope
    return float(reach / scale)


def _squared(coefficients: list[Fraction], direction: complex) -> np.ndarray:
    """Coefficients of |R(h direction)|² in rising powers of h, exactly."""
    x, y = Fraction(direction.real), Fraction(direction.imag)
    parts = np.empty((2, len(coefficients)), dtype=object)  # real and imaginary
    u, v = Fraction(1), Fraction(0)  # (x + iy)^k
    for k, r in enumerate(coefficients):
        parts[:, k] = r * u, r * v
        u, v = u * x - v * y, u * y + v * x
    real, imaginary = parts
    return np.convolve(real, real) + np.convolve(imaginary, imaginary)


def region(tableau: Tableau, re: ArrayLike, im: ArrayLike) -> np.ndarray:
    """Size ``|R(z)|`` on a grid of the complex plane; in the stability region it is at most 1.

    Parameters
    ----------
    tableau : Tableau
    re : (n,) array_like
        Real parts of z = hλ.
    im : (m,) array_like
        Imaginary parts.

    Returns
    -------
    (m, n) ndarray
        In the orientation that `matplotlib.axes.Axes.contour` takes.
    """
    z = np.asarray(re, dtype=float) + 1j * np.asarray(im, dtype=float)[:, np.newaxis]
    coefficients = [float(r) for r in stability_function(tableau).all_coeffs()]
    return np.abs(np.polyval(coefficients, z))
