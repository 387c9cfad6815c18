"""The explorer's table: packed curves against the runs that they come from."""

import base64
from itertools import product

import numpy as np
import pytest

from armbook import explorer
from armbook.events import story
from armsim.arm import AxisParameters, simulate

GRID = {"T_p": (0.021, 0.04), "K_2": (870.0,), "set_velocity": (2.0, 10.0)}


@pytest.fixture(scope="module")
def table():
    return explorer.table(GRID, t_end=1.2)


def runs():
    for T_p, K_2, volts in product(*GRID.values()):
        yield simulate(AxisParameters.paper_x_axis(T_p=T_p, K_2=K_2), volts, 1.2)


def test_published_case_is_in_the_grid():
    assert all(value in explorer.GRID[name] for name, value in explorer.PUBLISHED.items())


@pytest.mark.parametrize("tolerance", [1e-3, 0.1])
def test_corners_keep_a_curve_within_the_tolerance(tolerance):
    t = np.linspace(0, 1, 2001)
    y = np.sin(40 * t) * np.exp(-3 * t)
    places = explorer.corners(t, y, tolerance)
    assert np.abs(np.interp(t, t[places], y[places]) - y).max() <= tolerance
    assert places.size < t.size / 4  # it is thinned


def test_packed_curves_are_those_of_the_runs(table):
    """Within the tolerance, half a unit of the whole numbers, and rounding."""
    times = np.linspace(0.0, 1.2, explorer.SAMPLES)
    for case, run in enumerate(runs()):
        exact, kept = explorer.sampled(run, times), explorer.curves(table, case)
        for (t, y), true, unit, tolerance in zip(
            kept, exact, table["scale"], explorer.CURVES.values(), strict=True
        ):
            off = np.abs(np.interp(times, t, y) - true).max()
            assert off <= tolerance * np.ptp(true) + 0.51 * unit


def test_sampled_signals_are_those_of_the_simulation():
    run = next(runs())
    t = np.linspace(0.0, 1.2, 1001)
    y, more = run(t), run.auxiliary(t)
    difference = 1e6 * (run.parameters.r_g * y[2] - y[0])
    exact = [y[1], y[6], more["f_g"], difference, more["v_c"], more["v_m"]]
    for found, true in zip(explorer.sampled(run, t), exact, strict=True):
        assert found == pytest.approx(true, abs=1e-6 * np.ptp(true))


def test_packed_events_are_those_of_the_runs(table):
    kinds = {"event_counts": "<u2", "event_times": "<f8", "event_codes": "<u2"}
    counts, times, codes = (
        np.frombuffer(base64.b64decode(table[key]), kind) for key, kind in kinds.items()
    )
    events = [event for run in runs() for event in run.events]
    assert counts.tolist() == [len(run.events) for run in runs()]
    assert times.tolist() == [event.time for event in events]
    for code, event in zip(codes.tolist(), events, strict=True):
        assert table["words"][code // 27] == story(event.before, event.after)
        branches = [code // unit % 3 - 1 for unit in (9, 3, 1)]
        assert branches == [*event.after[:3]]


def test_what_does_not_apply_is_missing():
    """A run that ends before the arm has reached its speed does not overshoot or settle."""
    (numbers,) = explorer.table({k: (v,) for k, v in explorer.PUBLISHED.items()}, 0.3)["numbers"]
    assert numbers["overshoot"] is None and numbers["settling_time"] is None
    assert numbers["K_1"] == pytest.approx(1014.4, abs=0.5)


def test_distance_forgives_a_tick_and_no_more():
    tick = 5e-5
    t = np.linspace(0.1, 1.1, 50_001)
    jump = (t > 0.5).astype(float)
    for late, far in ((0.9, False), (1.5, True)):
        curve = np.array([[0, 0.5 + late * tick, 0.5 + late * tick + 1e-9, 1.2], [0, 0, 1, 1]])
        assert (explorer.distance(curve, t, jump, tick) > 0.5) == far
