"""The fixed-step class as a method of SciPy's `solve_ivp`: what SciPy asks of its own solvers.

The problems are those of SciPy's tests: a rational system with a known solution, in both
directions, with events, dense output and given times. What its tests ask of error control and of
implicit solvers has no counterpart here.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from armsim.methods import integrate, runge_kutta, tableaux
from armsim.methods.loops import python_loop
from armsim.methods.scipy_solver import fixed_step_solver

RK6 = fixed_step_solver(tableaux.RK6, step_size=0.1)
SPANS = pytest.mark.parametrize("span", [(5, 9), (5, 1)], ids=["forwards", "backwards"])


def rational(t, y):
    return [y[1] / t, y[1] * (y[0] + 2 * y[1] - 1) / (t * (y[0] - 1))]


def rational_solution(t):
    t = np.asarray(t)
    return np.array([t / (t + 10), 10 * t / (t + 10) ** 2])


def solved(span, method=RK6, fun=rational, **more):
    return solve_ivp(fun, span, rational_solution(span[0]), method=method, **more)


# --- a run --------------------------------------------------------------------------------------


@SPANS
@pytest.mark.parametrize("vectorized", [False, True])
def test_a_run_with_dense_output(span, vectorized):
    run = solved(span, vectorized=vectorized, dense_output=True)
    assert run.success and run.status == 0 and run.t_events is None
    assert (run.t[0], run.t[-1]) == span
    assert run.y == pytest.approx(rational_solution(run.t), rel=1e-6)
    between = np.linspace(*span)
    assert run.sol(between) == pytest.approx(rational_solution(between), rel=1e-4)
    assert np.array_equal(run.sol(run.t), run.y)
    assert run.sol(span[0]).shape == (2,)


@pytest.mark.parametrize("form", ["additive", "exponential"])
@pytest.mark.parametrize("span", [(0.0, 1.0), (0.3, 1.05), (1.0, 0.0)])
def test_it_takes_the_steps_of_integrate(form, span):
    def fun(t, y):
        return np.array([y[0] * (1.5 + np.sin(2 * t) - y[1]), y[1] * (y[0] - 1.0)])

    for tableau in (tableaux.EULER, tableaux.RK4_GILL, tableaux.DP5):
        run = solve_ivp(fun, span, [1.5, 0.5], method=fixed_step_solver(tableau, 0.1, form))
        ours = integrate(fun, span, [1.5, 0.5], tableau, 0.1, form)
        assert run.t == pytest.approx(ours.t, rel=1e-15)
        assert run.y == pytest.approx(ours.y, rel=1e-13)  # the lengths of steps are rounded
        assert run.nfev == ours.nfev


def test_its_source_is_compiled_once(monkeypatch):
    made = []

    def counted(*how):
        made.append(how)
        return python_loop(*how)

    monkeypatch.setattr(runge_kutta, "python_loop", counted)
    assert solved((5, 9)).nfev == 40 * 7
    assert len(made) == 1


def test_given_times():
    for span, times in (((5, 9), [5, 5.01, 7, 8, 8.01, 9]), ((5, 1), [4.99, 3, 1.5, 1.1, 1.01])):
        run = solved(span, t_eval=times)
        assert list(run.t) == times
        assert run.y == pytest.approx(rational_solution(times), rel=1e-4)
    with pytest.raises(ValueError, match="t_eval"):
        solved((5, 9), t_eval=[4, 6])


def test_a_late_start_costs_no_digits():
    solver = fixed_step_solver(tableaux.RK6, step_size=0.01)
    run = solve_ivp(lambda t, y: -y, (1e9, 1e9 + 1), [1.0], method=solver)
    assert run.y[0] == pytest.approx(np.exp(1e9 - run.t), rel=1e-14)
    with pytest.raises(ValueError, match=r"step_size = 1e-08 is below the spacing .*1.19e-07"):
        solved((1e9, 1e9 + 1), fixed_step_solver(tableaux.RK6, 1e-8))
    with pytest.raises(ValueError, match=r"step_size = 0.1 is below the spacing .*128"):
        solved((1e18, np.inf))


# --- events -------------------------------------------------------------------------------------


def test_events_in_both_directions():
    def one(t, y):
        return y[0] - y[1] ** 0.7

    def two(t, y):
        return y[1] ** 0.6 - y[0]

    for span in ((5, 8), (8, 5)):
        run = solved(span, events=(one, two))
        (first,), (second,) = run.t_events
        assert 5.3 < first < 5.7 and 7.3 < second < 7.7
        for event, time, state in zip((one, two), (first, second), run.y_events, strict=True):
            assert event(time, state[0]) == pytest.approx(0, abs=1e-12)
            assert state[0] == pytest.approx(rational_solution(time), rel=1e-4)


def half(t, y):
    return y[0] - 0.5


half.terminal = True


@pytest.mark.parametrize("form", ["additive", "exponential"])
@pytest.mark.parametrize("end", [np.inf, -np.inf, 1e300])
def test_a_terminal_event_ends_an_endless_span(form, end):
    rate = -math.copysign(1.0, end)
    solver = fixed_step_solver(tableaux.RK6, 0.1, form)
    run = solve_ivp(lambda t, y: rate * y, (0, end), [1.0], method=solver, events=half)
    assert run.status == 1
    assert run.t[-1] == pytest.approx(math.copysign(np.log(2), end), abs=1e-6)
    assert np.abs(np.diff(run.t))[:-1] == pytest.approx(0.1)


def test_a_throw_is_over_when_it_lands():
    """The step is 5 µs, and the times have no duplicates."""

    def height(t, y):
        return y[0]

    height.terminal, height.direction = True, -1
    solver = fixed_step_solver(tableaux.RK5, step_size=5e-6)
    run = solve_ivp(
        lambda t, y: [y[1], -9.80665], (0, np.inf), [0, 0.01], solver, events=height, max_step=5e-6
    )
    assert run.t_events[0] == pytest.approx([0.02 / 9.80665], rel=1e-9)
    assert run.y_events[0][0] == pytest.approx([0, -0.01], abs=1e-9)
    assert (np.diff(run.t) > 0).all()


# --- the class ----------------------------------------------------------------------------------


def test_the_class_step_by_step():
    solver = RK6(rational, 5, [1 / 3, 1 / 4.5], np.inf)
    assert (solver.n, solver.status, solver.t_bound) == (2, "running", np.inf)
    assert (solver.t, solver.direction, solver.step_size) == (5, 1, None)
    with pytest.raises(RuntimeError):
        solver.dense_output()
    assert solver.step() is None
    assert solver.status == "running"
    assert solver.t == pytest.approx(5.1)
    assert solver.step_size == pytest.approx(0.1)
    assert solver.nfev == 7
    assert solver.y.flags.contiguous
    assert solver.dense_output()(5) == pytest.approx([1 / 3, 1 / 4.5], rel=1e-15)


def test_nothing_to_integrate():
    run = solve_ivp(lambda t, y: -y, (4, 4), [2, 3], method=RK6, dense_output=True)
    assert run.success
    assert run.sol([4, 5]).tolist() == [[2, 2], [3, 3]]
    for end in (10, np.inf):
        run = solve_ivp(lambda t, y: y, (0, end), [], method=RK6, dense_output=True)
        assert run.success
        assert run.sol([1, 2, 3]).shape == (0, 3)


@pytest.mark.parametrize("end", [1e-4, 0.25, 2.0])
def test_no_evaluation_is_outside_the_span(end):
    times = []

    def fun(t, y):
        times.append(t)
        return y

    solve_ivp(fun, (0, end), [1.0], method=RK6, dense_output=True)
    assert min(times) == 0 and max(times) == end


# --- complex states -----------------------------------------------------------------------------


def test_states_may_be_complex_in_the_additive_form():
    times = np.linspace(0, 1, 7)
    run = solve_ivp(lambda t, y: 1j * y, (0, 1), [0.5 + 1j], method=RK6, dense_output=True)
    assert run.y[0] == pytest.approx((0.5 + 1j) * np.exp(1j * run.t), rel=1e-8)
    assert run.sol(times)[0] == pytest.approx((0.5 + 1j) * np.exp(1j * times), rel=1e-5)


def test_complex_states_are_refused_in_the_exponential_form():
    solver = fixed_step_solver(tableaux.RK6, 0.1, "exponential")
    with pytest.raises(ValueError, match="complex"):
        solve_ivp(lambda t, y: 1j * y, (0, 1), [1 + 0j], method=solver)


# --- options ------------------------------------------------------------------------------------


def test_options_that_agree_with_the_step_are_taken(recwarn):
    run = solved((5, 9), first_step=0.1, max_step=0.5)
    assert np.array_equal(run.y, solved((5, 9)).y)
    assert not recwarn


@pytest.mark.parametrize(
    "option", [{"first_step": 0.05}, {"first_step": -1}, {"max_step": 0.05}, {"max_step": -1}]
)
def test_options_that_contradict_the_step_are_refused(option):
    ((name, value),) = option.items()
    with pytest.raises(ValueError, match=f"{name} = {value}.*every step of this solver is 0.1"):
        solved((5, 9), **option)


def test_options_without_effect_are_a_warning():
    """As SciPy's solvers treat them."""
    with pytest.warns(UserWarning, match="a fixed-step solver ignores rtol, jac"):
        solved((5, 9), rtol=1e-9, jac=None)


def test_wrong_arguments_are_refused():
    with pytest.raises(TypeError, match="tableau = 'RK6': a Tableau is needed"):
        fixed_step_solver("RK6", 0.1)
    with pytest.raises(ValueError, match="step_size = 0"):
        fixed_step_solver(tableaux.RK6, 0)
    with pytest.raises(ValueError, match="form = 'log' is not known"):
        solved((5, 9), fixed_step_solver(tableaux.RK6, 0.1, "log"))
    with pytest.raises(ValueError, match=r"fun returned shape \(1,\); the state has 2"):
        solved((5, 9), fun=lambda t, y: [1.0])
    with pytest.raises(ValueError, match="finite"):
        solve_ivp(rational, (5, 9), [np.nan, 1], method=RK6)


# --- failures -----------------------------------------------------------------------------------


def test_a_blow_up_says_which_step_and_when(recwarn):
    run = solve_ivp(lambda t, y: y * y, (0, 3), [1.0], method=RK6)
    assert (run.success, run.status) == (False, -1)
    step = run.t.size  # the first that failed
    assert step > 10
    assert run.message.endswith(f"component 0 blew up at t = {0.1 * step:.12g}, step {step}")
    assert not recwarn


def test_zero_in_the_exponential_form_says_which_step_and_when():
    solver = fixed_step_solver(tableaux.EULER, 0.25, "exponential")
    run = solve_ivp(lambda t, y: [-1e6 if t >= 1 else 0.0], (0, 3), [1.0], method=solver)
    assert "reached zero" in run.message
    assert run.message.endswith("t = 1.25, step 5")
