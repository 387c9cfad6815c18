"""Tables, Butcher tableaux and formulas of the paper as printed, misprints included."""

import re
from collections.abc import Callable

import numpy as np
import sympy

from armsim.methods.tableaux import Tableau
from armsim.paths import read_toml

# --- tables -----------------------------------------------------------------------------------

#: Tables 1 to 5, one list of rows per table.
TABLES: dict[str, list[dict[str, str]]] = read_toml("paper/tables.toml")


def printed_value(text: str) -> float:
    """Return the number in a table entry such as ``"0.56 ohms"``; for a range, its upper end.

    The paper's procedure sets `K_2` to its upper end (Section 4: "at its maximum").
    """
    text = re.sub(r"\s*\\cdot\s*10\^", "e", text)
    return float(re.findall(r"\d+(?:\.\d+)?(?:e\d+)?", text.partition("²")[0])[text.count(" to ")])


# --- tableaux ---------------------------------------------------------------------------------


def _terms(formula: str) -> dict[int, tuple[int, int]]:
    """Unreduced numerators and denominators of k_1, k_2, … in a formula of the paper.

    Brackets and the exponentials around single terms are ignored because the paper misplaces
    both. The rest is a sum of terms ``sign fraction k_j``.
    """
    text = re.sub(r"\^\{?ij?\}?|\\left|\\right|\\exp|[()\[\]\s]", "", formula.partition("=")[2])
    text = re.sub(r"\\frac\{(k_\d)\}\{(\d+)\}", r"\\frac{1}{\2}\1", text)
    common = 1
    if factor := re.search(r"\\frac\{1\}\{(\d+)\}(?=\d+k)", text):  # 1/90 [7 k_1 + …]
        common = int(factor[1])
        text = text.replace(factor[0], "")
    found = {}
    term = re.compile(r"([+-]?)(?:\\frac\{(-?\d+)\}\{(\d+)\}|(\d+)|)k_(\d)")
    for sign, numerator, denominator, integer, stage in term.findall(text):
        value = int(numerator or integer or 1) * (-1 if sign == "-" else 1)
        found[int(stage)] = (value, common * int(denominator or 1))
    return found


def printed_fractions(key: str) -> list[list[tuple[int, int]]]:
    """Rows of A, then b, as ``(numerator, denominator)``, exactly as the paper prints them.

    Parameters
    ----------
    key : {"rk5", "rk6", "ndp5", "ndp6"}
        Method of the paper.

    Returns
    -------
    list of s + 1 rows of s pairs
        A coefficient that is not printed is ``(0, 1)``.
    """
    if key not in _FORMULAS:
        raise ValueError(f"printed tableau {key!r}: not in the paper; it prints {list(_FORMULAS)}")
    formulas = [*_FORMULAS[key]["stages"], _FORMULAS[key]["weights"]]
    rows = [_terms(formula) for formula in formulas]
    return [[row.get(j, (0, 1)) for j in range(1, len(formulas))] for row in rows]


def _as_printed(key: str) -> Tableau:
    *A, b = [[sympy.Rational(*pair) for pair in row] for row in printed_fractions(key)]
    name, where = _FORMULAS[key]["name"], _FORMULAS[key]["equations"]
    return Tableau(f"{name}, as printed", A, b, reference=f"the paper, eq. {where}")


_FORMULAS = read_toml("paper/tableaux.toml")

#: The four tableaux of the paper's eq. (10)-(16): ``"rk5"``, ``"rk6"``, ``"ndp5"``, ``"ndp6"``.
PRINTED = {key: _as_printed(key) for key in _FORMULAS}


def to_the_letter(slope: Callable[[float], float], y: float, steps: int) -> list[float]:
    """Apply eq. (15) and (16) word for word to y' = slope(y).

    There is no step size. In eq. (16) the exponentials contain only the coefficients, and every
    k_i but the last is a factor behind its exponential.

    Returns
    -------
    list of float
        The start and the value after each step; the last one is not finite after an overflow.
    """
    method, values = PRINTED["ndp6"], [y]
    A, b = np.array(method.A, dtype=float), np.array(method.b, dtype=float)
    printed = np.flatnonzero(b[:-1])  # no term has k_2
    with np.errstate(all="ignore"):
        while len(values) <= steps and np.isfinite(y):
            k = np.zeros(b.size)
            for stage, row in enumerate(A):
                k[stage] = slope(y * np.exp(row @ k))
            y = y * np.prod(np.exp(b[printed]) * k[printed]) * np.exp(b[-1] * k[-1])
            values.append(float(y))
    return values
