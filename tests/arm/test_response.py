"""Numbers read off a run against signals whose answers are known, and against SciPy."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from armsim.arm import AxisParameters, LinearAxis, simulate
from armsim.arm.dynamics import Region, affine
from armsim.arm.response import (
    SETTLED,
    arrival_time,
    crossings,
    gear_ringing,
    initial_slope,
    loop_ringing,
    nearest,
    ringing,
    rise,
    rise_rate,
    settling_time,
    step_quality,
    time_within,
)


@pytest.fixture(scope="module")
def published():
    return simulate(AxisParameters.paper_x_axis(), 10.0, 1.0)


def test_settling_time_of_an_exponential_is_its_logarithm():
    t = np.linspace(0, 1, 100_001)
    # linear interpolation between samples 1e-5 s apart: error below 1e-8
    assert settling_time(t, 1 - np.exp(-10 * t), 1.0, 0.02) == pytest.approx(
        np.log(50) / 10, abs=1e-8
    )


def test_settling_time_counts_the_last_exit_not_the_first_entry():
    t = np.arange(5.0)
    assert settling_time(t, np.array([1.0, 0.0, 2.0, 0.0, 0.0]), 0.0, 0.5) == pytest.approx(2.75)


def test_settling_time_at_the_edges():
    t = np.arange(3.0)
    assert settling_time(t, np.zeros(3), 0.0, 0.1) == 0.0
    assert np.isnan(settling_time(t, np.array([0, 0, 1.0]), 0.0, 0.1))


@pytest.mark.parametrize(("frequency", "rate"), [(29.4, 12.2), (6.6, 6.8), (80.0, 0.0)])
def test_ringing_of_a_damped_cosine(frequency, rate):
    t = np.arange(0, 1, 1e-4)
    signal = 3 + 0.2 * np.exp(-rate * t) * np.cos(2 * np.pi * frequency * t + 1)
    found = ringing(t, signal)
    # parabolas through samples 1e-4 s apart: relative error about (2π f 1e-4)² / 50
    assert found == pytest.approx((frequency, rate), rel=1e-4, abs=1e-3)


def test_what_does_not_ring_has_no_frequency(published):
    assert np.isnan(ringing(np.arange(10.0), np.arange(10.0))).all()
    assert np.isnan(ringing(np.arange(4.0), np.array([0.0, 1, 0, 1]))).all()  # two extrema
    assert np.isnan(loop_ringing(published)).all()  # it ends 0.15 s after the last event


def test_ringing_that_dies_away_to_rounding_errors_divides_by_no_zero():
    """Of the last top, 1 - 2**-53, 1, 1, the second difference rounds to zero if 2 comes first."""
    t = np.arange(44.0)
    signal = 1 + 0.1 * 0.9**t * np.cos(np.pi * t / 4)
    signal[40:] = 1 - 2.0**-53, 1.0, 1.0, 0.5
    with np.errstate(divide="raise", invalid="raise"):
        assert np.isfinite(ringing(t, signal)).all()


def test_the_gear_rings_with_its_own_mode(published):
    """Two masses on a spring with a damper, while the current is held at its limit."""
    p = published.parameters
    mass = 1 / (1 / p.M + p.r_g**2 / p.J_m)
    decay = p.b_g / (2 * mass)
    frequency = math.sqrt(p.K_g / mass - decay**2) / (2 * np.pi)
    # 5 %: the back EMF, which the current loop does not quite balance, damps as well
    assert gear_ringing(published) == pytest.approx((frequency, decay), rel=0.05)
    small = simulate(p, 0.1, 0.2)
    assert np.isnan(gear_ringing(small)).all()  # its preamplifier is soon off the limit


def test_the_quality_of_the_published_step():
    """Against the run itself, and the eigenvalue of the engaged loop."""
    p = AxisParameters.paper_x_axis()
    found = step_quality(p)
    t = np.linspace(0, 2, 200_001)
    velocity = simulate(p, 10.0, 2.0)(t)[1]
    assert found.overshoot == pytest.approx(velocity.max() - 1, rel=1e-3)
    outside = t[np.abs(velocity - 1) > SETTLED]
    assert found.settling == pytest.approx(outside[-1], abs=1e-3)
    modes = np.linalg.eigvals(affine(p, Region(0, 0, 1, 0))[0])
    pair = max((mode for mode in modes if mode.imag > 1e-6), key=lambda mode: mode.real)
    assert found.frequency == pytest.approx(pair.imag / (2 * np.pi), rel=1e-3)
    assert found.decay == pytest.approx(-pair.real, rel=1e-2)


def test_a_loop_that_buzzes_has_no_ringing():
    found = step_quality(AxisParameters.paper_x_axis(T_p=0.0071))
    assert math.isnan(found.frequency) and math.isnan(found.decay)
    assert 0 < found.settling < 1


# --- times --------------------------------------------------------------------------------------


def test_arrival_is_the_first_time_at_the_level():
    t = np.array([0.0, 0.5, 1.0, 1.5])
    assert arrival_time(t, np.array([0.0, 2.0, 1.0, 3.0]), 2.0) == 0.5
    assert arrival_time(t, np.array([0.0, 1.0, 3.0, 4.0]), 2.0) == 0.75
    assert arrival_time(t, np.array([0.0, -1.0, -3.0, 4.0]), -2.0) == 0.75
    assert arrival_time(t, np.ones(4), 1.0) == 0.0
    assert math.isnan(arrival_time(t, np.zeros(4), 1.0))
    assert math.isnan(arrival_time(t, np.full(4, np.nan), 1.0))


def limited(where):
    return where.preamplifier != 0


@pytest.mark.parametrize("until", [0.1, 0.81, 1.0])
def test_time_within_regions_is_that_of_samples(published, until):
    t = np.arange(0, until, 1e-4) + 5e-5  # 12 events: each errs by half a step at most
    share = np.mean([limited(where) for where in published.regions(t)])
    assert time_within(published, limited, until) == pytest.approx(share * until, abs=12e-4)


def test_time_within_regions_adds_up(published):
    both = [time_within(published, lambda r, s=s: limited(r) is s, 0.9) for s in (True, False)]
    assert sum(both) == pytest.approx(0.9, abs=1e-12)
    calm = simulate(AxisParameters.paper_x_axis(), 0.0, 0.5)
    assert not calm.events
    assert time_within(calm, limited, 0.4) == 0
    assert time_within(calm, lambda r: True, 0.4) == pytest.approx(0.4)
    assert math.isnan(time_within(published, limited, math.nan))


# --- curves -------------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [0.3, 1.8, 20.0])
def test_rise_rate_of_an_exponential(rate):
    def run(t):
        return np.array([0 * t, 1.2 - 0.9 * np.exp(-rate * t)])

    assert rise_rate(run, 0.1, 0.7) == pytest.approx(rate, rel=1e-6)


def test_what_never_rises_has_no_rate():
    def run(t):
        return np.ones((7, t.size))

    assert math.isnan(rise_rate(run, 0.1, math.nan))
    assert math.isnan(rise_rate(run, 0.1, 0.1))


class Exponential:
    """A made-up run: a rise to 1.05 m/s after a step."""

    t_end = 3.0

    def __init__(self, volts, rate):
        self.set_velocity = lambda t: volts
        self.rate = rate

    def __call__(self, t):
        return np.array([0 * t, 1.05 * (1 - np.exp(-self.rate * t))])


@pytest.mark.parametrize("rate", [1.1, 2.0, 15.0])
def test_the_rise_ends_at_the_set_velocity(rate):
    assert rise(Exponential(10.0, rate)) == pytest.approx(rate, rel=1e-6)
    assert math.isnan(rise(Exponential(11.0, rate)))  # which it never reaches
    assert math.isnan(rise(Exponential(10.0, 40.0)))  # which it reaches before 0.1 s


def test_the_initial_slope_by_integrals():
    """Of a line fitted to a continuous curve, and of the published run by F = m a."""
    run = Exponential(10.0, 2.0)
    moment, _ = quad(lambda t: (t - 0.05) * run(t)[1], 0.0, 0.1)
    # the fit has 1001 samples, whose ends weigh twice as much as in the integral: 0.1 %
    assert initial_slope(run) == pytest.approx(12 * moment / 0.1**3, rel=2e-3)
    p = AxisParameters.paper_x_axis()
    published = simulate(p, 10.0, 0.2)
    pushed = p.K_b * p.K_i * p.V_L * p.r_g / (p.J_m + p.r_g**2 * p.M)
    # the current is a little below its limit, and friction slows the arm
    assert 0.9 * pushed < initial_slope(published) < pushed


def test_what_is_nearest_to_a_target():
    near, met = nearest(math.cos, np.linspace(0, 10, 50), 0.5)
    assert met
    assert sorted(near) == pytest.approx([x * np.pi for x in (1 / 3, 5 / 3, 7 / 3)], abs=1e-11)
    near, met = nearest(lambda x: 2.0 if x < 1 else 5.0, [0.0, 3.0], 3.0)
    assert not met
    assert near == pytest.approx([1.0, 1.0], abs=2e-9)
    assert near[0] < 1 < near[1]  # 2 is nearer to 3 than 5 is
    assert nearest(math.cos, [0.0, 1.0], 3.0) == ([], False)


def test_crossings_of_a_cosine():
    roots, jumps = crossings(math.cos, np.linspace(0, 10, 50), 0.5)
    wanted = [x * np.pi for x in (1 / 3, 5 / 3, 7 / 3)]
    assert roots == pytest.approx(wanted, abs=1e-11)
    assert jumps == []
    assert crossings(math.cos, np.linspace(0, 10, 50), 2.0) == ([], [])


def test_a_crossing_at_a_point_of_the_grid_counts_once():
    assert crossings(lambda x: x, [-1.0, 0.0, 1.0]) == ([0.0], [])
    assert crossings(lambda x: -x, [-1.0, 0.0, 1.0]) == ([0.0], [])


def test_what_is_not_a_number_is_no_crossing():
    for sign in (1, -1):
        found, _ = crossings(lambda x, s=sign: math.nan if x < 1 else s * (x - 2), [0.0, 1.0, 3.0])
        assert found == pytest.approx([2.0])


def test_the_jump_of_a_settling_time_is_no_root():
    """At 2 % no time constant makes the linear arm settle in 30 ms: the time jumps across it."""
    p = AxisParameters.paper_x_axis()

    def settling(T_p):
        return LinearAxis(p.replace(T_p=T_p)).step_response(10.0).settling_time(0.02)

    roots, (jump,) = crossings(settling, np.geomspace(0.2, 0.4, 9), 0.03)
    assert roots == []
    assert settling(jump - 1e-6) == pytest.approx(0.0272, abs=1e-4)
    assert settling(jump + 1e-6) == pytest.approx(0.0359, abs=1e-4)


# --- a method that carries a run on --------------------------------------------------------------
