"""Stability functions and limits against known values, brute force and NodePy."""

import functools
import math
import re

import numpy as np
import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st
from nodepy import rk

from armsim.methods import stability, trees
from armsim.methods.tableaux import DP4, DP5, EULER, RK4_GILL, RK5, RK6, Tableau

METHODS = [EULER, RK4_GILL, RK5, RK6, DP5, DP4]
CLASSICAL = Tableau(
    "RK4", [[0] * 4, ["1/2", 0, 0, 0], [0, "1/2", 0, 0], [0, 0, 1, 0]], ["1/6", "1/3", "1/3", "1/6"]
)
methods = pytest.mark.parametrize("tableau", METHODS, ids=lambda t: t.name)


@functools.cache
def coefficients(tableau):
    """Floats of A and b."""
    return tableau.floats()[:2]


def step(tableau, eigenvalue, h):
    """One step for y' = λy from 1, in plain NumPy."""
    A, b = coefficients(tableau)
    k = np.zeros(tableau.stages, dtype=complex)
    for i in range(tableau.stages):
        k[i] = eigenvalue * (1 + h * A[i] @ k)
    return 1 + h * b @ k


def brute_limit(tableau, direction):
    """Where |R| first exceeds 1, by stepping out in small steps and bisecting."""
    A, b = coefficients(tableau)
    one = np.ones(tableau.stages)

    def unstable(x):
        z = x * direction
        R = 1 + z * b @ np.linalg.solve(np.eye(tableau.stages) - z * A, one)
        return abs(R) > 1 + 1e-14

    if unstable(0.05):  # nearer to 0, |R| is too near to 1 for rounded numbers
        return 0.0
    inside = 0.05
    while not unstable(inside + 1e-3):
        inside += 1e-3
    outside = inside + 1e-3
    for _ in range(60):
        middle = (inside + outside) / 2
        inside, outside = (inside, middle) if unstable(middle) else (middle, outside)
    return inside


@methods
def test_stability_function_is_the_exponential_series_to_the_order(tableau):
    coefficients = stability.stability_function(tableau).all_coeffs()[::-1]
    p = trees.order(tableau)
    series = [sympy.Rational(1, math.factorial(k)) for k in range(p + 2)]
    assert coefficients[: p + 1] == series[: p + 1]
    assert len(coefficients) <= tableau.stages + 1


@pytest.mark.parametrize("tableau", [RK5, RK6, DP5, DP4], ids=lambda t: t.name)
def test_stability_function_is_nodepys(tableau):
    other = rk.ExplicitRungeKuttaMethod(
        np.array(tableau.A.tolist(), dtype=object), np.array(tableau.b.tolist(), dtype=object)
    )
    numerator, denominator = other.stability_function()
    assert denominator.coeffs == [1]
    assert stability.stability_function(tableau).all_coeffs() == list(numerator.coeffs)


@methods
@given(
    st.floats(0.01, 2.0),
    st.complex_numbers(max_magnitude=3.0, allow_nan=False, allow_infinity=False),
)
def test_one_step_multiplies_by_the_stability_function(tableau, h, eigenvalue):
    value = stability.region(tableau, [(h * eigenvalue).real], [(h * eigenvalue).imag])
    assert value[0, 0] == pytest.approx(abs(step(tableau, eigenvalue, h)), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize(
    ("tableau", "real", "imaginary"),
    [
        (EULER, 2.0, 0.0),
        (CLASSICAL, 2.785293563405282, 2 * math.sqrt(2)),
        (RK4_GILL, 2.785293563405282, 2 * math.sqrt(2)),
    ],
)
def test_known_limits(tableau, real, imaginary):
    assert stability.real_limit(tableau) == pytest.approx(real, rel=1e-15)
    assert stability.imaginary_limit(tableau) == pytest.approx(imaginary, rel=1e-15)


@methods
def test_limits_by_brute_force(tableau):
    assert stability.real_limit(tableau) == pytest.approx(brute_limit(tableau, -1), rel=1e-10)
    assert stability.imaginary_limit(tableau) == pytest.approx(
        brute_limit(tableau, 1j), rel=1e-10, abs=1e-12
    )


@pytest.mark.parametrize("tableau", [RK5, RK6, DP5, DP4], ids=lambda t: t.name)
def test_limits_are_nodepys(tableau):
    other = rk.ExplicitRungeKuttaMethod(
        np.array(tableau.A.tolist(), dtype=object), np.array(tableau.b.tolist(), dtype=object)
    )
    assert stability.real_limit(tableau) == pytest.approx(other.real_stability_interval(), 1e-10)
    assert stability.imaginary_limit(tableau) == pytest.approx(
        other.imaginary_stability_interval(), rel=1e-10, abs=1e-12
    )


@methods
@given(st.floats(math.pi / 2 + 0.05, math.pi), st.floats(1e-3, 1e6))
def test_largest_step_lies_on_the_boundary(tableau, angle, size):
    eigenvalue = size * complex(math.cos(angle), math.sin(angle))
    h = stability.largest_step(tableau, [eigenvalue])
    assert abs(step(tableau, eigenvalue, h)) == pytest.approx(1, abs=1e-9)
    shorter = [abs(step(tableau, eigenvalue, h * x)) for x in np.linspace(0, 1, 50)]
    assert max(shorter) <= 1 + 1e-9
    assert abs(step(tableau, eigenvalue, h * 1.001)) > 1
    conjugate = stability.largest_step(tableau, [eigenvalue.conjugate()])
    assert conjugate == pytest.approx(h, rel=1e-12)


def test_step_scales_with_the_eigenvalue_and_the_largest_decides():
    x = stability.real_limit(RK4_GILL)
    assert stability.largest_step(RK4_GILL, [-1, -200.0, -50]) == pytest.approx(x / 200, rel=1e-15)
    assert stability.largest_step(RK4_GILL, [-1e9]) == pytest.approx(x / 1e9, rel=1e-15)


def test_zero_imaginary_and_growing_eigenvalues():
    assert stability.largest_step(DP5, [0, 0j]) == math.inf
    assert stability.largest_step(DP5, []) == math.inf
    assert stability.largest_step(DP5, [0, -1]) == stability.real_limit(DP5)
    assert stability.largest_step(EULER, [1j]) == 0
    assert stability.largest_step(RK4_GILL, [2j, -2j]) == pytest.approx(math.sqrt(2), rel=1e-15)
    assert stability.largest_step(DP5, [1e-3]) == 0
    # a zero eigenvalue as a computation gives it
    assert stability.largest_step(DP5, [1e-12, -1]) == 0
    assert stability.largest_step(DP5, [1e-12, -1], zero=1e-9) == stability.real_limit(DP5)


def test_rounding_near_the_imaginary_axis_does_not_limit_the_step():
    # |R|² - 1 has vanishing low coefficients there; rounded ones would give a tiny step.
    near = stability.largest_step(RK4_GILL, [-1e-17 + 1j])
    assert near == pytest.approx(2 * math.sqrt(2), rel=1e-12)
    # Euler: |1 + h(-ε + i)|² ≤ 1 up to h = 2ε/(1 + ε²)
    assert stability.largest_step(EULER, [-1e-9 + 1j]) == pytest.approx(2e-9, rel=1e-9)


def test_a_boundary_that_is_touched_is_not_a_limit():
    # Runge-Kutta-Chebyshev, 2 stages: R = T_2(1 + z/4) is -1 at z = -4 and stable to z = -8.
    chebyshev = Tableau("RKC2", [[0, 0], ["1/4", 0]], ["1/2", "1/2"])
    R = stability.stability_function(chebyshev).as_expr()
    z = sympy.Symbol("z")
    assert sympy.expand(R - sympy.chebyshevt(2, 1 + z / 4)) == 0
    assert stability.real_limit(chebyshev) == pytest.approx(8, rel=1e-14)


def test_region_is_that_of_the_plane():
    x, y = np.linspace(-4, 1, 6), np.linspace(-3, 3, 7)
    grid = stability.region(EULER, x, y)
    assert grid.shape == (7, 6)
    assert np.allclose(grid, np.hypot(1 + x, y[:, None]))


def test_bad_input_is_an_error():
    with pytest.raises(ValueError, match=re.escape("all must be finite")):
        stability.largest_step(DP5, [-1, math.nan])
    with pytest.raises(ValueError, match="irrational coefficients"):
        stability.real_limit(Tableau("odd", [[0]], ["sqrt(2)"]))
