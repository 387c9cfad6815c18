"""The comparison of solvers: what is run, what it costs, and how failures are told."""

import math
from itertools import product

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

from armbook.comparison import (
    EXPONENTIAL,
    NORMS,
    candidates,
    cheapest,
    compare,
    cpu_change,
    norms,
    ratios,
    reasons,
    spread,
    step_size_for,
    steps_for,
    voltage_error,
)
from armbook.peers import peers
from armbook.problems import linear_problem
from armbook.styles import METHODS
from armsim.arm import AxisParameters, LinearAxis, simulate
from armsim.arm.dynamics import constants, rhs
from armsim.methods import integrate, tableaux
from armsim.methods.scipy_solver import fixed_step_solver
from armsim.paper import PRINTED
from reportkit.timing import Timing

P = AxisParameters.paper_x_axis()
H = 1e-4


@pytest.fixture(scope="module")
def linear():
    return linear_problem(P, 10.0, 0.02)


@pytest.fixture(scope="module")
def compared(linear):
    return compare({"linear arm": linear}, [H], [1e-5])


def test_every_method_has_a_candidate_for_every_setting(linear):
    listed = list(candidates(linear, [1e-4, 1e-5], [1e-3]))
    fixed = len(METHODS) + len(PRINTED) + 3 * len(EXPONENTIAL)
    assert len(listed) == 2 * fixed + len(peers(1e-3, np.ones(1)))
    assert len({(one.method, one.setting) for one in listed}) == len(listed)


def test_errors_and_costs_are_those_of_a_run_by_hand(compared):
    runs, _ = compared
    A, B = LinearAxis(P).state_space()
    run = integrate(lambda t, y: A @ y + 10.0 * B, (0.0, 0.02), np.zeros(4), tableaux.RK6, H)
    exact = LinearAxis(P).step_response(10.0).velocity(run.t)
    found = runs[runs["method"] == tableaux.RK6.name].iloc[0]
    largest = np.abs(P.r_g * run.y[1] - exact).max() / np.abs(exact).max()
    assert found["error"] >= largest * (1 - 1e-6)  # that of the worst output
    assert (found["evaluations"], found["steps"], found["exponentials"]) == (run.nfev, 200, 0)
    end = P.r_g * run.y[0, -1] - LinearAxis(P).step_response(10.0).position(run.t[-1:])[0]
    assert found["end / mm"] == pytest.approx(1e3 * abs(end), rel=1e-3)
    shifted = runs[runs["method"] == f"{tableaux.DP4.name}, exponential, shifted"].iloc[0]
    assert shifted["exponentials"] == 200 * 4 * tableaux.DP4.exponentials()
    assert runs[runs["method"] == "SciPy Radau"]["steps"].isna().all()


def test_a_failure_is_told_and_not_counted(compared):
    runs, failures = compared
    at_rest = f"{tableaux.RK6.name}, exponential form"  # the arm starts at zero
    assert at_rest not in set(runs["method"])
    (reason,) = failures[failures["method"] == at_rest]["reason"]
    assert "exponential" in reason
    assert "\n" not in reason


def test_the_cheapest_run_that_is_good_enough():
    rng = np.random.default_rng(1)
    runs = pd.DataFrame(
        {
            "problem": rng.choice(["a", "b"], 60),
            "method": rng.choice(["x", "y", "z"], 60),
            "error": rng.random(60),
            "seconds": rng.random(60),
        }
    )
    runs.loc[runs["method"] == "z", "error"] = 2.0
    found = cheapest(runs, 0.5, "seconds")
    for problem in "ab":
        for method in "xyz":
            here = runs[(runs["problem"] == problem) & (runs["method"] == method)]
            wanted = sorted(
                s for s, e in zip(here["seconds"], here["error"], strict=True) if e <= 0.5
            )
            got = found[(found["problem"] == problem) & (found["method"] == method)]
            assert list(got["seconds"]) == wanted[:1]


def test_the_papers_metric_is_the_size_of_a_change():
    """Five repetitions, two of them slower and three faster: 10, 20, 30, 40 and 50 per cent."""
    seconds = np.array([[1.0, 1.5], [1.0, 0.9], [2.0, 2.4], [1.0, 0.7], [4.0, 2.4]])
    frame = pd.DataFrame({"function": ["prior", "new"] * 5, "seconds": seconds.ravel()})
    timing = Timing(frame, "process_time", 1e-9)
    assert cpu_change(timing, "new", "prior") == pytest.approx([20, 30, 40])


@pytest.mark.parametrize("order", [1, 4, 6.5])
def test_the_step_for_an_error_of_a_power_law(order):
    steps = np.geomspace(1e-1, 1e-4, 20)
    errors = 3 * steps**order
    assert step_size_for(3 * 2e-3**order, steps, errors) == pytest.approx(2e-3, rel=1e-12)
    assert np.isnan(step_size_for(2 * errors[0], steps, errors))
    assert np.isnan(step_size_for(errors[-1] / 2, steps, errors))


def test_the_steps_from_which_on_all_meet_an_error():
    steps = np.array([2, 3, 5, 8, 13])
    assert steps_for(1.0, steps, np.array([9, 0.5, 2, 1, 0.1])) == 8
    assert steps_for(1.0, steps, np.array([np.nan, 0.5, 1, 1, 0.1])) == 3
    assert steps_for(9.0, steps, np.arange(5.0)) == 2
    assert np.isnan(steps_for(1.0, steps, np.array([1, 1, 1, 1, 2.0])))


# --- two methods --------------------------------------------------------------------------------


def test_norms_of_made_up_errors():
    """Position and velocity err by sines, the current by a peak at the start."""
    t = np.linspace(0, 1, 10_001)[1:]
    errors = np.array([np.sin(np.pi * t), 3 * np.sin(np.pi * t), 9 * np.exp(-t / 1e-4)])
    found = {key: norm(t, errors) for key, (_, norm) in NORMS.items()}
    assert found["whole"] == pytest.approx(9 * np.exp(-1))  # at the first of the times
    assert found["late"] == pytest.approx(3)
    assert found["motion"] == pytest.approx(3)
    assert found["end"] == pytest.approx(0, abs=1e-14)
    assert found["rms"] == pytest.approx(3 / np.sqrt(2), rel=1e-6)


def test_norms_of_runs_by_hand(linear):
    RK6 = tableaux.RK6.name
    found = norms(linear, [tableaux.RK6, tableaux.EULER], [H, H / 2])
    assert set(found) == {(key, method) for key in NORMS for method in (RK6, "Euler")}
    A, B = LinearAxis(P).state_space()
    exact = LinearAxis(P).step_response(10.0)
    for n, h in enumerate((H, H / 2)):
        run = integrate(lambda t, y: A @ y + 10.0 * B, (0.0, 0.02), np.zeros(4), tableaux.EULER, h)
        off = np.abs(P.r_g * run.y[1] - exact.velocity(run.t)) / exact.velocity(run.t).max()
        assert found["end", "Euler"][n] >= off[-1] * (1 - 1e-3)  # of the worst output
        assert found["motion", "Euler"][n] == pytest.approx(off.max(), rel=0.05)  # every 0.2 ms
    assert found["whole", RK6][1] < found["whole", RK6][0] / 30


def test_ratios_of_made_up_errors():
    one = np.array([4.0, 1.0, 6.0, 1e-9, 3.0])
    other = np.array([2.0, 4.0, 2.0, 2.0, 1e-9])
    found = ratios(one, other, 1e-8)
    assert list(np.isnan(found)) == [False, False, False, True, True]
    known = sorted([4 / 2, 1 / 4, 6 / 2])
    told = spread(found)
    assert (told["least"], told["median"], told["most"]) == tuple(known)
    assert told["ahead"] == pytest.approx(100 / 3)
    assert np.isfinite(ratios(one, other)).all()
    assert np.isnan(list(spread(ratios(one, other, 10.0)).values())).all()


def test_failures_that_are_alike_are_one_row():
    columns = ["method", "problem", "setting", "reason"]
    blown = [
        [method, problem, h, f"component {n} blew up at t = {h}"]
        for n, (method, problem, h) in enumerate(product("AB", ["linear", "move"], [1e-4, 1e-5]))
    ]
    other = ["C", "move", 1e-3, "the step size is zero"]
    rows = reasons(pd.DataFrame([*blown, other], columns=columns), ["linear", "move"])
    assert rows == [
        ["A; B", "all", "1.e-05 to 1.e-04", "blows up"],
        ["C", "move", "1.e-03", "the step size is zero"],
    ]


@pytest.fixture(scope="module")
def published():
    return simulate(AxisParameters.paper_x_axis(), 10.0, 1.0)


@pytest.mark.parametrize(
    ("method", "step", "begin"), [(tableaux.EULER, 4e-5, 0.95), (tableaux.RK4_GILL, 1e-4, 0.79)]
)
def test_voltage_error_by_scipy(published, method, step, begin):
    p = published.parameters
    found = voltage_error(published, method, step, begin)
    solver = fixed_step_solver(method, step_size=step)
    steps = solve_ivp(rhs, (begin, 1.0), published(begin), solver, args=(10.0, constants(p)))
    voltages = []
    last = steps.t > 0.9
    for y in (steps.y[:, last], published(steps.t[last])):
        v_c = np.clip(y[4] + p.T_z * y[5], -p.V_L, p.V_L)
        voltages.append(np.clip(p.K_e * (v_c - y[6] / p.K_i), -p.V_M, p.V_M))
    # 1e-8 V: rounding of the current, times K_e / K_i and what the loop makes of it
    wanted = np.abs(voltages[0] - voltages[1]).max()
    assert found == pytest.approx(wanted, rel=1e-6, abs=1e-8)
    assert 1e-4 < found < 1


def test_a_method_that_blows_up_has_no_end(published):
    assert voltage_error(published, tableaux.EULER, 2e-3, begin=0.1) == math.inf
