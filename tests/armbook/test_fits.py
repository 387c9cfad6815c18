"""How the book tells a fit: digits, labels, and distances in standard errors."""

from types import SimpleNamespace

import numpy as np
import pytest

from armbook.fits import SCALE, UNITS, digits, in_errors, label, off_parabola
from armsim.arm.identify import NAMES


def test_every_fitted_parameter_has_a_unit_and_a_scale():
    assert set(UNITS) == set(SCALE) == set(NAMES)
    assert label("V_L") == "$V_L$ / V"
    assert label("K_g") == "$K_g$ / (kN/m)"


@pytest.mark.parametrize(
    ("value", "error", "scale", "text"),
    [
        (12.3456, 0.12, 1.0, "12.35"),  # two digits of the error
        (12.3456, 0.97, 1.0, "12.35"),
        (1234.56, 12.0, 1.0, "1235"),
        (1234.56, 200.0, 1.0, "1235"),  # never fewer than none
        (1234.56, 12.0, 1e-3, "1.235"),
        (np.nan, 0.1, 1.0, "–"),
    ],
)
def test_digits_end_at_a_tenth_of_the_error(value, error, scale, text):
    assert digits(value, error, scale) == text


def test_distances_are_in_standard_errors():
    fit = SimpleNamespace(values=np.array([1.0, 10.0]), standard_errors=np.array([0.1, 2.0]))
    assert in_errors(fit, (1.2, 4.0)) == pytest.approx([2.0, -3.0])


def test_the_distance_from_a_parabola_is_looked_for_near_the_estimate():
    x = np.array([-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0])
    rise = np.array([50.0, 4.1, 1.0, 0.0, 0.8, 4.0, 9.0])
    assert off_parabola(x, rise) == pytest.approx(0.2)
    assert off_parabola(x, rise, reach=4) == pytest.approx(41)
