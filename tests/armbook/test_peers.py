"""Tests of the solvers that are compared, on problems whose solutions are known."""

from dataclasses import replace

import numpy as np
import pytest

from armbook import peers as module
from armbook import problems
from armbook.peers import fixed, peers
from armbook.problems import arm_problems, exactly, linear_problem, region_flow
from armsim.arm import AxisParameters, SlaveControl, Track, simulate
from armsim.arm.dynamics import derivative, region_number, region_of_number
from armsim.methods import IntegrationError, tableaux

P = AxisParameters.paper_x_axis()
NAMES = list(peers(1e-3, np.ones(1)))


@pytest.fixture(scope="module")
def linear():
    return linear_problem(P, 10.0, 0.02)


@pytest.fixture(scope="module")
def step():
    return simulate(P, 10.0, 0.05)


@pytest.fixture(scope="module")
def move():
    control = SlaveControl(track=Track.trapezoid(0.05, 0.4, 1.0), counts=0)
    return simulate(P, control=control, t_end=0.03)


@pytest.mark.parametrize("name", NAMES)
def test_each_solver_meets_its_tolerance_where_all_is_smooth(linear, name):
    solve = peers(1e-7, 1e-7 * linear.size)[name]
    counter = linear.equations.counting()
    t, y = linear.run(solve, counter)
    assert t.size == y.shape[1] == 100
    assert linear.error(t, y) < 1e-5
    assert 50 < counter.count < 2000


@pytest.mark.parametrize("name", NAMES)
def test_restarted_at_the_events_each_solver_converges(step, name):
    _, problem = arm_problems(step)
    solve = peers(1e-8, 1e-8 * problem.size)[name]
    assert problem.error(*problem.run(solve)) < 1e-3  # DOP853 errs between its steps


def test_cvode_is_left_out_where_it_cannot_be_installed(monkeypatch):
    monkeypatch.setattr(module, "CVODE", None)
    names = list(peers(1e-3, np.ones(1)))
    assert names == [name for name in NAMES if "CVODE" not in name]
    assert "DP5(4)" in names


def test_fixed_steps_have_their_order_on_the_linear_arm(linear):
    errors = [linear.error(*linear.run(fixed(tableaux.RK6, h))) for h in (1e-4, 5e-5)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(6, abs=0.5)


def test_a_step_that_serves_several_times_is_compared_once(step):
    problem, _ = arm_problems(step, np.linspace(0, 0.05, 5001))
    t, y = problem.run(fixed(tableaux.RK5, 1.25e-4))
    asked = []
    watched = replace(problem, exact=lambda times: (asked.append(times), step(times))[1])
    assert watched.error(t, y) == problem.errors(t, y).max()
    assert t.size == 5000
    assert np.array_equal(asked[0], np.unique(t))
    assert asked[0].size == 400


def test_fixed_steps_are_those_of_simulate(step):
    problem, _ = arm_problems(step)
    run = simulate(P, 10.0, 0.05, method=tableaux.RK5, step_size=1e-5)
    t, y = problem.run(fixed(tableaux.RK5, 1e-5))
    assert t == pytest.approx(0.005 * np.arange(1, 11))
    assert y[:, -1] == pytest.approx(run.y[:, -1], rel=1e-9)


def test_control_reads_the_states_of_the_solver(move):
    problem, landed = arm_problems(move)
    run = simulate(P, control=move.control, t_end=0.03, method=tableaux.RK6, step_size=1e-5)
    t, y = problem.run(fixed(tableaux.RK6, 1e-5))
    assert t == pytest.approx(0.005 * np.arange(1, 7))
    assert y[:, -1] == pytest.approx(run.y[:, -1], rel=1e-9)
    assert len(landed.legs) > len(problem.legs)
    assert landed.error(*landed.run(fixed(tableaux.RK6, 1e-5))) < 1e-6


def test_exact_run_is_the_solution(step, move):
    for run in (step, move):
        problem, _ = arm_problems(run)
        states = exactly(run)()
        t = np.linspace(0, states.shape[1] - 1, states.shape[1]) * 0.005
        assert problem.error(t, states) < 1e-12


def test_the_flow_of_a_region_is_its_derivative(step):
    problem, _ = arm_problems(step)
    (k,) = problem.equations.fixed
    y = tuple(0.1 * problem.size)
    for where in map(region_of_number.py_func, range(0, 135, 7)):
        wanted = derivative.py_func(y, 5.0, k, where)
        assert region_flow(0.0, y, 5.0, region_number(where), k) == pytest.approx(wanted, rel=1e-12)


def test_runs_without_end_are_given_up(linear, monkeypatch):
    monkeypatch.setattr(problems, "MAX_EVALUATIONS", 20)
    solve = peers(1e-7, 1e-7 * linear.size)["SciPy RK45"]
    with pytest.raises(IntegrationError, match="more than 20 evaluations"):
        linear.run(solve, linear.equations.counting())


def test_what_is_not_finite_is_wrong(linear):
    y = np.full((4, 2), np.nan)
    assert linear.error(np.array([0.0, 0.01]), y) == np.inf
