"""Records of measured motion, ideal instruments, and the integrated accelerometer."""

import dataclasses
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armsim.arm import AxisParameters, simulate
from armsim.arm.files import read_axis, read_measurement
from armsim.arm.measurement import Instrument, Measurement, implausible, integrated, signals
from armsim.paths import DATA

P = AxisParameters.paper_x_axis()
T = np.arange(30) * 0.002 + 5.0
SIGNALS = ("position", "velocity", "acceleration")


def record(**changes):
    columns = dict(zip(SIGNALS, np.zeros((3, 30)), strict=True))
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
        ({"t": np.where(np.arange(30) == 4, T[3], T)}, "sample 4: time = 5.006 appears twice"),
    ],
)
def test_samples_are_checked(changes, message):
    with pytest.raises(ValueError, match=message):
        record(**changes)


@pytest.mark.parametrize(
    "values",
    [
        np.datetime64("2026-11-25T12:00") + 2 * np.arange(30).astype("timedelta64[ms]"),
        2 * np.arange(30).astype("timedelta64[ms]"),
        np.ma.array(T, mask=T > 5.05),
        T + 0j,
        T.astype(str),
        np.array([*T[:-1], "5.058"], dtype=object),
        np.array([*T[:-1], None], dtype=object),
        np.array([*T[:-1], np.datetime64(1, "s")], dtype=object),
        T > 5,
        [*range(29), 10**400],
    ],
)
def test_columns_are_real_numbers(values):
    """Each of these NumPy converts to floats, or fails to with an error of its own."""
    with pytest.raises(ValueError, match=r"^t = .*: real numbers are needed$"):
        record(t=values)


def test_numbers_of_any_type_are_columns():
    times = np.ma.array(np.arange(30), mask=False)
    columns = record(t=times, velocity=[Fraction(1, 2)] * 30, position=np.ones(30, np.float32))
    assert columns.velocity[3] == 0.5 and columns.t.dtype == columns.position.dtype == float


# --- what no fit can explain --------------------------------------------------------------------


def whole(name="x_axis_test.csv"):
    return read_measurement(DATA / "measurements" / name)


def scaled(one, **factors):
    return dataclasses.replace(one, **{k: f * getattr(one, k) for k, f in factors.items()})


@pytest.mark.parametrize(
    ("factors", "message"),
    [
        ({"t": 1e3}, "position varies by 0.0421, summed velocity by 42.1 m: check the units"),
        ({"t": 1e-3}, "position varies by 0.0421, summed velocity by 4.21e-05 m"),
        ({"position": 1e3, "velocity": 1e3, "acceleration": 1e3}, "974 m/s; the limit V_M allows"),
        ({"position": 1e3}, "position varies by 42.1, summed velocity by 0.0421 m"),
        ({"velocity": 60 / (2 * np.pi * P.r_g)}, "velocity up to"),
        ({"acceleration": 1e3}, "velocity varies by 0.132, summed acceleration by 132 m/s"),
    ],
)
def test_other_units_are_found_out(factors, message):
    noise = read_axis(DATA / "axes" / "x.toml")[1]
    assert message in next(implausible(scaled(whole(), **factors), P, noise))


def test_record_that_begins_in_motion_or_elsewhere_is_found_out():
    noise, one = read_axis(DATA / "axes" / "x.toml")[1], whole()
    later = Measurement(*(column[200:] for column in dataclasses.astuple(one)))
    moved = dataclasses.replace(one, position=one.position + 0.35)
    for bad, where in ((later, "at 0.1369 m, 0.6458 m/s"), (moved, "at 0.35 m, 0.003662 m/s")):
        assert list(implausible(bad, P, noise)) == [f"begins {where}; has to begin at rest, at 0 m"]


@pytest.mark.parametrize("name", ["x_axis_test.csv", "x_axis_test_curved.csv", "x_axis_move.csv"])
@pytest.mark.parametrize("end", [20, 60, 300, None])
def test_record_that_ends_in_motion_is_plausible(name, end):
    noise, one = read_axis(DATA / "axes" / "x.toml")[1], whole(name)
    cut = Measurement(*(column[:end] for column in dataclasses.astuple(one)))
    assert list(implausible(cut, P, noise)) == []


@given(
    heavier=st.floats(0.05, 50), softer=st.floats(1e-4, 10),
    friction=st.just(0) | st.floats(1e-3, 10),
    volts=st.floats(0.01, 10), end=st.floats(0.02, 20), noise=st.floats(0.01, 100),
    offset=st.floats(-0.02, 0.02),
)  # fmt: skip
@settings(max_examples=40)
def test_any_axis_is_plausible(heavier, softer, friction, volts, end, noise, offset):
    """Large, slow, soft, stuck or hardly moving, blunt instruments with offsets: never refused."""
    p = P.replace(K_1=P.K_1, M=heavier * P.M, K_g=softer * P.K_g, F_0=friction * 20)
    _, sharp = read_axis(DATA / "axes" / "x.toml")
    deviations = noise * sharp.deviations
    t = np.linspace(0, end, 200)
    seen = signals(simulate(p, volts, end)(t), t, p)
    seen += deviations * np.random.default_rng(0).standard_normal(seen.shape)
    seen[1:, 1:] += [[min(abs(offset), deviations[1, 0])], [1.0]]
    one = Measurement(t, np.full(200, volts), *seen)
    assert (
        list(implausible(one, p, Instrument(**dict(zip(SIGNALS, deviations[:, 0], strict=True)))))
        == []
    )


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
