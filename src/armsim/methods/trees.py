r"""Rooted trees and the order conditions of Runge-Kutta methods, in exact numbers.

A rooted tree is represented by the tuple of the subtrees of its root: ``()`` is the single node τ,
``((),)`` is [τ] and ``((), ())`` is [τ, τ]. Subtrees are in descending order, so that equal trees
are equal tuples.

A method has order p if and only if its elementary weight :math:`\Phi(t)` is
:math:`1/\gamma(t)` for every tree t of up to p nodes (Hairer, Nørsett and Wanner, *Solving
Ordinary Differential Equations I*, theorem II.2.13; Butcher, *Numerical Methods for Ordinary
Differential Equations*, chapter 3).
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import chain, count, groupby
from math import factorial, prod
from typing import Any

import sympy
from sympy.polys.constructor import construct_domain
from sympy.tensor.array.arrayop import Flatten

from armsim.checks import checked_count
from armsim.methods.tableaux import Tableau

Tree = tuple["Tree", ...]


@cache
def rooted_trees(order: int) -> tuple[Tree, ...]:
    """All rooted trees with `order` nodes, bushy ones first.

    Raises
    ------
    TypeError, ValueError
        If `order` is not a positive integer.

    Examples
    --------
    >>> [len(rooted_trees(n)) for n in range(1, 9)]
    [1, 1, 2, 4, 9, 20, 48, 115]
    """
    if checked_count("order", order) == 1:
        return ((),)
    # Removing the first and greatest subtree leaves a smaller tree.
    return tuple(
        (branch, *rest)
        for size in range(1, order)
        for branch in rooted_trees(size)
        for rest in rooted_trees(order - size)
        if not rest or rest[0] <= branch
    )


@cache
def size(tree: Tree) -> int:
    """Number of nodes of a tree, its order."""
    return 1 + sum(map(size, tree))


@cache
def symmetry(tree: Tree) -> int:
    r"""Number of ways to exchange equal subtrees, :math:`\sigma(t)`."""
    equal = [(branch, len(list(group))) for branch, group in groupby(tree)]
    return prod(factorial(times) * symmetry(branch) ** times for branch, times in equal)


@cache
def density(tree: Tree) -> int:
    r"""Product of the sizes of all subtrees, including the tree itself, :math:`\gamma(t)`."""
    return size(tree) * prod(map(density, tree))


def elementary_weight(tree: Tree, A: Sequence[Sequence[Any]], b: Sequence[Any]) -> Any:
    r"""Elementary weight :math:`\Phi(t)` of a method, in the arithmetic of `A` and `b`.

    Parameters
    ----------
    tree : nested tuples
    A : (s, s) nested sequence of numbers
        Fractions, SymPy numbers, floats or other numbers with addition and multiplication.
    b : (s,) sequence of numbers

    Returns
    -------
    number
        :math:`\sum_i b_i \prod_k g_{k,i}` over the subtrees k of the root, where each subtree
        has :math:`g_{k,i} = \sum_j a_{ij} \prod_l g_{l,j}` over its own subtrees l.

    Examples
    --------
    >>> elementary_weight(((), ()), [[0, 0], [0.5, 0]], [0, 1])  # Σ b c² of the midpoint rule
    0.25
    """
    return _dot(b, _product(tree, A, {}))


def _dot(left: Sequence[Any], right: Sequence[Any]) -> Any:
    return sum(x * y for x, y in zip(left, right, strict=True) if x)


def _product(tree: Tree, A: Sequence[Sequence[Any]], known: dict[Tree, list[Any]]) -> list[Any]:
    """Product over the subtrees for each stage; `known` caches the products by tree."""
    if tree not in known:
        branches = [[_dot(row, _product(branch, A, known)) for row in A] for branch in tree]
        known[tree] = [prod(values) for values in zip(*branches, strict=True)] or [1] * len(A)
    return known[tree]


@dataclass(frozen=True)
class Condition:
    r"""One order condition of a method: :math:`\Phi(t) = 1/\gamma(t)`."""

    tree: Tree
    order: int  #: nodes of the tree
    weight: sympy.Expr  #: elementary weight, exact
    residual: sympy.Expr  #: weight - 1/density, zero if the condition holds


def _conditions(tableau: Tableau, orders: Iterable[int]) -> Iterator[Condition]:
    """Evaluate the conditions of some orders exactly, over the smallest field for the tableau."""
    known: dict[Tree, list[Any]] = {}
    field, numbers = construct_domain([*Flatten(tableau.A), *tableau.b], field=True, extension=True)
    s = tableau.stages
    A, b = [numbers[i * s : (i + 1) * s] for i in range(s)], numbers[s * s :]
    for tree in chain.from_iterable(map(rooted_trees, orders)):
        weight = field.convert(_dot(b, _product(tree, A, known)))
        residual = weight - field.one / field.convert(density(tree))
        yield Condition(tree, size(tree), field.to_sympy(weight), field.to_sympy(residual))


def residuals(tableau: Tableau, order: int) -> list[Condition]:
    """Evaluate every order condition up to `order` exactly.

    Returns
    -------
    list of Condition
        In the order of `rooted_trees`, small trees first.

    Raises
    ------
    TypeError, ValueError
        If `order` is not a positive integer.
    """
    return list(_conditions(tableau, range(1, checked_count("order", order) + 1)))


def order(tableau: Tableau) -> int:
    """Exact order of a method: the highest order up to which every condition holds.

    Examples
    --------
    >>> from armsim.methods import tableaux
    >>> order(tableaux.RK6), order(tableaux.DP4)
    (6, 4)
    """
    # An explicit method of s stages fails for the tall tree of s + 1 nodes, so this ends.
    return next(c.order for c in _conditions(tableau, count(1)) if c.residual != 0) - 1


def latex(tree: Tree) -> str:
    r"""LaTeX bracket notation of a tree, such as ``[\tau^{2},[\tau]]``.

    Examples
    --------
    >>> print(latex((((),), (), ())))
    [[\tau],\tau^{2}]
    """
    powers = [(latex(branch), len(list(group))) for branch, group in groupby(tree)]
    return f"[{','.join(t if n == 1 else f'{t}^{{{n}}}' for t, n in powers)}]" if tree else r"\tau"


def layout(tree: Tree) -> tuple[list[tuple[float, float]], list[tuple[int, int]]]:
    """Positions for drawing a tree, with the root at the origin and each leaf in its own column.

    Returns
    -------
    nodes : list of (x, y)
        Root first, at (0, 0); y is the distance from the root; neighbouring leaves are 1 apart.
    edges : list of (int, int)
        Indices of parent and child.
    """
    nodes: list[tuple[float, float]] = []
    edges: list[tuple[int, int]] = []
    columns = count()

    def place(branch: Tree, level: int) -> int:
        me = len(nodes)
        nodes.append((0.0, 0.0))
        below = [place(child, level + 1) for child in branch]
        edges.extend((me, child) for child in below)
        x = sum(nodes[k][0] for k in below) / len(below) if below else float(next(columns))
        nodes[me] = (x, float(level))
        return me

    place(tree, 0)
    root = nodes[0][0]
    return [(x - root, y) for x, y in nodes], edges
