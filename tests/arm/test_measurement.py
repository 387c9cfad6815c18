"""Records of measured motion, ideal instruments, and the integrated accelerometer."""

import numpy as np
import pytest

from armsim.arm import AxisParameters, simulate
from armsim.arm.measurement import Instrument, Measurement, integrated, signals

P = AxisParameters.paper_x_axis()
T = np.arange(30) * 0.002 + 5.0


def record(**changes):
    columns = dict(zip(("position", "velocity", "acceleration"), np.zeros((3, 30)), strict=True))
    return Measurement(**({"t": T, "set_velocity": np.where(T < 5.01, 0, 9.0)} | columns | changes))


def test_schedule_holds_each_change_from_its_sample_on():
    volts = [0] * 10 + [9] * 10 + [-2] * 10
    schedule = record(set_velocity=volts).schedule
    assert [u for _, u in schedule] == [0, 9, -2]
    np.testing.assert_allclose([t for t, _ in schedule], [0, 0.02, 0.04], atol=1e-12)


def test_mean_acceleration_is_what_the_model_accelerates_by():
    run = simulate(P, 10.0, 0.1)
    t = np.arange(51) * 0.002
    seen = signals(run(t), t, P)
    fine = np.linspace(0.048, 0.050, 4001)
    y, f_g = run(fine), run.auxiliary(fine)["f_g"]
    mean = np.trapezoid((f_g - P.B_a * y[1]) / P.M, fine) / 0.002
    assert seen[2, 25] == pytest.approx(mean, rel=1e-6)
    np.testing.assert_array_equal(seen[:2], P.r_g * run(t)[2:4])
    assert seen[2, 0] == 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"position": np.zeros(29)}, "shapes"),
        ({"t": np.zeros((30, 1))}, "shapes"),
        (
            {"velocity": np.where(np.arange(30) == 7, np.nan, 0)},
            "sample 7: velocity = nan is not finite",
        ),
        ({"t": np.where(np.arange(30) == 4, T[3], T)}, "sample 4: time = 5.006 stands there twice"),
    ],
)
def test_samples_are_checked(changes, message):
    with pytest.raises(ValueError, match=message):
        record(**changes)


@pytest.mark.parametrize("value", [0, -1.0, np.inf, np.nan])
def test_noise_is_positive(value):
    with pytest.raises(ValueError, match="velocity = .* must be .*positive"):
        Instrument(position=1.0, velocity=value, acceleration=1.0)


def test_integration_takes_off_bias_and_drift():
    """A move whose velocity is known, with a drifting accelerometer: all of it comes back."""
    t = np.arange(1001) * 0.002
    moving = np.clip(t, 0, 1)
    velocity = 0.5 * (1 - np.cos(2 * np.pi * moving))
    position = 0.5 * (moving - np.sin(2 * np.pi * moving) / (2 * np.pi))
    acceleration = np.diff(velocity, prepend=0.0) / 0.002
    acceleration[1:] += 0.03 - 0.01 * (t[1:] - 0.001)
    zero = np.zeros(t.size)
    found = integrated(Measurement(t + 5, zero, zero, zero, acceleration), 1.2)
    np.testing.assert_allclose(found[0], velocity, atol=1e-12)
    np.testing.assert_allclose(found[1], position, atol=1.1e-6)  # 0.002² / 12 times a slope of π
