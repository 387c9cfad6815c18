"""Order conditions against known values and against NodePy."""

import math
import re
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nodepy import rk, rt

from armsim.methods import tableaux, trees
from armsim.methods.tableaux import Tableau
from armsim.paper import PRINTED

ORDERS = {"EULER": 1, "RK4_GILL": 4, "RK5": 5, "RK6": 6, "DP5": 5, "DP4": 4}
T = ()  # the tree of one node


def tree_of(notation):
    """Canonical tuple of a tree in NodePy's notation, such as ``{T^2{T}}``."""
    tokens = re.findall(r"[{}T]|\^\d+", notation)

    def branches():
        found = []
        while tokens and tokens[0] != "}":
            token = tokens.pop(0)
            if token[0] == "^":
                found += [found[-1]] * (int(token[1:]) - 1)
            elif token == "T":
                found.append(())
            else:
                found.append(branches())
                tokens.pop(0)
        return tuple(sorted(found, reverse=True))

    return branches()[0]


def fractions(tableau):
    """A and b of a rational tableau as lists of fractions."""
    *A, b = [[Fraction(int(x.p), int(x.q)) for x in row] for row in [*tableau.A, tableau.b]]
    return A, b


def has_order(A, b, order):
    return all(
        trees.elementary_weight(tree, A, b) * trees.density(tree) == 1
        for n in range(1, order + 1)
        for tree in trees.rooted_trees(n)
    )


def test_number_of_trees_up_to_ten_nodes():
    # Butcher's table; OEIS A000081
    expected = [1, 1, 2, 4, 9, 20, 48, 115, 286, 719]
    assert [len(trees.rooted_trees(n)) for n in range(1, 11)] == expected
    assert all(len(set(trees.rooted_trees(n))) == k for n, k in enumerate(expected, 1))


@pytest.mark.parametrize("n", range(1, 9))
def test_trees_have_their_size_and_descending_subtrees(n):
    for tree in trees.rooted_trees(n):
        assert trees.size(tree) == n
        assert list(tree) == sorted(tree, reverse=True)


@pytest.mark.parametrize("n", range(1, 9))
def test_monotonic_labellings_add_up(n):
    # n!/(symmetry density) of a tree counts its increasing labellings; in all there are (n-1)!
    total = sum(
        Fraction(math.factorial(n), trees.symmetry(t) * trees.density(t))
        for t in trees.rooted_trees(n)
    )
    assert total == math.factorial(n - 1)


@pytest.mark.parametrize(
    ("tree", "symmetry", "density", "latex"),
    [  # Hairer, Norsett, Wanner I, table II.2.2 has the densities
        (T, 1, 1, r"\tau"),
        ((T,), 1, 2, r"[\tau]"),
        ((T, T), 2, 3, r"[\tau^{2}]"),
        (((T,),), 1, 6, r"[[\tau]]"),
        ((T, T, T), 6, 4, r"[\tau^{3}]"),
        (((T,), T), 1, 8, r"[[\tau],\tau]"),
        (((T, T),), 2, 12, r"[[\tau^{2}]]"),
        ((((T,),),), 1, 24, r"[[[\tau]]]"),
        (((T,), (T,)), 2, 20, r"[[\tau]^{2}]"),
        (((T, T), (T, T)), 8, 63, r"[[\tau^{2}]^{2}]"),
    ],
)
def test_known_trees(tree, symmetry, density, latex):
    assert tree in trees.rooted_trees(trees.size(tree))
    assert (trees.symmetry(tree), trees.density(tree)) == (symmetry, density)
    assert trees.latex(tree) == latex


@pytest.mark.parametrize("n", range(1, 8))
def test_trees_agree_with_nodepy(n):
    known = {tree_of(t): (t.density(), t.symmetry()) for t in rt.list_trees(n)}
    assert known == {t: (trees.density(t), trees.symmetry(t)) for t in trees.rooted_trees(n)}


@pytest.mark.parametrize("name", ORDERS)
def test_order_p_holds_and_order_p_plus_1_fails(name):
    tableau, p = getattr(tableaux, name), ORDERS[name]
    assert trees.order(tableau) == p
    conditions = trees.residuals(tableau, p + 1)
    assert all(c.residual == 0 for c in conditions if c.order <= p)
    assert any(c.residual != 0 for c in conditions if c.order == p + 1)


@pytest.mark.parametrize("key", PRINTED)
def test_as_printed_every_method_is_consistent_and_no_more(key):
    assert trees.order(PRINTED[key]) == 1


@pytest.mark.parametrize("name", ["RK5", "RK6", "DP5", "DP4"])
def test_error_coefficients_agree_with_nodepy(name):
    tableau = getattr(tableaux, name)
    other = rk.ExplicitRungeKuttaMethod(
        np.array(tableau.A.tolist(), dtype=object), np.array(tableau.b.tolist(), dtype=object)
    )
    n = ORDERS[name] + 1
    assert other.order() == n - 1
    mine = {
        c.tree: c.residual / trees.symmetry(c.tree)
        for c in trees.residuals(tableau, n)
        if c.order >= n - 1
    }
    theirs = {tree_of(t): other.error_coefficient(t) for k in (n - 1, n) for t in rt.list_trees(k)}
    assert mine == theirs


def test_order_0_if_the_weights_do_not_add_up_to_1():
    assert trees.order(Tableau("half", [[0]], ["1/2"])) == 0


def test_zero_is_decided_exactly():
    # A residual of 1e-40 is not zero, nested radicals that cancel are.
    shifted = Tableau("shifted", [[0, 0], ["1/2", 0]], [f"1/{10**40}", f"1-1/{10**40}"])
    assert trees.order(shifted) == 1
    root = "sqrt(5+2*sqrt(6))-sqrt(2)-sqrt(3)"
    assert trees.order(Tableau("nested", [[0, 0], [f"1/2+{root}", 0]], [0, 1])) == 2


@given(st.lists(st.fractions(max_denominator=50), min_size=6, max_size=6))
def test_weights_are_the_sums_they_stand_for(numbers):
    a21, a31, a32, *b = numbers
    A = [[0, 0, 0], [a21, 0, 0], [a31, a32, 0]]
    c = [0, a21, a31 + a32]
    by_hand = sum(b[i] * c[i] * sum(A[i][j] * c[j] for j in range(3)) for i in range(3))
    assert trees.elementary_weight(((T,), T), A, b) == by_hand
    as_floats = trees.elementary_weight(((T,), T), [[float(x) for x in row] for row in A],
                                        [float(x) for x in b])  # fmt: skip
    assert as_floats == pytest.approx(float(by_hand), rel=1e-12, abs=1e-9)


def one_digit_off(number):
    """Fractions that differ from a fraction by one digit of its numerator or denominator."""
    text = f"{number.numerator}/{number.denominator}"
    for i, old in enumerate(text):
        for new in "0123456789" if old.isdigit() else "":
            changed = text[:i] + new + text[i + 1 :]
            if new != old and int(changed.partition("/")[2]):
                yield Fraction(changed)


@pytest.mark.parametrize("name", ["EULER", "RK5", "RK6", "DP5", "DP4"])
def test_one_wrong_digit_anywhere_is_noticed(name):
    tableau, p = getattr(tableaux, name), ORDERS[name]
    A, b = fractions(tableau)
    assert has_order(A, b, p)
    for row in [*A, b]:
        for j, right in enumerate(row):
            if right == 0:
                continue
            for wrong in one_digit_off(right):
                row[j] = wrong
                # DP5 never uses its last stage, which has to be the next step's first.
                assert not has_order(A, b, p) or (tableau.fsal and A[-1] != b), (name, wrong)
            row[j] = right


@pytest.mark.parametrize("order", [0, -1, 1.0, "4"])
def test_impossible_order_is_an_error(order):
    with pytest.raises((TypeError, ValueError), match=re.escape(f"order = {order!r} is ")):
        trees.rooted_trees(order)
    with pytest.raises((TypeError, ValueError), match="order = .* is "):
        trees.residuals(tableaux.EULER, order)


@pytest.mark.parametrize("n", range(1, 8))
def test_layout_places_each_node_once_and_children_above(n):
    for tree in trees.rooted_trees(n):
        nodes, edges = trees.layout(tree)
        assert len(set(nodes)) == len(nodes) == n
        assert nodes[0] == (0.0, 0.0)
        assert sorted(child for _, child in edges) == list(range(1, n))
        assert all(nodes[child][1] == nodes[parent][1] + 1 for parent, child in edges)
