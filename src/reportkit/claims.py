"""Claims, each tested on recorded values by its criterion.

A claim that passes its tests is confirmed; one that fails them, but passes those of a corrected
reading, is confirmed with a correction; one that fails both is refuted. Other reasonable readings
of the claim are tested as well. If one of them, or a changed choice of the authors, changes the
result, the claim depends on the reading. A claim may say that it cannot be tested, and why.
"""

import sys
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

import pandas as pd

from reportkit import text
from reportkit.check import load_all
from reportkit.program import run
from reportkit.project import Project, ProjectError

CONFIRMED, CORRECTED, REFUTED = "confirmed", "confirmed with a correction", "refuted"
DEPENDS, UNTESTABLE = "depends on the reading", "cannot be tested"
#: Every verdict in the order of the report, with its symbol.
VERDICTS = {REFUTED: "✗", DEPENDS: "◐", CORRECTED: "(✓)", CONFIRMED: "✓", UNTESTABLE: "?"}
_RELATIONS = {"equals": "= ", "above": "> ", "below": "< "}
PUBLISHED = "published"  #: the case that the other variations are compared with
#: What is written, from templates of these names; the last tells make that all are there.
FILES = ("verdicts-summary.md", "verdicts-list.md", "verdicts.md")

Records = Mapping[str, Mapping[str, Mapping[str, Any]]]  #: study, name, record


class ClaimError(ProjectError):
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
    what : str
        The measured quantity, if the name of the reading does not say it.
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
    what: str = ""

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
        within = abs(value - bound) <= self.tolerance
        return {"equals": within, "above": value > bound, "below": value < bound}[self.relation]

    def measured(self, records: Records) -> str:
        """Return the recorded value as a text."""
        return self._text(records, f"{_number(records, self.value):z{self.format}}")

    def criterion(self, records: Records) -> str:
        """Return what the value has to be, as a text."""
        bound = getattr(self, self.relation)
        form = f"z{self.format}" if isinstance(bound, str) else ".12g"  # a threshold as we wrote it
        allowed = f" ± {self.tolerance:g}" if self.tolerance else ""
        told = f"{_RELATIONS[self.relation]}{self.bound(records):{form}}{allowed}"
        return self._text(records, told)

    def _text(self, records: Records, told: str) -> str:
        unit = self.unit if self.unit is not None else _record(records, self.value)["unit"] or ""
        return text.number(told.replace("-", "−"), unit)


@dataclass(frozen=True)
class Reading:
    """One way to read a claim, and its tests, all of which have to pass."""

    name: str
    tests: Sequence[Test]

    def holds(self, records: Records) -> bool:
        """Return whether the claim holds, read in this way; not without a test."""
        return bool(self.tests) and all(test.passes(records) for test in self.tests)


@dataclass(frozen=True)
class Claim:
    """A statement and its tests.

    Parameters
    ----------
    name : str
        Short name for the list of verdicts, in plain text.
    where : str
        Place of the statement in its source.
    text : str
        The statement in a few words.
    page : str
        Page of the book that shows the evidence.
    tests : list of Test
        Tests of the statement as printed.
    reading : str
        Name of the reading that these tests make, or what they measure.
    corrected : list of Test
        Tests of a corrected reading.
    readings : list of Reading
        Other reasonable readings.
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
    reading: str = ""
    corrected: Sequence[Test] = field(default=())
    readings: Sequence[Reading] = field(default=())
    note: str = ""
    untestable: bool = False

    def __post_init__(self) -> None:
        if self.untestable != (not self.tests):
            raise ClaimError(f"{self.name}: expected either tests or untestable = true")
        if (self.untestable or self.corrected) and not self.note:
            raise ClaimError(f"{self.name}: the note is missing")
        if self.readings and not self.reading:
            raise ClaimError(f"{self.name}: name the reading of its tests if it has other readings")

    def as_listed(self) -> list[Reading]:
        """Return all readings, that of the claim's own tests first."""
        own, corrected = Reading(self.reading, self.tests), Reading("corrected", self.corrected)
        return [one for one in (own, corrected, *self.readings) if one.tests]

    def holding(self, records: Records) -> int:
        """Return under how many of its readings the claim holds."""
        return sum(reading.holds(records) for reading in self.as_listed())

    def verdict(self, records: Records, turned: Sequence[str] = ()) -> str:
        """Return one of `VERDICTS`.

        Parameters
        ----------
        records
            Recorded values.
        turned : list of str
            Changed choices with which the verdict is another.
        """
        if self.untestable:
            return UNTESTABLE
        own, corrected = (Reading("", t).holds(records) for t in (self.tests, self.corrected))
        verdict = CONFIRMED if own else CORRECTED if corrected else REFUTED
        others = {reading.holds(records) for reading in self.readings}
        return DEPENDS if turned or others - {verdict != REFUTED} else verdict


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
            own = {k: [Test(**one) for one in table.get(k, ())] for k in ("tests", "corrected")}
            named = table.get("readings", {}).items()
            readings = [Reading(name, [Test(**one) for one in tables]) for name, tables in named]
            claims.append(Claim(**table | own | {"readings": readings}))
        except (TypeError, ClaimError) as error:
            raise ClaimError(f"{path.name}, {table.get('name', table)}: {error}") from None
    return claims


def load_opinions(path: Path) -> dict[str, list[str]]:
    """Read for each recorded value how it was computed again; nothing if there is no such file."""
    found: dict[str, list[str]] = {}
    told = tomllib.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    for opinion in told.get("opinion", ()):
        for place in opinion["values"]:
            found.setdefault(place, []).append(opinion["how"])
    return found


def load_turned(path: Path) -> dict[str, list[str]]:
    """Read the changed choices that change the verdict on each claim.

    The file has the columns ``variation``, ``claim`` and ``verdict``, and the rows of the variation
    `PUBLISHED`. An empty verdict is that of a claim that the change makes meaningless.
    """
    if not path.is_file():
        return {}
    rows = pd.read_csv(path, dtype=str, keep_default_na=False)
    table = rows.pivot(index="claim", columns="variation", values="verdict")
    other = table.ne(table[PUBLISHED], axis=0) & table.ne("")
    return {claim: list(row.index[row]) for claim, row in other.iterrows()}


def _record(records: Records, place: str) -> Mapping[str, Any]:
    study, _, name = place.partition("::")
    if name not in records.get(study, {}):
        raise ClaimError(f"a claim needs {place}, which is not recorded")
    return records[study][name]


def _number(records: Records, place: str) -> float:
    return float(_record(records, place)["value"])


# --- what pages include -------------------------------------------------------------------------


@dataclass(frozen=True)
class Verdicts:
    """The claims of a report with all that decides on them."""

    claims: Sequence[Claim]
    records: Records
    turned: Mapping[str, Sequence[str]] = field(default_factory=dict)
    opinions: Mapping[str, Sequence[str]] = field(default_factory=dict)

    def of(self, claim: Claim) -> str:
        """Return the verdict on a claim."""
        return claim.verdict(self.records, self.turned.get(claim.name, ()))

    def by_verdict(self) -> dict[str, list[Claim]]:
        """Return the claims of each verdict that there is, in the order of `VERDICTS`."""
        found = {verdict: [c for c in self.claims if self.of(c) == verdict] for verdict in VERDICTS}
        return {verdict: claims for verdict, claims in found.items() if claims}

    def computed(self, claim: Claim) -> str:
        """Return how often each value of a claim was computed at least, and in which ways."""
        places = {test.value for reading in claim.as_listed() for test in reading.tests}
        ways = {place: self.opinions.get(place, ()) for place in places}
        timed = {p for p in places if not _record(self.records, p).get("compared", True)}
        fewest = 1 + min((len(ways[place]) for place in places - timed), default=0)
        times = {1: "once", 2: "twice"}.get(fewest, f"{fewest} times")
        own = "by the notebook, a measured time" if timed else "by the notebook"
        return f"Computed {times}: {'; '.join([own, *sorted({*chain(*ways.values())})])}."

    def render(self, template: str, folder: str = "") -> str:
        """Fill one of the templates `FILES`; `folder` is that of the pages that claims link to."""
        return text.render(template, found=self, symbols=VERDICTS, folder=folder)


def main(results: Path) -> None:
    """Run ``python -m reportkit.claims RESULTS``: write the verdicts beside the results."""
    project = Project.find()
    beside = load_turned(project.variations), load_opinions(project.opinions)
    found = Verdicts(load(project.claims), load_all(results), *beside)
    verdicts = [(claim.name, claim.where, found.of(claim)) for claim in found.claims]
    folder = f"/{project.results.parent.relative_to(project.root).as_posix()}"
    pages = {name: found.render(name, folder) for name in FILES}
    frame = pd.DataFrame(verdicts, columns=["claim", "where", "verdict"])
    text.write(results / "verdicts.csv", frame.to_csv(index=False, lineterminator="\n"))
    for name, page in pages.items():
        text.write(results / name, page)


if __name__ == "__main__":
    sys.exit(run(main, sys.argv[1:]))
