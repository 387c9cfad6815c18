"""Settling time and ringing against signals whose answers are known."""

import math

import numpy as np
import pytest

from armsim.arm import AxisParameters, simulate
from armsim.arm.dynamics import Region, affine
from armsim.arm.response import SETTLED, ringing, settling_time, step_quality


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


def test_ringing_without_extrema_is_an_error():
    with pytest.raises(ValueError, match="0 extrema"):
        ringing(np.arange(10.0), np.arange(10.0))


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
