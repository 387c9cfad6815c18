"""The package keeps the customs of scientific Python: short texts, equality, pickling, numbers."""

import copy
import os
import pickle
import subprocess
import sys
from dataclasses import replace
from fractions import Fraction

import bouncing_ball
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from armsim.amplifier import RamanAmplifier
from armsim.arm import (
    AxisParameters,
    LinearAxis,
    SlaveControl,
    Track,
    identify,
    linear,
    response,
    simulate,
    simulate_many,
)  # fmt: skip
from armsim.arm.files import FileError, read_axis, read_measurement
from armsim.arm.measurement import Instrument
from armsim.arm.move import move
from armsim.checks import IntegrationError
from armsim.methods import convergence, errata, integrate, stability, tableaux, trees
from armsim.methods.scipy_solver import fixed_step_solver
from armsim.methods.tableaux import Tableau
from armsim.paper import PRINTED, printed_fractions
from armsim.parallel import CaseError
from armsim.paths import DATA

P = AxisParameters.paper_x_axis()


def decay(t, y):
    return -y


@pytest.fixture(scope="module")
def results():
    """What a user may hold after a day's work, by name: results first, then values."""
    record = read_measurement(DATA / "measurements" / "x_axis_test.csv")
    axis, instrument = read_axis(DATA / "axes" / "x.toml")
    fit = identify.fit(record, axis, instrument, names=["V_L"], starts=1)
    amplifier = RamanAmplifier(channels=3)
    assert (amplifier.output_power > 0).all()
    ball, track, axis = bouncing_ball.solve(1.0, 2.0, 9.81, (0.8, 0.1)), Track.trapezoid(), P
    assert track(0.1).shape == (2,)
    return {
        "exact run": simulate(P, 10.0, 0.1),
        "controlled run": simulate(P, control=SlaveControl(), t_end=0.1),
        "fixed steps": simulate(P, 10.0, 0.001, method=tableaux.RK6, step_size=1e-5),
        "adaptive steps": simulate(P, 10.0, 0.001, method=tableaux.DP5),
        "solution": integrate(lambda t, y: -y, (0, 1), [1.0, 2.0], tableaux.RK6, 0.001),
        "adaptive solution": integrate(lambda t, y: -y, (0, 1), [1.0], tableaux.DP5),
        "exact solution": ball,
        "step response": LinearAxis(P).step_response(),
        "move": move(P, SlaveControl(track=Track((0.0, 0.01), (0.0, 0.0)))),
        "record": record,
        "problem": fit.problem,
        "fit": fit,
    }, {
        "axis": axis,
        "events": ball.events,
        "system": bouncing_ball.BALL,
        "linear axis": LinearAxis(P),
        "track": track,
        "long track": Track(tuple(range(1000)), (0.0,) * 1000),
        "control": SlaveControl(),
        "instrument": instrument,
        "check": identify.check_model(fit)[0],
        "tableau": tableaux.DP5,
        "surds": tableaux.RK4_GILL,
        "printed": PRINTED["ndp6"],
        "condition": trees.residuals(tableaux.RK4_GILL, 3)[-1],
        "errata": errata.search(printed_fractions("rk5")),
        "amplifier": amplifier,
    }  # fmt: skip


COPIES = [lambda held: pickle.loads(pickle.dumps(held)), copy.deepcopy, copy.copy]


@pytest.mark.parametrize("copied", COPIES)
def test_everything_can_be_pickled_and_copied(results, copied):
    """Values equal their copies. Results equal only themselves, but a copy holds the same."""
    runs, values = results
    for name, value in values.items():
        assert copied(value) == value, name
        assert hash(copied(value)) == hash(value), name
    for name, run in runs.items():
        other = copied(run)
        assert run == run and other != run and run != 1, name
        assert len({run, other}) == 2, name
        assert repr(other) == repr(run), name
        if callable(run) and name != "solution":
            assert np.array_equal(other(run.t), run(run.t)), name
            assert np.array_equal(other.y, run.y), name
    assert copied(runs["exact run"]).events == runs["exact run"].events
    assert copied(runs["exact solution"]).events == runs["exact solution"].events
    assert np.array_equal(copied(runs["fit"]).values, runs["fit"].values)
    assert copied(P.replace(K_1=3.0)).replace(K_2=1.0).K_1 == 3.0


def test_texts_are_short(results):
    runs, values = results
    for name, held in (runs | values).items():
        assert "\n" not in repr(held), name
        assert len(repr(held)) < (1000 if name in ("errata", "events") else 600), name
    texts = [repr(runs[name]) for name in ("solution", "record")]
    assert texts == [
        "<Solution: 2 states, 1001 times to t = 1>",
        "<Measurement of 651 samples from t = 0 to 1.3>",
    ]
    assert repr(runs["fit"]).startswith("<Fit: V_L = 2.69801>")
    assert repr(values["long track"]) == "<Track of 1000 points, 0.08 s apart>"
    exact = "<ExactSolution from t = 0 to 0.1: 7 states, 6 pieces, 5 events>"
    assert repr(runs["exact run"]) == f"Trajectory(solution={exact}, t_end=0.1)"


def test_tableaux_are_equal_by_their_coefficients():
    same = Tableau("midpoint", [["0", "0"], ["1/2", "0"]], [0, 1], reference="Runge")
    other = Tableau("midpoint", [[0, 0], [Fraction(1, 2), 0]], [0, 1])
    assert same == other and hash(same) == hash(other)
    assert replace(same, b=["1/2", "1/2"]) != same
    assert tableaux.DP4 != tableaux.DP5


def test_solver_classes_dense_output_and_errors_can_be_pickled():
    solver = fixed_step_solver(tableaux.RK6, 0.1, "exponential", shift=[1.0])
    run = solve_ivp(decay, (0, 1), [1.0], method=solver, dense_output=True)
    assert np.array_equal(pickle.loads(pickle.dumps(run)).sol(0.3), run.sol(0.3))
    again = solve_ivp(decay, (0, 1), [1.0], method=pickle.loads(pickle.dumps(solver)))
    assert np.array_equal(again.y, run.y)
    failure = CaseError("case 3: no")
    failure.case = 3
    assert pickle.loads(pickle.dumps(failure)).case == 3
    for kind in (IntegrationError, FileError):
        assert str(pickle.loads(pickle.dumps(kind("text")))) == "text"


# --- numbers ------------------------------------------------------------------------------------


def with_numbers(number, half):
    """Call all that takes real numbers; `half` makes 1/2, 1/4 … of them, exact in every type."""
    quarter, eighth = half / 2, half / 4
    p = P.replace(T_p=eighth / 2, H=number(0))
    control = SlaveControl(
        track=Track([number(0), eighth], [number(0), number(0)], eighth),
        K_p=number(8), K_I=number(4), K_v=quarter, period=eighth / 16, limit=number(10),
        volts_per_speed=number(10),
    )  # fmt: skip
    step, fine = LinearAxis(p).step_response(number(10)), half / 4096
    adaptive = integrate(decay, (number(0), half), [number(1)], tableaux.DP5, rtol=half**20)
    exponential = {"form": "exponential", "shift": half}
    solver = fixed_step_solver(tableaux.RK6, eighth, **exponential)
    amplifier = RamanAmplifier(
        pump_wavelengths=[1450e-9], pump_powers=[quarter], channels=2, length=number(50_000)
    )
    run = simulate(p, number(10), eighth, y0=[number(0)] * 7)
    yield run(eighth / 2)
    yield simulate(p, [(number(0), number(8)), (eighth / 2, number(-8))], eighth).y[:, -1]
    yield simulate(p, half, eighth, method=tableaux.RK6, step_size=fine).y[:, -1]
    yield simulate(p, control=control, t_end=eighth).y[:, -1]
    yield simulate_many([p], number(10), eighth)
    yield simulate_many([p], number(10), eighth, [eighth / 2, eighth])
    yield run.set_velocity(eighth / 2), run.auxiliary([eighth])["f_g"], run.regions([eighth])[0]
    yield step.velocity(eighth), step.position(eighth), step.settling_time(eighth)
    yield Track.trapezoid(half, half, number(1), eighth)(quarter)
    yield integrate(decay, (number(0), half), [number(1)], tableaux.RK6, eighth).y
    yield integrate(decay, (0, half), [number(1)], tableaux.RK6, eighth, **exponential).y
    yield adaptive.y, adaptive(quarter), adaptive([quarter, eighth])
    yield solve_ivp(decay, (0, 0.5), [1.0], method=solver).y
    yield bouncing_ball.solve(number(1), half, number(10), (0.5, 0.125))(quarter)
    yield amplifier.output_power, amplifier.gain
    yield Instrument(position=half, velocity=half, acceleration=half).deviations
    yield linear.nearly_linear(p, number(1000)).K_g, linear.oscillation(p, highest=number(200))
    yield response.arrival_time([number(0), half], [number(0), half], quarter)
    yield response.settling_time([number(0), half], [number(0), half], half, eighth)
    yield convergence.known_error(tableaux.RK6, eighth), stability.largest_step(tableaux.RK6, -half)
    yield convergence.observed_order([half, quarter], [half, quarter])


def flat(value):
    parts = value if isinstance(value, tuple) else (value,)
    return np.concatenate([np.ravel(np.asarray(part, dtype=float)) for part in parts])


@pytest.mark.parametrize("number", [np.float64, np.float32, Fraction])
def test_numbers_of_every_kind_are_numbers(number):
    """With all that takes numbers the result is that of Python's floats, to the last bit."""
    half = number(1) / number(2)
    for got, wanted in zip(with_numbers(number, half), with_numbers(float, 0.5), strict=True):
        assert flat(got).tolist() == flat(wanted).tolist()


@pytest.mark.parametrize("integer", [np.int64, np.int8, np.uint16])
def test_integers_of_every_kind_are_integers(integer):
    control = SlaveControl(delay=integer(2), counts=integer(100))
    assert control == SlaveControl(delay=2, counts=100)
    run, same = (simulate(P, control=c, t_end=0.1) for c in (control, replace(control, delay=2)))
    assert np.array_equal(run.y, same.y)
    assert AxisParameters.paper_x_axis(K_2=integer(100)) == AxisParameters.paper_x_axis(K_2=100.0)
    assert np.array_equal(simulate(P, integer(10), integer(1)).y, simulate(P, 10.0, 1.0).y)
    many = simulate_many([P], integer(10), integer(1), threads=integer(2))
    assert np.array_equal(many, simulate_many([P], 10.0, 1.0))
    few = integrate(decay, (0, 1), [1.0], tableaux.DP5, rtol=1e-9, max_steps=integer(100))
    assert few.t.size < 100
    assert trees.rooted_trees.__wrapped__(integer(4)) == trees.rooted_trees(4)
    assert len(trees.residuals(tableaux.RK5, integer(4))) == 8
    assert Tableau("mid", np.array([[0, 0], [1, 0]], integer), [0, 1]).A[1, 0] == 1
    square = [[[0, 1], [0, 1]], [[1, 2], [0, 1]], [[0, 1], [2, 1]]]
    assert errata.search(np.array(square, integer)) == errata.search(square)
    assert RamanAmplifier(channels=integer(3)).input_power.size == 8
    system = replace(bouncing_ball.BALL, guards=integer(1), matrices=integer(2))
    ball = system.solve([1, 0], integer(0), (0, 2), [(0, 10)], (0.5, 0.125), integer(99))
    assert ball.events


@pytest.mark.parametrize(
    "call",
    [
        lambda yes: simulate(P, yes),
        lambda yes: simulate(P, 10.0, yes),
        lambda yes: P.replace(T_p=yes),
        lambda yes: SlaveControl(delay=yes),
        lambda yes: SlaveControl(K_p=yes),
        lambda yes: integrate(decay, (0, 1), [1.0], tableaux.RK6, yes),
        lambda yes: integrate(decay, (0, 1), [yes], tableaux.RK6, 0.1),
        lambda yes: trees.rooted_trees.__wrapped__(yes),
        lambda yes: Tableau("a", [[0, 0], [yes, 0]], [0, 1]),
    ],
)
def test_truth_values_are_no_numbers(call):
    for yes in (True, np.True_):
        with pytest.raises((TypeError, ValueError), match=r"True"):
            call(yes)


SQUARE = np.zeros((2, 2))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: P.replace(L_a=1e-300), "L_a = 1e-300: it must lie between 1e-30 and 1e30"),
        (lambda: P.replace(J_m=1e200), "J_m = 1e+200: it must lie between 1e-30 and 1e30"),
        (lambda: P.replace(T_p=5e-324), "T_p = 5e-324: it must lie between 1e-30 and 1e30"),
        (
            lambda: integrate(decay, (0, 1), [1.0], tableaux.DP5, rtol=1e-30),
            "rtol = 1e-30 is not allowed; it must be at least 2.22e-14",
        ),
        (
            lambda: Track.trapezoid(period=0),
            "period = 0 is not allowed; it must be finite and positive",
        ),
        (
            lambda: simulate(P, 10.0, 0.1)(SQUARE),
            "t has shape (2, 2); a number or one row is needed",
        ),
        (
            lambda: integrate(decay, (0, 1), [1.0], tableaux.DP5)(SQUARE),
            "t has shape (2, 2); a number or one row is needed",
        ),
        (
            lambda: simulate_many([P], 10.0, 0.1, SQUARE),
            "times has shape (2, 2); a number or one row is needed",
        ),
        (
            lambda: simulate_many([P], 10.0, Fraction(1, 10), [1]),
            "times = 1.0 is outside the run; allowed is 0.0 to 0.1",
        ),
        (lambda: simulate(P, 10.0, 0.1).set_velocity("x"), "t = 'x': real numbers are needed"),
        (lambda: Track.trapezoid()("x"), "t = 'x': real numbers are needed"),
        (
            lambda: LinearAxis(P).step_response().position([1j]),
            "t = [1j]: real numbers are needed",
        ),
        *[
            (
                lambda f=f: f(SQUARE),
                "t, signal have shapes (2, 2), (2, 2); two rows (n,) are needed",
            )
            for f in (
                lambda t: response.arrival_time(t, t, 1.0),
                lambda t: response.settling_time(t, t, 1.0, 0.1),
                lambda t: response.ringing(t, t),
            )
        ],
        (
            lambda: response.ringing([1.0, 2.0], [1.0]),
            "t, signal have shapes (2,), (1,); two rows (n,) are needed",
        ),
    ],
)
def test_message_names_what_is_wrong(call, message):
    with pytest.raises(ValueError) as error:  # noqa: PT011
        call()
    assert str(error.value) == message


# --- settings of Python and numba ---------------------------------------------------------------

RUN = """
import armsim.exact
from armsim.arm import AxisParameters, SlaveControl, simulate
from armsim.methods import integrate, tableaux
p = AxisParameters.paper_x_axis()
print(simulate(p, control=SlaveControl(), t_end=0.1).y[:, -1].tolist())
print(simulate(p, t_end=0.01, method=tableaux.DP5).y[:, -1].tolist())
"""


def test_settings_of_python_and_numba_change_nothing():
    settings = {"NUMBA_DISABLE_JIT": "1", "PYTHONWARNINGS": "error"}
    command = [sys.executable, "-c", RUN]
    out = subprocess.run(command, env=os.environ | settings, check=True, capture_output=True).stdout
    runs = [
        simulate(P, control=SlaveControl(), t_end=0.1),
        simulate(P, t_end=0.01, method=tableaux.DP5),
    ]
    assert out.decode().splitlines() == [str(run.y[:, -1].tolist()) for run in runs]
