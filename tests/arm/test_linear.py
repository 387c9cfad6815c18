"""Linear models against SciPy and against runs; the reduced one as a limit of the seven states."""

import numpy as np
import pytest
from scipy import signal
from scipy.linalg import eigh, expm

from armsim.arm import AxisParameters, LinearAxis, simulate
from armsim.arm.dynamics import Region, affine, constants, region, rhs
from armsim.arm.linear import (
    ENGAGED,
    UNLIMITED,
    arm_mode,
    eigenvalues,
    fastest_decay,
    gear_oscillation,
    growth_rate,
    nearly_linear,
    oscillation,
    steady_motion,
    unstable_below,
)
from armsim.arm.response import loop_ringing
from armsim.methods import tableaux

P = AxisParameters.paper_x_axis()
#: Loops with real poles only, with a fast pair and with a slow pair.
T_PS = [0.0071, 0.04, 0.3, 4.74]


def state_space(p):
    """Eq. (10) with y6 = K_i v_c and eq. (16), for position, velocity, y4 and y5 of the arm."""
    J, B = p.J_m + p.r_g**2 * p.M, p.B_m + p.r_g**2 * p.B_a
    push = p.r_g * p.K_b * p.K_i / J
    T2 = p.T_p * p.T_r
    A = [
        [0, 1, 0, 0],
        [0, -B / J, push, push * p.T_z],
        [0, 0, 0, 1],
        [0, -p.K_2 * p.K_t / (p.r_g * T2), -1 / T2, -(p.T_p + p.T_r) / T2],
    ]
    C = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, p.K_i, p.K_i * p.T_z]]  # position, velocity, current
    return np.array(A), np.array([[0], [0], [0], [p.K_1 / T2]]), np.array(C), np.zeros((3, 1))


def step_by_expm(p, volts, t):
    """Exact response at each time, from the exponential of the matrix that holds A and B U."""
    A, B, C, _ = state_space(p)
    bordered = np.zeros((5, 5))
    bordered[:4, :4], bordered[:4, 4:] = A, B * volts
    return np.array([C @ expm(bordered * s)[:4, 4] for s in t]).T


def test_inertia_and_friction_are_those_of_equation_16():
    axis = LinearAxis(P)
    inertia, friction = axis.J, axis.B
    assert inertia == pytest.approx(0.000847 + 0.00573**2 * 146, rel=1e-15)
    assert friction == pytest.approx(0.000733 + 0.00573**2 * 211, rel=1e-15)


@pytest.mark.parametrize("T_p", T_PS)
def test_transfer_function_is_that_of_the_state_space(T_p):
    p = P.replace(T_p=T_p)
    numerator, denominator = LinearAxis(p).transfer_function
    s = 1j * np.geomspace(1e-1, 1e5, 25)
    A, B, C, _ = state_space(p)
    response = [(C[1] @ np.linalg.solve(x * np.eye(4) - A, B)).item() for x in s]
    assert np.polyval(numerator, s) / np.polyval(denominator, s) == pytest.approx(
        response, rel=1e-10
    )


def test_transfer_function_agrees_with_ss2tf():
    numerator, denominator = LinearAxis(P).transfer_function
    theirs, common = signal.ss2tf(*state_space(P))
    # theirs has a fourth pole and a zero at 0, from the position
    assert common[:4] == pytest.approx(denominator / denominator[0], rel=1e-9)
    assert theirs[1, -3:-1] == pytest.approx(numerator / denominator[0], rel=1e-6)
    assert abs(common[4] / common[3]) < 1e-9


def test_state_space_agrees_with_the_transfer_function_by_scipy_step():
    axis = LinearAxis(P)
    A, B = axis.state_space()
    to_velocity = np.array([[0, P.r_g, 0, 0]])
    t = np.linspace(0, 0.1, 201)
    _, ours = signal.step((A, B[:, None], to_velocity, [[0]]), T=t)
    _, theirs = signal.step(signal.TransferFunction(*axis.transfer_function), T=t)
    assert ours == pytest.approx(theirs, abs=1e-9)
    assert ours * 10 == pytest.approx(axis.step_response(10.0).velocity(t), abs=1e-9)


@pytest.mark.parametrize("T_p", T_PS)
@pytest.mark.parametrize("volts", [10.0, -3.0])
def test_step_response_is_the_matrix_exponential(T_p, volts):
    p = P.replace(T_p=T_p)
    t = np.array([0.0, 1e-5, 1e-4, 1e-3, 0.01, 0.03, 0.1, 0.3])
    position, velocity, current = step_by_expm(p, volts, t)
    ours = LinearAxis(p).step_response(volts)
    # 1e-10 of the largest: the poles are known to about 1e-13, times t |pole| up to 2000
    for found, exact in (
        (ours.position(t), position), (ours.velocity(t), velocity), (ours.current(t), current)
    ):  # fmt: skip
        assert found == pytest.approx(exact, rel=1e-9, abs=1e-10 * np.abs(exact).max())


def test_step_response_agrees_with_lsim():
    t = np.linspace(0, 0.2, 401)
    _, outputs, _ = signal.lsim(state_space(P), np.full(t.size, 10.0), t)
    ours = LinearAxis(P).step_response(10.0)
    expected = np.array([ours.position(t), ours.velocity(t), ours.current(t)])
    for found, exact in zip(outputs.T, expected, strict=True):
        assert found == pytest.approx(exact, abs=1e-9 * np.abs(exact).max())


def test_starts_at_rest_and_ends_at_the_final_value():
    response = LinearAxis(P).step_response()
    for start in (response.position(0.0), response.velocity(0.0), response.current(0.0)):
        assert start == pytest.approx(0.0, abs=1e-9)  # a sum of residues up to 4000 A
    A, B, C, _ = state_space(P)
    rest = -np.linalg.solve(A[1:, 1:], B[1:, 0] * 10.0)
    assert response.final == pytest.approx(rest[0], rel=1e-12)
    assert response.velocity(1.0) == pytest.approx(rest[0], rel=1e-12)
    assert response.current(1.0) == pytest.approx(C[2, 1:] @ rest, rel=1e-9)
    # K_1 is set for finite K_e, which takes 53 V / 100 of the preamplifier's 10 143 V
    assert response.final == pytest.approx(1.0, abs=1e-4)


def test_responses_take_a_time_or_an_array_of_any_shape():
    response = LinearAxis(P).step_response()
    t = np.array([[0.001, 0.01], [0.02, 0.03]])
    for read in (response.position, response.velocity, response.current):
        assert read(t).shape == (2, 2)
        assert read(t)[1, 0] == read(0.02)
        assert np.shape(read(0.02)) == ()


@pytest.mark.parametrize("T_p", T_PS)
def test_poles_are_the_eigenvalues(T_p):
    p = P.replace(T_p=T_p)
    poles = LinearAxis(p).step_response().poles
    eigenvalues = np.linalg.eigvals(state_space(p)[0])
    eigenvalues = eigenvalues[np.abs(eigenvalues) > 1e-6]  # without the position's 0
    assert np.sort_complex(poles) == pytest.approx(np.sort_complex(eigenvalues), rel=1e-9)


@pytest.mark.parametrize("T_p", T_PS)
@pytest.mark.parametrize("volts", [10.0, -10.0])
def test_settling_time_and_peak_current_by_brute_force(T_p, volts):
    response = LinearAxis(P.replace(T_p=T_p)).step_response(volts)
    t = np.linspace(0, 1.0, 200_001)
    for criterion in (0.02, 0.2):
        outside = np.abs(response.velocity(t) - response.final) > criterion * abs(response.final)
        assert response.settling_time(criterion) == pytest.approx(
            t[outside].max(), abs=5.0001e-6
        )  # the grid
    # Between points the curve rises by (1e-7 s · 7000/s)² / 8 of the peak, later by less.
    fine = np.append(np.linspace(0, 0.02, 200_001), np.linspace(0.02, 0.2, 180_001))
    peak = np.abs(response.current(fine)).max()
    assert response.peak_current() == pytest.approx(peak, rel=1e-7)
    assert response.peak_current() >= peak * (1 - 1e-12)


@pytest.mark.parametrize("T_p", T_PS)
def test_arrival_by_the_matrix_exponential(T_p):
    p = P.replace(T_p=T_p)
    response = LinearAxis(p).step_response()
    t = np.union1d(np.linspace(0, 0.02, 2001), np.linspace(0, 0.2, 1001))
    velocity = step_by_expm(p, 10.0, t)[1]
    for criterion in (0.02, 0.2):
        inside = int(np.argmax(velocity >= (1 - criterion) * response.final))
        assert t[inside - 1] <= response.arrival_time(criterion) <= t[inside]


@pytest.mark.parametrize("T_p", [0.04, 0.3])
def test_simulation_without_nonlinear_factors_agrees(T_p):
    """The paper's Figure 3 from the seven state equations: tight stiff gear, limits far away."""
    p = P.replace(T_p=T_p, H=0, F_0=0, V_L=1e9, V_M=1e9, K_e=1e4, K_g=1e12, K_1=P.K_1)
    run = simulate(p, 10.0, 0.05, method=tableaux.RK4_GILL, step_size=1e-6)
    exact = LinearAxis(p).step_response(10.0)
    # K_e delays the current by L_a K_i / K_e = 0.7 µs, during which its peak rises by 1 %
    assert run.y[0] == pytest.approx(exact.position(run.t), abs=1e-6)
    assert run.y[1] == pytest.approx(exact.velocity(run.t), abs=2e-3)
    assert run.y[6] == pytest.approx(exact.current(run.t), abs=0.01 * exact.peak_current())


# --- the seven-state model tends to the linear one ----------------------------------------------


def distance(p):
    """Largest relative difference of the two models' motion and current up to 300 rad/s.

    With limits far away, no backlash and no static friction, the seven-state model stays in one
    region, whose matrices give its frequency response; no stiff integration is needed.
    """
    A, B, _ = affine(p, Region(0, 0, 1, 0))
    A4, B4, C4, _ = state_space(p)
    worst = 0.0
    for s in 1j * np.geomspace(1.0, 300.0, 13):
        full = np.linalg.solve(s * np.eye(7) - A, B)
        reduced = (C4 @ np.linalg.solve(s * np.eye(4) - A4, B4))[:, 0]
        worst = max(worst, *np.abs(full[[0, 1, 6]] / reduced - 1))
    return worst


@pytest.mark.parametrize(
    ("gain", "other", "factors"), [("K_e", "K_g", (1, 10, 100)), ("K_g", "K_e", (100, 1e3, 1e4))]
)
def test_the_error_of_the_linear_model_falls_as_one_over_each_gain(gain, other, factors):
    stiff = P.replace(H=0, F_0=0, K_1=P.K_1, **{other: 1e6 * getattr(P, other)})
    errors = [distance(stiff.replace(**{gain: f * getattr(P, gain)})) for f in factors]
    # 10 %: the next power of 1 / gain, and what the other gain leaves, are up to 5 % of the first
    assert errors[0] / errors[1] == pytest.approx(10, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(10, rel=0.1)
    assert errors[2] < 5e-4


def test_a_nearly_linear_axis_tends_to_the_linear_one():
    axes = [nearly_linear(P, gain) for gain in (1e3, 1e4, 1e5)]
    errors = [distance(p) for p in axes]
    assert errors[0] / errors[1] == pytest.approx(10, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(10, rel=0.1)
    for p, gain in zip(axes, (1e3, 1e4, 1e5), strict=True):
        assert p.K_e == gain
        assert {name: getattr(p, name) for name in UNLIMITED} == UNLIMITED
        assert p.K_1 == P.replace(K_e=gain).K_1  # the rule, which no limit enters


def test_in_the_limit_the_step_responses_agree():
    p = P.replace(H=0, F_0=0, K_1=P.K_1, K_e=1e7, K_g=1e12)
    A, B, _ = affine(p, Region(0, 0, 1, 0))
    bordered = np.zeros((8, 8))
    bordered[:7, :7], bordered[:7, 7] = A, B * 10.0
    exact = LinearAxis(p).step_response(10.0)
    for t in (1e-3, 5e-3, 0.02, 0.1):
        y = expm(bordered * t)[:7, 7]
        # expm loses |A| t = 1e14 · 0.1 … roundings to scaling and squaring: 1e-5 and less seen
        assert y[1] == pytest.approx(exact.velocity(t), rel=1e-3)
        assert y[0] == pytest.approx(exact.position(t), rel=1e-3)
        assert P.r_g * y[2] == pytest.approx(y[0], rel=1e-3)


@pytest.mark.parametrize(
    ("name", "values", "other"),
    [("H", [1e-5, 1e-6, 1e-7], {"F_0": 0}), ("F_0", [20.0, 2.0, 0.2], {"H": 0})],
)
def test_the_effect_of_backlash_and_of_static_friction_vanishes_in_proportion(name, values, other):
    """Difference of position and velocity to the run without either, away from every limit."""

    def motion(**changes):
        p = P.replace(K_1=P.K_1, V_L=1e9, V_M=1e9, **changes)
        return simulate(p, 10.0, 0.1, method=tableaux.RK6, step_size=5e-6).y[:2]

    ideal = motion(H=0, F_0=0)
    errors = [np.abs(motion(**{name: value}, **other) - ideal).max() for value in values]
    # 5 %: the time for which a nonlinearity acts changes with it
    assert errors[0] / errors[1] == pytest.approx(10, rel=0.05)
    assert errors[1] / errors[2] == pytest.approx(10, rel=0.05)


# --- the seven-state model inside a region ------------------------------------------------------

GAP = Region(preamplifier=0, power=0, contact=0, friction=0)
HELD = Region(preamplifier=1, power=0, contact=0, friction=0)  # no spring, and no feedback


@pytest.mark.parametrize(("where", "motions"), [(ENGAGED, 6), (GAP, 5)])
def test_eigenvalues_are_those_of_the_jacobian_of_the_right_hand_side(where, motions):
    k, state = constants(P), np.zeros(7)
    state[1], state[2] = 0.5, 2 * P.H / P.r_g * where.contact
    state[3] = state[1] / P.r_g
    assert region(state, k) == where
    h = 1e-7
    columns = [
        (np.array(rhs(0.0, state + h * unit, 0.0, k)) - rhs(0.0, state - h * unit, 0.0, k))
        / (2 * h)
        for unit in np.eye(7)
    ]
    theirs = np.linalg.eigvals(np.array(columns).T)
    theirs = theirs[np.argsort(np.abs(theirs))][-motions:]
    ours = eigenvalues(P, where)
    assert ours.size == motions
    # differences of forces up to 1e5 N with steps of 1e-7 lose about 1e-6 of them
    assert np.sort_complex(ours) == pytest.approx(np.sort_complex(theirs), rel=1e-4)


@pytest.mark.parametrize("T_p", [0.04, 0.3])
def test_oscillation_is_what_a_run_shows(T_p):
    p = P.replace(T_p=T_p)
    measured = loop_ringing(simulate(p, 10.0, 2.5))
    assert oscillation(p) == pytest.approx(measured, rel=2e-3)


def test_oscillation_below_a_frequency_and_none_at_all():
    fast, slow = oscillation(P.replace(T_p=0.0071)), oscillation(P.replace(T_p=0.0071), highest=200)
    assert fast[0] > 200 > slow[0] > 20
    assert fast[1] < 0 < slow[1]  # the current loop is unstable there
    assert np.isnan(oscillation(P, HELD)).all()
    assert oscillation(P, highest=30) == oscillation(P)  # 29.4 Hz
    assert np.isnan(oscillation(P, highest=29)).all()


def test_gear_oscillation_is_that_of_two_masses_and_a_spring():
    masses = np.diag([P.M, P.J_m / P.r_g**2])
    pull = np.array([[1.0, -1.0], [-1.0, 1.0]])
    natural = np.sqrt(eigh(P.K_g * pull, masses, eigvals_only=True)[1])
    frequency, damping = gear_oscillation(P)
    assert frequency == pytest.approx(natural / (2 * np.pi), rel=1e-12)
    inverse = np.linalg.inv(masses)
    both = np.block(
        [[np.zeros((2, 2)), np.eye(2)], [-P.K_g * inverse @ pull, -P.b_g * inverse @ pull]]
    )
    mode = max(np.linalg.eigvals(both), key=lambda value: value.imag)
    assert mode == pytest.approx(natural * (-damping + 1j * np.sqrt(1 - damping**2)), rel=1e-9)


@pytest.mark.parametrize("velocity", [1.0, 0.3])
def test_steady_motion_is_where_a_long_run_ends(velocity):
    state, volts = steady_motion(P, velocity)
    end = simulate(P, volts, 3.0)(3.0)
    assert volts == pytest.approx(10 * velocity, rel=1e-12)
    moved = np.array([end[0], 0, end[0] / P.r_g, 0, 0, 0, 0])
    assert end - moved == pytest.approx(state, rel=1e-6, abs=1e-8)


# --- what is refused ----------------------------------------------------------------------------


def test_coincident_poles_are_refused():
    with pytest.raises(ValueError, match=r"(?s)poles .* nearly coincide.*change T_p"):
        LinearAxis(P.replace(K_2=0, K_1=1, T_p=P.T_r)).step_response()


@pytest.mark.parametrize("read", ["settling_time", "peak_current"])
def test_an_unstable_loop_has_no_settling_time_and_no_peak(read):
    unstable = LinearAxis(P.replace(T_z=0)).step_response()
    assert unstable.poles.real.max() > 0
    with pytest.raises(ValueError, match="not stable; its poles are"):
        getattr(unstable, read)()


def test_a_loop_without_friction_and_feedback_has_no_final_velocity():
    with pytest.raises(ValueError, match="K_2 = B_m = B_a = 0"):
        LinearAxis(P.replace(K_2=0, B_m=0, B_a=0, K_1=1)).step_response()


@pytest.mark.parametrize("read", ["settling_time", "peak_current"])
def test_a_step_of_nothing_has_no_settling_time_and_no_peak(read):
    with pytest.raises(ValueError, match="the response is 0"):
        getattr(LinearAxis(P).step_response(0.0), read)()


@pytest.mark.parametrize("volts", [np.nan, np.inf])
def test_a_step_that_is_not_finite_is_refused(volts):
    with pytest.raises(ValueError, match=f"set_velocity = {volts}"):
        LinearAxis(P).step_response(volts)


@pytest.mark.parametrize("criterion", [0.0, 1.0, -0.1, 2.0, np.nan])
def test_a_settling_criterion_outside_0_and_1_is_refused(criterion):
    with pytest.raises(ValueError, match=f"criterion = {criterion}"):
        LinearAxis(P).step_response().settling_time(criterion)


@pytest.fixture(scope="module")
def limit():
    return unstable_below(P, np.geomspace(0.0071, 4.74, 100))


def test_below_the_limit_a_run_chatters_to_its_end(limit):
    """The limits and the play turn the instability into events without end."""
    last = [simulate(P.replace(T_p=f * limit), 10.0, 2.0).events[-1].time for f in (0.98, 1.02)]
    assert last[0] > 1.999
    assert last[1] < 1.5
    rates = [growth_rate(P.replace(T_p=f * limit)) for f in (0.98, 1.02)]
    assert rates[0] > 0 > rates[1]
    assert np.isnan(arm_mode(P.replace(T_p=0.98 * limit))).all()
    assert np.isnan(unstable_below(P, np.geomspace(1.0, 4.74, 10)))


def test_the_fastest_decay_is_that_of_runs():
    T_p, decay = fastest_decay(P, 0.1, 2.0)
    measured = [
        loop_ringing(simulate(P.replace(T_p=f * T_p), 10.0, 2.5))[1] for f in (0.8, 1.0, 1.25)
    ]
    assert measured[1] == max(measured)
    assert measured[1] == pytest.approx(decay, rel=0.02)  # as test_oscillation_is_what_a_run_shows
    assert arm_mode(P.replace(T_p=T_p))[1] == pytest.approx(decay, rel=1e-12)
