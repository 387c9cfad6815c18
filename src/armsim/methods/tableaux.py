"""Exact Butcher tableaux of the paper's methods, with its misprints corrected.

Each tableau is written once, in ``tableaux.toml`` beside this file. Nodes, stage count, reuse of
the last stage, floats and compiled code are derived from it.
"""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations_with_replacement
from numbers import Rational
from operator import add, mul, sub, truediv
from pathlib import Path
from typing import Any

import numpy as np
import sympy

#: Operations that a coefficient in text may contain.
_OPERATIONS: dict[type, Callable] = {ast.Add: add, ast.Sub: sub, ast.Mult: mul, ast.Div: truediv}


@dataclass(frozen=True)
class Tableau:
    r"""An explicit Runge-Kutta method :math:`(A, b, c)`.

    Parameters
    ----------
    name : str
        Short name, used in messages and legends.
    A : (s, s) array_like of exact numbers
        Strictly lower triangular stage coefficients: integers, fractions, SymPy numbers or
        strings such as ``"1/4"``, ``"0.25"`` or ``"(2-sqrt(2))/2"``. Floats of any kind are
        rejected because they are not exact.
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
    reference: str = field(default="", repr=False, compare=False)

    def __post_init__(self) -> None:
        name, s = f"tableau {self.name}", len([*self.A])  # of an array, len counts all entries
        if s == 0:
            raise ValueError(f"{name}: A is empty; at least one stage is needed")
        for label in ("A", "b", "b_embedded", "interpolant"):
            if (given := getattr(self, label)) is None:
                continue
            exact = _exact(given, label, 2 if label in ("A", "interpolant") else 1)
            rows = {f"A[{i}]": row for i, row in enumerate(exact)} if label == "A" else {}
            for where, row in {label: exact, **rows}.items():
                if len(row) != s:
                    found = f"{where} has {len(row)} entries"
                    raise ValueError(f"{name}: {found}; a tableau of {s} stages needs {s}")
            object.__setattr__(self, label, sympy.ImmutableDenseNDimArray(exact))
            for i, j in combinations_with_replacement(range(s), 2):
                if label == "A" and exact[i][j] != 0:
                    entry = f"A[{i}][{j}] = {exact[i][j]}"
                    raise ValueError(f"{name}: {entry} makes the method implicit; it must be 0")

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
        """Stages needed by a fixed step, those that affect the result through the weights `b`."""
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

    def floats(self) -> tuple[np.ndarray, ...]:
        """Double-precision ``A`` (s, s), ``b`` (s,) and ``c`` (s,), rounded only here."""
        return tuple(np.array(part, dtype=float) for part in (self.A, self.b, self.c))


def _exact(value: Any, where: str, depth: int = 0) -> Any:
    """Return a number, or rows of them nested to a depth, exactly."""
    if depth:
        return [_exact(item, f"{where}[{i}]", depth - 1) for i, item in enumerate(value)]
    exact = isinstance(value, str | Rational | sympy.Expr) and not isinstance(value, bool)
    if not exact or (isinstance(value, sympy.Expr) and value.has(sympy.Float)):
        raise ValueError(f"{where} = {value!r} is not exact; give an integer, fraction or string")
    try:
        number = _parsed(value.strip()) if isinstance(value, str) else sympy.sympify(value)
    except (SyntaxError, ValueError, TypeError, RecursionError, MemoryError) as error:
        raise ValueError(f"{where} = {value!r} is not a number") from error
    if not (number.is_number and number.is_real):
        raise ValueError(f"{where} = {value!r} is not a real number of digits + - * / ( ) sqrt")
    return number


def _parsed(text: str) -> sympy.Expr:
    """Exact value of a text, which is never run as code; NaN if it contains anything else."""

    def value(node: ast.AST) -> sympy.Expr:
        digits = ast.get_source_segment(text, node) or ""
        match node:
            case ast.BinOp(left, sign, right) if type(sign) in _OPERATIONS:
                return _OPERATIONS[type(sign)](value(left), value(right))
            case ast.UnaryOp(ast.USub() | ast.UAdd() as sign, part):
                return -value(part) if isinstance(sign, ast.USub) else value(part)
            case ast.Call(ast.Name("sqrt"), [part], []):
                return sympy.sqrt(value(part))
            case ast.Constant() if re.fullmatch(r"[0-9.]+(e-?[0-9]{1,2})?", digits):
                return sympy.Rational(digits)
        return sympy.nan

    return value(ast.parse(text, mode="eval").body)


def _corrected(name: str, A: str, b: str, reference: str, **more: str) -> Tableau:
    """Tableau from its texts in ``tableaux.toml``."""
    below = [[], *(row.split() for row in A.splitlines())]
    square = [row + ["0"] * (len(below) - len(row)) for row in below]
    rows: dict[str, Any] = {label: text.split() for label, text in more.items()}
    if "interpolant" in more:
        rows["interpolant"] = [row.split() for row in more["interpolant"].splitlines()]
    return Tableau(name, square, b.split(), reference=reference, **rows)


_TABLES = tomllib.loads(Path(__file__).with_name("tableaux.toml").read_text(encoding="utf-8"))

# In the order of the file.
EULER, RK4_GILL, RK5, RK6, DP5 = (_corrected(**table) for table in _TABLES.values())
#: Embedded weights of the same pair, which the paper presents as a sixth-order method.
DP4 = Tableau("DP4", DP5.A, DP5.b_embedded, reference=DP5.reference)
