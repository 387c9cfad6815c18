"""The fit: recovers the truth, is as sure as it says, and finds out a wrong model."""

import dataclasses
import pickle
import tomllib
from fractions import Fraction

import numpy as np
import pytest
from joblib import parallel_config
from scipy.optimize import approx_fprime

from armsim.arm import identify
from armsim.arm.files import read_axis, read_measurement
from armsim.arm.identify import (
    SIGNALS,
    Problem,
    bootstrap,
    check_model,
    fit,
    identifiability,
    profile,
)
from armsim.methods import IntegrationError, tableaux
from armsim.paths import DATA

AXIS, INSTRUMENT = read_axis(DATA / "axes" / "x.toml")
RECORD = read_measurement(DATA / "measurements" / "x_axis_test.csv")
TRUTH = tomllib.loads((DATA / "measurements" / "truth.toml").read_text(encoding="utf-8"))
TRUE = np.array([TRUTH["axis"][name] for name in identify.NAMES])


@pytest.fixture(scope="module")
def found():
    return fit(RECORD, AXIS, INSTRUMENT)


@pytest.fixture(scope="module")
def curved():
    record = read_measurement(DATA / "measurements" / "x_axis_test_curved.csv")
    return fit(record, AXIS, INSTRUMENT, starts=1)


# --- estimates ----------------------------------------------------------------------------------


def test_truth_is_recovered(found):
    assert found.converged and not found.at_bounds
    assert np.all(np.abs(found.values - TRUE) < 3 * found.standard_errors)
    np.testing.assert_allclose(found.values[[0, 1, 3]], TRUE[[0, 1, 3]], rtol=0.01)
    dof = found.degrees_of_freedom
    assert dof == 3 * 651 - 7
    assert abs(found.chi_squared - dof) < 3 * np.sqrt(2 * dof)


def test_setting_K_1_does_not_follow_the_friction(found):
    assert found.parameters.K_1 == AXIS.K_1
    assert found.parameters.replace(K_1=None).K_1 != AXIS.K_1


def test_saturation_current_is_K_i_V_L(found):
    current, error = found.saturation_current
    assert current == pytest.approx(3 * found.values[0], rel=1e-14)
    assert error == pytest.approx(3 * found.standard_errors[0], rel=1e-14)


def test_bias_and_drift_are_those_of_a_linear_regression(found):
    t = RECORD.t
    ideal = found.problem.model([found.logarithms])[0, 2] * INSTRUMENT.acceleration
    drift, bias = np.polyfit(t, RECORD.acceleration - ideal, 1)
    assert (found.bias, found.drift) == (pytest.approx(bias), pytest.approx(drift))
    error = 2 * INSTRUMENT.acceleration / np.sqrt(t.size)
    true = TRUTH["instrument"]
    assert abs(bias - true["acceleration_bias"]) < 3 * error
    assert abs(drift - true["acceleration_drift"]) < 3 * np.sqrt(3) * error


def test_covariance_is_that_of_all_unknowns_together(found):
    """Bias and drift as two more columns, in place of elimination."""
    problem, n = found.problem, RECORD.t.size
    model = problem.model(found.logarithms + np.vstack([np.eye(5), -np.eye(5)]) * 1e-6)
    slopes = (model[:5] - model[5:]).reshape(5, -1) / 2e-6
    line = np.zeros((2, 3, n))
    line[:, 2] = problem.line.T
    together = np.vstack([slopes, line.reshape(2, -1)])
    covariance = np.linalg.inv(together @ together.T)[:5, :5]
    scale = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(
        found.covariance / np.outer(scale, scale), covariance / np.outer(scale, scale), atol=1e-4
    )


def test_jacobian_agrees_with_central_differences(found):
    problem, x = found.problem, found.logarithms
    central = (
        approx_fprime(x, problem.residuals, 1e-5) + approx_fprime(x, problem.residuals, -1e-5)
    ) / 2
    error = np.linalg.norm(problem.jacobian(x) - central, axis=0)
    assert np.all(error < 1e-4 * np.linalg.norm(central, axis=0))  # 1e-5 is seen


def test_jacobian_stays_within_the_bounds(found):
    problem = dataclasses.replace(found.problem, high=found.logarithms)
    np.testing.assert_allclose(
        problem.jacobian(found.logarithms), found.problem.jacobian(found.logarithms), rtol=0.1,
        atol=1e-2 * np.abs(problem.jacobian(found.logarithms)).max(),
    )  # fmt: skip


def test_starts_that_end_elsewhere_are_counted(found):
    assert found.start_chi_squared.shape == (5,)
    assert found.start_chi_squared.min() == pytest.approx(found.chi_squared)
    worse = found.start_chi_squared > found.chi_squared + 0.1
    assert found.other_minima == worse.sum()
    assert not worse[0]  # from the axis file's values


def test_fewer_parameters_can_be_fitted():
    truth = AXIS.replace(K_1=AXIS.K_1, **TRUTH["axis"])
    bounds = {"b_g": (500, Fraction(2000))}
    one = fit(RECORD, truth, INSTRUMENT, names=["b_g"], bounds=bounds, starts=1)
    assert abs(one.values[0] - TRUE[2]) < 3 * one.standard_errors[0]
    assert one.saturation_current == (3 * TRUE[0], 0)
    (only,) = identifiability(one)
    assert only.verdict == "identified" and only.partner == ""


def test_fine_steps_give_the_exact_estimates_and_coarse_ones_do_not(found):
    how = {"method": tableaux.RK6, "starts": 1}
    fine = fit(RECORD, AXIS, INSTRUMENT, step_size=1e-5, **how)
    coarse = fit(RECORD, AXIS, INSTRUMENT, step_size=1e-4, **how)
    away = [np.abs(one.values - found.values) / found.standard_errors for one in (fine, coarse)]
    assert away[0].max() < 0.5
    assert away[1].max() > 3  # B_a by 9 is seen
    np.testing.assert_allclose(fine.standard_errors, found.standard_errors, rtol=0.1)


# --- what the data tell -------------------------------------------------------------------------


def test_profile_rises_as_the_standard_error_says(found):
    for n, name in enumerate(found.names):
        at = found.values[n] + np.array([-2, -1, 0, 1, 2]) * found.standard_errors[n]
        rise = profile(found, name, at)
        np.testing.assert_allclose(rise, [4, 1, 0, 1, 4], rtol=0.08, atol=1e-3)


def test_all_five_parameters_are_identified(found):
    for n, one in enumerate(identifiability(found)):
        assert one.verdict == "identified"
        low, high = one.interval
        width = 2 * 1.96 * found.standard_errors[n]
        assert high - low == pytest.approx(width, rel=0.1) and low < found.values[n] < high
        assert abs(one.correlation) == pytest.approx(
            np.sort(np.abs(found.correlation[n]))[-2], rel=1e-12
        )


def test_what_the_data_do_not_tell_is_said(found):
    """Blunt instruments: of the whole range of b_g, none is out of the question."""
    blunt = dataclasses.replace(INSTRUMENT, position=1e-2, velocity=1.0, acceleration=20.0)
    verdicts = {
        one.name: one.verdict
        for one in identifiability(fit(RECORD, AXIS, blunt, names=("V_L", "b_g"), starts=1))
    }
    assert verdicts["b_g"] == "not bounded from below and above"
    assert verdicts["V_L"] == "identified"


def test_parameter_without_effect_is_not_identified():
    """Where there is no static friction, its threshold does not matter."""
    axis = AXIS.replace(K_1=AXIS.K_1, **TRUTH["axis"]).replace(F_0=0)
    one = fit(RECORD, axis, INSTRUMENT, names=("V_L", "v_s"), starts=1)
    v_s = identifiability(one)[1]
    assert v_s.verdict == "not bounded from below and above"
    assert v_s.relative_error > 1e6 and abs(v_s.correlation) < 1e-6


def test_bootstrap_spreads_as_the_standard_errors_say(found):
    drawn = bootstrap(found, 150)
    spread = drawn.std(axis=0, ddof=1)
    np.testing.assert_allclose(spread, found.standard_errors, rtol=0.25)  # 4 / √(2 150)
    low, high = np.percentile(drawn, [2.5, 97.5], axis=0)
    np.testing.assert_allclose(high - low, 2 * 1.96 * found.standard_errors, rtol=0.35)
    with parallel_config("sequential"):
        again = bootstrap(found, 10)
    np.testing.assert_array_equal(again, drawn[:10])


def test_slopes_at_the_fit_serve_for_its_refits(found):
    """Bias and drift cancel, so those of the fitted motion serve for every record of it."""
    problem, start = found.problem, found.logarithms
    ideal, slopes = problem.model([start])[0], problem.jacobian(start)
    for seed in range(5):
        noise = np.random.default_rng(seed).standard_normal(ideal.shape)
        seen = (ideal + noise) * problem.instrument.deviations
        record = dataclasses.replace(problem.measurement, **dict(zip(SIGNALS, seen, strict=True)))
        noisy = dataclasses.replace(problem, measurement=record)
        np.testing.assert_array_equal(noisy.jacobian(start), slopes)
        off = noisy.solve(start, slopes).x - noisy.solve(start).x
        assert np.abs(off).max() > 0
        assert np.all(np.abs(off) < 0.03 * np.sqrt(np.diag(found.covariance)))


def test_interval_of_a_fit_that_explains_nothing_is_an_answer(found, monkeypatch):
    """χ² may be so large that its rounding alone is a rise, at the estimate as well."""
    monkeypatch.setattr(identify, "profile", lambda fit, name, values: [100.0])
    for n, one in enumerate(identifiability(found)):
        assert one.interval == pytest.approx((found.values[n],) * 2, rel=0.1)


# --- whether the model is right -----------------------------------------------------------------


def test_right_model_passes(found):
    assert all(check.passed for check in check_model(found))


def test_wrong_model_is_found_out(curved):
    """Friction is off by 5 % at low speed."""
    failed = {check.signal for check in check_model(curved) if not check.passed}
    assert failed == {"position", "acceleration"}
    assert curved.chi_squared > 10 * curved.degrees_of_freedom
    assert curved.at_bounds == ("F_0",)
    assert identifiability(curved)[4].verdict.startswith("not bounded from below")


def test_long_run_of_many_steps_is_computed_in_stretches(found, monkeypatch):
    """Whatever the stretches, the samples are the same, at the same changes of the input."""
    volts = RECORD.set_velocity + np.where(RECORD.t > 1, 3.0, 0.0)
    record = dataclasses.replace(RECORD, t=RECORD.t + 7, set_velocity=volts)
    problem = dataclasses.replace(
        found.problem, measurement=record, method=tableaux.DP4, step_size=1e-4
    )
    whole = problem.model([found.logarithms])
    runs = []

    def simulate(p, volts, end, **how):
        runs.append(end)
        return identify_simulate(p, volts, end, **how)

    identify_simulate = identify.simulate
    monkeypatch.setattr(identify, "simulate", simulate)
    for steps, count in ((2000, 7), (37, 650), (1, 650)):
        runs.clear()
        monkeypatch.setattr(identify, "_STRETCH", steps)
        np.testing.assert_allclose(problem.model([found.logarithms]), whole, rtol=1e-9, atol=1e-6)
        assert len(runs) == count and max(runs) < steps * 1e-4 + 0.0021


# --- input --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"names": ("V_L", "K_q")}, "names = .*'K_q'.* are needed, of R_a, L_a"),
        ({"names": ("V_L", "V_L")}, "different parameters are needed"),
        ({"names": ()}, "one or more"),
        ({"names": ("K_1",)}, "names = "),
        ({"bounds": {"M": (1, 2)}}, "bounds for M, not among the fitted"),
        ({"bounds": {"V_L": (2, 1)}}, r"bounds of V_L: \(2, 1\); 0 < low < high"),
        ({"bounds": {"V_L": (1, 2, 3)}}, r"bounds of V_L: \(1, 2, 3\); 0 < low < high"),
        ({"bounds": {"V_L": 2}}, "bounds of V_L: 2; 0 < low < high"),
        ({"bounds": {"V_L": "12"}}, "bounds of V_L = '12': real numbers"),
        (
            {"names": ("F_0",), "axis": AXIS.replace(F_0=0)},
            r"F_0: .*needed \(it is 0 in the axis\)",
        ),
        ({"starts": 0}, "starts = 0 is not allowed"),
        ({"starts": True}, "starts = True is a bool"),
        ({"step_size": 1e-5}, "step_size = 1e-05 .* for a Runge-Kutta method"),
        ({"measurement": dataclasses.replace(RECORD, set_velocity=0 * RECORD.t)}, "no motion"),
        ({"measurement": dataclasses.replace(RECORD, t=1e3 * RECORD.t)}, "record: .*of time"),
    ],
)
def test_input_is_checked(changes, message):
    arguments = {"measurement": RECORD, "axis": AXIS, "instrument": INSTRUMENT} | changes
    with pytest.raises((ValueError, TypeError), match=message):
        fit(**arguments)


def test_path_in_place_of_a_record_is_refused():
    with pytest.raises(TypeError, match="a Measurement is needed"):
        fit("run.csv", AXIS, INSTRUMENT)


def test_step_too_coarse_to_run_is_an_error():
    with pytest.raises(IntegrationError, match="blew up"):
        fit(RECORD, AXIS, INSTRUMENT, method=tableaux.RK6, step_size=1e-3)


def test_value_of_zero_is_held():
    axis = AXIS.replace(F_0=0, B_a=0, b_g=0, K_1=AXIS.K_1)
    one = fit(RECORD, axis, INSTRUMENT, bounds={"B_a": (50, 900)}, starts=1)
    assert one.names == ("V_L", "B_a", "K_g")
    assert (one.parameters.F_0, one.parameters.b_g) == (0, 0)


def test_value_of_zero_is_fitted_once_it_has_bounds():
    axis = AXIS.replace(F_0=0, K_1=AXIS.K_1)
    one = fit(RECORD, axis, INSTRUMENT, bounds={"F_0": (5, 60)}, starts=1)
    assert abs(one.values[4] - TRUE[4]) < 3 * one.standard_errors[4]


@pytest.mark.parametrize(("name", "values"), [("M", [1.0]), ("V_L", [-1.0]), ("V_L", [[1.0]])])
def test_profile_checks_its_input(found, name, values):
    with pytest.raises(ValueError, match="was not fitted|a row of positive numbers"):
        profile(found, name, values)


@pytest.mark.parametrize("n", [1, True])
def test_bootstrap_checks_its_input(found, n):
    with pytest.raises((ValueError, TypeError), match=f"n = {n} "):
        bootstrap(found, n)


def test_problem_is_small_enough_to_send(found):
    assert len(pickle.dumps(found.problem)) < 100_000
    assert isinstance(pickle.loads(pickle.dumps(found.problem)), Problem)
