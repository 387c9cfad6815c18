"""`integrate`: order, agreement with a plain Runge-Kutta step, limits, input and errors."""

import re
from fractions import Fraction

import numpy as np
import pytest
from numba import njit
from scipy.integrate import solve_ivp

from armsim.methods import IntegrationError, integrate, runge_kutta, tableaux
from armsim.methods.tableaux import Tableau

ORDERS = {
    tableaux.EULER: 1,
    tableaux.RK4_GILL: 4,
    tableaux.RK5: 5,
    tableaux.RK6: 6,
    tableaux.DP5: 5,
    tableaux.DP4: 4,
}
every_method = pytest.mark.parametrize("tableau", ORDERS, ids=lambda tableau: tableau.name)
every_form = pytest.mark.parametrize("form", ["additive", "exponential"])


@njit
def hairer(t, y):
    """Nonlinear, coupled both ways and time-dependent: Hairer, Nørsett and Wanner I, (II.4)."""
    return 2 * t * y[0] * np.log(y[1]), -2 * t * y[1] * np.log(y[0])


def hairer_solution(t):
    return np.exp([np.sin(t**2), np.cos(t**2)])


@njit
def hunt(t, y):
    """Predator and prey with a season: positive, and nonlinear in ln y too (unlike `hairer`)."""
    return y[0] * (1.5 + np.sin(2 * t) - y[1]), y[1] * (y[0] - 1.0)


HUNT = np.array([1.5, 0.5])


def hunt_solution(t):
    """By a method of order 8 at the limit of its accuracy, about 1e-14."""
    if t == 0.0:
        return HUNT
    return solve_ivp(hunt.py_func, (0, t), HUNT, "DOP853", rtol=1e-13, atol=1e-15).y[:, -1]


def oscillator(t, y, rate=1.0):
    return np.array([y[1], -rate * y[0]])


def plain_step(fun, t, y, h, A, b, c, form):
    """One step, in arrays and in the order in which textbooks write it."""
    k = np.zeros((len(b), y.size))
    move = (lambda z: y + h * z) if form == "additive" else (lambda z: y * np.exp(h * z))
    for i in range(len(b)):
        stage = move(A[i] @ k)
        k[i] = np.asarray(fun(t + c[i] * h, stage)) / (1 if form == "additive" else stage)
    return move(b @ k)


# --- order --------------------------------------------------------------------------------------


@every_method
@pytest.mark.parametrize("compiled", [True, False], ids=["compiled", "plain"])
@pytest.mark.parametrize(
    ("form", "fun", "solution", "end"),
    [("additive", hairer, hairer_solution, 2.0), ("exponential", hunt, hunt_solution, 4.0)],
    ids=["additive", "exponential"],
)
def test_observed_order(tableau, compiled, form, fun, solution, end):
    order = ORDERS[tableau]
    # So many steps that the next order's error is small, and rounding (1e-14) smaller still. The
    # slack of 0.2 is needed by DP5 only, which was made to have a small fifth-order error.
    steps = {1: 1280, 4: 320, 5: 320, 6: 80}[order]
    fun = fun if compiled else fun.py_func
    coarse, fine = (
        integrate(fun, (0.0, end), solution(0.0), tableau, end / n, form).y[:, -1] - solution(end)
        for n in (steps, 2 * steps)
    )
    observed = np.log2(np.linalg.norm(coarse) / np.linalg.norm(fine))
    assert observed == pytest.approx(order, abs=0.2 if tableau is tableaux.DP5 else 0.1)


# --- one step, and many -------------------------------------------------------------------------


def random_tableau(seed, stages):
    """Explicit, consistent at no order, some entries zero."""
    rng = np.random.default_rng(seed)

    def number():
        return Fraction(int(rng.integers(-9, 10)), int(rng.integers(1, 12)))

    A = [[number() if j < i else 0 for j in range(stages)] for i in range(stages)]
    return Tableau(f"random {seed}", A, [number() for _ in range(stages)])


@every_form
@pytest.mark.parametrize("seed", range(6))
def test_a_step_of_a_random_tableau_is_the_plain_runge_kutta_step(seed, form):
    tableau = random_tableau(seed, stages=seed + 1)
    A, b, c = (np.array([[float(x) for x in row] for row in tableau.A.tolist()]),
               np.array([float(x) for x in tableau.b]),
               np.array([sum(map(float, row)) for row in tableau.A.tolist()]))  # fmt: skip
    y0, t0, h = np.array([0.4, 0.45]), 0.3, 0.01
    expected = plain_step(hunt.py_func, t0, y0, h, A, b, c, form)
    for fun in (hunt, hunt.py_func):
        found = integrate(fun, (t0, t0 + h), y0, tableau, 1.0, form).y[:, -1]
        assert found == pytest.approx(expected, rel=1e-14)


@every_form
@every_method
def test_compiled_and_plain_runs_differ_by_rounding_only(tableau, form):
    compiled, plain = (
        integrate(fun, (0.0, 1.0), [0.5, 0.4], tableau, 0.01, form) for fun in (hunt, hunt.py_func)
    )
    assert compiled.y == pytest.approx(plain.y, rel=1e-14)  # 100 steps of 1e-16 each, not in phase
    assert np.array_equal(compiled.t, plain.t)
    assert compiled.nfev == plain.nfev


@every_form
@every_method
def test_right_hand_side_is_called_as_often_as_counted_and_at_the_nodes(tableau, form):
    times = []

    def fun(t, y):
        times.append(t)
        return -y * t

    found = integrate(fun, (1.0, 2.0), [1.0], tableau, 0.3, form)
    assert found.nfev == len(times)
    c = np.array([float(sum(row)) for row in tableau.A.tolist()])
    b = [float(x) for x in tableau.b]
    if b[-1] == 0:  # DP5: the last stage is for the error estimate only
        c = c[:-1]
    starts, steps = found.t[:-1], np.diff(found.t)
    expected = (starts[:, None] + c * steps[:, None]).ravel()
    assert times == pytest.approx(expected, rel=1e-14)


def test_times_are_the_start_and_whole_steps():
    found = integrate(oscillator, (0.5, 1.75), [1.0, 0.0], tableaux.EULER, 0.25)
    assert list(found.t) == [0.5, 0.75, 1.0, 1.25, 1.5, 1.75]


@pytest.mark.parametrize(("step", "count", "last"), [(0.3, 4, 0.1), (0.1, 10, 0.1), (5.0, 1, 1.0)])
def test_the_last_step_is_shortened_and_none_is_added_by_rounding(step, count, last):
    found = integrate(oscillator, (0.0, 1.0), [1.0, 0.0], tableaux.RK6, step)
    assert found.t.size == count + 1
    assert found.t[-1] == 1.0
    assert found.t[-1] - found.t[-2] == pytest.approx(last)
    assert found.y[:, -1] == pytest.approx([np.cos(1), -np.sin(1)], abs=2e-3)


@pytest.mark.parametrize(("end", "step", "count"), [(2.1, 0.7, 3), (4.2, 0.7, 6), (0.7, 0.1, 7)])
def test_rounding_of_the_number_of_steps_adds_none(end, step, count):
    """2.1 / 0.7 and 4.2 / 0.7 come out a little above 3 and 6 in binary, 0.7 / 0.1 below 7."""
    assert integrate(oscillator, (0.0, end), [1.0, 0.0], tableaux.EULER, step).t.size == count + 1


def test_time_runs_backwards():
    forth = integrate(hairer, (0.3, 1.3), hairer_solution(0.3), tableaux.RK6, 0.005)
    back = integrate(hairer, (1.3, 0.3), forth.y[:, -1], tableaux.RK6, 0.005)
    assert np.all(np.diff(back.t) < 0)
    assert back.t[-1] == 0.3
    # both ways err by less than 1e-10
    assert back.y[:, -1] == pytest.approx(hairer_solution(0.3), rel=2e-10)


def test_a_span_of_no_length_is_the_initial_state():
    for fun in (hunt, hunt.py_func):
        found = integrate(fun, (1.0, 1.0), [0.5, 0.4], tableaux.RK6, 0.1)
        assert found.t.tolist() == [1.0]
        assert found.y.tolist() == [[0.5], [0.4]]
        assert found.nfev == 0


@pytest.mark.parametrize("step", [1.0000001, 3.0, 1e10, 1e300])
@pytest.mark.parametrize("span", [(0.0, 1.0), (1.0, 0.0)])
def test_a_step_longer_than_the_span_is_shortened_to_it(step, span):
    found = integrate(oscillator, span, [1.0, 0.0], tableaux.RK6, step)
    assert tuple(found.t) == span
    assert found.y[:, 1] == pytest.approx([np.cos(1), -np.sin(span[1] - span[0])], abs=1e-3)


@pytest.mark.parametrize("step", [1e-5, None], ids=["fixed", "adaptive"])
@pytest.mark.parametrize("start", [0.3, -1e9, 5e-324])
def test_a_span_between_neighbouring_times_is_one_step(start, step):
    end = np.nextafter(start, np.inf)
    for span in ((start, end), (end, start)):
        found = integrate(oscillator, span, [1.0, 0.0], tableaux.DP5, step)
        assert tuple(found.t) == span
        assert np.isfinite(found.y).all()


# --- times that are large beside their span ------------------------------------------------------


@njit
def shrinking(t, y):
    return (-y[0],)


@pytest.mark.parametrize("start", [0.0, 2e3, 1e6, 1e9, -1e9, 1e12])
@pytest.mark.parametrize("fun", [shrinking, shrinking.py_func], ids=["compiled", "plain"])
def test_a_late_start_costs_no_digits(start, fun):
    """Each step has the length that the rounded times say; SciPy is off by 6e-15 to 8e-14."""
    for span in ((start, start + 1), (start + 1, start)):
        for how in ({"step_size": 0.01}, {"rtol": 1e-12, "atol": 1e-14}):
            found = integrate(fun, span, [1.0], tableaux.DP5, **how)
            assert tuple(found.t[[0, -1]]) == span
            assert (np.diff(found.t) * (span[1] - span[0]) > 0).all()
            # 3e-13: the method itself, as at t = 0
            assert found.y[0] == pytest.approx(np.exp(span[0] - found.t), rel=3e-13)


def test_an_adaptive_run_starts_late_from_zero():
    """Without a scale for the first step, the spacing of the times is one."""
    found = integrate(lambda t, y: 1 - y, (1e12, 1e12 + 1), [0.0], tableaux.DP5)
    assert found.y[0, -1] == pytest.approx(1 - np.exp(-1), abs=1e-6)


@pytest.mark.parametrize("size", [1.0, 1.3, 2.5, 1e3])
def test_steps_near_the_spacing_of_the_times_are_distinct(size):
    spacing = np.spacing(1e9)
    for steps in (7, 7.001, 7.9):
        end = 1e9 + steps * size * spacing
        found = integrate(shrinking, (1e9, end), [1.0], tableaux.EULER, size * spacing)
        assert found.t[-1] == end
        assert (np.diff(found.t) >= spacing).all()


@pytest.mark.parametrize("step", [1e-8, 1e-30, 5e-324])
def test_a_step_below_the_spacing_of_the_times_is_an_error_with_both(step):
    with pytest.raises(ValueError, match=rf"step_size = {step} is below the spacing .*1.19e-07"):
        integrate(shrinking, (1e9, 1e9 + 1), [1.0], tableaux.RK6, step)


# --- limits of an adaptive run -------------------------------------------------------------------


@njit
def sliding(t, y):
    return (-np.sign(y[0]),)


def test_an_adaptive_run_that_would_not_end_says_where_it_stopped():
    with pytest.raises(IntegrationError, match=r"DP5.*stopped at t = 1.0.* after 100000 steps"):
        integrate(sliding, (0, 2), [1.0], tableaux.DP5)


def test_the_number_of_steps_can_be_limited():
    problem = (shrinking, (0, 800), [1.0], tableaux.DP5)
    free = integrate(*problem)
    steps = free.t.size - 1
    assert steps > 256  # more than one call of the loop
    assert np.array_equal(integrate(*problem, max_steps=steps).y, free.y)
    with pytest.raises(IntegrationError) as error:
        integrate(*problem, max_steps=steps - 1)
    assert f"after {steps - 1} steps, max_steps = {steps - 1}" in str(error.value)
    time = float(str(error.value).split("t = ")[1].split(" ")[0])
    assert time == pytest.approx(free.t[-2])


@pytest.mark.parametrize("wrong", [0, -3, 2.5, "10", True])
def test_a_wrong_limit_of_steps_is_refused(wrong):
    with pytest.raises((ValueError, TypeError), match="max_steps = "):
        integrate(shrinking, (0, 2), [1.0], tableaux.DP5, max_steps=wrong)


def test_an_adaptive_run_keeps_to_the_memory(monkeypatch):
    """A step of DP5 stores a time, a state and seven slopes."""
    monkeypatch.setattr(runge_kutta, "MAX_STORED", 30 * (1 + 2 + 14) + 5)
    with pytest.raises(IntegrationError, match=r"after 30 steps, the limit of memory"):
        integrate(hunt, (0, 20), HUNT, tableaux.DP5)


def test_a_component_that_is_zero_needs_an_absolute_tolerance():
    with pytest.raises(ValueError, match=r"atol = 0: .*not 0 where y0 is 0"):
        integrate(oscillator, (0, 1), [1.0, 0.0], tableaux.DP5, atol=0)
    with pytest.raises(ValueError, match=r"atol = \[1e-09, 0\]"):
        integrate(oscillator, (0, 1), [1.0, 0.0], tableaux.DP5, atol=[1e-9, 0])
    found = integrate(oscillator, (0, 1), [1.0, 0.0], tableaux.DP5, atol=[0, 1e-9])
    assert found.y[0, -1] == pytest.approx(np.cos(1), abs=1e-5)


# --- right-hand sides of every kind -------------------------------------------------------------


@njit
def oscillator_tuple(t, y, rate):
    return y[1], -rate * y[0]


@njit
def oscillator_array(t, y, rate):
    return np.array([y[1], -rate * y[0]])


@njit
def oscillator_vector(t, y, rate):
    return y[::-1] * np.array([1.0, -rate])


@njit("float64[:](float64, float64[:], float64)")
def oscillator_eager(t, y, rate):
    return np.array([y[1], -rate * y[0]])


def oscillator_list(t, y, rate):
    return [y[1], -rate * y[0]]


class Mute(float):
    """A number of which no text can be made."""

    def __repr__(self):
        raise AssertionError("a message is made that nobody reads")

    __str__ = __format__ = __repr__


@pytest.mark.parametrize("step_size", [0.1, None])
def test_no_message_is_made_of_arguments_that_are_right(step_size):
    """It would take longer than a short run: numpy takes 0.2 ms to print a matrix."""
    run = integrate(
        lambda t, y, rate: -rate * y, (0, 1), [1.0], tableaux.DP5, step_size, args=(Mute(1.0),)
    )
    assert run.y[0, -1] == pytest.approx(np.exp(-1), rel=1e-5)


@pytest.mark.parametrize(
    "fun",
    [oscillator, oscillator_list, oscillator_tuple, oscillator_array, oscillator_vector,
     oscillator_eager],
    ids=lambda fun: fun.__name__,
)  # fmt: skip
def test_tuples_lists_and_arrays_compiled_or_not_with_args(fun):
    found = integrate(fun, (0, 1), (1, 0), tableaux.RK4_GILL, 0.01, args=(4.0,))
    assert found.y.shape == (2, 101)
    assert found.y.dtype == float
    assert found.y[:, -1] == pytest.approx([np.cos(2), -2 * np.sin(2)], rel=1e-7)


@pytest.mark.parametrize("compiled", [True, False])
def test_a_right_hand_side_may_return_the_same_array_every_time(compiled):
    def decay(t, y, out):
        out[0] = -y[0]
        return out

    fun = njit(decay) if compiled else decay
    found = integrate(fun, (0, 1), [1.0], tableaux.RK4_GILL, 0.01, args=(np.zeros(1),))
    assert found.y[0, -1] == pytest.approx(np.exp(-1), rel=1e-8)


@njit
def decay(t, y, rates):
    return -rates * y


@pytest.mark.parametrize("size", [1, 16, 17])
def test_systems_of_any_size(size):
    rates = np.linspace(0.1, 2, size)
    for fun in (decay, decay.py_func):
        found = integrate(fun, (0, 1), np.ones(size), tableaux.RK4_GILL, 0.01, args=(rates,))
        assert found.y[:, -1] == pytest.approx(np.exp(-rates), rel=1e-8)
        found = integrate(fun, (0, 1), np.ones(size), tableaux.DP5, args=(rates,), rtol=1e-9)
        assert found.y[:, -1] == pytest.approx(np.exp(-rates), rel=1e-8)


def test_initial_state_is_not_changed():
    y0 = np.array([1.0, 0.0])
    found = integrate(oscillator, (0, 1), y0, tableaux.RK6, 0.1)
    found.y[:] = 7
    assert y0.tolist() == [1.0, 0.0]


# --- input --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "step", [0, 0.0, -0.1, np.inf, -np.inf, np.nan, True, np.True_, "0.1", 5e-324, 1e-300]
)
def test_a_wrong_step_is_refused(step):
    with pytest.raises((ValueError, TypeError), match="step_size = "):
        integrate(oscillator, (0, 1), [1.0, 0.0], tableaux.RK6, step)


def test_a_step_too_small_for_the_memory_says_how_many_fit():
    with pytest.raises(ValueError, match=r"step_size = 1e-12 would take 1e\+12 steps.* at most"):
        integrate(oscillator, (0, 1), [1.0, 0.0], tableaux.RK6, 1e-12)


@pytest.mark.parametrize(
    "span",
    [(0, np.inf), (np.nan, 1), (0,), (0, 1, 2), 1.0, ("a", 1), ("0", "1"), None, (-1e308, 1e308)],
)
def test_a_wrong_span_is_refused(span):
    with pytest.raises(ValueError, match="t_span = "):
        integrate(oscillator, span, [1.0, 0.0], tableaux.RK6, 0.1)


@pytest.mark.parametrize(
    "y0",
    [
        1.0,
        [],
        [[1.0, 0.0]],
        [1.0, np.nan],
        [np.inf, 0.0],
        [1j, 0.0],
        "ab",
        ["1", "0"],
        None,
        [[1], []],
    ],
)
def test_a_wrong_initial_state_is_refused(y0):
    with pytest.raises(ValueError, match="y0 "):
        integrate(oscillator, (0, 1), y0, tableaux.RK6, 0.1)


def test_an_unknown_form_is_answered_with_the_known_ones():
    with pytest.raises(ValueError, match=r"form = 'log' is not known; allowed are .*'additive'"):
        integrate(oscillator, (0, 1), [1.0, 0.0], tableaux.RK6, 0.1, "log")


@pytest.mark.parametrize("y0", [[1.0, 0.0], [1.0, -1e-300]])
def test_the_exponential_form_needs_positive_components(y0):
    with pytest.raises(ValueError, match=r"y0\[1\].*exponential form needs"):
        integrate(oscillator, (0, 1), y0, tableaux.RK6, 0.1, "exponential")


@pytest.mark.parametrize("args", [-1, 4.0, None, [4.0], np.array([4.0])])
def test_arguments_that_are_no_tuple_are_refused(args):
    told = re.escape(f"args = {args!r}: a tuple is needed, such as ({args!r},)")
    with pytest.raises(TypeError, match=told):
        integrate(oscillator, (0, 1), [1.0, 0.0], tableaux.RK6, 0.1, args=args)


@pytest.mark.parametrize(
    ("name", "value"),
    [(name, value) for name in ("atol", "shift")
     for value in ([1.0, 2.0, 3.0], [], [[1.0, 2.0]], "1e-9", ["1", "2"], np.nan, 1j)]
    + [("atol", -1e-9), ("atol", [1e-9, -1e-9]), ("atol", None)],
)  # fmt: skip
def test_wrong_numbers_for_components_are_refused(name, value):
    how = {"atol": {}, "shift": {"form": "exponential"}}[name]
    with pytest.raises(ValueError, match=f"{name} = "):
        integrate(oscillator, (0, 1), [1.0, 1.0], tableaux.DP5, **how, **{name: value})


def test_numbers_for_components_may_be_fractions():
    for atol in (Fraction(1, 10**9), [Fraction(1, 10**9), 1e-9]):
        found = integrate(oscillator, (0, 1), [Fraction(1), 0], tableaux.DP5, atol=atol)
        same = integrate(oscillator, (0, 1), [1.0, 0.0], tableaux.DP5, atol=1e-9)
        assert np.array_equal(found.y, same.y)


@njit
def one_too_many(t, y):
    return y[0], y[0], y[0]


@njit
def scalar(t, y):
    return y[0]


@pytest.mark.parametrize(
    "fun", [one_too_many, one_too_many.py_func, scalar, scalar.py_func, lambda t, y: [[1.0, 2.0]]]
)
def test_a_right_hand_side_of_the_wrong_shape_is_refused(fun):
    with pytest.raises(ValueError, match=r"fun returned shape .*state has 2 components"):
        integrate(fun, (0, 1), [1.0, 0.0], tableaux.RK6, 0.1)


def test_a_compiled_tuple_too_long_to_unroll_is_refused():
    @njit
    def fun(t, y):
        return (y[0], y[1], y[2], y[3], y[4], y[5], y[6], y[7], y[8], y[9], y[10], y[11], y[12],
                y[13], y[14], y[15], y[16])  # fmt: skip

    with pytest.raises(ValueError, match=r"returns a tuple.*16 components"):
        integrate(fun, (0, 1), np.ones(17), tableaux.RK6, 0.1)


# --- blow-up ------------------------------------------------------------------------------------


@njit
def square(t, y):
    return (y[0], y[1] * y[1])


@every_form
@pytest.mark.parametrize("fun", [square, square.py_func], ids=["compiled", "plain"])
def test_a_blow_up_names_method_form_step_component_and_time(fun, form):
    """ẏ = y² from 1 leaves every bound at t = 1."""
    with pytest.raises(IntegrationError) as error:
        integrate(fun, (0, 3), [1.0, 1.0], tableaux.DP5, 0.01, form)
    message = str(error.value)
    for part in ("DP5", form, "step size 0.01", "component 1", "blew up"):
        assert part in message
    time = float(message.split("t = ")[1].split(",")[0])
    assert 1.0 <= time < 1.1


@pytest.mark.parametrize("form", runge_kutta.FORMS)
def test_a_state_that_is_lost_for_one_step_only_stays_lost(form):
    """The last state tells, so that a run that ends well need not be searched."""

    def wild(t, y):
        return [np.nan if 0.5 < t < 0.6 else 0.0]

    with pytest.raises(IntegrationError, match=r"blew up at t = 0\.54, step 18"):
        integrate(wild, (0, 1), [1.0], tableaux.EULER, 0.03, form)


def test_a_shifted_state_that_rounds_to_zero_on_its_way_is_lost():
    """It may come back, so here the last state does not tell."""
    shift, t, y = np.array([1.0]), np.array([0.0, 0.1, 0.2]), np.array([[1.0, -1.0, 2.0]])
    start, settings = (0.0, 0.2, y[:, 0]), (shift, (), "step size 0.1")
    problem = runge_kutta.Problem(hairer, *start, tableaux.RK6, "exponential", *settings)
    with pytest.raises(IntegrationError, match=r"reached zero, .* at t = 0\.1, step 1"):
        runge_kutta.raise_if_lost(problem, t, y)


def test_the_states_of_a_run_that_ends_well_are_not_all_read(monkeypatch):
    read = []
    monkeypatch.setattr(runge_kutta.np, "isfinite", lambda y, f=np.isfinite: read.append(y) or f(y))
    for form in ("additive", "exponential"):
        integrate(hairer, (0, 1), [1.0, 1.5], tableaux.EULER, 1e-3, form)
    assert sum(map(np.size, read)) < 100


def test_a_blow_up_gives_no_warning_beside_its_error(recwarn):
    with pytest.raises(IntegrationError):
        integrate(square.py_func, (0, 3), [1.0, 1.0], tableaux.DP5, 0.01)
    assert not recwarn


def test_a_blow_up_of_an_adaptive_run_counts_all_its_steps():
    """ẏ = y overflows after ln(1.8e308) = 709.78."""
    with pytest.raises(IntegrationError) as error:
        integrate(lambda t, y: y, (0, 800), [1.0], tableaux.DP5)
    _, where = str(error.value).split("t = ")
    time, step = where.split(", step ")
    assert 709 < float(time) < 710
    assert int(step) > 256


@pytest.mark.parametrize("step", [0.125, None], ids=["fixed", "adaptive"])
@pytest.mark.parametrize("since", [0.0, 1.0])
def test_a_right_hand_side_that_is_not_finite_gives_the_time(step, since):
    for value in (np.nan, np.inf):

        def fun(t, y, value=value):
            return [value if t >= since else 1.0]

        with pytest.raises(IntegrationError) as error:
            integrate(fun, (0, 2), [1.0], tableaux.DP5, step)
        time = float(str(error.value).split("t = ")[1].split(",")[0])
        assert since - 1e-9 <= time <= since + (step or 0)


def test_a_trial_step_out_of_the_domain_makes_the_first_step_smaller():
    """The right-hand side overflows where the first step is tried, and later it does not."""
    calls = []

    def fun(t, y):
        calls.append(t)
        return [np.inf if len(calls) == 2 else 1.0]

    assert integrate(fun, (0, 2), [1.0], tableaux.DP5).y[0, -1] == pytest.approx(3)


def test_a_solution_that_reaches_zero_in_the_exponential_form_is_an_error():
    with pytest.raises(IntegrationError, match=r"Euler, exponential .*component 0 .*t = 1, step 1"):
        integrate(lambda t, y: -1e6 * y, (0, 1), [1.0], tableaux.EULER, 1.0, "exponential")


# --- between the steps --------------------------------------------------------------------------


def test_only_adaptive_runs_have_states_between_their_steps():
    pair = Tableau("pair", [[0, 0], [1, 0]], ["1/2", "1/2"], b_embedded=[1, 0])  # no interpolant
    for found in (
        integrate(oscillator, (0, 1), [1.0, 0.0], tableaux.DP5, 0.1),
        integrate(oscillator, (0, 1), [1.0, 0.0], pair),
    ):
        with pytest.raises(ValueError, match=r"t = 0.5: only adaptive runs with an interpolant"):
            found(0.5)


def test_a_run_of_no_length_has_its_state():
    found = integrate(oscillator, (1.0, 1.0), [1.0, 2.0], tableaux.DP5)
    assert found(1.0).tolist() == [1.0, 2.0]
    assert found([1.0, 1.0]).tolist() == [[1.0, 1.0], [2.0, 2.0]]


@pytest.mark.parametrize(
    ("t", "message"),
    [
        (np.zeros((2, 2)), r"t has shape \(2, 2\); a number or one row"),
        ("0.5", "t = '0.5': real numbers are needed"),
        ([0.1, 1j], "real numbers are needed"),
        ([0.5, 1.5], "t = 1.5 is outside the run; allowed is 0.0 to 1.0"),
    ],
)
def test_wrong_times_are_refused(t, message):
    with pytest.raises(ValueError, match=message):
        integrate(oscillator, (0, 1), [1.0, 0.0], tableaux.DP5)(t)


def test_a_state_between_steps_that_is_not_finite_gives_the_time():
    """The coefficients of the interpolant overflow, the steps do not."""
    found = integrate(lambda t, y: [-8e307], (0, 1), [1.7e308], tableaux.DP5)
    assert found.y[0, -1] == pytest.approx(0.9e308)
    with pytest.raises(IntegrationError, match=r"not finite at t = 0.5$"):
        found(0.5)


def test_a_tableau_by_name_is_an_error():
    with pytest.raises(TypeError, match="tableau = 'RK6': a Tableau is needed"):
        integrate(lambda t, y: -y, (0, 1), [1.0], "RK6", 0.1)
