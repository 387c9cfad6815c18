"""The Raman amplifier: its spectrum, what it conserves, and solutions in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.constants import c
from scipy.integrate import quad, solve_ivp
from scipy.optimize import approx_fprime

from armsim.amplifier import (
    _MODES,
    RamanAmplifier,
    average_power,
    growth_rate,
    log_rhs,
    raman_spectrum,
    rhs,
)
from armsim.methods import integrate, tableaux

AMPLIFIER = RamanAmplifier(channels=20)


def powers_at_the_end(amplifier, method, rtol):
    span, start = (0.0, amplifier.length), amplifier.input_power
    return solve_ivp(rhs, span, start, method, args=amplifier.args, rtol=rtol, atol=0).y[:, -1]


# --- the fibre --------------------------------------------------------------------------------


def test_the_spectrum_is_odd_with_its_peak_near_13_terahertz():
    shift = np.linspace(0, 40e12, 4001)
    gain = raman_spectrum(shift)
    assert gain.max() == pytest.approx(1, abs=1e-5)
    assert shift[gain.argmax()] == pytest.approx(13.2e12, abs=0.1e12)
    assert raman_spectrum(-shift) == pytest.approx(-gain, abs=1e-14)
    assert (gain[1:] > 0).all()


def test_the_spectrum_is_the_sine_transform_of_the_response():
    position, strength, gauss, lorentz = _MODES * 100 * np.pi * c * 1e-12
    position = 2 * position
    strength = strength / (100 * np.pi * c * 1e-12)

    def response(t):
        decay = np.exp(-lorentz * t - (gauss * t / 2) ** 2)
        return (strength * decay * np.sin(position * t)).sum()

    def transform(shift):  # in THz
        return quad(lambda t: response(t) * np.sin(2 * np.pi * shift * t), 0, 5, limit=2000)[0]

    found = transform(5.0) / transform(13.2)
    assert found == pytest.approx(raman_spectrum(5e12) / raman_spectrum(13.2e12), rel=1e-8)


def test_every_digit_of_the_modes_of_silica():
    """Hollenbeck and Cantrell, table 1, by columns, written down independently of the package."""
    position = [56.25, 100, 231.25, 362.5, 463, 497, 611.5, 691.67, 793.67, 835.5, 930, 1080, 1215]
    strength = [1, 11.4, 36.67, 67.67, 74, 4.5, 6.8, 4.6, 4.2, 4.5, 2.7, 3.1, 3]
    gauss = [52.1, 110.42, 175, 162.5, 135.33, 24.5, 41.5, 155, 59.5, 64.3, 150, 91, 160]
    lorentz = [
        17.37,
        38.81,
        58.33,
        54.17,
        45.11,
        8.17,
        13.83,
        51.67,
        19.83,
        21.43,
        50,
        30.33,
        53.33,
    ]
    assert _MODES.tolist() == [position, strength, gauss, lorentz]


def test_gain_and_loss_are_those_of_a_standard_fibre():
    loss = dict(zip(1e9 * c / AMPLIFIER.frequency, AMPLIFIER.loss, strict=True))
    near_1550 = min(loss, key=lambda wavelength: abs(wavelength - 1550))
    assert 1e4 * loss[near_1550] / np.log(10) == pytest.approx(0.19, abs=0.005)
    pair = RamanAmplifier((1450e-9,), (0.1,), 1, (c / (c / 1450e-9 - 13.2e12),) * 2)
    assert 1e3 * pair.gain[0, 1] == pytest.approx(0.4, rel=1e-3)
    # the same shift from a pump of 1425 nm: proportional to its frequency
    short = RamanAmplifier((1425e-9,), (0.1,), 1, (c / (c / 1425e-9 - 13.2e12),) * 2)
    assert short.gain[0, 1] / pair.gain[0, 1] == pytest.approx(1450 / 1425, rel=1e-9)


def test_an_interaction_takes_as_many_photons_as_it_gives():
    photons = AMPLIFIER.gain * AMPLIFIER.frequency[:, None]
    assert photons == pytest.approx(-photons.T, rel=1e-12)
    assert (np.diag(photons) == 0).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pump_powers": (0.1,)}, "5 pump_wavelengths and 1 pump_powers"),
        ({"channels": 0}, "channels = 0"),
        ({"length": -1.0}, "length = -1.0"),
    ],
)
def test_an_impossible_amplifier_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        RamanAmplifier(**change)


# --- solutions --------------------------------------------------------------------------------


def test_without_loss_photons_are_conserved():
    lossless = RamanAmplifier(channels=20, rayleigh=0.0, infrared=0.0)
    run = integrate(rhs, (0, 50e3), lossless.input_power, tableaux.RK6, 100.0, args=lossless.args)
    photons = (1 / lossless.frequency) @ run.y
    assert photons == pytest.approx(np.full(run.t.size, photons[0]), rel=1e-13)
    assert run.y[:5, -1].sum() < 0.5 * run.y[:5, 0].sum()  # so that it was not for want of gain


def test_without_gain_every_form_and_method_leaves_the_loss():
    dark = RamanAmplifier(channels=20, peak_gain=1e-40)
    expected = dark.input_power * np.exp(-dark.loss * dark.length)
    for method in (tableaux.EULER, tableaux.DP5):
        run = integrate(
            rhs, (0, dark.length), dark.input_power, method, dark.length, "exponential", dark.args
        )
        assert run.y[:, -1] == pytest.approx(expected, rel=1e-14)
    found = average_power(dark.input_power, *dark.args, dark.length, 1, 2)
    assert found == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize("form", ["additive", "exponential", "exponential product"])
def test_one_pump_and_one_signal_without_loss_are_logistic(form):
    pair = RamanAmplifier((1450e-9,), (0.5,), 1, (1550e-9, 1550e-9), 1e-3, rayleigh=0, infrared=0)
    pump, signal = pair.input_power / pair.frequency
    flux = pump + signal
    rate = pair.gain[0, 1] * pair.frequency[0] * flux
    run = integrate(rhs, (0, 50e3), pair.input_power, tableaux.RK6, 100.0, form, pair.args)
    share = 1 / (1 + pump / signal * np.exp(-rate * run.t))
    assert run.y[1] == pytest.approx(share * flux * pair.frequency[1], rel=1e-12)
    assert run.y[0] == pytest.approx((1 - share) * flux * pair.frequency[0], rel=1e-12)


def test_the_solution_is_that_of_an_implicit_solver():
    explicit = powers_at_the_end(AMPLIFIER, "DOP853", 1e-12)
    assert powers_at_the_end(AMPLIFIER, "Radau", 1e-11) == pytest.approx(explicit, rel=1e-10)
    assert AMPLIFIER.output_power == pytest.approx(explicit, rel=1e-11)
    half = AMPLIFIER.solution(25e3)
    assert powers_at_the_end(replace(AMPLIFIER, length=25e3), "Radau", 1e-11) == pytest.approx(half)


def test_the_gain_is_that_over_a_fibre_without_pumps():
    weak = replace(AMPLIFIER.scaled(1e-9), pump_powers=AMPLIFIER.pump_powers)
    dark = replace(weak, pump_powers=(1e-20,) * 5)
    ratio = weak.output_power[5:] / dark.output_power[5:]
    assert weak.on_off_gain == pytest.approx(10 * np.log10(ratio), abs=1e-9)


def test_the_fastest_rates_are_those_of_numerical_jacobians():
    power = AMPLIFIER.output_power
    of_power = approx_fprime(power, lambda p: rhs(0.0, p, *AMPLIFIER.args), 1e-6 * power)
    of_logarithm = approx_fprime(np.log(power), lambda q: log_rhs(0.0, q, *AMPLIFIER.args), 1e-6)
    wanted = [np.abs(np.linalg.eigvals(J)).max() for J in (of_power, of_logarithm)]
    assert AMPLIFIER.fastest_rates() == pytest.approx(wanted, rel=1e-4)


def test_powers_stay_positive_in_steps_that_the_additive_form_cannot_take():
    def run(form):
        return integrate(
            rhs, (0, 50e3), AMPLIFIER.input_power, tableaux.RK5, 25e3, form, AMPLIFIER.args
        ).y

    assert (run("exponential") > 0).all()
    assert (run("additive") < 0).any()


def test_the_growth_rate_is_the_sum_over_the_waves():
    power = AMPLIFIER.input_power
    rate = power @ AMPLIFIER.gain - AMPLIFIER.loss
    assert growth_rate(power, *AMPLIFIER.args) == pytest.approx(rate, rel=1e-12)
    assert rhs(0.0, power, *AMPLIFIER.args) == pytest.approx(power * rate, rel=1e-12)


# --- the average-power method -----------------------------------------------------------------


@pytest.mark.parametrize(("evaluations", "order"), [(1, 1), (2, 2), (5, 2)])
def test_the_order_of_the_average_power_method(evaluations, order):
    exact = powers_at_the_end(AMPLIFIER, "DOP853", 1e-12)

    def error(sections):
        found = average_power(
            AMPLIFIER.input_power, *AMPLIFIER.args, AMPLIFIER.length, sections, evaluations
        )
        return np.abs(found / exact - 1).max()

    assert np.log2(error(1000) / error(2000)) == pytest.approx(order, abs=0.02)


def test_the_average_power_method_with_one_evaluation_is_the_exponential_euler_method():
    found = average_power(AMPLIFIER.input_power, *AMPLIFIER.args, AMPLIFIER.length, 100, 1)
    euler = integrate(
        rhs, (0, 50e3), AMPLIFIER.input_power, tableaux.EULER, 500.0, "exponential", AMPLIFIER.args
    )
    assert found == pytest.approx(euler.y[:, -1], rel=1e-12)


def test_scaling_multiplies_every_power():
    assert AMPLIFIER.scaled(3.0).input_power == pytest.approx(3 * AMPLIFIER.input_power)
    assert AMPLIFIER.scaled(3.0).length == AMPLIFIER.length
