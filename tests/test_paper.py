"""The printed formulas, evaluated to the letter from their own text."""

import re

import mpmath
import pytest

from armsim.paper import to_the_letter
from armsim.paths import read_toml

FORMULAS = read_toml("paper/tableaux.toml")["ndp6"]


def expression(formula):
    """Right side of a printed formula as Python."""
    text = re.sub(r"\\left|\\right|\^\{ij\}|\\(?=exp)", "", formula.partition("=")[2])
    text = text.replace(r"x_{ij}(n\tau)", "y").replace("f'(", "slope(")
    text = re.sub(r"\\frac\{k_(\d)\}\{(\d+)\}", r"k[\1]/\2", text)
    text = re.sub(r"\\frac\{(-?\d+)\}\{(\d+)\}", r"mpf(\1)/\2", text)
    text = re.sub(r"k_(\d)", r"k[\1]", text)
    return re.sub(r"(?<=[\w)\]]) *(?=exp|k)", "*", text).strip()


def test_a_formula_as_python():
    assert expression(FORMULAS["stages"][1]) == "slope(y*exp(k[1]/5))"
    assert expression(FORMULAS["stages"][2]) == "slope(y*exp(mpf(3)/40*k[1])*exp(mpf(9)/40*k[2]))"
    assert expression(FORMULAS["weights"]).startswith("y*exp(mpf(5179)/57600)*k[1]*exp(")


@pytest.mark.parametrize(("rate", "steps"), [(-1.0, 1), (-0.1, 3), (0.1, 3)])
def test_eq_15_and_16_in_multiprecision(rate, steps):
    names = {"mpf": mpmath.mpf, "exp": mpmath.exp, "slope": lambda y: rate * y}
    y, values = mpmath.mpf(1), [1.0]
    for _ in range(steps):
        k = {}
        for n, formula in enumerate(FORMULAS["stages"], start=1):
            k[n] = eval(expression(formula), names | {"y": y, "k": k})
        y = eval(expression(FORMULAS["weights"]), names | {"y": y, "k": k})
        values.append(float(y))
    assert to_the_letter(lambda y: rate * y, 1.0, steps) == pytest.approx(values, rel=1e-12)


def test_an_overflow_ends_it():
    values = to_the_letter(lambda y: -y, 1.0, 8)
    assert len(values) < 9
    assert abs(values[-1]) not in values[:-1]
    assert not mpmath.isfinite(values[-1])
