"""Tests of the looks of methods and of the parts of the arm."""

from armbook import styles
from reportkit import figures


def test_every_method_has_a_colour_and_a_marker_of_its_own():
    looks = [styles.LOOK[method.name] for method in styles.METHODS]
    assert len({look["color"] for look in looks}) == len({look["marker"] for look in looks}) == 6
    assert styles.LOOK["DP4"]["color"] == figures.PALETTE[1]
    assert styles.EXACT not in [look["color"] for look in looks]


def test_a_solver_of_a_library_looks_like_a_method_that_is_not_drawn_beside_it():
    beside = ["DP4", "RK6 (Butcher)", "DP5(4)", "SciPy odeint", "CVODE BDF", "SciPy Radau"]
    assert len({styles.LOOK[name]["color"] for name in beside}) == len(beside)
    liars = ["CVODE BDF", "CVODE Adams", "SciPy Radau"]
    assert len({styles.LOOK[name]["color"] for name in liars}) == len(liars)
