"""Orders and evaluations of the printed formulas, from exact steps on polynomial test problems.

Every rooted tree has an initial-value problem that isolates it: node v stands for a component with
y_v' = product of the y_c over the children c of v, and all components start at zero. The exact
solution at t = 1 is 1/gamma in the root. One step of size 1 in rational arithmetic must give the
same number for all trees with up to p nodes if, and only if, the method has order p. The trees are
all arrays of parents in which a parent comes before its children; that repeats some, but leaves
out none.
"""

from collections.abc import Iterator
from fractions import Fraction
from functools import cache
from itertools import count, product
from math import prod

from printed_tableaux import FORMULAS, Tableau, first_same_as_last, printed, repaired

Parents = tuple[int, ...]  # of the nodes 1, 2, ...; node 0 is the root


def trees(nodes: int) -> Iterator[Parents]:
    """Every rooted tree with so many nodes, at least once."""
    return product(*(range(node) for node in range(1, nodes)))


def children(parents: Parents, node: int) -> list[int]:
    """Nodes that hang on a node."""
    return [child for child, parent in enumerate(parents, start=1) if parent == node]


def exact(parents: Parents) -> Fraction:
    """Root of the exact solution at t = 1: the integral of t^(n-1) over and over."""
    size, value = {}, {}
    for node in reversed(range(len(parents) + 1)):
        size[node] = 1 + sum(size[child] for child in children(parents, node))
        value[node] = prod((value[c] for c in children(parents, node)), start=Fraction(1))
        value[node] /= size[node]
    return value[0]


def one_step(tableau: Tableau, parents: Parents) -> Fraction:
    """Root of the numerical solution after one step of size 1."""
    rows, weights = tableau
    k = {}
    for node in reversed(range(len(parents) + 1)):
        below = [[dot(row, k[child]) for row in rows] for child in children(parents, node)]
        k[node] = [prod(factors, start=Fraction(1)) for factors in zip(*below, strict=True)]
        k[node] = k[node] or [Fraction(1)] * len(rows)  # a leaf: y' = 1
    return dot(weights, k[0])


def dot(left: list[Fraction], right: list[Fraction]) -> Fraction:
    """Scalar product."""
    return sum((a * b for a, b in zip(left, right, strict=True) if a), start=Fraction(0))


def order(tableau: Tableau) -> int:
    """Highest order whose conditions all hold, with those of all lower orders."""
    holds = (
        all(one_step(tableau, parents) == exact(parents) for parents in trees(nodes))
        for nodes in count(1)
    )
    return next(p for p, met in enumerate(holds) if not met)


def evaluations(tableau: Tableau) -> int:
    """Calls of the right-hand side in a second step, which may begin with a stage of the first."""
    rows, weights = tableau
    calls = []

    def step(y: Fraction, before: Fraction | None) -> tuple[Fraction, Fraction | None]:
        @cache
        def k(stage: int) -> Fraction:
            if stage == 0 and before is not None:
                return before
            calls.append(stage)
            return -(y + sum((a * k(j) for j, a in enumerate(rows[stage]) if a), start=Fraction(0)))

        end = y + sum((b * k(j) for j, b in enumerate(weights) if b), start=Fraction(0))
        return end, k(len(rows) - 1) if rows[-1] == weights else None

    state = step(Fraction(1), None)
    first = len(calls)
    step(*state)
    return len(calls) - first


def opinions() -> dict[str, tuple[float, float]]:
    """Recorded names with value and tolerance, which is zero: the numbers are counts."""
    values = {f"order_printed_{key}": order(printed(key)) for key in FORMULAS}
    values |= {f"order_after_{key}": order(repaired(key)) for key in FORMULAS}
    values |= {
        "order_RK5": values["order_after_rk5"],
        "evaluations_RK5": evaluations(repaired("rk5")),
        "evaluations_DP5": evaluations(first_same_as_last()),
        "evaluations_DP4": evaluations(repaired("ndp6")),
    }
    return {f"12_order_conditions::{name}": (float(value), 0.0) for name, value in values.items()}
