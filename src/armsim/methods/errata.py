r"""Search for misprints of a tableau: the edits that restore its order.

**Search space.** Each row of A and the weights b may differ from the printed row by up to two
edits, in all rows at once. An edit is a typesetting error:

- the sign of a coefficient is flipped;
- a digit of a numerator or denominator is replaced, inserted, deleted, or swapped with its
  neighbour (the resulting number does not begin with 0);
- two neighbouring coefficients of a row are exchanged, or one stands at the wrong index, where none
  is printed (one of the two, once per row).

Other coefficients that are not printed stay 0: a dropped term is not searched for, since its value
could be any. Nodes are the row sums of A.

**Pruning.** The weights must sum to 1. Rows are built from the top down, and each stage
:math:`i \ge 3` must satisfy

.. math:: q_i := \sum_j a_{ij} c_j - c_i^2 / 2 = 0,

which involves only the row and the nodes above it. Before the last stage is chosen, the quadrature
conditions :math:`\sum_i b_i c_i^{k-1} = 1/k` determine its node. The remaining candidates are
decided by `armsim.methods.trees.order`. The claim is therefore: *among all tableaux within the
edits whose stages satisfy* :math:`q_i = 0`, those found are all that reach the highest order.

**Where q = 0 is no restriction.** Three conditions of order 5, those for the weights
:math:`b c^4`, :math:`b c^2 (Ac)` and :math:`b (Ac)^2`, combine to

.. math:: \sum_i b_i q_i^2 = \tfrac{1}{20} - \tfrac{1}{10} + \tfrac{1}{4} \cdot \tfrac{1}{5} = 0,

so if no weight is negative, every method of order 5 or more has :math:`q_i = 0` wherever
:math:`b_i \ne 0`. `Errata.weights_positive` counts the weights for which this holds. For the
two fifth-order methods of the paper, the tests also cover the other weights, by the quadrature
conditions alone, except the five of the novel form with a coefficient printed at the wrong index.
For these, for the few weights of the sixth-order method with a negative entry, and for the embedded
weights of Dormand and Prince, q = 0 remains an assumption of the search.

Rows are filtered modulo a prime larger than every denominator. An equation between rationals also
holds modulo the prime, so no candidate is lost. Accidental matches fail the exact test of the
order.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import accumulate, combinations, pairwise
from math import prod
from numbers import Integral
from typing import NamedTuple

import numpy as np

from armsim.methods import trees
from armsim.methods.tableaux import Tableau

Pair = tuple[int, int]
_Rows = Sequence[Sequence[Pair]]

_EDITS = 2  # per row
_DIGITS = "0123456789"
_PRIME = 2**30 - 35  # sums of seven products of residues fit into 64 bits
_MAX_STAGES = 8
_MAX_DENOMINATOR = 10**7 - 1  # below the prime even with two more digits


@dataclass(frozen=True)
class Change:
    """Coefficient that differs from the printed one."""

    coefficient: str  #: such as ``"a_61"`` or ``"b_5"``
    printed: str
    corrected: str  #: fraction of this value reached by the fewest edits
    kind: str


@dataclass(frozen=True)
class Repair:
    """Tableau of the highest order and its differences from the printed one."""

    tableau: Tableau
    changes: tuple[Change, ...]
    edits: int  #: number of edits that lead to it


@dataclass(frozen=True)
class Errata:
    """Result of `search`."""

    printed: Tableau
    order_before: int
    order_after: int  #: highest order within the edits, at least `order_before`
    repairs: tuple[Repair, ...]  #: all tableaux that reach it, fewest edits first
    candidates: tuple[int, ...]  #: numbers of versions of the rows of A below the first, and of b
    weights_consistent: int  #: versions of b that sum to 1
    weights_positive: int  #: those without a negative weight

    @property
    def combinations(self) -> int:
        """Size of the searched space."""
        return prod(self.candidates)


def search(source: _Rows, name: str = "tableau") -> Errata:
    """Find every tableau near a printed one that reaches the highest order.

    Parameters
    ----------
    source : (s + 1) rows of s pairs
        The rows of A, then the weights, as unreduced ``(numerator, denominator)``; ``(0, 1)`` for
        a coefficient that is not printed. `armsim.paper.printed_fractions` returns the paper's.
    name : str
        Name of the method.

    Returns
    -------
    Errata
        Result for the edits and stage conditions in the docstring of this module.

    Raises
    ------
    ValueError
        If the tableau is not explicit or has rows of unequal length, the number of stages is not
        2 to 8, a number is not an integer, or a denominator is not between 1 and 9999999.
    """
    source = _checked(source)
    *A, b = ([Fraction(*pair) for pair in row] for row in source)
    printed = Tableau(name, A, b)
    before = after = trees.order(printed)
    versions = [_Versions(row, reach) for reach, row in enumerate(source[1:], start=1)]
    consistent, heads = _consistent(versions[-1]), _heads(versions[:-2])
    repairs: tuple[Repair, ...] = ()
    for target in range(printed.stages, before, -1):  # order s at most with s stages
        found = _complete(heads, versions, [*consistent.values()], target)
        if repairs := _repairs(name, source, versions, found, target):
            after = target
            break
    return Errata(
        printed, before, after, repairs,
        candidates=tuple(row.sums.size for row in versions),
        weights_consistent=len(consistent),
        weights_positive=sum(min(values) >= 0 for values in consistent),
    )  # fmt: skip


def _checked(rows: _Rows) -> _Rows:
    if not 2 <= len(rows) - 1 <= _MAX_STAGES:
        raise ValueError(f"stages = {len(rows) - 1}: the search takes 2 to {_MAX_STAGES}")
    for n, d in (pair for row in rows for pair in row):
        if not (isinstance(n, Integral) and isinstance(d, Integral)):
            raise ValueError(f"coefficient {n!r}/{d!r}: must be a pair of integers")
        if not 1 <= d <= _MAX_DENOMINATOR:
            raise ValueError(f"denominator {d}: must lie within 1 and {_MAX_DENOMINATOR}")
    return [[(int(n), int(d)) for n, d in row] for row in rows]


# --- edits ------------------------------------------------------------------------------------


def _numbers(number: int) -> Iterator[tuple[int, str]]:
    """Positive numbers that differ from a positive number by one edit of its digits."""
    text = str(number)
    for i in range(len(text) + 1):
        head, tail = text[:i], text[i:]
        found = [(head + digit + tail, "digit inserted") for digit in _DIGITS]
        if tail:
            found += [(head + digit + tail[1:], "digit replaced") for digit in _DIGITS]
            found += [(head + tail[1:], "digit deleted")]
            found += [(head + tail[1::-1] + tail[2:], "digits swapped")]
        for edited, kind in found:
            if edited and edited[0] != "0" and edited != text:
                yield int(edited), kind


def _edited(pair: Pair) -> Iterator[tuple[Pair, str]]:
    """Yield the coefficients that one more edit can produce."""
    n, d = pair
    yield (-n, d), "sign flipped"
    for number, kind in _numbers(abs(n)):
        yield (number if n > 0 else -number, d), f"{kind} in the numerator"
    for number, kind in _numbers(d):
        yield (n, number), f"{kind} in the denominator"


class _Reading(NamedTuple):
    """Possible reading of a coefficient."""

    pair: Pair
    kinds: tuple[str, ...] = ()  # one per edit


class _Readings(NamedTuple):
    """Distinct values of a coefficient within two edits, each with its fewest edits."""

    known: list[_Reading]
    ends: list[int]  # numbers of readings with no edit, at most one, at most two
    residues: np.ndarray


@cache
def _readings(pair: Pair) -> _Readings:
    kinds: dict[Pair, tuple[str, ...]] = {pair: ()}
    newest = [pair] if pair[0] else []  # an unprinted one cannot be misprinted
    values = {Fraction(*pair).as_integer_ratio(): _Reading(pair)}
    ends = [1]
    for _ in range(_EDITS):
        # Fractions of equal value are kept apart here, since they allow different second edits.
        older, newest = newest, []
        for base in older:
            for text, kind in _edited(base):
                if text not in kinds:
                    kinds[text] = (*kinds[base], kind)
                    newest.append(text)
        for text in sorted(newest, key=lambda pair: pair[1]):  # 2/7 rather than 22/77
            lowest = Fraction(*text).as_integer_ratio()
            values.setdefault(lowest, _Reading(text, kinds[text]))
        ends.append(len(values))
    residues = np.array([n * pow(d, -1, _PRIME) % _PRIME for n, d in values])
    return _Readings(list(values.values()), ends, residues)


def _rearranged(row: Sequence[Pair], reach: int) -> Iterator[tuple[list[_Reading], int]]:
    """Yield the row, and rows with one or two coefficients at other places, with the edits left."""
    columns = [_Reading(pair) for pair in row]
    yield columns, _EDITS
    printed = [j for j, (n, _) in enumerate(row) if n]
    free = [k for k in range(reach) if k not in printed]
    exchanged = [(j, k, "exchanged with its neighbour") for j, k in pairwise(printed)]
    misplaced = [(j, k, "wrong index") for j in printed for k in free]
    for j, k, kind in exchanged + misplaced:
        moved = list(columns)
        moved[j], moved[k] = (_Reading(row[i], (kind,)) for i in (k, j))
        yield moved, _EDITS - 1


def _picks(ends: Sequence[Sequence[int]], budget: int) -> np.ndarray:
    """Index of the reading of each coefficient (row) in each version (column) within `budget`."""
    blocks = [np.zeros((len(ends), 1), dtype=int)]
    for n in range(1, budget + 1):
        for changed in combinations(range(len(ends)), n):
            # If two change, each does so by one edit.
            ranges = tuple(slice(1, ends[j][budget + 1 - n]) for j in changed)
            picked = np.mgrid[ranges].reshape(n, -1)
            blocks.append(np.zeros((len(ends), picked.shape[1]), dtype=int))
            blocks[-1][list(changed)] = picked
    return np.hstack(blocks)


class _Versions:
    """All versions of a row within two edits; `residues` has one column per version."""

    def __init__(self, row: Sequence[Pair], reach: int) -> None:
        self._arranged, picks, residues = list(_rearranged(row, reach)), [], []
        for columns, budget in self._arranged:
            readings = [_readings(column.pair) for column in columns]
            picks.append(_picks([r.ends for r in readings], budget))
            of_each = zip(readings, picks[-1], strict=True)
            residues.append(np.stack([r.residues[k] for r, k in of_each]))
        self._picks, self.residues = np.hstack(picks), np.hstack(residues)
        self._arrangement = np.repeat(np.arange(len(picks)), [p.shape[1] for p in picks])
        self.sums = self.residues.sum(axis=0) % _PRIME
        self._half_squares = self.sums * self.sums % _PRIME * pow(2, -1, _PRIME) % _PRIME

    def tied(self, nodes: Sequence[int]) -> np.ndarray:
        """Versions with Σ a_ij c_j = c_i²/2, given the nodes above; all versions for stage 2."""
        if len(nodes) == 1:
            return np.arange(self.sums.size)
        total = sum(c * self.residues[j] for j, c in enumerate(nodes) if c)
        return np.flatnonzero((total - self._half_squares) % _PRIME == 0)

    def readings(self, version: int) -> tuple[list[_Reading], int]:
        """Coefficients of a version, and its number of edits."""
        columns, budget = self._arranged[self._arrangement[version]]
        picked = zip(columns, self._picks[:, version], strict=True)
        found = [_readings(column.pair).known[k] for column, k in picked]
        edits = _EDITS - budget + sum(len(reading.kinds) for reading in found)
        pairs = zip(columns, found, strict=True)
        return [_Reading(r.pair, (*column.kinds, *r.kinds)) for column, r in pairs], edits


# --- search -----------------------------------------------------------------------------------


#: Nodes, as residues, of all stages but the last, and versions of their rows below the first.
_Head = tuple[tuple[int, ...], tuple[int, ...]]


def _heads(stages: Sequence[_Versions]) -> list[_Head]:
    """Rows of all stages but the last, satisfying q = 0."""
    heads: list[_Head] = [((0,), ())]
    for stage in stages:
        heads = [
            ((*nodes, int(stage.sums[k])), (*versions, int(k)))
            for nodes, versions in heads
            for k in stage.tied(nodes)
        ]
    return heads


def _consistent(weights: _Versions) -> dict[tuple[Fraction, ...], int]:
    """Weights that sum to exactly 1, each with its version of fewest edits."""
    found: dict[tuple[Fraction, ...], tuple[int, int]] = {}
    for k in map(int, np.flatnonzero(weights.sums == 1)):
        readings, edits = weights.readings(k)
        values = tuple(Fraction(*reading.pair) for reading in readings)
        if sum(values) == 1:
            found[values] = min(found.get(values, (edits, k)), (edits, k))
    return {values: k for values, (_, k) in found.items()}


def _complete(
    heads: Sequence[_Head], rows: Sequence[_Versions], consistent: Sequence[int], order: int
) -> Iterator[tuple[int, ...]]:
    """Yield versions of all rows that satisfy q = 0 and the quadrature conditions up to `order`."""
    *_, last_stage, weights = rows
    nodes = np.array([nodes for nodes, _ in heads], dtype=np.int64).reshape(-1, len(rows) - 1)
    *b, last = weights.residues[:, consistent]
    moments = _moments(nodes, np.array(b), order)
    possible = np.ones((len(heads), len(consistent)), dtype=bool)
    for one, next_one in pairwise(moments):  # each ratio must be the last node
        possible &= (moments[0] * one - last * next_one) % _PRIME == 0
    for h in map(int, np.flatnonzero(possible.any(axis=1))):
        above, versions = heads[h]
        tied = last_stage.tied(above)
        for w in map(int, np.flatnonzero(possible[h])):
            first = last_stage.sums[tied] * last[w] % _PRIME
            for k in tied[first == moments[0][h, w]] if moments else tied:
                yield (*versions, int(k), consistent[w])


def _moments(nodes: np.ndarray, b: np.ndarray, order: int) -> list[np.ndarray]:
    """Contribution of the last stage required by Σ b_i c_i^k = 1/(k + 1), k = 1 … order - 1.

    Each array has one row per head and one column per version of the weights.
    """
    powers = accumulate([nodes] * (order - 1), lambda power, node: power * node % _PRIME)
    return [(pow(k, -1, _PRIME) - power @ b) % _PRIME for k, power in enumerate(powers, start=2)]


def _repairs(
    name: str, rows: _Rows, versions: Sequence[_Versions], found: Iterator, order: int
) -> tuple[Repair, ...]:
    """Distinct tableaux among those found that have the order, fewest edits first."""
    repairs: dict[tuple[tuple[Fraction, ...], ...], Repair] = {}
    for picks in found:
        readings = [v.readings(k) for v, k in zip(versions, picks, strict=True)]
        read = [[_Reading(pair) for pair in rows[0]], *(row for row, _ in readings)]
        edits = sum(number for _, number in readings)
        *A, b = key = tuple(tuple(Fraction(*reading.pair) for reading in row) for row in read)
        if key in repairs and repairs[key].edits <= edits:
            continue
        tableau = Tableau(f"{name}, corrected", A, b)
        if trees.order(tableau) >= order:
            repairs[key] = Repair(tableau, _changes(rows, read), edits)
    return tuple(sorted(repairs.values(), key=lambda repair: repair.edits))


def _changes(rows: _Rows, read: Sequence[Sequence[_Reading]]) -> tuple[Change, ...]:
    labels = [*(f"a_{i}" for i in range(1, len(rows))), "b_"]
    return tuple(
        Change(f"{label}{j}", _text(pair), _text(reading.pair), ", ".join(reading.kinds))
        for label, row, new in zip(labels, rows, read, strict=True)
        for j, (pair, reading) in enumerate(zip(row, new, strict=True), start=1)
        if reading.kinds
    )


def _text(pair: Pair) -> str:
    return f"{pair[0]}/{pair[1]}" if pair[1] != 1 else str(pair[0])
