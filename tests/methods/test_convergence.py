"""Errors, digits and observed orders against known answers; the test problem against SciPy."""

from math import isnan, nan

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.stats import linregress

from armsim.methods import IntegrationError, tableaux
from armsim.methods.convergence import (
    agreeing_digits,
    error_curve,
    known_error,
    known_slope,
    known_solution,
    observed_order,
    relative_error,
)

H = np.array([0.1, 0.05, 0.02, 0.01])


# --- observed order -----------------------------------------------------------------------------


@pytest.mark.parametrize("order", [1, 4, 6.5])
def test_order_of_a_power_is_its_exponent(order):
    for steps in (H, H[::-1]):
        assert observed_order(steps, 7 * steps**order, smallest=0) == pytest.approx(order)


def test_order_is_the_slope_of_a_regression():
    errors = H**3 * [1.0, 1.4, 0.8, 1.1]
    slope = linregress(np.log(H), np.log(errors)).slope
    assert observed_order(H, errors) == pytest.approx(slope, abs=1e-11)


def test_only_errors_in_range_and_finite_count():
    errors = np.array([0.5, 1e-3, 1e-5, 1e-13])
    two = np.log(1e-3 / 1e-5) / np.log(0.05 / 0.02)
    assert observed_order(H, errors, largest=0.1) == pytest.approx(two)
    assert observed_order(H, np.array([nan, 1e-3, 1e-5, np.inf]), largest=1) == pytest.approx(two)
    assert observed_order(H[[2, 0, 1]], errors[[2, 0, 1]], finest=2) == pytest.approx(two)


def test_one_error_has_no_order():
    assert isnan(observed_order(H, [nan, nan, nan, 1e-3]))
    assert isnan(observed_order([], []))
    assert isnan(observed_order(H, 1e-14 * H))


# --- the test problem ---------------------------------------------------------------------------


def test_the_known_solution_solves_the_problem():
    found = solve_ivp(
        known_slope, (0, 1), known_solution(0.0), "DOP853", [0.3, 1.0], rtol=1e-13, atol=1e-14
    )
    for t, y in zip(found.t, found.y.T, strict=True):
        assert y == pytest.approx(known_solution(t), rel=1e-12)


def test_the_problem_is_coupled_and_depends_on_time():
    t, y = 0.3, known_solution(0.3)
    here = np.array(known_slope(t, y))
    assert np.all(here != known_slope(t + 0.1, y))
    assert np.all(here != known_slope(t, y * [1.1, 1.0]))
    assert here[0] != known_slope(t, y * [1.0, 1.1])[0]


def test_error_of_eulers_method_is_that_of_its_formula():
    y, z, h = known_solution(0.0), np.log(known_solution(0.0)), 0.01
    for n in range(100):
        y = y + h * np.array(known_slope(n * h, y))
        z = z + h * np.array(known_slope(n * h, np.exp(z))) / np.exp(z)
    wanted = np.abs(y - known_solution(1.0)).max()
    assert known_error(tableaux.EULER, h) == pytest.approx(wanted, rel=1e-9)
    wanted = np.abs(np.exp(z) - known_solution(1.0)).max()
    assert known_error(tableaux.EULER, h, "exponential") == pytest.approx(wanted, rel=1e-9)


# --- errors -------------------------------------------------------------------------------------


def test_relative_error_is_that_of_the_worst_component():
    exact = np.array([[1.0, -4.0], [100.0, 50.0]])
    got = exact + np.array([[0.0, 0.2], [1.0, -3.0]])
    assert relative_error(got, exact) == pytest.approx(0.05)  # 0.2 of 4, against 3 of 100
    assert relative_error(got, exact, [40.0, 10.0]) == pytest.approx(0.3)
    assert relative_error(got[0], exact[0]) == pytest.approx(0.05)
    assert isnan(relative_error(got * nan, exact))


@pytest.mark.parametrize(("error", "digits"), [(1e-10, 10), (3e-10, 9), (0.5, 0), (20.0, -2)])
def test_digits_are_those_that_agree(error, digits):
    assert agreeing_digits(error) == digits
    assert error <= 10.0**-digits
    assert error > 10.0 ** -(digits + 1)


def test_no_more_digits_than_a_float_has():
    assert agreeing_digits(0.0) == agreeing_digits(1e-30) == 15


def test_a_run_that_fails_has_no_error_instead_of_none():
    def error(step):
        if step > 0.04:
            raise IntegrationError("too large")
        return step**2

    assert error_curve(error, H) == pytest.approx([nan, nan, 4e-4, 1e-4], nan_ok=True)
    with pytest.raises(ZeroDivisionError):
        error_curve(lambda step: 1 / 0, H)
