"""The tableaux against second, independent sources."""

from decimal import Decimal
from fractions import Fraction

import mpmath
import numpy as np
import pytest
import sympy
from nodepy import rk
from scipy.integrate import RK45

from armsim import paper
from armsim.methods import tableaux, trees
from armsim.methods.tableaux import DP4, DP5, RK4_GILL, RK5, RK6, Tableau
from armsim.paper import PRINTED

# Butcher (1964), one list of (stage, previous stage, numerator, denominator) for each method,
# written down independently of the package.
RK5_ENTRIES = [
    (2, 1, 1, 4), (3, 1, 1, 8), (3, 2, 1, 8), (4, 2, -1, 2), (4, 3, 1, 1), (5, 1, 3, 16),
    (5, 4, 9, 16), (6, 1, -3, 7), (6, 2, 2, 7), (6, 3, 12, 7), (6, 4, -12, 7), (6, 5, 8, 7),
]  # fmt: skip
RK5_WEIGHTS = [(7, 90), (0, 1), (16, 45), (2, 15), (16, 45), (7, 90)]
RK6_ENTRIES = [
    (2, 1, 1, 2), (3, 1, 2, 9), (3, 2, 4, 9), (4, 1, 7, 36), (4, 2, 2, 9), (4, 3, -1, 12),
    (5, 1, -35, 144), (5, 2, -55, 36), (5, 3, 35, 48), (5, 4, 15, 8), (6, 1, -1, 360),
    (6, 2, -11, 36), (6, 3, -1, 8), (6, 4, 1, 2), (6, 5, 1, 10), (7, 1, -41, 260),
    (7, 2, 22, 13), (7, 3, 43, 156), (7, 4, -118, 39), (7, 5, 32, 195), (7, 6, 80, 39),
]  # fmt: skip
RK6_WEIGHTS = [(13, 200), (0, 1), (11, 40), (11, 40), (4, 25), (4, 25), (13, 200)]


@pytest.mark.parametrize(
    ("tableau", "entries", "weights"),
    [(RK5, RK5_ENTRIES, RK5_WEIGHTS), (RK6, RK6_ENTRIES, RK6_WEIGHTS)],
    ids=lambda value: value.name if isinstance(value, Tableau) else "",
)
def test_every_digit_of_butchers_methods(tableau, entries, weights):
    A = sympy.zeros(tableau.stages)
    for i, j, numerator, denominator in entries:
        A[i - 1, j - 1] = sympy.Rational(numerator, denominator)
    assert tableau.A.tolist() == A.tolist()
    assert list(tableau.b) == [sympy.Rational(*w) for w in weights]


def test_dormand_prince_is_nodepys():
    other = rk.loadRKM("DP5")
    assert DP5.A.tolist() == other.A.tolist()
    assert list(DP5.b) == list(other.b)
    assert list(DP5.b_embedded) == list(DP4.b) == list(other.bhat)
    assert DP4.A == DP5.A


def test_dormand_prince_is_scipys():
    A, b, c = DP5.floats()
    # SciPy leaves the last row of A, which is b, and the last column out.
    assert np.array_equal(A[:6, :5], RK45.A)
    assert np.array_equal(b[:6], RK45.B)
    assert np.array_equal(c[:6], RK45.C)
    assert np.allclose(b - DP4.floats()[1], -RK45.E, rtol=0, atol=2e-17)


def test_the_interpolant_ends_at_the_step_and_is_of_fourth_order_between():
    P = sympy.Matrix(DP5.interpolant.tolist())
    powers = sympy.ones(4, 1)
    assert list(P * powers) == list(DP5.b)  # at the end of the step
    assert list(P * sympy.Matrix([1, 2, 3, 4])) == [0] * 6 + [1]  # its slope there: the last stage
    assert list(P[:, 0]) == [1] + [0] * 6  # its slope at the start: the first one
    A = DP5.A.tolist()
    for theta in map(sympy.Rational, ("1/7", "1/3", "1/2", "4/5", "9/8")):  # degree 4: enough
        b = list(P * sympy.Matrix([theta**n for n in range(1, 5)]))
        for order in range(1, 5):
            for tree in trees.rooted_trees(order):
                assert trees.elementary_weight(tree, A, b) == theta**order / trees.density(tree)
    floats = np.array(DP5.interpolant.tolist(), dtype=float)
    assert np.allclose(floats, RK45.P, rtol=1e-15, atol=0)


def test_gills_surds_are_exact():
    r = sympy.sqrt(2)
    half = sympy.Rational(1, 2)
    A = [[0, 0, 0, 0], [half, 0, 0, 0], [r / 2 - half, 1 - r / 2, 0, 0], [0, -r / 2, 1 + r / 2, 0]]
    b = [1, 2 - r, 2 + r, 1]
    assert all(
        sympy.expand(x - y) == 0
        for row, other in zip(RK4_GILL.A.tolist(), A, strict=True)
        for x, y in zip(row, other, strict=True)
    )
    assert all(sympy.expand(6 * x - y) == 0 for x, y in zip(RK4_GILL.b, b, strict=True))
    assert list(RK4_GILL.c) == [0, half, half, 1]


@pytest.mark.parametrize(
    ("tableau", "nodes"),
    [
        (RK5, "0 1/4 1/4 1/2 3/4 1"),
        (RK6, "0 1/2 2/3 1/3 5/6 1/6 1"),
        (DP5, "0 1/5 3/10 4/5 8/9 1 1"),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_nodes(tableau, nodes):
    assert list(tableau.c) == [sympy.Rational(c) for c in nodes.split()]


def test_what_derives_from_a_tableau():
    assert [t.stages for t in (tableaux.EULER, RK4_GILL, RK5, RK6, DP5, DP4)] == [1, 4, 6, 7, 7, 7]
    assert [t.fsal for t in (tableaux.EULER, RK6, DP5, DP4)] == [False, False, True, False]
    assert DP5.evaluated_stages == tuple(range(6))
    assert DP4.evaluated_stages == tuple(range(7))


@pytest.mark.parametrize(
    ("key", "row", "stage", "pair"),
    [  # where the paper's formulas are easy to misread, and where they are wrong
        ("rk5", 3, 2, (1, 8)),
        ("rk5", 4, 3, (1, 1)),
        ("rk5", 4, 1, (0, 1)),
        ("rk5", 6, 1, (-3, 27)),
        ("rk5", 7, 3, (32, 90)),
        ("rk5", 7, 2, (0, 1)),
        ("rk6", 5, 1, (-35, 144)),
        ("rk6", 7, 3, (-43, 156)),
        ("rk6", 8, 7, (13, 200)),
        ("ndp5", 2, 1, (1, 5)),
        ("ndp5", 5, 1, (9372, 6561)),
        ("ndp5", 6, 3, (-46732, 4247)),
        ("ndp5", 7, 5, (-2187, 6784)),
        ("ndp6", 7, 6, (11, 84)),
        ("ndp6", 8, 5, (-92097, 339200)),
        ("ndp6", 8, 7, (1, 40)),
    ],
)
def test_printed_fractions_are_the_papers(key, row, stage, pair):
    rows = paper.printed_fractions(key)
    assert rows[row - 1][stage - 1] == pair
    entry = [*PRINTED[key].A.tolist(), list(PRINTED[key].b)][row - 1][stage - 1]
    assert entry == sympy.Rational(*pair)


def test_both_novel_methods_print_the_same_rows():
    fifth, sixth = (paper.printed_fractions(key) for key in ("ndp5", "ndp6"))
    assert [row[:6] for row in sixth[:6]] == fifth[:6]
    assert sixth[6][:6] == fifth[6]  # the last stage is at the fifth-order solution


def test_unknown_printed_tableau_is_an_error():
    with pytest.raises(ValueError, match=r"'rk7'.*'rk5', 'rk6', 'ndp5', 'ndp6'"):
        paper.printed_fractions("rk7")


@pytest.mark.parametrize(
    ("A", "b", "message"),
    [
        ([], [], "at least one stage"),
        ([[0, 1], [1, 0]], [0, 1], r"A\[0\]\[1\] = 1 makes the method implicit"),
        ([[0, 0], [1, "1/2"]], [0, 1], r"A\[1\]\[1\] = 1/2 makes the method implicit"),
        ([[0, 0], [1]], [0, 1], r"A\[1\] has 1 entries; .* 2 stages needs 2"),
        ([[0, 0, 0], [1, 0, 0]], [0, 1], r"A\[0\] has 3 entries"),
        ([[0, 0], [1, 0]], [1], "b has 1 entries; .* 2 stages needs 2"),
        ([[0, 0], [0.5, 0]], [0, 1], r"A\[1\]\[0\] = 0.5 is not exact"),
        ([[0, 0], ["1/2", 0]], [0, 1.0], r"b\[1\] = 1.0 is not exact"),
        ([[0, 0], [np.float64(0.5), 0]], [0, 1], "is not exact"),
        ([[0, 0], [float("nan"), 0]], [0, 1], "is not exact"),
        ([[0, 0], [sympy.nan, 0]], [0, 1], "is not a real number"),
        ([[0, 0], ["nan", 0]], [0, 1], "is not a real number"),
        ([[0, 0], ["oo", 0]], [0, 1], "is not a real number"),
        ([[0, 0], ["sqrt(-1)", 0]], [0, 1], "is not a real number"),
        ([[0, 0], ["x", 0]], [0, 1], "is not a real number"),
        ([[0, 0], ["1/", 0]], [0, 1], "is not a number"),
        ([[0, 0], [True, 0]], [0, 1], "is not exact"),
        ([[0, 0], [np.True_, 0]], [0, 1], "is not exact"),
        ([[0, 0], [None, 0]], [0, 1], "is not exact"),
        ([[0, 0], [sympy.Float("0.5"), 0]], [0, 1], "is not exact"),
        ([[0, 0], [0.5 * sympy.sqrt(2), 0]], [0, 1], "is not exact"),
        ([[0, 0], [Decimal("0.5"), 0]], [0, 1], "is not exact"),
        ([[0, 0], [mpmath.mpf("0.5"), 0]], [0, 1], "is not exact"),
        ([[0, 0], [sympy.Symbol("x"), 0]], [0, 1], "is not a real number"),
        ([[0, 0], ["1/0", 0]], [0, 1], "is not a real number"),
    ],
)
def test_bad_tableau_is_an_error(A, b, message):
    with pytest.raises(ValueError, match=message):
        Tableau("bad", A, b)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("-3", -3),
        ("+1/2", Fraction(1, 2)),
        (" - 7 / -14 ", Fraction(1, 2)),
        ("0.125", Fraction(1, 8)),
        (".5", Fraction(1, 2)),
        ("1e-3", Fraction(1, 1000)),
        ("0.1000000000000000000001", Fraction(10**21 + 1, 10**22)),  # more digits than a float has
        ("2*(1-1/4)", Fraction(3, 2)),
        ("(2-sqrt(2))/2", 1 - sympy.sqrt(2) / 2),
        ("sqrt(1/2+1.5)", sympy.sqrt(2)),
        ("sqrt(2)*sqrt(2)", 2),
    ],
)
def test_texts_are_exact(text, value):
    assert sympy.expand(Tableau("one", [[0]], [text]).b[0] - sympy.sympify(value)) == 0


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').abort()", "exit()", "[].append(1)", "sqrt.__class__", "sqrt",
        "sqrt(2, evaluate=False)", "sqrt(2, 3)", "sin(1)", "pi", "E", "Rational(1, 2)", "lambda: 1",
        "2**3", "9**9**9**9", "7 // 2", "7 % 2", "~1", "not 1", "1 if 1 else 2", "1 < 2", "(1, 2)",
        "[1]", "'1'", "1j", "True", "...", "0x10", "1_000", "1e999999999", "1;2", "1 2", "",
        "(" * 500 + "1" + ")" * 500, "-" * 50_000 + "1", "9" * 10_000, "1\0",
    ],
)  # fmt: skip
def test_a_text_that_is_more_than_a_number_is_refused_and_not_run(text):
    with pytest.raises(ValueError, match=r"b\[0\] = .* is not a (real )?number"):
        Tableau("bad", [[0]], [text])


def test_embedded_weights_are_checked_too():
    with pytest.raises(ValueError, match="b_embedded has 2 entries"):
        Tableau("bad", [[0]], [1], b_embedded=[1, 0])


def test_fractions_are_taken_as_they_are():
    tableau = Tableau("midpoint", [[0, 0], [Fraction(1, 2), 0]], [0, 1])
    assert list(tableau.c) == [0, sympy.Rational(1, 2)]
    assert isinstance(tableau.A[1, 0], sympy.Rational)


@pytest.mark.parametrize(
    ("tableau", "of_sums", "one_by_one"),
    [(tableaux.EULER, 1, 1), (RK4_GILL, 4, 9), (RK5, 6, 17), (DP5, 6, 20), (DP4, 7, 26)],
)
def test_exponentials_of_a_step(tableau, of_sums, one_by_one):
    """Counted in the formulas: one for each stage but the first, and one for the step."""
    assert tableau.exponentials() == of_sums
    assert tableau.exponentials(product=True) == one_by_one


@pytest.mark.parametrize(("A", "b"), [([[0]], [[1]]), ([[[0]]], [1])])
def test_numbers_nested_too_deep_are_refused(A, b):
    with pytest.raises(ValueError, match=r"= \[.\] is not exact"):
        Tableau("bad", A, b)
