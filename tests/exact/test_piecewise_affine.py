"""Systems whose answers are known in closed form, and the ways in which a run can fail."""

import itertools
import math
import re
from fractions import Fraction
from typing import NamedTuple

import flint
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numba import njit
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

from armsim.exact import crossing, modal
from armsim.exact.piecewise_affine import System
from armsim.methods import IntegrationError


class Table(NamedTuple):
    """A system given by tables: of what each mode is, and what follows each guard on each side."""

    A: np.ndarray  # (modes, n, n)
    b: np.ndarray  # (modes, n); inputs are added to it
    normal: np.ndarray  # (modes, guards, n)
    lower: np.ndarray  # (modes, guards)
    upper: np.ndarray  # (modes, guards)
    following: np.ndarray  # (modes, guards, 2) mode after leaving below, above
    reset: np.ndarray  # (n, n) the state is multiplied by this at every event


@njit
def from_table(mode, u, table, out):
    out.A[:] = table.A[mode]
    out.b[:] = table.b[mode] + u
    out.normal[:] = table.normal[mode]
    out.lower[:] = table.lower[mode]
    out.upper[:] = table.upper[mode]


@njit
def by_table(mode, guard, side, z, table):
    z[:] = table.reset @ z
    return table.following[mode, guard, (side + 1) // 2]


SYSTEM = System(from_table, by_table, guards=2, matrices=4)


def table(modes, following=None, reset=None):
    """Build a `Table` from (A, b, {guard: (normal, lower, upper)}) for each mode."""
    n = len(modes[0][0])
    normal = np.zeros((len(modes), 2, n))
    lower, upper = np.full((len(modes), 2), -np.inf), np.full((len(modes), 2), np.inf)
    for m, (_, _, guards) in enumerate(modes):
        for g, (row, low, high) in guards.items():
            normal[m, g], lower[m, g], upper[m, g] = row, low, high
    after = np.zeros((len(modes), 2, 2), int)
    for (m, g), pair in (following or {}).items():
        after[m, g] = pair
    return Table(
        np.array([A for A, _, _ in modes], float),
        np.array([b for _, b, _ in modes], float),
        normal,
        lower,
        upper,
        after,
        np.eye(n) if reset is None else np.array(reset, float),
    )


def solve(modes, z0, t_end, following=None, reset=None, inputs=None, mode=0, **more):
    n = len(z0)
    rows = [(t, np.zeros(n) + u) for t, u in (inputs or [(0.0, 0.0)])]
    constants = table(modes, following, reset)
    return SYSTEM.solve(z0, mode, (0.0, t_end), rows, constants, **more)


# --- one mode, no guard: a linear system ----------------------------------------------------------


def linear(A, z0, t_end, inputs=None):
    return solve([(A, np.zeros(len(A)), {})], z0, t_end, inputs=inputs)


CIRCLE = [[0.0, 1.0], [-1.0, 0.0]]


def exact(A, b, z, t):
    n = len(b)
    augmented = np.zeros((n + 1, n + 1))
    augmented[:n, :n], augmented[:n, n] = A, b
    return (expm(augmented * t) @ np.append(z, 1.0))[:n]


MATRICES = {
    "diagonal, stiff": [[-1.0, 0.0], [0.0, -1e6]],
    "oscillator": [[0.0, 1.0], [-100.0, -0.1]],
    "critically damped": [[0.0, 1.0], [-4.0, -4.0]],
    "nearly defective": [[0.0, 1.0], [-4.0, -4.0 - 1e-13]],
    "double pole, decoupled": [[-3.0, 0.0], [0.0, -3.0]],
    "integrator": [[0.0, 1.0], [0.0, -2.0]],
    "double integrator": [[0.0, 1.0], [0.0, 0.0]],
    "triple integrator": [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]],
    "nothing moves": [[0.0, 0.0], [0.0, 0.0]],
    "unstable": [[0.0, 1.0], [3.0, 0.5]],
    "slow beside fast": [[-1e-9, 1.0, 0.0], [0.0, -1e4, 1e4], [0.0, 0.0, -2.0]],
    "mixed units": [[-5.0, 1e7, 0.0], [-1e-5, -3.0, 1e-9], [0.0, 1e9, -1.0]],
}


@pytest.mark.parametrize("name", MATRICES)
def test_a_linear_system_follows_its_matrix_exponential(name):
    A = np.array(MATRICES[name])
    z0, b = np.linspace(1.0, -0.5, len(A)), 0.3
    run = linear(A, z0, 2.0, [(0.0, b)])
    for t in (1e-9, 1e-4, 0.1, 0.7, 2.0):
        expected = exact(A, np.full(len(A), b), z0, t)
        # scipy's own error grows with ‖A t‖
        assert run(t) == pytest.approx(expected, rel=2e-12, abs=2e-11 * np.abs(expected).max())
    assert run.events == ()
    assert run.nfev == 0


def test_a_step_so_short_that_the_state_hardly_moves_is_exact_as_well():
    run = linear(CIRCLE, [1.0, 0.0], 1.0)
    assert run(1e-9)[1] == pytest.approx(-1e-9, rel=1e-15)


def to_30_digits(A, b, z, t):
    """The same as `exact` in ball arithmetic: matrices of these sizes, and only proven digits."""
    rows = np.column_stack((A, b)).tolist()
    with flint.ctx.workprec(400):
        augmented = flint.arb_mat([*rows, (len(b) + 1) * [0.0]]) * flint.arb(t)
        state = augmented.exp() * flint.arb_mat([[float(x)] for x in (*z, 1.0)])
        assert all(float(x.rad()) < 1e-25 for x in state.entries())
        return np.array([float(x) for x in state.entries()[:-1]])


def error(A, z0, b, times):
    """Largest error at these times, relative to each state's largest value; and the run."""
    A, z0, b = np.array(A, float), np.array(z0, float), np.zeros(len(A)) + b
    run = linear(A, z0, times[-1], [(0.0, b)])
    wanted = np.array([to_30_digits(A, b, z0, t) for t in times])
    largest = np.abs([z0, *wanted]).max(axis=0)
    got = run(np.array(times)).T
    return (np.abs(got - wanted) / np.where(largest > 0, largest, 1.0)).max(), run


def test_differences_are_summed_in_twice_the_working_precision():
    """Of A V - V Λ, hardly a digit is left in ordinary sums; the exact values are fractions."""
    rng = np.random.default_rng(3)
    A = rng.normal(size=(5, 5)) + 0j
    rates, V = np.linalg.eig(A)
    found = modal._difference(A, V, V, rates)
    for i, j in np.ndindex(5, 5):
        terms = [(A[i, k], V[k, j]) for k in range(5)] + [(-V[i, j], rates[j])]
        real = sum(Fraction(p.real) * Fraction(q.real) for p, q in terms)
        real -= sum(Fraction(p.imag) * Fraction(q.imag) for p, q in terms)
        imag = sum(Fraction(p.real) * Fraction(q.imag) for p, q in terms)
        imag += sum(Fraction(p.imag) * Fraction(q.real) for p, q in terms)
        assert (found[i, j].real, found[i, j].imag) == pytest.approx((real, imag), rel=1e-14)
        assert abs(found[i, j]) < 1e-14


def lags(n, gain):
    """A chain of n equal lags, closed with a gain."""
    A = np.diag(np.full(n, -2.0)) + np.diag(np.full(n - 1, 2.0), -1)
    A[0, -1] -= gain
    return A


TINY = [1e-4, 1e-8, 1e-16, 1e-20, 1e-30, 1e-100, 1e-300]
NEAR_DOUBLE = {
    "damping": [[[0, 1], [-4, -4 - d]] for d in (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 0)],
    "feedback of two": [[[-1, 1], [x, -1]] for x in TINY],
    "feedback of three": [[[-1, 1, 0], [0, -1, 1], [x, 0, -1]] for x in TINY],
    "lags": [
        lags(n, gain)
        for n in range(2, 7)
        for gain in (0, 1e-16, 1e-12, 1e-8, 1e-4, 1e-2, 0.3, 3, -1e-8, -1e-3, -1)
    ],
}


@pytest.mark.parametrize("name", NEAR_DOUBLE)
def test_eigenvalues_that_nearly_meet_cost_no_digits(name):
    """Also from a start with a single state: what it drives is then the difference of modes."""
    for A in NEAR_DOUBLE[name]:
        for z0 in (np.linspace(1.0, -0.5, len(A)), np.eye(len(A))[-1]):
            worst, run = error(A, z0, 0.3, (0.05, 0.5, 1.0, 2.0))
            assert worst <= min(1e-12, run.loss)


@pytest.mark.parametrize("gap", [1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 0.0])
def test_random_matrices_with_a_small_gap_cost_no_digits(gap):
    """Two eigenvalues differ by the gap; half of the matrices are a Jordan block for none."""
    rng = np.random.default_rng(7)
    for n in range(2, 7):
        for coupled in (0.0, 1.0):
            form = np.diag(-rng.uniform(0.1, 5.0, n))
            form[1, 1], form[0, 1] = form[0, 0] + gap, coupled
            change = rng.normal(size=(n, n))
            A = change @ form @ np.linalg.inv(change)
            worst, run = error(A, rng.normal(size=n), 0.0, (0.2, 0.8, 1.5))
            assert worst <= min(1e-12, run.loss)


@pytest.mark.parametrize("L", [1e-3, 1e-6, 1e-9, 1e-12, 1e-15])
def test_stiffness_costs_no_digits(L):
    """A motor whose armature is up to 10¹⁵ times as fast as its shaft."""
    A = [[-1 / L, -0.5 / L, 0], [25, -5, -3], [0, 1, 0]]
    worst, run = error(A, np.zeros(3), np.array([10 / L, 0, 0]), (1e-3, 0.05, 0.2, 1.0))
    assert worst <= 1e-14
    assert len(run.room.start) == 1


def test_what_cannot_be_solved_to_nine_digits_is_an_error():
    """A double pole beside one 10¹⁵ times as fast: by modes too inexact, by its series too long."""
    A = [[-1, 1, 0], [0, -1, 0], [0, 1e15, -1e15]]
    with pytest.raises(IntegrationError, match=r"t = 0: .* more than 1e-09 of the solution"):
        linear(A, [1.0, 1.0, 1.0], 1.0)


@given(
    st.lists(st.integers(-300, 300), min_size=9, max_size=9),
    st.lists(st.integers(-10, 10), min_size=3, max_size=3),
    st.sampled_from([0.0, 1.0, -2.5]),
)
@example([0, 0, 174, 0, 37, 300, 149, 300, 300], [0, 0, 4], 0.0)
def test_any_matrix_follows_its_exponential(entries, z0, b):
    A = np.array(entries).reshape(3, 3) / 100
    worst, run = error(A, z0, b, (0.2, 1.5))
    growth = max(np.linalg.norm(expm(A * t), 2) for t in np.linspace(0, 1.5, 9))
    # What rounding of A alone would do.
    assert worst <= run.loss + 1e-15 * growth * (1 + np.linalg.norm(A, 2))


def test_held_inputs_change_at_their_times():
    A, levels = np.array([[-3.0]]), [1.0, -2.0, 0.5, 0.0]
    schedule = [(0.1 * n, level) for n, level in enumerate(levels)]
    run = linear(A, [0.2], 0.4, schedule)
    y = 0.2
    for n, level in enumerate(levels):
        assert run(0.1 * n)[0] == pytest.approx(y, rel=1e-14)
        y = level / 3 + (y - level / 3) * math.exp(-0.3)
    assert run(0.4)[0] == pytest.approx(y, rel=1e-14)
    assert set(np.array([0.0, 0.1, 0.2, 0.1 * 3])) <= set(run.t)


# --- guards: no event is missed, none is made up --------------------------------------------------


def guarded(A, z0, t_end, limit, inputs=None, normal=None):
    """The first component has an upper limit; beyond is a mode like this one without it."""
    zero, first = np.zeros(len(A)), np.eye(len(A))[0] if normal is None else normal
    modes = [(A, zero, {0: (first, -np.inf, limit)}), (A, zero, {})]
    return solve(modes, z0, t_end, {(0, 0): (1, 1)}, inputs=inputs)


def circle_events(limit, z0=(0.0, 1.0), t_end=6.0):
    return guarded(CIRCLE, z0, t_end, limit).events


@pytest.mark.parametrize("depth", [0.5, 1e-3, 1e-6, 1e-9, 1e-12])
def test_a_limit_just_below_the_top_is_found(depth):
    (event,) = circle_events(1 - depth)
    assert event.time == pytest.approx(math.asin(1 - depth), abs=1e-15 / math.sqrt(2 * depth))
    assert event.causes == ((0, 1),)
    assert (event.before, event.after) == (0, 1)


@pytest.mark.parametrize("depth", [1e-3, 1e-9, 1e-12])
def test_a_limit_just_above_the_top_is_not_reached(depth):
    assert circle_events(1 + depth, t_end=100.0) == ()


def test_a_start_at_the_limit_leaves_or_turns_inwards_as_its_derivatives_say():
    assert circle_events(1.0, (1.0, 0.0)) == ()  # value 0, slope 0, curvature inwards
    assert circle_events(0.0, (0.0, -1.0), 3.0) == ()  # slope inwards
    assert circle_events(0.0, (0.0, 1.0))[0].time == 0.0  # slope outwards
    assert circle_events(-1.0, (-1.0, 0.0))[0].time == 0.0  # slope 0, curvature outwards
    assert circle_events(0.5, (0.7, 0.7))[0].time == 0.0  # outside


def test_a_start_at_the_limit_whose_third_derivative_decides():
    triple = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    for push, count in ((1.0, 1), (-1.0, 0)):
        run = guarded(triple, np.zeros(3), 1.0, 0.0, [(0.0, np.array([0.0, 0.0, push]))])
        assert len(run.events) == count
        assert run(1.0)[0] == pytest.approx(push / 6, rel=1e-14)


@pytest.mark.parametrize("distance", [5e-324, 3e-319, 1e-310, 1e-300, 1e-200, 1e-160])
def test_a_start_at_no_distance_worth_the_name_goes_on(distance):
    """Numbers whose squares are zero, or that have hardly a digit: what rounding leaves at zero."""
    run = guarded(CIRCLE, (-distance, -1.0), 3.0, 0.0)
    assert run.events == ()
    assert run(1.0)[0] == pytest.approx(-math.sin(1.0), rel=1e-15)
    (event,) = guarded(CIRCLE, (-distance, 1.0), 3.0, 0.0).events
    assert event.time == pytest.approx(0.0, abs=1.01 * distance)


@pytest.mark.parametrize("scale", [5e-324, 1e-310, 1e-200, 1.0, 1e200])
def test_a_state_at_its_limit_is_put_there(scale):
    for normal, limit in ((1.0, 0.0), (-2.0, 0.0), (-2.0, 4 * scale)):
        z = np.array([1.0, 7 * scale, 0.0])
        crossing.put_at_limit(np.array([0.0, normal, 4.0]), limit, z)
        assert z[1] == pytest.approx(limit / normal, rel=4e-16, abs=0)
        assert (z[0], z[2]) == (1.0, 0.0)
    z = np.array([3.0, 1e-3])
    crossing.put_at_limit(np.array([1.0, 1.0]), 3.0, z)
    assert z.sum() == 3.0 and z[1] == pytest.approx(1e-3, rel=1e-6)


def decays(A, z0, b, limit, t_end):
    """The first component falls to a lower limit; beyond is a mode like this one without it."""
    b, first = np.array(b, float), np.eye(len(A))[0]
    return solve([(A, b, {0: (first, limit, np.inf)}), (A, b, {})], z0, t_end, {(0, 0): (1, 1)})


@pytest.mark.parametrize("limit", [1e-3, 1e-9, 1e-12, 1e-15, 1e-20, 1e-100, 1e-280])
def test_a_decaying_signal_reaches_a_small_limit_at_its_time(limit):
    for A, z0 in (([[-1.0]], [1.0]), ([[-1.0, 0.0], [0.0, -2.0]], [1.0, 1.0])):
        run = decays(A, z0, np.zeros(len(A)), limit, 700.0)
        (event,) = run.events
        assert event.time == pytest.approx(-math.log(limit), abs=1e-13)
        assert run(600.0) == pytest.approx(np.exp(600.0 * np.diag(A)), rel=1e-12, abs=0)


def test_a_limit_that_a_signal_only_tends_to_is_not_reached():
    assert decays([[-1.0]], [1.0], [0.0], 0.0, 1e4).events == ()
    assert decays([[-1.0]], [3.0], [2.0], 2.0, 1e4).events == ()


def test_near_an_equilibrium_other_than_zero_the_limit_itself_is_rounded():
    distance = (2 + 1e-9) - 2  # exact
    (event,) = decays([[-1.0]], [3.0], [2.0], 2 + 1e-9, 100.0).events
    assert event.time == pytest.approx(-math.log(distance), abs=2e-15 / distance)


@given(st.integers(0, 2**32 - 1))
@example(389875)
def test_a_system_at_rest_at_its_limit_stays_there(seed):
    """To within rounding, so that no derivative says whether it leaves; and it is not asked for."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(3, 3))
    A -= (np.linalg.eigvals(A).real.max() + 1.0) * np.eye(3)  # stable
    rest, normal = rng.normal(size=3), rng.normal(size=3)
    modes = [(A, -A @ rest, {0: (normal, -np.inf, normal @ rest)})] * 2
    run = solve(modes, rest, 100.0, {(0, 0): (1, 1), (1, 0): (1, 1)}, mode=0, max_events=30)
    assert run.room.label.shape[0] < 50
    assert run(100.0) == pytest.approx(rest, rel=1e-13)


@pytest.mark.parametrize("size", [3e-3, 1e-4, 1e-6])
def test_ripples_on_a_slow_rise_are_not_overlooked(size):
    """z0 = t + size sin(ωt): an endpoint check on any grid coarser than the ripple would fail."""
    omega = 1000.0
    A = np.zeros((3, 3))
    A[0, 1], A[1, 2], A[2, 1] = 1.0, omega, -omega
    limit = 0.5
    start = [0.0, size * omega, 0.0]  # z1 = size ω cos ωt
    run = guarded(A, start, 1.0, limit, [(0.0, np.array([1.0, 0.0, 0.0]))])

    def gap(t):
        return t + size * math.sin(omega * t) - limit

    grid = np.arange(limit - size - 1e-5, limit + size + 1e-5, 1e-6)
    first = next(t for t in grid if gap(t + 1e-6) >= 0)
    assert run.events[0].time == pytest.approx(
        brentq(gap, first, first + 1e-6, xtol=1e-16), abs=1e-13
    )


def test_two_guards_reached_at_one_time_make_one_event():
    zero, one = np.zeros((2, 2)), np.ones(2)
    x, y = (np.eye(2)[0], -np.inf, 1.0), (np.eye(2)[1], -np.inf, 1.0)
    modes = [(zero, one, {0: x, 1: y}), (zero, one, {1: y}), (zero, one, {0: x}), (zero, one, {})]
    following = {(0, 0): (1, 1), (0, 1): (2, 2), (1, 1): (3, 3), (2, 0): (3, 3)}
    run = solve(modes, [0.0, 0.0], 2.0, following)
    (event,) = run.events
    assert event == (pytest.approx(1.0, rel=1e-15), 0, 3, ((0, 1), (1, 1)))
    assert run.modes(np.array([0.5, event.time, 1.5])) == [0, 3, 3]


# --- impacts ------------------------------------------------------------------------------------


def ball(g, e, height, t_end, **more):
    modes = [([[0, 1], [0, 0]], [0, -g], {0: ([1, 0], 0.0, np.inf)})]
    return solve(modes, [height, 0.0], t_end, reset=np.diag([1.0, -e]), **more)


def test_a_bouncing_ball_keeps_its_times():
    g, e, h = 9.81, 0.8, 1.0
    run = ball(g, e, h, 3.0)
    fall = math.sqrt(2 * h / g)
    times = fall + np.cumsum([0.0] + [2 * fall * e**n for n in range(1, 30)])
    times = times[times < 3.0]
    assert [event.time for event in run.events] == pytest.approx(times, rel=1e-14)
    speeds = [run(event.time)[1] for event in run.events]
    assert speeds == pytest.approx([g * fall * e**n for n in range(1, len(times) + 1)], rel=1e-13)


def test_impacts_that_accumulate_end_in_an_error_that_says_when():
    g, e = 9.81, 0.8
    end = math.sqrt(2 / g) * (1 + e) / (1 - e)
    with pytest.raises(IntegrationError, match="events at one time") as stopped:
        ball(g, e, 1.0, 10.0)
    when = float(re.search(r"t = ([\d.]+)", str(stopped.value))[1])
    assert when == pytest.approx(end, abs=1e-9)  # the printed digits
    with pytest.raises(IntegrationError, match="more than 50 events"):
        ball(g, e, 1.0, 10.0, max_events=50)


def test_a_drive_train_with_backlash_and_impacts():
    """Two free masses, play ±H, restitution e: relative speed w, after n impacts (-e)ⁿ w."""
    H, e, m1, m2, w = 1e-3, 0.7, 2.0, 5.0, 0.1
    A = np.zeros((4, 4))
    A[0, 2] = A[1, 3] = 1.0
    modes = [(A, np.zeros(4), {0: ([1, -1, 0, 0], -H, H)})]
    impact = (1 + e) / (m1 + m2) * np.array([[m2, -m2], [-m1, m1]])
    reset = np.eye(4)
    reset[2:, 2:] -= impact
    run = solve(modes, [0.0, 0.0, w, 0.0], 5.0, reset=reset)
    times = H / w + np.cumsum([0.0] + [2 * H / (e**n * w) for n in range(1, 30)])
    times = times[times < 5.0]
    assert [event.time for event in run.events] == pytest.approx(times, rel=1e-13)
    assert [event.causes[0][1] for event in run.events] == [(-1) ** n for n in range(len(times))]
    assert np.array([0, 0, m1, m2]) @ run.y == pytest.approx(np.full(run.t.size, m1 * w), rel=1e-13)


# --- sliding: friction and relays -----------------------------------------------------------------


@pytest.mark.parametrize(("drag", "hold", "speed"), [(1, 1.5, 0.2), (0.5, 3, 1), (0.9, 1, 1e-3)])
def test_a_stick_slip_oscillator_has_its_period(drag, hold, speed):
    """A mass on a belt: x'' = -x + F, where F is `drag` while it slips, and sticks up to `hold`.

    Slipping is an arc of a circle around (drag, 0), sticking a straight line back.
    """
    slips = (CIRCLE, [0, drag], {0: ([0, 1], -np.inf, speed)})
    sticks = (np.zeros((2, 2)), [speed, 0], {0: ([1, 0], -np.inf, hold)})
    excess, cycles = hold - drag, 4
    stick, slip = 2 * excess / speed, 2 * (math.pi - math.atan2(excess, speed))
    t_end = cycles * (stick + slip) + 0.5 * stick
    start = [2 * drag - hold, speed]
    run = solve([slips, sticks], start, t_end, {(0, 0): (1, 1), (1, 0): (0, 0)}, mode=1)
    expected = [n * (stick + slip) + part for n in range(cycles) for part in (stick, stick + slip)]
    assert [event.time for event in run.events] == pytest.approx(expected, rel=1e-13)
    assert [event.after for event in run.events] == [0, 1] * cycles
    bottom = run(run.events[0].time + slip / 2)
    assert bottom == pytest.approx([drag, -math.hypot(excess, speed)], rel=1e-12)


@pytest.mark.parametrize(
    ("frequency", "friction"), [(0.6, 0.5), (0.8, 0.2), (1.3, 0.5), (1.7, 0.2)]
)
def test_a_forced_oscillator_with_dry_friction_has_the_amplitude_of_den_hartog(frequency, friction):
    """x'' + x = cos(ωt) - F sgn x', a steady motion without stops.

    Its amplitude in closed form: J. P. Den Hartog, Forced vibrations with combined Coulomb and
    viscous friction, Trans. ASME 53 (1931) APM-53-9. The force is the third state.
    """
    slides = np.zeros((4, 4))
    slides[0, 1], slides[1, 0], slides[1, 2] = 1.0, -1.0, 1.0
    slides[2, 3], slides[3, 2] = frequency, -frequency
    sticks = slides.copy()
    sticks[:2] = 0.0
    push = [0.0, friction, 0.0, 0.0]
    modes = [
        (slides, push, {0: ([0, 1, 0, 0], -np.inf, 0.0)}),
        (sticks, np.zeros(4), {1: ([-1, 0, 1, 0], -friction, friction)}),
        (slides, np.negative(push), {0: ([0, 1, 0, 0], 0.0, np.inf)}),
    ]
    following = {(0, 0): (1, 1), (1, 1): (0, 2), (2, 0): (1, 1)}
    run = solve(modes, [0, 0, 1.0, 0], 1000 * math.pi / frequency, following, mode=2)
    dynamic = 1 / (1 - frequency**2)
    angle = math.pi / frequency
    lost = friction * math.sin(angle) / (frequency * (1 + math.cos(angle)))
    last = run.events[-1]
    assert last.before + last.after == 2  # it turns round without a rest
    assert abs(run(last.time)[0]) == pytest.approx(math.sqrt(dynamic**2 - lost**2), rel=1e-12)


@njit
def relay(mode, u, constants, out):
    """ẋ = A x + B u, u = -sgn(C x): modes -1 and 1 are the value of C x's sign, 0 is sliding."""
    A, B, C = constants
    out.A[:] = A
    out.b[:] = -mode * B
    out.normal[0] = C
    out.lower[0], out.upper[0] = -np.inf, np.inf
    if mode == 1:
        out.lower[0] = 0.0
    elif mode == -1:
        out.upper[0] = 0.0
    else:  # the equivalent control keeps C x where it is; it has to be between -1 and 1
        strength = C @ B
        out.A[:] -= np.outer(B, C @ A) / strength
        out.normal[0] = C @ A / strength
        out.lower[0], out.upper[0] = -1.0, 1.0


@njit
def relay_successor(mode, guard, side, z, constants):
    A, B, C = constants
    if mode == 0:
        return side
    slope, strength = C @ (A @ z), C @ B
    if abs(slope) < strength:
        return 0
    return -mode


def relay_constants(A, B, C):
    return np.array(A, float), np.array(B, float), np.array(C, float)


RELAY = System(relay, relay_successor, guards=1, matrices=2)


def test_a_first_order_relay_slides_at_zero():
    run = RELAY.solve([2.0], 1, (0.0, 5.0), constants=relay_constants([[-1]], [1], [1]))
    (event,) = run.events
    assert (event.time, event.after) == (pytest.approx(math.log(3), rel=1e-14), 0)
    assert run(np.array([2.0, 5.0])) == pytest.approx(np.zeros((1, 2)), abs=1e-16)


def test_a_relay_slides_and_leaves_where_the_equivalent_control_reaches_its_limit():
    """x₁ = 0 with x₂' = x₂: slides until |x₂| = 1, at t = ln 4 from x₂ = 1/4."""
    A, B, C = [[0, 1], [0, 1]], [1, 0], [1, 0]
    run = RELAY.solve([0.0, 0.25], 1, (0.0, 2.0), constants=relay_constants(A, B, C))
    assert [event.after for event in run.events] == [0, 1]
    assert run.events[0].time == 0.0
    assert run.events[1].time == pytest.approx(math.log(4), rel=1e-13)
    t = 1.7
    assert run(t)[0] == pytest.approx(0.25 * math.exp(t) - 1 - (t - math.log(4)), rel=1e-12)


def test_the_limit_cycle_of_a_third_order_relay_system():
    """Symmetric oscillation of 1/(s + 1)³ under a relay; the harmonic balance of Tsypkin gives it.

    A half period T has to satisfy C (I + e^{AT})⁻¹ ∫₀ᵀ e^{As} B ds = 0.
    """
    A, B, C = relay_constants([[-1, 1, 0], [0, -1, 1], [0, 0, -1]], [0, 0, 1], [1, 0, 0])

    def residual(T):
        whole = expm(A * T)
        return C @ np.linalg.solve(np.eye(3) + whole, np.linalg.solve(A, (whole - np.eye(3)) @ B))

    half = brentq(residual, 1.0, 6.0, xtol=1e-15)
    run = RELAY.solve([0.1, 0.0, 0.0], 1, (0.0, 100.0), constants=(A, B, C))
    gaps = np.diff([event.time for event in run.events])
    assert gaps[-1] == pytest.approx(half, rel=1e-12)


def test_the_relay_of_piiroinen_and_kuznetsov_slides_many_times_in_a_period():
    """Their eq. (32), doi 10.1145/1356052.1356054, against DOP853 from switch to switch."""
    zeta, omega, sigma = 0.05, 25.0, 1.0
    A = [[-2 * zeta * omega - 1, 1, 0], [-2 * zeta * omega - omega**2, 0, 1], [-(omega**2), 0, 0]]
    A, B, C = relay_constants(A, [1, -2 * sigma, 1], [1, 0, 0])
    run = RELAY.solve([0.05, -0.01, 0.1], 1, (0.0, 100.0), constants=(A, B, C))
    slides, off = A - np.outer(B, C @ A) / (C @ B), 1e-4  # s, off the surface just left
    for here, there in itertools.pairwise(run.events[-40:]):
        matrix, push = (slides, 0 * B) if here.after == 0 else (A, -here.after * B)

        def ends(t, z, sliding=here.after == 0):  # the equivalent control is C A z, for C B = 1
            return abs(C @ A @ z) - 1 if sliding else C @ z

        ends.terminal = True
        arc = solve_ivp(
            lambda t, z, matrix=matrix, push=push: matrix @ z + push,
            (off, 10.0),
            exact(matrix, push, run(here.time), off),
            "DOP853",
            events=ends,
            rtol=1e-13,
            atol=1e-15,
        )
        assert arc.t_events[0][0] == pytest.approx(there.time - here.time, abs=1e-11)
        assert arc.y_events[0][0] == pytest.approx(run(there.time), abs=1e-11)


# --- failures -----------------------------------------------------------------------------------


def test_modes_that_chase_each_other_are_an_error():
    """The relay above without its sliding mode."""
    modes = [([[-1]], [1], {0: ([1], -np.inf, 0)}), ([[-1]], [-1], {0: ([1], 0, np.inf)})]
    with pytest.raises(IntegrationError, match=r"t = 1\.0986.*at one time.*guard 0 .* 0 to 1"):
        solve(modes, [2.0], 5.0, {(0, 0): (1, 1), (1, 0): (0, 0)}, mode=1)


def test_a_search_without_end_is_an_error(monkeypatch):
    """Four fast oscillators that hardly ever are at the top together."""
    monkeypatch.setattr(crossing, "MAX_SEARCH", 10_000)
    A = np.zeros((8, 8))
    for i, factor in enumerate((1.0, math.sqrt(2), math.e, math.pi)):
        A[2 * i, 2 * i + 1], A[2 * i + 1, 2 * i] = 1e9 * factor, -1e9 * factor
    with pytest.raises(IntegrationError, match=r"t = 0: no next event found in 10000 steps"):
        guarded(A, 4 * [0.0, 1.0], 10.0, 4 - 1e-6, None, 4 * [1.0, 0.0])


def test_a_solution_that_leaves_all_numbers_is_an_error_that_says_when():
    for rate, end in ((1.0, 710.0), (1.0, 1e4), (100.0, 10.0)):
        when = f"{math.log(np.finfo(float).max) / rate:.12g}"
        with pytest.raises(IntegrationError, match=f"t = {when}: the solution is not finite"):
            linear([[rate]], [1.0], end)
    with pytest.raises(IntegrationError, match="t = 0: the solution is not finite"):
        linear([[1e200]], [1e200], 1.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"t_span": (1.0, 0.0)}, "t_span"),
        ({"t_span": (0.0, math.inf)}, "t_span"),
        ({"z0": [math.nan]}, "z0"),
        ({"z0": [[1.0]]}, "z0"),
        ({"inputs": [(0.5, 1.0)]}, "times of inputs"),
        ({"inputs": [(0.0, 1.0), (0.0, 2.0)]}, "times of inputs"),
    ],
)
def test_arguments_are_checked(changes, message):
    constants = table([([[-1.0]], [0.0], {})])
    arguments = {"z0": [1.0], "mode": 0, "t_span": (0.0, 1.0), "constants": constants} | changes
    with pytest.raises(ValueError, match=message):
        SYSTEM.solve(**arguments)


def test_times_outside_the_run_are_refused():
    run = linear([[-1.0]], [1.0], 1.0)
    for t in (-0.1, 1.1, math.nan):
        with pytest.raises(ValueError, match="outside the run"):
            run(t)


def test_more_matrices_than_announced_are_an_error():
    modes = [(np.array([[-1.0 - m]]), [1.0], {0: ([1], -np.inf, 0.1 * m)}) for m in range(4)]
    following = {(m, 0): (m + 1, m + 1) for m in range(3)}
    small = System(from_table, by_table, guards=2, matrices=2)
    with pytest.raises(IntegrationError, match="more than 2 different matrices"):
        small.solve([0.0], 0, (0.0, 5.0), [(0.0, np.zeros(1))], table(modes, following))
