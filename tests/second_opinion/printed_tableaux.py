"""Read the Runge-Kutta coefficients from the printed formulas, and repair the misprints.

Brackets and exponentials around single terms are ignored: what counts is the factor in front of
each k. All numbers are fractions.
"""

import re
from fractions import Fraction

from printed_values import load

Tableau = tuple[list[list[Fraction]], list[Fraction]]  # rows of A, weights b

FORMULAS = load("paper/tableaux.toml")

#: The coefficients of Butcher (1964) and of Dormand and Prince (1980) where the print differs, by
#: the stage whose formula has them and the stage that they multiply.
DORMAND_PRINCE = {(5, 1): Fraction(19372, 6561), (6, 3): Fraction(46732, 5247)}
REPAIRS = {
    "rk5": {(6, 1): Fraction(-3, 7)},
    "rk6": {(7, 3): Fraction(43, 156)},
    "ndp5": DORMAND_PRINCE,
    "ndp6": DORMAND_PRINCE,
}

TERM = re.compile(r"([+-]?)(?:\\frac\{(-?\d+)\}\{(\d+)\}|(\d*))k_(\d)")


def coefficients(formula: str, stages: int) -> list[Fraction]:
    """Factors of k_1, k_2, ... on the right-hand side of one formula."""
    right = formula.partition("=")[2]
    common = re.search(r"\\frac\{1\}\{(\d+)\}\[", right)  # 1/90 in front of all weights
    right = right.replace(common[0], "") if common else right
    right = re.sub(r"\^i|\^\{ij\}|x_\{ij\}|\(n\\tau\)|\\left|\\right|\\exp|f'|[][()\s]", "", right)
    right = re.sub(r"\\frac\{(k_\d)\}", r"\\frac{1}\1", right)  # k_1/5 is 1/5 k_1
    right = re.sub(r"(k_\d)(\{\d+\})", r"\2\1", right)
    row = [Fraction(0)] * stages
    for sign, upper, lower, whole, k in TERM.findall(right):
        size = Fraction(int(upper or whole or 1), int(lower or 1))
        row[int(k) - 1] = (-size if sign == "-" else size) / int(common[1] if common else 1)
    return row


def printed(key: str) -> Tableau:
    """Tableau as printed."""
    stages = FORMULAS[key]["stages"]
    return (
        [coefficients(formula, len(stages)) for formula in stages],
        coefficients(FORMULAS[key]["weights"], len(stages)),
    )


def repaired(key: str) -> Tableau:
    """Tableau with the misprints put right."""
    rows, weights = printed(key)
    for (stage, k), value in REPAIRS[key].items():
        rows[stage - 1][k - 1] = value
    return rows, weights


def first_same_as_last() -> Tableau:
    """Seven stages of Dormand and Prince with their fifth-order weights."""
    return repaired("ndp6")[0], [*repaired("ndp5")[1], Fraction(0)]
