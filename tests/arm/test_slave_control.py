"""The slave control unit alone, and in a closed loop with every kind of solver."""

import math
import sys

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from armsim.arm import AxisParameters, simulate, simulate_many
from armsim.arm.dynamics import constants, rhs
from armsim.arm.slave_control import MEMORY, SlaveControl, Track, put_out
from armsim.exact.piecewise_affine import recorded
from armsim.methods import tableaux

P = AxisParameters.paper_x_axis()
MOVE = SlaveControl(track=Track.trapezoid(0.05, 0.4, 1.0))

# --- track ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("distance", "velocity", "acceleration"),
    [(1.0, 0.9, 1.0), (-0.4, 0.5, 2.0), (0.1, 0.9, 1.0), (0.0, 1.0, 1.0)],
)
def test_a_trapezoid_covers_its_distance_within_its_limits(distance, velocity, acceleration):
    track = Track.trapezoid(distance, velocity, acceleration, period=0.01)
    t = np.linspace(0, track.duration, 20_001)
    position, speed = track(t)
    assert position[0] == 0.0 and position[-1] == pytest.approx(distance, rel=1e-14)
    assert np.abs(speed).max() <= velocity * (1 + 1e-12)
    # a cubic over a corner of the schedule exceeds the acceleration, but not twice
    assert np.abs(np.diff(speed)).max() <= 2 * acceleration * t[1] + 1e-12
    assert np.trapezoid(speed, t) == pytest.approx(distance, abs=1e-8)
    assert np.gradient(position, t) == pytest.approx(speed, abs=2e-3)
    top = min(velocity, math.sqrt(acceleration * abs(distance)))
    lasts = abs(distance) / top + top / acceleration if distance else 0.0
    assert lasts <= track.duration <= lasts + 0.02
    assert np.abs(speed).max() == pytest.approx(top, abs=acceleration * 0.01)


def test_the_track_has_its_data_at_their_times_and_stays_at_its_end():
    track = Track((0.0, 0.02, 0.05), (0.0, 0.5, 0.0))
    assert track(np.array([0.0, 0.08, 0.16])) == pytest.approx(
        np.array([[0.0, 0.02, 0.05], [0.0, 0.5, 0.0]]), rel=1e-14
    )
    assert track(7.0) == pytest.approx([0.05, 0.0], abs=1e-15)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Track((0.0,), (0.0,)), "at least two"),
        (lambda: Track((0.0, 1.0), (0.0,)), "as many"),
        (lambda: Track((0.0, math.nan), (0.0, 0.0)), "finite"),
        (lambda: Track((0.0, 1.0), (0.0, 0.1)), r"speed 0\.1"),
        (lambda: Track((0.0, 1.0), (0.0, 0.0), 0.0), "period = 0"),
        (lambda: Track.trapezoid(velocity=-1.0), r"velocity = -1\.0 .* positive"),
        (lambda: Track.trapezoid(acceleration=math.inf), "acceleration = inf"),
        (lambda: Track.trapezoid(distance=math.nan), "distance = nan"),
        (lambda: SlaveControl(K_p=-1.0), r"K_p = -1\.0 .* not negative"),
        (lambda: SlaveControl(period=0.0), "period"),
        (lambda: SlaveControl(limit=0), "limit"),
        (lambda: SlaveControl(counts=-5), "counts = -5"),
        (lambda: simulate(P, 5.0, control=MOVE), "set_velocity = 5.0: with control"),
    ],
)
def test_values_out_of_range_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize(
    "make",
    [
        lambda: SlaveControl(delay=1.5),
        lambda: SlaveControl(counts=True),
        lambda: SlaveControl(K_p="8"),
        lambda: SlaveControl(track=[(0.0, 0.0)]),
        lambda: Track.trapezoid(distance="1"),
        lambda: simulate(P, control=lambda t: 0.0),
    ],
)
def test_values_of_another_type_are_refused(make):
    with pytest.raises(TypeError):
        make()


# --- law ------------------------------------------------------------------------------------------


def outputs(control, angles, track, r_g=P.r_g):
    memory, volts = np.zeros(MEMORY), np.zeros(len(angles))
    for n, angle in enumerate(angles):
        put_out(n, angle, r_g, track, control.law, memory, volts)
    return volts


def law_of_the_docstring(control, angles, track, r_g=P.r_g):
    integral, volts = 0.0, [0.0] * control.delay
    counts = 2 * math.pi / control.counts if control.counts else None
    x = [r_g * (round(a / counts) * counts if counts else a) for a in angles]
    for n in range(len(x)):
        e, rate = track[n, 0] - x[n], (x[n] - x[n - 1]) / control.period if n else 0.0
        new = integral + e * control.period
        U = control.volts_per_speed * (
            track[n, 1] + control.K_p * e + control.K_I * new + control.K_v * (track[n, 1] - rate)
        )
        if abs(U) <= control.limit or U * e < 0:
            integral = new
        volts.append(min(max(U, -control.limit), control.limit))
    return volts[: len(x)]


@pytest.mark.parametrize("delay", [0, 1, 3])
@pytest.mark.parametrize("counts", [0, 500])
def test_the_law_is_the_one_of_its_docstring(delay, counts):
    rng = np.random.default_rng(3)
    control = SlaveControl(K_p=20.0, K_I=30.0, K_v=0.5, delay=delay, counts=counts)
    track = np.column_stack([0.05 * rng.normal(size=200).cumsum(), rng.normal(size=200)])
    angles = rng.normal(size=200).cumsum()
    volts = outputs(control, angles, track)
    assert volts == pytest.approx(law_of_the_docstring(control, angles, track), rel=1e-12)
    assert 0.2 < np.mean(np.abs(volts) == control.limit) < 0.9  # both branches were taken


def test_the_integral_does_not_wind_up():
    """An arm held fast for 2 s: let go at its goal, the unit asks for what its error says."""
    control = SlaveControl(K_p=5.0, K_I=50.0, K_v=0.0, delay=0, counts=0)
    track = np.column_stack([np.full(500, 0.3), np.zeros(500)])
    angles = np.where(np.arange(500) < 400, 0.0, 0.3 / P.r_g)
    volts = outputs(control, angles, track)
    assert volts[399] == control.limit
    # the integral stopped where the output met the limit: 10 V = 10 (5 · 0.3 m + 50 ∫)
    assert volts[400] == 0.0 or abs(volts[400]) <= control.limit
    largest = control.limit - 10 * 5 * 0.3
    assert abs(volts[400]) <= max(largest, 0.0) + 1e-9


def test_a_coarse_encoder_knows_its_counts_only():
    control = SlaveControl(K_p=1.0, K_I=0.0, K_v=0.0, delay=0, counts=100, volts_per_speed=1.0)
    track = np.zeros((50, 2))
    angles = np.linspace(0, 0.5, 50)
    steps = -outputs(control, angles, track) / (P.r_g * 2 * math.pi / 100)
    assert steps == pytest.approx(np.round(steps), abs=1e-12)
    assert len(set(np.round(steps))) == 9


# --- closed loop ----------------------------------------------------------------------------------


def test_what_is_put_out_follows_from_the_motion():
    run = simulate(P, control=MOVE, t_end=0.5)
    times, volts = np.array(run.schedule).T
    assert times == pytest.approx(0.005 * np.arange(100), abs=1e-15)
    expected = law_of_the_docstring(MOVE, run(times)[2], MOVE.track(times).T)
    assert volts == pytest.approx(expected, abs=1e-9)
    assert run.control is MOVE
    again = simulate(P, run.schedule, 0.5)  # what was put out, as an input known beforehand
    assert np.array_equal(again(run.t), run.y)
    assert again.events == run.events


@pytest.mark.parametrize("delay", [0, 1])
def test_the_closed_loop_agrees_with_scipy_from_sample_to_sample(delay):
    """DOP853, restarted at the samples but not at the events, which cost it some digits."""
    control = SlaveControl(track=MOVE.track, delay=delay)
    times, volts, y = 0.005 * np.arange(11), [0.0] * delay, [np.zeros(7)]
    k = constants(P)
    for n in range(10):
        angles = [state[2] for state in y]
        volts = law_of_the_docstring(control, angles, control.track(times[: n + 1]).T)
        piece = solve_ivp(
            rhs,
            times[n : n + 2],
            y[-1],
            "DOP853",
            rtol=1e-7,
            atol=1e-10,
            max_step=5e-4,
            args=(volts[n], k),
        )
        y.append(piece.y[:, -1])
    run = simulate(P, control=control, t_end=times[-1])
    largest = np.abs(run.y).max(axis=1)
    assert np.all(np.abs(run(times) - np.array(y).T).max(axis=1) <= 1e-5 * largest)


def test_runge_kutta_tends_to_the_exact_closed_loop_and_meets_every_sample():
    ideal = SlaveControl(track=MOVE.track, counts=0)  # a count more or less would be a jump
    exact = simulate(P, control=ideal, t_end=0.4)
    largest = np.abs(exact.y).max(axis=1)

    def distance(**how):
        run = simulate(P, control=ideal, t_end=0.4, **how)
        assert np.isin(0.005 * np.arange(80), run.t).all()
        return (np.abs(exact(run.t) - run.y).max(axis=1) / largest).max()

    coarse = distance(method=tableaux.RK6, step_size=1e-5)
    assert distance(method=tableaux.RK6, step_size=1e-6) < coarse / 3
    assert distance(method=tableaux.DP5) < 1e-2
    with pytest.raises(ValueError, match="exponential form needs"):  # as without control
        distance(method=tableaux.DP4, step_size=1e-6, form="exponential")


def test_a_sample_costs_a_piece_and_no_more():
    run = simulate(P, control=SlaveControl(), t_end=3.0)
    pieces = len(run.solution.room.start)
    changes = len({event.time for event in run.events} | {t for t, _ in run.schedule})
    assert pieces == changes


def test_a_run_that_needs_more_room_is_the_same(monkeypatch):
    runs = [simulate(P, t_end=0.5, control=MOVE)]
    module = sys.modules["armsim.arm.simulate"]  # not the function of that name
    with_4_rows = lambda run, sizes, _, names: recorded(run, sizes, -126, names)  # noqa: E731
    monkeypatch.setattr(module, "recorded", with_4_rows)
    runs.append(simulate(P, t_end=0.5, control=MOVE))
    assert len(runs[0].solution.room.start) > 32  # more than eight times four
    first, second = ([*run.solution.room[:4], run.schedule] for run in runs)
    assert all(map(np.array_equal, first, second))


def test_a_batch_is_the_same_as_one_by_one():
    axes = [P.replace(M=mass) for mass in (100.0, 146.0, 190.0)]
    times = np.linspace(0, 0.5, 7)
    many = simulate_many(axes, t_end=0.5, times=times, control=MOVE)
    for axis, y in zip(axes, many, strict=True):
        assert np.array_equal(y, simulate(axis, control=MOVE, t_end=0.5)(times))


def test_the_default_move_is_well_damped():
    run = simulate(P, control=SlaveControl(), t_end=3.5)
    t = np.linspace(0, 3.5, 3501)
    wanted, position = SlaveControl().track(t)[0], run(t)[0]
    assert np.abs(wanted - position).max() < 2e-3
    assert position.max() < 1.0 + 1.5e-3
    assert np.abs(position[t > SlaveControl().track.duration + 0.1] - 1.0).max() < 0.5e-3
