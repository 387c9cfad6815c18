"""What is read off a map, against plain loops over its points."""

import numpy as np
import pytest

from armbook.step_map import last_missing, peak, spread

X, Y = np.array([0.1, 0.2, 0.4, 0.8]), np.array([10.0, 20.0, 30.0])
MAP = np.array([[1.0, 2.0, 3.0, np.nan], [np.nan, 7.0, 4.0, 5.0], [np.nan, np.nan, 6.0, 1.0]])


def test_the_peak_is_the_largest_of_all_points():
    points = [(MAP[m, n], X[n], Y[m]) for m in range(3) for n in range(4) if MAP[m, n] == MAP[m, n]]
    assert peak(MAP, X, Y) == max(points)
    assert peak(MAP[-1:], X, Y[-1:]) == (6.0, 0.4, 30.0)
    assert np.isnan(peak(np.full((2, 2), np.nan), X[:2], Y[:2])).all()


def test_the_spread_is_within_a_column():
    columns = [[v for v in column if v == v] for column in MAP.T]
    assert spread(MAP) == pytest.approx(max(max(c) / min(c) for c in columns) - 1)


def test_the_last_missing_point_of_a_row():
    assert last_missing(MAP[2], X) == 0.2
    assert last_missing(MAP[0], X) == 0.8
    assert np.isnan(last_missing(np.ones(4), X))
