"""Exact Butcher tableaux of the paper's methods, with its misprints corrected.

Each tableau is written once, in ``tableaux.toml`` beside this file. Nodes, stage count, reuse of
the last stage, floats and compiled code are derived from it.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any

import numpy as np
import sympy


@dataclass(frozen=True, eq=False)
class Tableau:
    r"""An explicit Runge-Kutta method :math:`(A, b, c)`.

    Parameters
    ----------
    name : str
        Short name, used in messages and legends.
    A : (s, s) array_like of exact numbers
        Strictly lower triangular stage coefficients: integers, fractions, SymPy numbers or
        strings such as ``"1/4"``. Floats are rejected because they are not exact.
    b : (s,) array_like of exact numbers
        Weights.
    b_embedded : (s,) array_like of exact numbers, optional
        Weights of the embedded method whose difference from `b` estimates the error.
    interpolant : (s, q) array_like of exact numbers, optional
        Coefficients of the weights of a continuous extension: row i holds those of
        :math:`b_i(\theta) = \sum_k p_{ik} \theta^k`, k = 1 … q.
    reference : str
        Source of the coefficients.

    Raises
    ------
    ValueError
        If a coefficient is not an exact number, a row has the wrong length, or the tableau is
        not explicit.
    """

    name: str
    A: sympy.Array
    b: sympy.Array
    b_embedded: sympy.Array | None = None
    interpolant: sympy.Array | None = field(default=None, repr=False)
    reference: str = field(default="", repr=False)

    def __post_init__(self) -> None:
        if (s := len([*self.A])) == 0:  # of an array, len counts all entries
            raise ValueError(f"tableau {self.name}: A is empty; at least one stage is needed")
        for label in ("A", "b", "b_embedded", "interpolant"):
            if (given := getattr(self, label)) is not None:
                exact = [self._row(label, i, item, s) for i, item in enumerate(given)]
                self._check_length(label, exact, s)
                object.__setattr__(self, label, sympy.ImmutableDenseNDimArray(exact))
        for i, j in combinations_with_replacement(range(s), 2):
            if self.A[i, j] != 0:
                raise ValueError(
                    f"tableau {self.name}: A[{i}][{j}] = {self.A[i, j]} makes the method implicit; "
                    "entries on and above the diagonal must be 0"
                )

    def _row(self, label: str, i: int, item: Any, s: int) -> Any:
        """Return a weight, or a row of a matrix, in exact numbers."""
        where = f"{label}[{i}]"
        if label not in ("A", "interpolant"):
            return _exact(item, where)
        row = [_exact(number, f"{where}[{j}]") for j, number in enumerate(item)]
        if label == "A":
            self._check_length(where, row, s)
        return row

    def _check_length(self, label: str, row: list, s: int) -> None:
        if len(row) != s:
            raise ValueError(
                f"tableau {self.name}: {label} has {len(row)} entries; a tableau of {s} stages "
                f"needs {s}"
            )

    @cached_property
    def c(self) -> sympy.Array:
        """Nodes as the row sums of `A`, so that each stage is consistent with its time."""
        return sympy.ImmutableDenseNDimArray([sympy.expand(sum(row)) for row in self.A])

    @property
    def stages(self) -> int:
        """Number of stages s."""
        return len(self.b)

    @cached_property
    def fsal(self) -> bool:
        """Whether the last stage is the first stage of the next step ("first same as last")."""
        return self.stages > 1 and list(self.A[-1]) == list(self.b)

    @cached_property
    def evaluated_stages(self) -> tuple[int, ...]:
        """Stages needed by a fixed step: those that affect the result through the weights `b`."""
        needed: set[int] = set()
        for i in reversed(range(self.stages)):
            if self.b[i] != 0 or any(self.A[k, i] != 0 for k in needed):
                needed.add(i)
        return tuple(sorted(needed))

    def exponentials(self, product: bool = False) -> int:
        """Count the exponentials of one component in a step of the exponential form.

        Parameters
        ----------
        product : bool
            Whether the exponentials of single terms are multiplied, as printed in the paper,
            instead of taking one exponential of the sum.
        """
        rows = [*(self.A[i] for i in self.evaluated_stages), self.b]
        counts = [sum(a != 0 for a in row) for row in rows]
        return sum(counts) if product else sum(count > 0 for count in counts)

    def floats(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Double-precision ``A`` (s, s), ``b`` (s,) and ``c`` (s,), rounded only here."""
        A, b, c = (np.array(part.tolist(), dtype=float) for part in (self.A, self.b, self.c))
        return A, b, c


def _exact(value: object, where: str) -> sympy.Expr:
    if isinstance(value, bool | float | np.floating):
        raise ValueError(f"{where} = {value!r} is not exact; give an integer, fraction or string")
    try:
        number = sympy.sympify(value, rational=True)
    except (sympy.SympifyError, TypeError) as error:
        raise ValueError(f"{where} = {value!r} is not a number") from error
    if not (number.is_number and number.is_real):
        raise ValueError(f"{where} = {value!r} is not a real number")
    return number


def _corrected(name: str, A: str, b: str, reference: str, **more: str) -> Tableau:
    """Tableau from its texts in ``tableaux.toml``."""
    below = [[], *(row.split() for row in A.splitlines())]
    square = [row + ["0"] * (len(below) - len(row)) for row in below]
    rows: dict[str, Any] = {label: text.split() for label, text in more.items()}
    if "interpolant" in more:
        rows["interpolant"] = [row.split() for row in more["interpolant"].splitlines()]
    return Tableau(name, square, b.split(), reference=reference, **rows)


_FILE = Path(__file__).with_name("tableaux.toml")
_TABLES = tomllib.loads(_FILE.read_text(encoding="utf-8"))

EULER = _corrected(**_TABLES["EULER"])
RK4_GILL = _corrected(**_TABLES["RK4_GILL"])
RK5 = _corrected(**_TABLES["RK5"])
RK6 = _corrected(**_TABLES["RK6"])
DP5 = _corrected(**_TABLES["DP5"])
#: Embedded weights of the same pair, which the paper presents as a sixth-order method.
DP4 = Tableau("DP4", DP5.A, DP5.b_embedded, reference=DP5.reference)
