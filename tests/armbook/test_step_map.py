"""What is read off a map, against plain loops over its points."""

import numpy as np
import pytest

from armbook.step_map import missing_up_to, peak, spread

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


def test_what_is_missing_from_the_beginning_of_a_row():
    assert missing_up_to(MAP[2], X) == 0.2
    assert missing_up_to(np.full(4, np.nan), X) == 0.8
    assert missing_up_to(np.array([np.nan, 1.0, np.nan, np.nan]), X) == 0.1
    assert np.isnan(missing_up_to(MAP[0], X))  # the end is missing, for another reason
    assert np.isnan(missing_up_to(np.ones(4), X))
