r"""Misprints of a tableau, found by search: the edits that restore its order.

**What is searched.** Each row of A and the weights b may differ from the print by up to two
edits, in all rows at once. An edit is what goes wrong in typesetting:

- the sign of a coefficient flipped;
- a digit of a numerator or denominator replaced, inserted, deleted, or swapped with its neighbour
  (the number does not then begin with 0);
- two neighbouring coefficients of a row exchanged.

Coefficients that are not printed stay 0, and nodes are the row sums of A.

**How it is pruned.** Weights must add up to 1, and rows are built up from the top; a stage
:math:`i \ge 3` has to satisfy

.. math:: q_i := \sum_j a_{ij} c_j - c_i^2 / 2 = 0,

which ties a row to itself and to the nodes above it. Before the last stage is chosen, the
quadrature conditions :math:`\sum_i b_i c_i^{k-1} = 1/k` are used, which determine its node. What
is left is decided by `armsim.methods.trees.order`. So the claim is: *among all tableaux within
the edits whose stages satisfy* :math:`q_i = 0`, those found are all that reach the highest order.

**When the condition on q is no restriction.** Three of the conditions of order 5, those for
:math:`b c^4`, :math:`b c^2 (Ac)` and :math:`b (Ac)^2`, add up to

.. math:: \sum_i b_i q_i^2 = \tfrac{1}{20} - \tfrac{1}{10} + \tfrac{1}{4} \cdot \tfrac{1}{5} = 0,

hence where no weight is negative, every method of order 5 or more has :math:`q_i = 0` at each
stage with a weight. `Errata.weights_tied` counts the rows of weights for which this holds.

All pruning is by arithmetic modulo a prime larger than every denominator that occurs: an equation
between the rationals holds modulo the prime too, so nothing is lost, and what passes by accident
fails the exact test of the order.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations, product
from math import prod

import numpy as np

from armsim.methods import trees
from armsim.methods.tableaux import Tableau, printed_fractions

Pair = tuple[int, int]

_PRIME = 2**30 - 35  # sums of eight products of residues fit into 64 bits
_MAX_STAGES = 8
_MAX_DENOMINATOR = 10**7 - 1  # two inserted digits keep it below the prime
_EDITS = 2


@dataclass(frozen=True)
class Edit:
    """One coefficient that differs from the print."""

    coefficient: str  #: such as ``"a_61"`` or ``"b_5"``
    printed: str
    corrected: str
    kind: str
    edits: int  #: how many single edits that is


@dataclass(frozen=True)
class Repair:
    """A tableau of the highest order and how it differs from the print."""

    tableau: Tableau
    changes: tuple[Edit, ...]

    @property
    def edits(self) -> int:
        """Number of single edits."""
        return sum(change.edits for change in self.changes)


@dataclass(frozen=True)
class Errata:
    """What `search` found."""

    printed: Tableau
    order_before: int
    order_after: int  #: the highest order within the searched edits
    repairs: tuple[Repair, ...]  #: all that reach it, fewest edits first; empty if none is needed
    candidates: tuple[int, ...]  #: versions examined of each row of A below the first, and of b
    weights_consistent: int  #: versions of b that add up to 1
    weights_tied: int  #: those for which order 5 needs stage conditions q = 0, see the module

    @property
    def unique(self) -> bool:
        """Whether exactly one tableau within the searched edits reaches the highest order."""
        return len(self.repairs) == 1

    @property
    def combinations(self) -> int:
        """Size of the searched space: the product of `candidates`."""
        return prod(self.candidates)


def search(source: str | Sequence[Sequence[Pair]], name: str = "tableau") -> Errata:
    """Find every tableau near a printed one that has the highest order.

    Parameters
    ----------
    source : {"rk5", "rk6", "ndp5", "ndp6"} or (s + 1) rows of s pairs
        A method of the paper, or the rows of A and, last, the weights, as unreduced
        ``(numerator, denominator)``; ``(0, 1)`` for a coefficient that is not printed.
    name : str
        Name of the method, if `source` is not a key.

    Returns
    -------
    Errata
        For the edits and conditions in the description of this module.

    Raises
    ------
    ValueError
        If the key is unknown, the tableau is not explicit or has rows of unequal length, it has
        more than eight stages, or a denominator is not an integer from 1 to 9999999.
    """
    if isinstance(source, str):
        name, rows = source, printed_fractions(source)
    else:
        rows = [[(int(n), int(d)) for n, d in row] for row in source]
    printed = _tableau(name, _checked(rows))
    before = trees.order(printed)
    stages, weights = [_Versions(row) for row in rows[1:-1]], _Versions(rows[-1])
    consistent = np.flatnonzero(weights.sums == 1)
    heads = _heads(stages[:-1])
    repairs: tuple[Repair, ...] = ()
    after = before
    for target in range(printed.stages, before, -1):  # s stages never exceed order s
        tableaux = _complete(heads, stages, weights, consistent, target)
        if repairs := _repairs(rows, stages, weights, tableaux, name, target):
            after = target
            break
    return Errata(
        printed, before, after, repairs,
        candidates=(*(version.count for version in stages), weights.count),
        weights_consistent=len(consistent),
        weights_tied=sum(all(w.value >= 0 for w in weights.choice(k)) for k in consistent),
    )  # fmt: skip


def _checked(rows: Sequence[Sequence[Pair]]) -> Sequence[Sequence[Pair]]:
    if not 3 <= len(rows) <= _MAX_STAGES + 1:
        raise ValueError(
            f"tableau of {len(rows) - 1} stages: the search takes 2 to {_MAX_STAGES} stages"
        )
    for row in rows:
        for _, d in row:
            if not 1 <= d <= _MAX_DENOMINATOR:
                raise ValueError(f"denominator {d}: must lie within 1 and {_MAX_DENOMINATOR}")
    return rows


def _tableau(name: str, rows: Sequence[Sequence[Pair]]) -> Tableau:
    *A, b = [[f"{n}/{d}" for n, d in row] for row in rows]
    return Tableau(name, A, b)


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
    """A coefficient after one more edit."""
    n, d = pair
    yield (-n, d), "sign flipped"
    for number, kind in _numbers(abs(n)):
        yield (number if n > 0 else -number, d), f"{kind} in the numerator"
    for number, kind in _numbers(d):
        yield (n, number), f"{kind} in the denominator"


@cache
def _readings(pair: Pair) -> tuple[list[_Reading], list[int]]:
    """Each value of a coefficient within two edits, and how many there are within 0, 1, 2."""
    texts: dict[Pair, tuple[str, ...]] = {pair: ()}
    ends = [1]
    newest = list(texts) if pair[0] else []  # what is not printed cannot be misprinted
    values = {Fraction(*pair): _Reading(pair, ())}
    for _ in range(_EDITS):
        # Texts of equal value stay apart here, because they lead to different second edits.
        fresh = [(t, (*texts[base], kind)) for base in newest for t, kind in _edited(base)]
        newest = []
        for text, kinds in fresh:
            if text not in texts:
                texts[text] = kinds
                newest.append(text)
                values.setdefault(Fraction(*text), _Reading(text, kinds))
        ends.append(len(values))
    return list(values.values()), ends


class _Versions:
    """All versions of a row within two edits, as residues, one column of a matrix each."""

    def __init__(self, row: Sequence[Pair]) -> None:
        self._blocks = [
            (columns, picks) for columns, budget in _exchanged(row)
            for picks in [_picks([_readings(pair)[1] for pair, _ in columns], budget)]
        ]  # fmt: skip
        self.residues = np.hstack([_residues(*block) for block in self._blocks])
        self.sums = self.residues.sum(axis=0) % _PRIME
        self.count = len(self.sums)
        self._printed = tuple(j for j, (n, _) in enumerate(row) if n)
        self._half_squares = self.sums * self.sums % _PRIME * pow(2, -1, _PRIME) % _PRIME

    def tied(self, nodes: Sequence[int]) -> np.ndarray:
        """Versions for which Σ a_ij c_j = c_i²/2, given the nodes above; any for stage 2."""
        if len(nodes) == 1:
            return np.arange(self.count)
        total = -self._half_squares
        for j in self._printed:
            total += self.residues[j] * nodes[j] % _PRIME
        return np.flatnonzero(total % _PRIME == 0)

    def readings(self, version: int) -> list[_Reading]:
        """Coefficients of a version, with the edits that lead to each."""
        for columns, picks in self._blocks:
            if version < picks.shape[1]:
                break
            version -= picks.shape[1]
        found = [_readings(pair)[0][k] for (pair, _), k in zip(columns, picks[:, version])]
        return [
            _Reading(reading.pair, (*moved, *reading.kinds))
            for reading, (_, moved) in zip(found, columns, strict=True)
        ]
