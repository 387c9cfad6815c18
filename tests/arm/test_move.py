"""The quality of a move: on made-up motions, by events, and by a Runge-Kutta run."""

from itertools import pairwise

import numpy as np
import pytest

from armsim.arm import AxisParameters, SlaveControl, Track, simulate
from armsim.arm.move import BAND, REST, Move, linear_move, move
from armsim.methods import tableaux

P = AxisParameters.paper_x_axis()


@pytest.fixture(scope="module")
def short():
    return move(P, SlaveControl(track=Track.trapezoid(0.1, 0.4, 1.0), counts=0))


@pytest.mark.parametrize("sign", [1, -1])
def test_quality_of_a_made_up_motion(sign):
    """To 1 m in a second; 3 mm late on the way, 2 mm too far, and slowly back."""
    t = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.5])
    wanted = sign * np.array([[0, 0.5, 1, 1, 1, 1], np.zeros(6)])
    y = np.zeros((7, 6))
    y[0] = sign * np.array([0, 0.497, 1, 1.002, 1, 1])
    made_up = Move(None, t, y, wanted)
    assert made_up.tracking_error == pytest.approx(3e-3)
    assert made_up.overshoot == pytest.approx(2e-3)
    assert made_up.arrival == pytest.approx(1.5 + 0.5 * (2e-3 - BAND) / 2e-3)
    y[0] = sign * 0.99
    assert np.isnan(made_up.arrival)
    assert made_up.overshoot == 0


def test_a_runge_kutta_run_has_the_same_tracking_error(short):
    control, t_end = short.run.control, short.run.control.track.duration + REST
    run = simulate(P, control=control, t_end=t_end, method=tableaux.RK6, step_size=1e-5)
    error = max(abs(x - y) for x, y in zip(control.track(run.t)[0], run.y[0], strict=True))
    assert short.tracking_error == pytest.approx(error, rel=1e-3)
    assert short.t[-1] == run.t[-1] == t_end


def test_the_time_at_the_limit_is_that_between_events(short):
    end, run = short.run.control.track.duration, short.run
    times = [0.0, *(event.time for event in run.events if event.time < end), end]
    at_limit = sum(
        b - a
        for a, b in pairwise(times)
        if b > a and run.regions(np.array([(a + b) / 2]))[0].preamplifier
    )
    assert at_limit > 0
    assert short.share_at_limit == pytest.approx(at_limit / end, abs=2e-3)


def test_the_linear_model_by_a_runge_kutta_run(short):
    gain, control = 1e3, short.run.control
    far = {"H": 0.0, "F_0": 0.0, "V_L": 1e9, "V_M": 1e9}
    stiff = P.replace(K_e=gain, K_g=1e6 * gain, b_g=100 * gain, **far)
    run = simulate(stiff, control=control, t_end=short.t[-1], method=tableaux.RK6, step_size=5e-6)
    found, y = linear_move(short, gain), run(short.t)
    # 1 µm and 1e-4 m/s: Runge-Kutta runs are interpolated between their steps
    assert found.y[0] == pytest.approx(y[0], abs=1e-6)
    assert found.y[1] == pytest.approx(y[1], abs=1e-4)
    assert found.error == pytest.approx(short.wanted[0] - y[0], abs=1e-6)
    assert np.abs(found.y[6]).max() == pytest.approx(np.abs(y[6]).max(), rel=1e-3)
