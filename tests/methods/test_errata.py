"""The search for misprints: what it finds in the paper, and that it finds what was planted."""

import functools
import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
import sympy
from numba import njit

from armsim import paper
from armsim.methods import errata, tableaux, trees
from armsim.methods.errata import search

CORRECT = {"rk5": tableaux.RK5, "rk6": tableaux.RK6, "ndp5": tableaux.DP5, "ndp6": tableaux.DP4}
ORDERS = {"rk5": 5, "rk6": 6, "ndp5": 5, "ndp6": 4}


@pytest.fixture(scope="module")
def found():
    return {key: search(paper.printed_fractions(key), key) for key in CORRECT}


def pairs(tableau):
    """Rows of a rational tableau as a source of the search."""
    return [[(int(x.p), int(x.q)) for x in row] for row in [*tableau.A.tolist(), tableau.b]]


RK5_UNREDUCED = [
    *pairs(tableaux.RK5)[:-1],
    [(7, 90), (0, 1), (32, 90), (12, 90), (32, 90), (7, 90)],
]


def planted(rows, **misprints):
    """Rows in which the coefficient, say ``a31`` or ``b2``, is another pair."""
    rows = [list(row) for row in rows]
    for where, pair in misprints.items():
        i, j = (int(where[1]), int(where[2])) if where[0] == "a" else (len(rows), int(where[1]))
        rows[i - 1][j - 1] = pair
    return rows


@pytest.mark.parametrize("key", CORRECT)
def test_the_paper_has_one_repair_and_it_is_the_known_method(found, key):
    result = found[key]
    assert (result.order_before, result.order_after) == (1, ORDERS[key])
    assert len(result.repairs) == 1
    s = result.printed.stages
    correct = CORRECT[key]
    assert result.repairs[0].tableau.A.tolist() == [row[:s] for row in correct.A.tolist()[:s]]
    assert list(result.repairs[0].tableau.b) == list(correct.b)[:s]
    assert trees.order(result.repairs[0].tableau) == ORDERS[key]


@pytest.mark.parametrize(
    ("key", "changes", "edits"),
    [
        ("rk5", [("a_61", "-3/27", "-3/7")], 1),
        ("rk6", [("a_73", "-43/156", "43/156")], 1),
        ("ndp5", [("a_51", "9372/6561", "19372/6561"), ("a_63", "-46732/4247", "46732/5247")], 3),
        ("ndp6", [("a_51", "9372/6561", "19372/6561"), ("a_63", "-46732/4247", "46732/5247")], 3),
    ],
)
def test_the_misprints(found, key, changes, edits):
    (repair,) = found[key].repairs
    assert [(c.coefficient, c.printed, c.corrected) for c in repair.changes] == changes
    assert repair.edits == edits


def test_kinds_of_edit(found):
    kinds = [change.kind for key in ("rk5", "rk6", "ndp5") for change in
             found[key].repairs[0].changes]  # fmt: skip
    assert kinds == [
        "digit deleted in the denominator",
        "sign flipped",
        "digit inserted in the numerator",
        "sign flipped, digit replaced in the denominator",
    ]


@pytest.mark.parametrize("key", ["rk5", "rk6"])
def test_most_weights_of_butchers_methods_need_the_stage_condition(found, key):
    assert 0 < found[key].weights_positive <= found[key].weights_consistent
    assert found[key].candidates[0] > 1000
    assert found[key].combinations > 10**20


def test_squares_of_the_stage_conditions_vanish_at_order_5():
    # The argument of the module: Σ b q² = 0, of order 5 alone; it fails for order 4.
    for tableau, holds in [(tableaux.RK5, True), (tableaux.RK4_GILL, False)]:
        A, b, c = sympy.Matrix(tableau.A.tolist()), list(tableau.b), list(tableau.c)
        q = [sum(A.row(i)[j] * c[j] for j in range(len(c))) - c[i] ** 2 / 2 for i in range(len(c))]
        assert (sympy.expand(sum(w * x**2 for w, x in zip(b, q, strict=True))) == 0) is holds


def test_no_fifth_and_sixth_stage_save_the_sixth_order():
    # Weights of eq. (16) and the nodes of the rows that are not misprinted: two quadrature
    # conditions leave two pairs of nodes c5, c6; neither meets the condition of order 5.
    b = paper.PRINTED["ndp6"].b
    c = list(paper.PRINTED["ndp6"].c)
    c[4:6] = c5, c6 = sympy.symbols("c5 c6")
    moment = [sum(w * x**k for w, x in zip(b, c, strict=True)) for k in range(5)]
    solutions = sympy.solve([moment[1] - sympy.Rational(1, 2), moment[2] - sympy.Rational(1, 3)])
    assert {c5: sympy.Rational(8, 9), c6: 1} in solutions
    assert len(solutions) == 2
    for solution in solutions:
        assert sympy.radsimp(moment[4].subs(solution)) != sympy.Rational(1, 5)


@pytest.mark.parametrize(
    ("misprints", "changes"),
    [
        ({"b3": (32, 99)}, [("b_3", "32/99", "32/90")]),
        ({"a62": (-2, 77)}, [("a_62", "-2/77", "2/7")]),
        (
            {"a21": (1, 2), "a64": (12, 7), "a65": (8, 17)},
            [("a_21", "1/2", "1/4"), ("a_64", "12/7", "-12/7"), ("a_65", "8/17", "8/7")],
        ),
        (
            {"a63": (21, 7), "b6": (-7, 90)},
            [("a_63", "21/7", "12/7"), ("b_6", "-7/90", "7/90")],
        ),
        (
            {"a64": (8, 7), "a65": (-12, 7)},
            [("a_64", "8/7", "-12/7"), ("a_65", "-12/7", "8/7")],
        ),
    ],
)
def test_planted_misprints_are_found(misprints, changes):
    result = search(planted(RK5_UNREDUCED, **misprints), "planted")
    assert (result.order_after, len(result.repairs)) == (5, 1)
    (repair,) = result.repairs
    assert [(c.coefficient, c.printed, c.corrected) for c in repair.changes] == changes


def test_exchanged_coefficients_are_one_edit():
    (repair,) = search(planted(RK5_UNREDUCED, a64=(8, 7), a65=(-12, 7))).repairs
    assert {change.kind for change in repair.changes} == {"exchanged with its neighbour"}
    assert repair.edits == 1


@pytest.mark.parametrize(
    ("misprints", "changes"),
    [
        ({"b2": (32, 90), "b3": (0, 1)}, [("b_2", "32/90", "0"), ("b_3", "0", "32/90")]),
        ({"a51": (0, 1), "a52": (3, 16)}, [("a_51", "0", "3/16"), ("a_52", "3/16", "0")]),
    ],
)
def test_a_wrong_index_is_one_edit(misprints, changes):
    (repair,) = search(planted(RK5_UNREDUCED, **misprints)).repairs
    assert [(c.coefficient, c.printed, c.corrected) for c in repair.changes] == changes
    assert {change.kind for change in repair.changes} == {"wrong index"}
    assert repair.edits == 1


@pytest.mark.parametrize("tableau", [tableaux.RK5, tableaux.DP5], ids=lambda t: t.name)
def test_a_method_without_misprint_gives_no_edits(tableau):
    result = search(pairs(tableau))
    assert (result.order_before, result.order_after, result.repairs) == (5, 5, ())


def test_what_is_no_typing_error_is_not_repaired():
    assert search(planted(RK5_UNREDUCED, a54=(16, 9))).order_after < 5  # fraction inverted
    assert search(planted(RK5_UNREDUCED, a54=(0, 1))).order_after < 5  # coefficient lost


@njit
def zeros_modulo(prime, quartics, powers):
    """Pairs (i, j) for which quartic i vanishes at number j."""
    hits = []
    for i in range(len(quartics)):
        q0, q1, q2, q3, q4 = quartics[i]
        for j in range(len(powers)):
            x1, x2, x3, x4 = powers[j]
            if (q0 + q1 * x1 + q2 * x2 + q3 * x3 + q4 * x4) % prime == 0:
                hits.append((i, j))
    return hits


def nodes_of_a_quadrature(b, versions):
    """Nodes c3 to c6, as residues, of all rows within the edits that suit b up to degree 4.

    Given c3 and c4, what the last two nodes have to contribute to the moments of degree 0 to 4
    fills a 3 x 3 Hankel matrix of rank 2; its determinant, a quartic in c4, vanishes.
    """
    P = errata._PRIME
    c3, c4, c5, c6 = (np.unique(version.sums) for version in versions[1:5])
    b1, b3, b4, b5, b6 = (
        b[i].numerator * pow(b[i].denominator, -1, P) % P for i in (0, 2, 3, 4, 5)
    )

    def times(*factors):
        return functools.reduce(lambda x, y: x * y % P, factors)

    moment = [(pow(k + 1, -1, P) - times(b3, *[c3] * k)) % P for k in range(5)]
    m0, m1, m2, m3, m4 = moment[0] - b1, *moment[1:]
    adjugate = {
        (0, 0): times(m2, m4) - times(m3, m3), (0, 1): times(m2, m3) - times(m1, m4),
        (0, 2): times(m1, m3) - times(m2, m2), (1, 1): times(m0 % P, m4) - times(m2, m2),
        (1, 2): times(m1, m2) - times(m0 % P, m3), (2, 2): times(m0 % P, m2) - times(m1, m1),
    }  # fmt: skip
    w = {key: value % P for key, value in adjugate.items()}
    determinant = times(m0 % P, w[0, 0]) + times(m1, w[0, 1]) + times(m2, w[0, 2])
    quartic = [w[0, 0], 2 * w[0, 1], 2 * w[0, 2] + w[1, 1], 2 * w[1, 2], w[2, 2]]
    quartic = [times(-b4 % P, q % P) for q in quartic]
    quartic[0] = (quartic[0] + determinant) % P
    powers = np.stack([times(*[c4] * k) for k in range(1, 5)], axis=1)
    found = set()
    for i, j in zeros_modulo(P, np.stack(quartic, axis=1), powers):
        left = [(int(moment[k][i]) - b4 * int(powers[j, k - 1])) % P for k in range(1, 5)]
        last = (left[0] - b5 * c5) % P * pow(b6, -1, P) % P
        fits = np.isin(last, c6)
        for k in range(2, 5):
            fits &= (times(b5, *[c5] * k) + times(b6, *[last] * k) - left[k - 1]) % P == 0
        found |= {(int(c3[i]), int(c4[j]), int(c5[n]), int(last[n])) for n in np.flatnonzero(fits)}
    return found


@pytest.mark.parametrize("key", ["rk5", "ndp5"])
def test_the_stage_condition_is_no_restriction_for_the_fifth_order_methods(key):
    # Weights that are not negative need q = 0 for order 5. For all others within the edits only
    # the nodes of Dormand and Prince suit their weights; b q is then orthogonal to 1, c and c²,
    # so that q = t v with known v; and Σ b q² = 0 leaves only t = 0. So the repair is unique
    # without any condition on the stages, but for weights with a coefficient at a wrong index.
    rows = paper.printed_fractions(key)
    versions = [errata._Versions(row, reach) for reach, row in enumerate(rows[1:], start=1)]
    correct = [Fraction(int(w.p), int(w.q)) for w in CORRECT[key].b][:6]
    nodes = [Fraction(int(c.p), int(c.q)) for c in CORRECT[key].c][2:6]
    residues = tuple(c.numerator * pow(c.denominator, -1, errata._PRIME) % errata._PRIME
                     for c in nodes)  # fmt: skip
    negative = [b for b in errata._consistent(versions[-1]) if min(b) < 0]
    misplaced = [b for b in negative if b[1]]  # a weight printed at a wrong index
    assert len(misplaced) == {"rk5": 0, "ndp5": 5}[key]  # for these, q = 0 is assumed
    assert len(negative) >= 8
    for b in [b for b in negative if not b[1]]:
        expected = {residues} if list(b) == correct else set()
        assert nodes_of_a_quadrature(b, versions) == expected
    for version, node, residue in zip(versions[1:5], nodes, residues, strict=True):
        same = [version.readings(int(k))[0] for k in np.flatnonzero(version.sums == residue)]
        assert {sum(Fraction(*r.pair) for r in row) for row in same} == {node}
    v = [1 / math.prod(x - y for y in nodes if y != x) for x in nodes]
    assert sum(x**2 / w for x, w in zip(v, correct[2:], strict=True)) != 0


def test_three_edits_in_a_row_are_beyond_the_search():
    rows = planted(RK5_UNREDUCED, a61=(-4, 7), a62=(3, 7), a63=(13, 7))
    assert search(rows).order_after < 5


@functools.cache
def neighbours(text):
    """Every number one typing error away, by trying all strings of nearly its length."""
    length, found = len(text), set()
    for n in (length - 1, length, length + 1):
        for letters in itertools.product("0123456789", repeat=n):
            other = "".join(letters)
            if other and other[0] != "0" and other != text:
                if n == length:
                    differ = [i for i in range(n) if text[i] != other[i]]
                    swap = (
                        len(differ) == 2
                        and differ[1] == differ[0] + 1
                        and text[differ[0]] + text[differ[1]] == other[differ[1]] + other[differ[0]]
                    )
                    near = len(differ) == 1 or swap
                else:
                    long, short = sorted((text, other), key=len, reverse=True)
                    near = any(long[:i] + long[i + 1 :] == short for i in range(len(long)))
                if near:
                    found.add(int(other))
    return found


@pytest.mark.parametrize("number", [1, 7, 10, 11, 27, 90, 121, 348])
def test_edits_of_a_number_are_those_of_a_brute_force_search(number):
    assert {n for n, _ in errata._numbers(number)} == neighbours(str(number))


def test_two_stages_against_brute_force():
    def once(pair):
        n, d = pair
        sign = 1 if n > 0 else -1
        return {(-n, d), *((sign * k, d) for k in neighbours(str(abs(n)))),
                *((n, k) for k in neighbours(str(d)))}  # fmt: skip

    def values(pair):
        one = once(pair)
        two = {text for base in one for text in once(base)}
        return [{Fraction(*text) for text in texts} for texts in ({pair}, {pair} | one, one | two)]

    node, weight = (2, 1), (1, 2)  # Heun's method, whose node should be 1
    zero_one_two = values(weight)
    weights = {
        (b1, b2)
        for i, k in ((0, 2), (1, 1), (2, 0))
        for b1 in zero_one_two[i] if (b2 := 1 - b1) in zero_one_two[k]
    }  # fmt: skip
    nodes = values(node)[2] | {Fraction(*node)}
    expected = {(1 / (2 * b2), b1, b2) for b1, b2 in weights if 1 / (2 * b2) in nodes}
    result = search([[(0, 1), (0, 1)], [node, (0, 1)], [weight, weight]])
    assert (result.order_before, result.order_after) == (1, 2)
    assert len(result.repairs) > 1
    read = {(r.tableau.A[1, 0], *r.tableau.b) for r in result.repairs}
    assert {tuple(Fraction(int(x.p), int(x.q)) for x in r) for r in read} == expected
    assert result.repairs[0].edits == 1
    assert [r.edits for r in result.repairs] == sorted(r.edits for r in result.repairs)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ([[(0, 1)], [(1, 1)]], "stages = 1: the search takes 2 to 8"),
        ([[(0, 1), (0, 1)], [(1, 2), (0, 1)], [(1, 1)]], "b has 1 entries"),
        ([[(0, 1), (0, 1)], [(1, 2)], [(0, 1), (1, 1)]], r"A\[1\] has 1 entries"),
        ([[(0, 1), (1, 2)], [(1, 2), (0, 1)], [(0, 1), (1, 1)]], "implicit"),
        ([[(0, 1), (0, 1)], [(1, 0), (0, 1)], [(0, 1), (1, 1)]], "denominator 0"),
        ([[(0, 1), (0, 1)], [(1, -2), (0, 1)], [(0, 1), (1, 1)]], "denominator -2"),
        ([[(0, 1), (0, 1)], [(1, 10**7), (0, 1)], [(0, 1), (1, 1)]], "denominator 10000000"),
        ([[(0, 1), (0, 1)], [(0.5, 1), (0, 1)], [(0, 1), (1, 1)]], "0.5/1: must be a pair of int"),
    ],
)
def test_bad_source_is_an_error(source, message):
    with pytest.raises(ValueError, match=message):
        search(source)
