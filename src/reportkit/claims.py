"""Claims, each tested on recorded values by a criterion fixed in advance.

A claim that passes its tests is confirmed; one that fails them, but passes those of a corrected
reading, is confirmed with a correction; one that fails both is refuted. A claim may say that it
cannot be tested, and why.
"""

import sys
import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pandas as pd
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from reportkit import figures, text
from reportkit.check import load_all
from reportkit.project import Project

CONFIRMED, CORRECTED = "confirmed", "confirmed with a correction"
REFUTED, UNTESTABLE = "refuted", "cannot be tested"
VERDICTS = (CONFIRMED, CORRECTED, REFUTED, UNTESTABLE)
_RELATIONS = {"equals": "", "above": "> ", "below": "< "}

HEADING = ["the paper says", "required", "measured", "difference", "tolerance", "verdict"]

Records = Mapping[str, Mapping[str, Mapping[str, Any]]]  #: study, name, record


class ClaimError(ValueError):
    """A claim is malformed, or its recorded value is missing."""


@dataclass(frozen=True)
class Test:
    """A criterion that compares a recorded value with a number or with another recorded value.

    Parameters
    ----------
    value : str
        Recorded value, ``"NN_topic::name"``.
    equals, above, below : float or str
        One of them: a number, or a recorded value.
    times : float
        Factor of that number or value.
    tolerance : float
        Largest difference allowed by `equals`.
    format : str
        Format in which the value is printed.
    unit : str, optional
        Unit to print instead of the recorded one.
    """

    __test__ = False  # for pytest

    value: str
    equals: float | str | None = None
    above: float | str | None = None
    below: float | str | None = None
    times: float = 1.0
    tolerance: float = 0.0
    format: str = "g"
    unit: str | None = None

    def __post_init__(self) -> None:
        if [self.equals, self.above, self.below].count(None) != 2:
            raise ClaimError(f"{self.value}: one of {', '.join(_RELATIONS)} is needed")
        if (self.tolerance > 0) != isinstance(self.equals, float | str):  # a count must be equal
            raise ClaimError(f"{self.value}: a tolerance belongs to equals, and equals needs one")

    @property
    def relation(self) -> str:
        """`equals`, `above` or `below`."""
        return next(name for name in _RELATIONS if getattr(self, name) is not None)

    def bound(self, records: Records) -> float:
        """Return the number that the value is compared with."""
        bound = getattr(self, self.relation)
        return self.times * (_number(records, bound) if isinstance(bound, str) else bound)

    def passes(self, records: Records) -> bool:
        """Return whether the recorded value meets the criterion."""
        value, bound = _number(records, self.value), self.bound(records)
        if self.relation == "equals":
            return abs(value - bound) <= self.tolerance
        return value > bound if self.relation == "above" else value < bound

    def row(self, records: Records) -> tuple[str, str, str, str]:
        """Return required value, measured value, difference and tolerance, as texts."""
        value, bound = _number(records, self.value), self.bound(records)
        unit = self.unit if self.unit is not None else _record(records, self.value)["unit"] or ""
        unit = "" if unit == "1" else f" {unit}"
        tolerance = f"{self.tolerance:g}{unit}" if self.tolerance else "exact"
        return (
            f"{_RELATIONS[self.relation]}{bound:{self.format}}{unit}",
            f"{value:{self.format}}{unit}",
            f"{value - bound:+{self.format}}{unit}".replace("-", "−"),
            tolerance if self.relation == "equals" else "one-sided",
        )


@dataclass(frozen=True)
class Claim:
    """A statement and its tests.

    Parameters
    ----------
    name : str
        Short name for the figure.
    where : str
        Place of the statement in its source.
    text : str
        The statement in a few words.
    page : str
        Page of the book that shows the evidence.
    tests : list of Test
        Tests of the statement as printed.
    corrected : list of Test
        Tests of a corrected reading.
    note : str
        Correction, reason or assumption.
    untestable : bool
        Whether it cannot be tested; then `note` says why.
    """

    name: str
    where: str
    text: str
    page: str
    tests: Sequence[Test] = field(default=())
    corrected: Sequence[Test] = field(default=())
    note: str = ""
    untestable: bool = False

    def __post_init__(self) -> None:
        if self.untestable != (not self.tests):
            raise ClaimError(f"{self.name}: tests, or that it is untestable, one of them")
        if (self.untestable or self.corrected) and not self.note:
            raise ClaimError(f"{self.name}: the note is missing")

    def verdict(self, records: Records) -> str:
        """Return one of `VERDICTS`."""
        if self.untestable:
            return UNTESTABLE
        if all(test.passes(records) for test in self.tests):
            return CONFIRMED
        if self.corrected and all(test.passes(records) for test in self.corrected):
            return CORRECTED
        return REFUTED


def load(path: Path) -> list[Claim]:
    """Read the claims.

    Raises
    ------
    ClaimError
        If a claim is malformed.
    """
    claims = []
    for table in tomllib.loads(path.read_text(encoding="utf-8"))["claim"]:
        try:
            for key in {"tests", "corrected"} & set(table):
                table[key] = [Test(**test) for test in table[key]]
            claims.append(Claim(**table))
        except TypeError as error:
            raise ClaimError(f"{table.get('name', table)}: {error}") from None
    return claims


def _record(records: Records, place: str) -> Mapping[str, Any]:
    study, _, name = place.partition("::")
    if name not in records.get(study, {}):
        raise ClaimError(f"a claim needs {place}, which is not recorded")
    return records[study][name]


def _number(records: Records, place: str) -> float:
    return float(_record(records, place)["value"])


# --- what pages include -------------------------------------------------------------------------


def table(claims: Iterable[Claim], records: Records) -> str:
    """Return the table of the claims and their verdicts, for a page in the folder of the pages."""
    rows = []
    for claim in claims:
        verdict = claim.verdict(records)
        tests = [*claim.tests, *(claim.corrected if verdict == CORRECTED else ())]
        columns = zip(*(test.row(records) for test in tests), strict=True)
        cells = [*map("<br>".join, columns)] or ["–"] * 4
        note = f": {claim.note}" if claim.note else ""
        told = f"**{verdict}**{note} ({{doc}}`shown here <{claim.page}>`)"
        rows.append([f"{claim.text} ({claim.where})", *cells, told])
    return text.markdown_table(HEADING, rows)


def summary(claims: Sequence[Claim], records: Records) -> str:
    """Return one sentence that counts the verdicts."""
    counts = Counter(claim.verdict(records) for claim in claims)
    verbs = {name: "is " if counts[name] == 1 else "are " for name in VERDICTS} | {UNTESTABLE: ""}
    *others, last = [f"{counts[name]} {verbs[name]}{name}" for name in VERDICTS if counts[name]]
    return f"Of {len(claims)} claims, {', '.join(others)}{' and ' if others else ''}{last}.\n"


_LOOK = {CONFIRMED: (3, "o"), CORRECTED: (0, "D"), REFUTED: (1, "X"), UNTESTABLE: (4, "s")}


@mpl.rc_context(figures.STYLE)
def figure(claims: Sequence[Claim], records: Records) -> Figure:
    """Draw the claims by verdict, one line each in two columns."""
    groups = {name: [c.name for c in claims if c.verdict(records) == name] for name in VERDICTS}
    sides = ((CONFIRMED, UNTESTABLE), (CORRECTED, REFUTED))
    height = max(sum(len(groups[name]) + 2 for name in side if groups[name]) for side in sides)
    fig, ax = plt.subplots(figsize=(figures.WIDTH, 0.27 * height))
    for left, side in enumerate(sides):
        y = 0
        for verdict in (name for name in side if groups[name]):
            colour, marker = _LOOK[verdict]
            ax.text(left, y, f"{len(groups[verdict])} {verdict}", weight="bold", va="center")
            for n, name in enumerate(groups[verdict], 1):
                ax.plot(left + 0.03, y - n, marker, color=figures.PALETTE[colour], ms=7)
                ax.text(left + 0.08, y - n, name, va="center")
            y -= len(groups[verdict]) + 2
    ax.set(xlim=(0, 2), ylim=(1.0 - height, 0.7))
    ax.set_axis_off()
    return fig


def main(arguments: Sequence[str] | None = None) -> int:
    """Run ``python -m reportkit.claims RESULTS``: write the verdicts beside the results."""
    (results,) = map(Path, sys.argv[1:] if arguments is None else arguments)
    try:
        claims, records = load(Project.find().claims), load_all(results)
        verdicts = [(claim.name, claim.where, claim.verdict(records)) for claim in claims]
    except ClaimError as error:
        print(f"claims.toml: {error}", file=sys.stderr)
        return 1
    frame = pd.DataFrame(verdicts, columns=["claim", "where", "verdict"])
    figures.save(figure(claims, records), results / "verdicts.svg")
    text.write(results / "verdicts-summary.md", summary(claims, records))
    text.write(results / "verdicts.csv", frame.to_csv(index=False, lineterminator="\n"))
    # last, because make takes it as the sign that all are there
    text.write(results / "verdicts.md", table(claims, records))
    return 0


if __name__ == "__main__":
    sys.exit(main())
