"""Exact Butcher tableaux of the paper's methods, with its misprints corrected.

Each tableau is written once, as text. Nodes, stage count, reuse of the last stage, floats and
compiled code are derived from it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations_with_replacement
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
        if (s := len(self.A)) == 0:
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


def _lower(rows: str) -> list[list[str]]:
    """Square matrix from the text of its rows below the diagonal."""
    parts = [[], *(row.split() for row in rows.strip().splitlines())]
    return [part + ["0"] * (len(parts) - len(part)) for part in parts]


EULER = Tableau("Euler", [[0]], [1], reference="Euler, Institutionum calculi integralis I, 1768")

RK4_GILL = Tableau(
    "RK-Gill",
    _lower("""
        1/2
        (sqrt(2)-1)/2  (2-sqrt(2))/2
        0              -sqrt(2)/2     (2+sqrt(2))/2
    """),
    "1/6 (2-sqrt(2))/6 (2+sqrt(2))/6 1/6".split(),
    reference="Gill, Proc. Cambridge Phil. Soc. 47 (1951) 96-108",
)

RK5 = Tableau(
    "RK5 (Butcher)",
    _lower("""
        1/4
        1/8    1/8
        0     -1/2   1
        3/16   0     0      9/16
        -3/7   2/7   12/7  -12/7   8/7
    """),
    "7/90 0 32/90 12/90 32/90 7/90".split(),
    reference="Butcher, J. Austral. Math. Soc. 4 (1964) 179-194",
)

RK6 = Tableau(
    "RK6 (Butcher)",
    _lower("""
        1/2
        2/9      4/9
        7/36     2/9    -1/12
        -35/144  -55/36  35/48   15/8
        -1/360   -11/36  -1/8    1/2      1/10
        -41/260  22/13   43/156  -118/39  32/195  80/39
    """),
    "13/200 0 11/40 11/40 4/25 4/25 13/200".split(),
    reference="Butcher, J. Austral. Math. Soc. 4 (1964) 179-194",
)

_DP_ROWS = _lower("""
    1/5
    3/40        9/40
    44/45       -56/15       32/9
    19372/6561  -25360/2187  64448/6561  -212/729
    9017/3168   -355/33      46732/5247  49/176    -5103/18656
    35/384      0            500/1113    125/192   -2187/6784   11/84
""")
_DP_FIFTH = "35/384 0 500/1113 125/192 -2187/6784 11/84 0".split()
_DP_FOURTH = "5179/57600 0 7571/16695 393/640 -92097/339200 187/2100 1/40".split()
_DP_REFERENCE = "Dormand and Prince, J. Comput. Appl. Math. 6 (1980) 19-26, RK5(4)7M"

# Fourth-order interpolant with continuous derivative: Shampine, Math. Comp. 46 (1986) 135-150
_DP_INTERPOLANT = [
    row.split()
    for row in """
    1  -8048581381/2820520608     8663915743/2820520608     -12715105075/11282082432
    0   0                         0                          0
    0   131558114200/32700410799 -68118460800/10900136933    87487479700/32700410799
    0  -1754552775/470086768      14199869525/1410260304    -10690763975/1880347072
    0   127303824393/49829197408 -318862633887/49829197408   701980252875/199316789632
    0  -282668133/205662961       2019193451/616988883      -1453857185/822651844
    0   40617522/29380423        -110615467/29380423         69997945/29380423
    """.strip().splitlines()
]

DP5 = Tableau(
    "DP5",
    _DP_ROWS,
    _DP_FIFTH,
    b_embedded=_DP_FOURTH,
    interpolant=_DP_INTERPOLANT,
    reference=_DP_REFERENCE,
)
#: Embedded weights of the same pair, which the paper presents as a sixth-order method.
DP4 = Tableau("DP4", _DP_ROWS, _DP_FOURTH, reference=_DP_REFERENCE)
