"""Runs at a fixed step: schedules, interpolation, agreement with SciPy, and how a run fails."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from armsim.arm import AxisParameters, simulate
from armsim.arm.dynamics import constants, rhs
from armsim.methods import IntegrationError, integrate, runge_kutta, tableaux

P = AxisParameters.paper_x_axis()
K = constants(P)
#: No nonlinearity acts on this axis, so the solution is smooth and errors follow the order.
SMOOTH = P.replace(H=0, F_0=0, V_L=1e9, V_M=1e9, K_1=P.K_1)


def run(p=P, set_velocity=10.0, t_end=0.05, method=tableaux.RK6, step_size=1e-5, **more):
    return simulate(p, set_velocity, t_end, method=method, step_size=step_size, **more)


# --- against SciPy ------------------------------------------------------------------------------


def python_rhs(t, y, volts, k):
    """The same equations without compilation."""
    return rhs.py_func(t, y, volts, k)


def test_agrees_with_dop853():
    """Two methods with nothing in common but the right-hand side."""
    theirs = solve_ivp(
        rhs, (0, 0.05), np.zeros(7), "DOP853", args=(10.0, K), rtol=1e-10, atol=1e-13, max_step=1e-4
    )
    ours = run(step_size=1e-6)
    scale = np.abs(ours.y).max(axis=1)
    # Steps of ours pass over the ends of backlash and limits with an error of about 1e-6 s times
    # the jump in slope; DOP853 steps back there. 1e-7 is seen.
    assert np.all(np.abs(ours.y[:, -1] - theirs.y[:, -1]) < 1e-6 * scale)


def test_agrees_with_dop853_to_its_tolerance_where_the_motion_is_smooth():
    theirs = solve_ivp(
        rhs,
        (0, 0.02),
        np.zeros(7),
        "DOP853",
        args=(10.0, constants(SMOOTH)),
        rtol=1e-11,
        atol=1e-10,
    )
    ours = run(SMOOTH, t_end=0.02, step_size=2e-6)
    scale = np.abs(ours.y).max(axis=1)
    assert np.all(np.abs(ours.y[:, -1] - theirs.y[:, -1]) < 1e-9 * scale)


@pytest.mark.parametrize("method", [tableaux.EULER, tableaux.RK6], ids=lambda m: m.name)
def test_compiled_and_plain_equations_give_the_same_run(method):
    compiled = run(t_end=0.004, method=method)
    plain = integrate(python_rhs, (0, 0.004), np.zeros(7), method, 1e-5, args=(10.0, K))
    scale = np.abs(plain.y).max(axis=1)
    # 400 steps; fused multiply-add rounds once where Python rounds twice
    assert np.all(np.abs(compiled.y[:, -1] - plain.y[:, -1]) < 1e-10 * scale)
    assert np.array_equal(compiled.t, plain.t)
    assert compiled.nfev == plain.nfev


def test_every_method_tends_to_the_same_motion():
    exact = run(SMOOTH, t_end=0.01, step_size=1e-6).y[:, -1]
    scale = np.abs(exact) + 1e-6
    for method, bound in (
        (tableaux.EULER, 1e-1), (tableaux.RK4_GILL, 1e-5), (tableaux.RK5, 1e-6),
        (tableaux.RK6, 1e-7), (tableaux.DP5, 1e-6), (tableaux.DP4, 1e-5),
    ):  # fmt: skip
        error = np.abs(run(SMOOTH, t_end=0.01, step_size=1e-5, method=method).y[:, -1] - exact)
        assert np.all(error < bound * scale), method.name


# --- steps and schedules ------------------------------------------------------------------------


def test_a_run_has_its_steps_states_and_evaluations():
    found = run(t_end=0.01, step_size=1e-4)
    assert found.t == pytest.approx(np.arange(101) * 1e-4, abs=1e-17)
    assert found.y.shape == (7, 101)
    assert found.nfev == 7 * 100
    assert np.array_equal(found.y[:, 0], np.zeros(7))
    assert found.parameters is P
    assert found.schedule == ((0.0, 10.0),)
    assert found.events == ()


def test_the_last_step_is_shortened():
    found = run(t_end=0.00105, step_size=1e-4)
    assert found.t.size == 12
    assert found.t[-1] == 0.00105
    assert np.diff(found.t)[:-1] == pytest.approx(1e-4)
    assert np.diff(found.t)[-1] == pytest.approx(5e-5)


def test_a_step_longer_than_the_run_is_shortened_to_it():
    assert list(run(t_end=1e-5, step_size=1.0).t) == [0.0, 1e-5]


def test_starts_from_a_given_state():
    middle = run(t_end=0.02)
    rest = run(t_end=0.01, y0=middle.y[:, 1000])
    assert rest.y[:, -1] == pytest.approx(middle.y[:, -1], rel=1e-12, abs=1e-12)


def test_switch_times_are_hit_exactly():
    schedule = [(0.0, 8.0), (0.0123456, -8.0), (0.03, 0.0)]
    found = run(set_velocity=schedule, t_end=0.04, step_size=1e-4)
    assert {0.0123456, 0.03} <= set(found.t)
    assert np.diff(found.t).min() > 0
    assert np.diff(found.t).max() < 1e-4 + 1e-12
    assert found.nfev == 7 * (found.t.size - 1)


def test_a_schedule_is_one_run_after_the_other():
    whole = run(set_velocity=[(0.0, 8.0), (0.0123456, -8.0)], t_end=0.03)
    first = run(set_velocity=8.0, t_end=0.0123456)
    second = run(set_velocity=-8.0, t_end=0.03 - 0.0123456, y0=first.y[:, -1])
    assert whole.y[:, first.t.size - 1] == pytest.approx(first.y[:, -1], rel=1e-15, abs=1e-300)
    # times of the second part round differently
    assert whole.y[:, -1] == pytest.approx(second.y[:, -1], rel=1e-9)


def test_before_the_first_time_the_input_is_zero():
    found = run(set_velocity=[(0.01, 5.0)], t_end=0.02)
    assert found.schedule == ((0.0, 0.0), (0.01, 5.0))
    assert not found.y[:, found.t <= 0.01].any()
    assert found.y[1, -1] > 0


@pytest.mark.parametrize("second", [0.02, 0.0200001, 7.0])
def test_switches_after_the_end_do_nothing(second):
    found = run(set_velocity=[(0, 5), (second, -5), (8, 1)], t_end=0.02)
    assert found.t[-1] == 0.02
    assert np.array_equal(found.y, run(set_velocity=5.0, t_end=0.02).y)


def test_set_velocity_is_the_new_value_from_a_switch_on():
    found = run(set_velocity=iter([(0.0, 8.0), (0.01, -8.0)]), t_end=0.02)
    assert list(found.set_velocity([0.0, 0.00999, 0.01, 0.02])) == [8.0, 8.0, -8.0, -8.0]


@pytest.mark.parametrize(
    ("method", "step"), [(tableaux.RK6, 1e-4), (tableaux.EULER, 1e-5), (tableaux.DP5, None)]
)
def test_a_segment_between_neighbouring_times_is_a_step(method, step):
    """0.1 + 0.2 is the next number after 0.3."""
    first, second = 0.3, 0.1 + 0.2
    assert second == np.nextafter(first, 1)
    schedule = [(0, 0), (first, 1), (second, 2)]
    for t_end, last in ((0.31, 2.0), (second, 1.0), (first, 0.0)):
        found = run(set_velocity=schedule, t_end=t_end, method=method, step_size=step)
        assert found.t[-1] == t_end
        assert {t for t in (first, second) if t <= t_end} <= set(found.t)
        assert (np.diff(found.t) > 0).all()
        assert found.set_velocity(found.t[-2]) == last
        assert np.isfinite(found(t_end)).all()


def test_a_segment_changes_nothing_when_it_is_short():
    found = run(set_velocity=[(0, 8), (0.01, -8), (np.nextafter(0.01, 1), 8)], t_end=0.02)
    assert found.y[:, -1] == pytest.approx(run(set_velocity=8, t_end=0.02).y[:, -1], rel=1e-9)


# --- interpolation ------------------------------------------------------------------------------


def test_at_the_steps_the_interpolation_is_the_run():
    found = run(set_velocity=[(0, 8), (0.0012, -8)], t_end=0.003, step_size=1e-4)
    # weights 1 and 0, but for the rounding of (t - t_n) / h at the last step
    assert found(found.t) == pytest.approx(found.y, rel=1e-13, abs=1e-15)
    assert found(0.003).shape == (7,)
    assert found(np.array([0.001])).shape == (7, 1)


def test_interpolation_is_of_fourth_order():
    fine = run(SMOOTH, t_end=0.003, step_size=1e-6)
    times = np.linspace(1e-3, 2.9e-3, 57) + 3e-7
    errors = []
    for step in (2e-5, 1e-5):
        difference = np.abs(run(SMOOTH, t_end=0.003, step_size=step)(times) - fine(times))
        errors.append(difference.max(axis=1) / np.abs(fine.y).max(axis=1))
    order = np.log2(errors[0] / errors[1])
    assert np.all(errors[1] < 1e-6)
    assert np.all(order[:6] > 3.5)


def test_interpolation_does_not_smear_a_switch():
    """On either side of it the slope is that of its own input."""
    switch, h = 0.0102, 1e-6
    found = run(SMOOTH, set_velocity=[(0, 8), (switch, -8)], t_end=0.02)
    for side, volts in ((-1, 8.0), (1, -8.0)):
        ends = found(switch + side * h * np.array([0.5, 1.5]))
        slope = side * (ends[:, 1] - ends[:, 0]) / h
        expected = rhs(0.0, found(switch + side * h), volts, constants(SMOOTH))
        assert slope[5] == pytest.approx(expected[5], rel=1e-2)


@pytest.mark.parametrize("t", [-1e-9, 0.0500001, np.nan, np.inf])
def test_times_outside_the_run_are_refused(t):
    with pytest.raises(ValueError, match=r"is outside the run; allowed is 0.0 to 0.05"):
        run()(t)
    with pytest.raises(ValueError, match="outside the run"):
        run()([0.01, t])


@pytest.mark.parametrize("method", [tableaux.RK6, None], ids=["RK6", "exact"])
def test_times_have_to_be_a_number_or_a_row(method):
    found = simulate(P, t_end=0.01, method=method, step_size=method and 1e-5)
    for call in (found, found.auxiliary, found.regions):
        with pytest.raises(ValueError, match=r"t has shape \(2, 2\); a number or one row"):
            call(np.zeros((2, 2)))
        with pytest.raises(ValueError, match=r"t = .*real numbers are needed"):
            call(["0.001"])


def test_auxiliary_variables_go_with_the_steps():
    found = run(t_end=0.01)
    v = found.auxiliary()
    assert {name: numbers.shape for name, numbers in v.items()} == dict.fromkeys(
        ["f_g", "F_s", "v_m", "v_c"], found.t.shape
    )
    assert v["v_c"].max() == P.V_L
    # M ẏ1 = f_g - F_s - B_a y1, by central differences of the run
    slope = np.gradient(found.y[1], found.t)
    assert slope[500] == pytest.approx(
        (v["f_g"] - v["F_s"] - P.B_a * found.y[1])[500] / P.M, rel=1e-3
    )


# --- how a run fails ----------------------------------------------------------------------------


@pytest.mark.parametrize("method", [tableaux.EULER, tableaux.RK6, tableaux.DP5])
def test_a_step_far_too_large_is_a_blow_up_with_method_step_and_time(method):
    with pytest.raises(IntegrationError) as error:
        run(t_end=20.0, method=method, step_size=0.01)
    for part in (method.name, "step size 0.01", "blew up", "t = "):
        assert part in str(error.value)


def test_growth_of_the_preamplifier_is_a_blow_up_before_it_is_infinite():
    """At 400 µs, past 2 T_r, its fast lag is unstable, and the limits hide that from the arm."""
    with pytest.raises(IntegrationError, match=r"Euler, step size 0.0004: .*\|y4\| = .* V at t = "):
        run(t_end=0.02, method=tableaux.EULER, step_size=4e-4)


@pytest.mark.parametrize("step", [1e-5, None], ids=["fixed", "adaptive"])
@pytest.mark.parametrize("size", [1e300, 1e308])
def test_states_that_overflow_are_an_error_with_the_time(step, size):
    with pytest.raises(IntegrationError, match=r"DP5, .* at t = \S+"):
        run(t_end=0.5, y0=[size] * 7, method=tableaux.DP5, step_size=step)


def test_a_state_between_steps_that_overflows_is_an_error_with_the_time():
    """The states are finite at both ends of the step, the slope is not at its end."""
    start = [0, 0, 0, 0, 1e301, 5e300, 0]
    found = run(set_velocity=0, t_end=1.0, method=tableaux.EULER, step_size=1.0, y0=start)
    assert np.isfinite(found.y).all()
    with pytest.raises(IntegrationError, match=r"not finite at t = 0.5$"):
        found(0.5)


def test_the_memory_is_that_of_the_whole_run(monkeypatch):
    """Each of ten segments could be stored, but not all."""
    schedule = [(n / 10, n) for n in range(10)]
    with pytest.raises(ValueError, match=r"step_size = 1e-08 would take 1e\+08 steps .* to 1.0"):
        run(set_velocity=schedule, t_end=1.0, step_size=1e-8)
    adaptive = {"set_velocity": schedule, "t_end": 1.0, "method": tableaux.DP5, "step_size": None}
    steps = run(**adaptive).t.size
    monkeypatch.setattr(runge_kutta, "MAX_STORED", 8 * steps // 2)
    monkeypatch.setattr(runge_kutta, "_CHUNK", 8)
    with pytest.raises(IntegrationError, match=r"DP5.* (memory|t = )"):
        run(**adaptive)


def test_just_below_the_stability_limit_nothing_is_reported():
    found = run(t_end=0.5, method=tableaux.EULER, step_size=5e-5)
    assert np.isfinite(found.y).all()


def test_a_large_initial_preamplifier_state_is_no_blow_up():
    y0 = [0, 0, 0, 0, 1e5, 1e6, 0]
    assert abs(run(set_velocity=0.0, t_end=0.01, y0=y0).y[4]).max() >= 1e5


@pytest.mark.parametrize(
    ("schedule", "message"),
    [
        ([], "set_velocity is empty"),
        ([(0, 1), (0, 2)], r"set_velocity\[1\] time = 0.0: .*must rise"),
        ([(0.2, 1), (0.1, 2)], r"set_velocity\[1\] time = 0.1: .*must rise"),
        ([(-0.1, 1)], r"set_velocity\[0\] time = -0.1: .*not be negative"),
        ([(0, np.nan)], r"set_velocity\[0\] volts = nan is not allowed"),
        ([(0, 1), (np.inf, 1)], r"set_velocity\[1\] time = inf is not allowed"),
        ([1.0, 2.0], r"set_velocity\[0\] = 1.0: a pair \(time, volts\) is needed"),
        ([(0, 1, 2)], r"set_velocity\[0\] = \(0, 1, 2\): a pair"),
        (np.nan, "set_velocity = nan is not allowed"),
        (-np.inf, "set_velocity = -inf is not allowed"),
    ],
)
def test_a_wrong_schedule_is_refused(schedule, message):
    with pytest.raises(ValueError, match=message):
        run(set_velocity=schedule)


@pytest.mark.parametrize(
    "volts", [True, "10", [(0, "1")], [(False, 1.0)], np.array(3.0), object(), 1j]
)
def test_volts_and_times_have_to_be_numbers(volts):
    with pytest.raises(TypeError, match=r"set_velocity.* a real number is needed"):
        run(set_velocity=volts)


@pytest.mark.parametrize("t_end", [0.0, -1.0, np.nan, np.inf])
def test_a_wrong_end_is_refused(t_end):
    with pytest.raises(ValueError, match=f"t_end = {t_end} is not allowed"):
        run(t_end=t_end)


@pytest.mark.parametrize("y0", ["rest", ["0"] * 7, np.zeros(7, complex), [[0], [0, 0]]])
@pytest.mark.parametrize("method", [tableaux.RK6, None])
def test_a_state_has_to_be_of_real_numbers(y0, method):
    with pytest.raises(ValueError, match=r"y0 = .*: real numbers are needed"):
        simulate(P, y0=y0, method=method, step_size=method and 1e-5)


@pytest.mark.parametrize("y0", [np.zeros(6), np.zeros((7, 1)), 0.0, [np.nan] * 7])
def test_a_wrong_state_is_refused(y0):
    with pytest.raises(ValueError, match="y0 = .*: one row of 7 finite numbers"):
        run(y0=y0)


@pytest.mark.parametrize("step_size", [0.0, -1e-5, np.nan, np.inf])
def test_a_wrong_step_is_refused(step_size):
    with pytest.raises(ValueError, match=f"step_size = {step_size} is not allowed"):
        run(step_size=step_size)


def test_at_rest_the_exponential_form_cannot_start():
    with pytest.raises(ValueError, match=r"y0\[0\].*exponential form needs"):
        run(form="exponential")
