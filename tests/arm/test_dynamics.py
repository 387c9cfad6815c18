"""The state equations against a second transcription of the paper's eq. (10)-(15)."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from armsim.arm import AxisParameters, simulate
from armsim.arm.dynamics import (
    STUCK,
    Region,
    affine,
    auxiliary_variables,
    constants,
    derivative,
    region,
    region_number,
    region_of_number,
    rhs,
)
from armsim.methods import integrate, tableaux

P = AxisParameters.paper_x_axis()
K = constants(P)
REGIONS = [Region(*signs) for signs in itertools.product((-1, 0, 1), repeat=4)]
#: Every constant different from the paper's and from the others, so that no two can be mixed up.
ODD = P.replace(
    R_a=0.7, L_a=0.011, K_b=0.31, J_m=0.0021, B_m=0.13, K_t=0.17, r_g=0.23, H=0.19, M=1.7, T_z=0.37,
    T_p=0.43, T_r=0.29, K_1=5.3, K_2=7.1, K_i=2.3, K_e=11.0, V_M=13.0, V_L=1.9, B_a=3.1, b_g=4.3,
    K_g=17.0, F_0=2.9, v_s=0.47,
)  # fmt: skip


def paper(p, y, U):
    """Eq. (10)-(15) with clip and sign instead of cases; returns ẏ and (f_g, F_s, v_m, v_c)."""
    y0, y1, y2, y3, y4, y5, y6 = y
    v_c = np.clip(y4 + p.T_z * y5, -p.V_L, p.V_L)
    v_m = np.clip(p.K_e * (v_c - y6 / p.K_i), -p.V_M, p.V_M)
    x = p.r_g * y2 - y0
    wound = x - np.clip(x, -p.H, p.H)
    f_g = p.K_g * wound + p.b_g * (p.r_g * y3 - y1) * (np.abs(x) > p.H)
    F_s = p.F_0 * np.sign(y1) * (np.abs(y1) < p.v_s)
    slope = [
        y1,
        (f_g - F_s - p.B_a * y1) / p.M,
        y3,
        (p.K_b * y6 - p.B_m * y3 - p.r_g * f_g) / p.J_m,
        y5,
        (p.K_1 * U - p.K_2 * p.K_t * y3 - y4 - (p.T_p + p.T_r) * y5) / (p.T_p * p.T_r),
        (v_m - p.R_a * y6 - p.K_b * y3) / p.L_a,
    ]
    return np.array(slope), np.array([f_g, F_s, v_m, v_c])


def rounding(p, y, U):
    """What rounding may do to each component of ẏ: 1e-14 times the sum of its terms' sizes."""
    y0, y1, y2, y3, y4, y5, y6 = np.abs(y)
    v_m = p.K_e * (y4 + p.T_z * y5 + p.V_L + y6 / p.K_i)
    f_g = p.K_g * (p.r_g * y2 + y0 + p.H) + p.b_g * (p.r_g * y3 + y1)
    return 1e-14 * np.array(
        [
            y1,
            (f_g + p.F_0 + p.B_a * y1) / p.M,
            y3,
            (p.K_b * y6 + p.B_m * y3 + p.r_g * f_g) / p.J_m,
            y5,
            (p.K_1 * abs(U) + p.K_2 * p.K_t * y3 + y4 + (p.T_p + p.T_r) * y5) / (p.T_p * p.T_r),
            (v_m + p.V_M + p.R_a * y6 + p.K_b * y3) / p.L_a,
        ]
    )


def state(p, signals):
    """State from what decides its region: v_c and v_m before their limits, the gap, y1, in limits.

    The other three numbers are y0, y3 and y5 in units of their own.
    """
    v_c, v_m, gap, y1, y0, y3, y5 = signals
    y0, y5 = y0 * 1e-2, y5 * p.V_L / (p.T_p + p.T_z)
    y4 = v_c * p.V_L - p.T_z * y5
    y6 = p.K_i * (np.clip(v_c, -1, 1) * p.V_L - v_m * p.V_M / p.K_e)
    return np.array([y0, y1 * p.v_s, (y0 + gap * p.H) / p.r_g, y3 * 100, y4, y5, y6])


def signals_in(where, rng):
    """Random signals that lie in a region."""
    inside = rng.uniform(0.05, 0.95, 4) * rng.choice([-1, 1], 4)
    v_c, v_m, gap, y1 = np.where(np.array(where) == 0, inside, where * rng.uniform(1.05, 3, 4))
    # Static friction is the other way round: it has a sign below the threshold velocity.
    y1 = where[3] * abs(inside[3]) if where[3] else rng.choice([-1, 1]) * rng.uniform(1.05, 3)
    return [v_c, v_m, gap, y1, *rng.uniform(-1, 1, 3)]


# At the flanks of the gear the force jumps, so rounding of the gap decides on which side it is.
away_from_flanks = st.floats(-3, 3).filter(lambda gap: abs(abs(gap) - 1) > 1e-3)
signal = st.floats(-3, 3)


def test_each_region_has_numbers_of_its_own():
    """108 regions; those without static friction have two numbers, for the two fast ranges."""
    of_number = {number: region_of_number(number) for number in range(135)}
    regions = {Region(*signs) for signs in itertools.product((-1, 0, 1), (-1, 0, 1), (-1, 0, 1),
                                                             (-1, 0, 1, STUCK))}  # fmt: skip
    assert set(of_number.values()) == regions
    assert all(of_number[region_number(where)] == where for where in regions)
    assert [region_number(where, n % 5) for n, where in of_number.items()] == list(range(135))


@pytest.mark.parametrize("p", [P, ODD], ids=["paper", "odd"])
@given(
    signals=st.tuples(signal, signal, away_from_flanks, signal, signal, signal, signal),
    volts=st.floats(-10, 10),
)
def test_rhs_is_the_papers(p, signals, volts):
    y = state(p, signals)
    assert np.all(np.abs(rhs(0.0, y, volts, constants(p)) - paper(p, y, volts)[0])
                  <= rounding(p, y, volts))  # fmt: skip


@pytest.mark.parametrize("p", [P, ODD], ids=["paper", "odd"])
@pytest.mark.parametrize("where", REGIONS)
def test_each_region_is_recognized_and_has_the_papers_equations(p, where, rng):
    for _ in range(3):
        y = state(p, signals_in(where, rng))
        assert region(y, constants(p)) == where
        error = np.array(derivative(y, 7.0, constants(p), where)) - paper(p, y, 7.0)[0]
        assert np.all(np.abs(error) <= rounding(p, y, 7.0))


@pytest.mark.parametrize("where", [*REGIONS, *(Region(0, 0, sign, STUCK) for sign in (-1, 0, 1))])
def test_affine_matrices_reproduce_the_derivative_anywhere(where, rng):
    """Also outside their region, where a mode-by-mode solver needs them."""
    A, B, c = affine(ODD, where)
    for y in rng.normal(size=(3, 7)):
        expected = derivative(y, -4.0, constants(ODD), where)
        # 1e-12: about 50 roundings of terms up to 100 times the sums
        assert A @ y + B * -4.0 + c == pytest.approx(expected, rel=1e-12, abs=1e-11)


@pytest.mark.parametrize("where", REGIONS)
def test_affine_matrix_is_the_jacobian(where, rng):
    """Differences of the paper's equations within a region are exact but for rounding."""
    y = state(ODD, signals_in(where, rng))
    step = 1e-3  # keeps within the region: signals stay 5 % off every border
    J = np.column_stack(
        [(paper(ODD, y + e, 1.0)[0] - paper(ODD, y - e, 1.0)[0]) / (2 * step)
         for e in step * np.eye(7)]
    )  # fmt: skip
    dU = paper(ODD, y, 2.0)[0] - paper(ODD, y, 1.0)[0]
    A, B, _ = affine(ODD, where)
    # rounding of ẏ, at most 1e4, over the step: 1e4 · 1e-16 · 10 / 1e-3
    assert pytest.approx(J, rel=1e-9, abs=1e-8) == A
    assert pytest.approx(dU, rel=1e-9, abs=1e-8) == B


def test_where_the_arm_sticks_static_friction_balances_all_other_forces(rng):
    for y in rng.normal(size=(5, 7)):
        for contact in (-1, 0, 1):
            slope = derivative(y, 3.0, constants(ODD), Region(0, 0, contact, STUCK))
            assert slope[1] == pytest.approx(0.0, abs=1e-14)  # forces of about 20, rounded


# --- borders: numbers that binary floats hold exactly -------------------------------------------

BORDER = ODD.replace(r_g=0.5, H=0.25, v_s=0.25, V_L=2.0, V_M=8.0, K_e=4.0, K_i=2.0, T_z=0.5)


@pytest.mark.parametrize("sign", [-1, 1])
def test_at_the_flank_the_teeth_do_not_touch_yet(sign):
    """Eq. (14): zero for -H <= x <= H, so the damping does not act at |x| = H."""
    y = np.array([0.0, 0.0, sign * 0.5, 9.0, 0.0, 0.0, 0.0])
    assert region(y, constants(BORDER)).contact == 0
    assert auxiliary_variables(BORDER, y[:, None])["f_g"] == 0.0
    y[2] *= 1.0001
    assert region(y, constants(BORDER)).contact == sign


@pytest.mark.parametrize("sign", [-1, 1])
def test_static_friction_is_gone_at_the_threshold_and_zero_at_rest(sign):
    """Eq. (15): |y1| < v, and sgn(0) = 0."""
    forces = [
        auxiliary_variables(BORDER, np.array([[0, y1, 0, 0, 0, 0, 0]]).T)["F_s"].item()
        for y1 in (0.0, sign * 1e-300, sign * 0.2499, sign * 0.25, sign * 1.0)
    ]
    assert forces == [0.0, sign * 2.9, sign * 2.9, 0.0, 0.0]


@pytest.mark.parametrize("sign", [-1, 1])
def test_limits_join_without_a_jump(sign):
    at_limit = np.array([0.0, 0.0, 0.0, 0.0, sign * 1.0, sign * 2.0, 0.0])
    assert region(at_limit, constants(BORDER))[:2] == (0, 0)
    v = auxiliary_variables(BORDER, at_limit[:, None])
    assert (v["v_c"].item(), v["v_m"].item()) == (sign * 2.0, sign * 8.0)
    beyond = at_limit + sign * np.array([0, 0, 0, 0, 0.001, 0, -0.001])
    assert region(beyond, constants(BORDER))[:2] == (sign, sign)


# --- auxiliary variables ------------------------------------------------------------------------


@pytest.mark.parametrize("p", [P, ODD], ids=["paper", "odd"])
def test_auxiliary_variables_are_those_of_table_2(p, rng):
    y = np.array([state(p, signals_in(where, rng)) for where in REGIONS]).T
    found = auxiliary_variables(p, y)
    assert list(found) == ["f_g", "F_s", "v_m", "v_c"]
    expected = np.array([paper(p, column, 0.0)[1] for column in y.T]).T
    scale = [p.K_g * np.abs(y[0]).max(), p.F_0, p.V_M + p.K_e * p.V_L, p.V_L]
    for name, numbers, size in zip(found, expected, scale, strict=True):
        # 1e-13: rounding of y0 and r_g y2 (1e-2 m) is 1e-13 of the force that they would make
        assert found[name] == pytest.approx(numbers, rel=1e-13, abs=1e-13 * size), name


def test_auxiliary_variables_take_any_array_of_states():
    y = np.arange(21).reshape(3, 7)
    columns = auxiliary_variables(P, y.T)["v_m"]
    assert columns.shape == (3,)
    assert columns == pytest.approx(
        [auxiliary_variables(P, row[:, None])["v_m"].item() for row in y.astype(float)], rel=1e-15
    )


# --- steady motion ------------------------------------------------------------------------------


@pytest.mark.parametrize("volts", [10.0, 4.0, -7.0])
def test_steady_motion_in_closed_form(volts):
    """By the rule for K_1, 0.1 m/s a volt; the rest follows backwards through the equations."""
    y1 = 0.1 * volts
    y3, f_g = y1 / P.r_g, P.B_a * y1
    y6 = (P.B_m * y3 + P.r_g * f_g) / P.K_b
    v_m = P.R_a * y6 + P.K_b * y3
    windup = f_g / P.K_g + np.sign(volts) * P.H
    y = np.array([0.0, y1, windup / P.r_g, y3, y6 / P.K_i + v_m / P.K_e, 0.0, y6])
    expected = [y1, 0, y3, 0, 0, 0, 0]
    assert rhs(0.0, y, volts, K) == pytest.approx(expected, abs=rounding(P, y, volts).max())
    assert list(auxiliary_variables(P, y[:, None])) == ["f_g", "F_s", "v_m", "v_c"]
    assert auxiliary_variables(P, y[:, None])["f_g"].item() == pytest.approx(f_g, rel=1e-10)

    # The slowest mode of this region decays with 12/s: e^-12/s · 2.5 s leaves 1e-13.
    end = simulate(P, volts, 2.5, method=tableaux.RK4_GILL, step_size=2e-5).y[:, -1]
    # Rounding of y0 = 2.5 m is 4e-16 m or 2e-9 N of gear force; the current rings with it at 1e-8.
    assert end[[1, 3, 4, 6]] == pytest.approx(y[[1, 3, 4, 6]], rel=1e-7)
    assert P.r_g * end[2] - end[0] == pytest.approx(windup, rel=1e-7)


def test_opposite_input_gives_the_opposite_motion():
    up, down = (
        simulate(P, volts, 0.3, method=tableaux.RK6, step_size=1e-5).y for volts in (10.0, -10.0)
    )
    assert np.array_equal(up, -down)


# --- energy -------------------------------------------------------------------------------------


@njit
def with_work(t, y, volts, c, B_a, R_a, B_m, L_a):
    """State equations with two more states: energy fed in by v_m, and energy dissipated."""
    F_s, v_m = friction_and_voltage(y, c)
    s = rhs(t, (y[0], y[1], y[2], y[3], y[4], y[5], y[6]), volts, c)
    slip = c.r_g * y[3] - y[1]
    in_gear = c.b_g * slip * slip if abs(c.r_g * y[2] - y[0]) > c.H else 0.0
    lost = R_a * y[6] ** 2 + B_m * y[3] ** 2 + B_a * y[1] ** 2 + F_s * y[1] + in_gear
    return s[0], s[1], s[2], s[3], s[4], s[5], s[6], v_m * y[6], lost


@njit
def friction_and_voltage(y, c):
    v_c = min(max(y[4] + c.T_z * y[5], -c.V_L), c.V_L)
    v_m = min(max(c.K_e * (v_c - y[6] * c.per_K_i), -c.V_M), c.V_M)
    F_s = c.F_0 * np.sign(y[1]) if abs(y[1]) < c.v_s else 0.0
    return F_s, v_m


def stored_energy(p, y):
    x = p.r_g * y[2] - y[0]
    wound = x - np.clip(x, -p.H, p.H)
    magnet, motor, arm, gear = (
        p.L_a * y[6] ** 2,
        p.J_m * y[3] ** 2,
        p.M * y[1] ** 2,
        p.K_g * wound**2,
    )
    return (magnet + motor + arm + gear) / 2


@pytest.mark.parametrize("volts", [10.0, -3.0, 0.05], ids=["fast", "backwards", "in friction"])
def test_energy_fed_in_is_stored_or_dissipated(volts):
    y0 = np.zeros(9)
    y0[1], y0[3] = (
        0.1,
        0.1 / P.r_g,
    )  # moves at first, so that reversing takes the gear through its gap
    args = (volts, K, P.B_a, P.R_a, P.B_m, P.L_a)
    imbalance = []
    for step in (4e-6, 1e-6):
        y = integrate(with_work, (0.0, 0.4), y0, tableaux.RK6, step, args=args).y
        stored = stored_energy(P, y)
        imbalance.append(np.abs(stored - stored[0] - y[7] + y[8]).max())
    # Steps within a region are exact to sixth order. A step across a jump of power (gear damping,
    # static friction) is wrong by the jump times the part of the step on the wrong side: below
    # 1 W · 1e-6 s at each of up to 50 jumps here, where about 1 to 80 J are fed in.
    assert imbalance[1] < 1e-8 * (np.abs(y[7]).max() + stored.max())
    assert imbalance[1] < imbalance[0] / 4
