"""The solvers on the fibre amplifier agree, and fewer steps than the fewest miss the target."""

import numpy as np
import pytest

from armbook.propagation import Amplifier, fewest
from armsim.amplifier import rhs
from armsim.methods import IntegrationError, integrate, tableaux

AMPLIFIER = Amplifier(channels=20)


def test_all_solvers_agree():
    """With the solution in ln P, which is compared with Radau's in the tests of the amplifier."""
    exact = AMPLIFIER.output_power
    for method, rtol in (("DOP853", 1e-12), ("Radau", 1e-11)):
        assert AMPLIFIER.by_scipy(method, rtol)[1] == pytest.approx(exact, rel=1e-10)
    evaluations, logarithmic = AMPLIFIER.by_scipy_for_logarithms("DOP853", 1e-13)
    assert logarithmic == pytest.approx(exact, rel=1e-11)
    assert AMPLIFIER.by_scipy_for_logarithms("DOP853", 1e-3)[0] < evaluations
    for form in ("additive", "exponential"):
        assert AMPLIFIER.controlled(form, 1e-11)[1] == pytest.approx(exact, rel=1e-9)
        assert AMPLIFIER.run(tableaux.RK6, form, 1000)[:, -1] == pytest.approx(exact, rel=1e-9)
    assert AMPLIFIER.averaged(4000) == pytest.approx(exact, rel=1e-4)


@pytest.mark.parametrize("least", [1, 2, 7, 63, 64, 65, 127, 128, 129, 300, 511, 512])
def test_the_fewest_steps_are_exact_up_to_512(least):
    assert fewest(lambda n: n >= least, 4096) == least


@pytest.mark.parametrize("least", [513, 777, 2050, 4096])
def test_the_fewest_steps_are_close_beyond(least):
    assert least <= fewest(lambda n: n >= least, 4096) <= 1.005 * least


def test_what_never_succeeds_has_no_fewest_steps():
    tried = []
    assert np.isnan(fewest(lambda n: tried.append(n), 1024))
    assert max(tried) == 1024


def test_a_lucky_small_number_does_not_count():
    assert fewest(lambda n: n in (3, 5) or n > 9, 4096) == 10


@pytest.mark.parametrize("form", ["additive", "exponential"])
def test_one_step_fewer_misses_the_target(form):
    """Against runs by `integrate` itself, and the powers by Radau."""
    exact = AMPLIFIER.by_scipy("Radau", 1e-11)[1]

    def end(n):
        start, step = AMPLIFIER.input_power, AMPLIFIER.length / n
        run = integrate(rhs, (0, 50e3), start, tableaux.DP5, step, form, AMPLIFIER.args)
        return run.y

    def off(n):
        return max(abs(a / b - 1) for a, b in zip(end(n)[:, -1], exact, strict=True))

    n = int(AMPLIFIER.steps_for(1e-4, tableaux.DP5, form))
    assert off(n) <= 1e-4 < off(n - 1)
    n = int(AMPLIFIER.positive_steps(tableaux.DP5, form))
    assert (end(n) > 0).all()
    if form == "exponential":
        with pytest.raises(IntegrationError):
            end(n - 1)
    else:
        assert (end(n - 1) <= 0).any()


def test_sections_of_the_average_power_method():
    n = int(AMPLIFIER.sections_for(1e-2))
    assert (
        AMPLIFIER.error(AMPLIFIER.averaged(n)) <= 1e-2 < AMPLIFIER.error(AMPLIFIER.averaged(n - 1))
    )


def test_a_breakdown_has_no_error():
    strong = AMPLIFIER.scaled(1e6)
    assert np.isnan(strong.error(strong.run(tableaux.EULER, "additive", 64)[:, -1]))


def test_an_error_too_large_for_a_float_is_infinite():
    with np.errstate(over="raise"):
        assert AMPLIFIER.error(np.full_like(AMPLIFIER.input_power, 1e308)) == np.inf
