"""The explorer's table: packed curves against the runs that they come from."""

from itertools import product

import numpy as np
import pytest

from armbook import explorer
from armsim.arm import AxisParameters, simulate

GRID = {"T_p": (0.021, 0.04), "K_2": (870.0,), "set_velocity": (2.0, 10.0)}


@pytest.fixture(scope="module")
def table():
    return explorer.table(GRID)


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
    for case, (T_p, K_2, volts) in enumerate(product(*GRID.values())):
        run = simulate(AxisParameters.paper_x_axis(T_p=T_p, K_2=K_2), volts, explorer.T_END)
        exact = (*run(explorer.TIMES)[[1, 6]], run.auxiliary(explorer.TIMES)["f_g"])
        for (t, y), true, unit in zip(
            explorer.curves(table, case), exact, table["scale"], strict=True
        ):
            off = np.abs(np.interp(explorer.TIMES, t, y) - true).max()
            assert off <= explorer.TOLERANCE * np.ptp(true) + 0.51 * unit


def test_distance_forgives_a_tick_and_no_more():
    tick = explorer.TIMES[1]
    t = np.linspace(0.1, 1.1, 50_001)
    jump = (t > 0.5).astype(float)
    for late, far in ((0.9, False), (1.5, True)):
        curve = np.array([[0, 0.5 + late * tick, 0.5 + late * tick + 1e-9, 1.2], [0, 0, 1, 1]])
        assert (explorer.distance(curve, t, jump) > 0.5) == far
