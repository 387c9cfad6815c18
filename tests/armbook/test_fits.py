"""The input of the notebook of the parameter fit, and distances in standard errors."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from armbook.fits import checked, in_errors, off_parabola, read
from armsim.paths import DATA

USUAL = {"measurements": "", "axis": "", "bounds": "", "starts": 5, "refits": 1000,
         "coarse_step": 1e-4, "fine_step": 5e-6}  # fmt: skip
RECORD = DATA / "measurements" / "x_axis_test.csv"


def test_distances_are_in_standard_errors():
    fit = SimpleNamespace(values=np.array([1.0, 10.0]), standard_errors=np.array([0.1, 2.0]))
    assert in_errors(fit, (1.2, 4.0)) == pytest.approx([2.0, -3.0])


def test_the_distance_from_a_parabola_is_looked_for_near_the_estimate():
    x = np.array([-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0])
    rise = np.array([50.0, 4.1, 1.0, 0.0, 0.8, 4.0, 9.0])
    assert off_parabola(x, rise) == pytest.approx(0.2)
    assert off_parabola(x, rise, reach=4) == pytest.approx(41)


def test_bounds_are_read_from_text():
    (record, axis, _), bounds = read("", "", "F_0 = [1, 60], b_g = [5e2, 5_000]")
    assert bounds == {"F_0": [1, 60], "b_g": [500, 5000]}
    assert (record.t.size, axis.V_L) == (651, 2.783)


@pytest.mark.parametrize("text", ["F_0", "F_0 1 60", "F_0 = [1", "F_0 = [1, 60]; b_g", "= " * 9])
def test_bounds_that_cannot_be_read_are_quoted(text):
    with pytest.raises(ValueError, match=r"^bounds = .*: expected NAME = \[LOW, HIGH\], …$"):
        read("", "", text)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"bounds": "M = [1, 2]"}, "bounds for M, not among the fitted"),
        ({"bounds": "F_0 = 3"}, "bounds of F_0: 3; 0 < low < high"),
        ({"measurements": str(DATA / "axes" / "x.toml")}, "x.toml, row 4: no column"),
        ({"axis": str(RECORD)}, "x_axis_test.csv: not a TOML file"),
        ({"axis": str(DATA / "axes" / "z.toml")}, None),
    ],
)
def test_what_cannot_be_fitted_is_refused_before_the_run(changes, message):
    if message is None:
        assert checked(USUAL | changes) == ""
    else:
        with pytest.raises(ValueError, match=message) as caught:
            checked(USUAL | changes)
        assert "\n" not in str(caught.value)


def test_long_work_is_told_beforehand():
    """The published record takes less than two minutes, with the usual parameters."""
    assert checked(USUAL) == ""
    assert re.fullmatch(
        ", about [0-9]+ minutes; fewer refits .*", checked(USUAL | {"fine_step": 1e-7})
    )
