"""Every measurement on signals whose answers are known, whatever their parameters.

A first-order and a second-order system have their settling time, overshoot and ringing in closed
form. Signals that never arrive, never settle or do not ring have none, which is NaN and not zero.
"""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armsim.arm import AxisParameters, simulate
from armsim.arm.dynamics import Region
from armsim.arm.response import (
    arrival_time,
    crossings,
    overshoot,
    pulling,
    ringing,
    rise_rate,
    settling_time,
    time_within,
)

sizes = st.floats(0.01, 100) | st.floats(-100, -0.01)
bands = st.floats(0.005, 0.2)
dampings = st.floats(0.05, 0.6)
rates = st.floats(0.6, 20)
t = np.linspace(0, 10, 200_001)


def lag(final, rate):
    return final * (1 - np.exp(-rate * t))


def second_order(final, damping):
    """Step response of 1/(s² + 2ζs + 1)."""
    omega = math.sqrt(1 - damping**2)
    decaying = np.exp(-damping * 4 * t)
    return final * (
        1 - decaying * (np.cos(4 * omega * t) + damping / omega * np.sin(4 * omega * t))
    )


@given(sizes, rates, bands)
def test_first_order_lag(final, rate, band):
    signal, width = lag(final, rate), band * abs(final)
    # samples are 5e-5 s apart, and the curvature between them is at most rate²: 1e-7 s
    assert settling_time(t, signal, final, width) == pytest.approx(-math.log(band) / rate, abs=1e-6)
    level = (1 - band) * final
    assert arrival_time(t, signal, level) == pytest.approx(-math.log(band) / rate, abs=1e-6)
    assert overshoot(signal, final, width) == 0.0
    assert np.isnan(ringing(t, signal)).all()


@given(sizes, dampings)
def test_second_order_system(final, damping):
    signal, omega = second_order(final, damping), 4 * math.sqrt(1 - damping**2)
    wanted = math.exp(-math.pi * damping / math.sqrt(1 - damping**2))
    assert overshoot(signal, final, 0.02 * abs(final)) == pytest.approx(wanted, rel=1e-6)
    frequency, decay = ringing(t[:40_001], signal[:40_001])  # two seconds, above rounding
    if not math.isnan(frequency):  # else fewer than three extrema in that time
        assert (frequency, decay) == pytest.approx((omega / (2 * math.pi), 4 * damping), rel=1e-4)
    first = (math.pi - math.acos(damping)) / omega
    assert arrival_time(t, signal, final) == pytest.approx(first, abs=1e-6)
    # the settling time is that of the last of all samples outside the band
    width = 0.02 * abs(final)
    settled = settling_time(t, signal, final, width)
    assert np.all(np.abs(signal[t > settled] - final) <= width * (1 + 1e-9))
    assert abs(signal[np.searchsorted(t, settled) - 1] - final) >= width * (1 - 1e-9)


@given(sizes, rates, st.floats(0.05, 0.9))
def test_what_never_arrives_has_no_times(final, rate, share):
    short, band = lag(share * final, rate), 0.01 * abs(final)
    assert math.isnan(settling_time(t, short, final, band))
    assert math.isnan(arrival_time(t, short, final))
    assert math.isnan(overshoot(short, final, band))


@given(sizes, rates)
def test_what_never_settles_has_no_settling_time(final, rate):
    forever = final * (1 + 0.5 * np.cos(rate * t + 1))
    n = np.flatnonzero(np.abs(forever / final - 1) > 1e-3)[-1] + 1  # it must not end in the band
    assert math.isnan(settling_time(t[:n], forever[:n], final, 1e-3 * abs(final)))


def test_nothing_is_measured_on_nothing():
    nothing = np.full(5, np.nan)
    times = np.arange(5.0)
    assert math.isnan(settling_time(times, nothing, 1.0, 0.02))
    assert math.isnan(arrival_time(times, nothing, 1.0))
    assert math.isnan(overshoot(nothing, 1.0, 0.02))
    assert np.isnan(ringing(times, nothing)).all()


@given(sizes, st.floats(1e-17, 1e-14))
def test_rounding_errors_do_not_ring(mean, noise):
    ripple = mean * (1 + noise * np.cos(np.arange(1000.0)))
    assert np.isnan(ringing(np.arange(1000.0), ripple)).all()


@given(st.integers(20, 400), st.floats(0, 1))
def test_a_top_of_two_equal_samples_is_an_extremum(per_period, rate):
    """An even number of samples a period, half a sample off the tops: pairs of equal samples."""
    n = np.arange(10 * 2 * per_period)
    times = n / (2 * per_period)
    signal = np.exp(-rate * times) * np.round(np.cos(2 * math.pi * (times + 0.25 / per_period)), 12)
    frequency, decay = ringing(times, signal)
    assert (frequency, decay) == pytest.approx((1.0, rate), rel=1e-2, abs=1e-2)


@given(rates, st.floats(0.2, 3))
def test_rise_rate(rate, size):
    def run(times):
        return np.array([0 * times, 1.5 * size - size * np.exp(-rate * times)])

    assert rise_rate(run, 0.0, 1.0) == pytest.approx(rate, rel=1e-5)


@pytest.mark.parametrize("level", [0.0, 1.0, -3.0])
def test_a_constant_has_no_rise_rate(level):
    assert math.isnan(rise_rate(lambda times: np.full((7, times.size), level), 0.0, 1.0))


@given(st.lists(st.floats(0.001, 0.999), max_size=8, unique=True), st.floats(0.1, 2))
def test_time_within_counts_every_second_interval(cuts, t_end):
    inside, outside = Region(1, 0, 0, 0), Region(0, 0, 0, 0)
    events = [
        SimpleNamespace(time=time, after=(inside, outside)[n % 2])
        for n, time in enumerate(sorted(cuts))
    ]
    run = SimpleNamespace(t=np.zeros(1), regions=lambda t: [outside], events=events)
    edges = [*sorted(cuts), math.inf]
    wanted = sum(max(0.0, min(t_end, b) - a) for a, b in zip(edges[::2], edges[1::2], strict=False))
    found = time_within(run, lambda where: where == inside, t_end)
    assert found == pytest.approx(wanted, abs=1e-12)


@given(st.floats(-0.9, 0.9), st.floats(0.01, 5), st.sampled_from([1, -1]))
def test_a_jump_is_no_root(place, height, sign):
    def steps(x):
        return sign * (x + (height + 2 if x >= place else -height - 2))

    roots, jumps = crossings(steps, np.linspace(-1, 1, 14))
    assert roots == []
    assert jumps == pytest.approx([place], abs=1e-9)


@given(st.floats(-0.9, 0.9), st.floats(1e-3, 1e3))
def test_a_steep_root_is_no_jump(place, slope):
    roots, jumps = crossings(lambda x: math.atan(slope * (x - place)), np.linspace(-1, 1, 14))
    assert jumps == []
    assert roots == pytest.approx([place], abs=1e-9)


@given(st.floats(-0.05, 0.05))
def test_teeth_pull_only_where_the_damper_says_so(speed):
    """A made-up run: in contact at a constant distance, the teeth parting at a constant speed."""
    p = AxisParameters.paper_x_axis()
    gap = 2e-6  # m, into the spring

    def run(times):
        y = np.zeros((7, times.size))
        y[2] = (p.H + gap) / p.r_g * (times < 0.5)  # in contact for half of the time
        y[1] = speed
        return y

    def auxiliary(times):
        return {"f_g": np.where(times < 0.5, gap * p.K_g - speed * p.b_g, 0.0)}

    run.parameters, run.t_end, run.auxiliary = p, 1.0, auxiliary
    force, share = pulling(run, 1e-3)
    assert force == pytest.approx(max(0.0, speed * p.b_g - gap * p.K_g))
    assert share == (1.0 if speed * p.b_g > gap * p.K_g else 0.0)


def test_teeth_that_never_meet_have_no_pull():
    calm = simulate(AxisParameters.paper_x_axis(), 0.0, 0.1)
    assert np.isnan(pulling(calm, 1e-4)).all()
