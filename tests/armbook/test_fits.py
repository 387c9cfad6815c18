"""Distances from a fit in standard errors."""

from types import SimpleNamespace

import numpy as np
import pytest

from armbook.fits import in_errors, off_parabola


def test_distances_are_in_standard_errors():
    fit = SimpleNamespace(values=np.array([1.0, 10.0]), standard_errors=np.array([0.1, 2.0]))
    assert in_errors(fit, (1.2, 4.0)) == pytest.approx([2.0, -3.0])


def test_the_distance_from_a_parabola_is_looked_for_near_the_estimate():
    x = np.array([-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0])
    rise = np.array([50.0, 4.1, 1.0, 0.0, 0.8, 4.0, 9.0])
    assert off_parabola(x, rise) == pytest.approx(0.2)
    assert off_parabola(x, rise, reach=4) == pytest.approx(41)
