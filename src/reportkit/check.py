"""Compare the values that notebooks recorded with the expected ones.

Only recorded values are compared. Tables and the data of figures come from the same computations,
but some of their columns are rounding errors, which differ between machines.
"""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain, groupby
from pathlib import Path
from typing import Any

from reportkit import text
from reportkit.project import ProjectError

#: Headings of `Comparison.change`.
CHANGE = ["recorded value", "published", "here", "difference", "relative", "unit"]
#: Relative tolerance of a float recorded without one; all other values must then be equal.
DEFAULT_RELATIVE = 1e-9

Record = Mapping[str, Any]
Records = Mapping[str, Record]


@dataclass(frozen=True)
class Comparison:
    """One recorded value beside the expected one; the record of a missing one is empty."""

    study: str
    name: str
    expected: Record
    got: Record

    @property
    def difference(self) -> float | None:
        """The recorded value minus the expected one; None unless both are numbers."""
        old, new = (side.get("value", "") for side in (self.expected, self.got))
        return None if {type(old), type(new)} & {bool, str} else new - old

    @property
    def relative(self) -> float | None:
        """The difference as a share of the expected value."""
        value = self.expected.get("value")
        return None if self.difference is None or not value else self.difference / abs(value)

    @property
    def moved(self) -> str:
        """Why the records differ: new, missing, unit, tolerance or value; empty if they agree."""
        old, new = self.expected, self.got
        if not old or not new:
            return "missing" if old else "new"
        if old["unit"] != new["unit"]:
            return "unit"
        if _rule(old) != _rule(new):
            return "tolerance"  # otherwise a notebook could loosen its own test
        if self.difference is None:
            agree = type(old["value"]) is type(new["value"]) and old["value"] == new["value"]
        else:
            agree = abs(self.difference) <= _allowed(old)
        return "" if agree or not old.get("compared", True) else "value"

    def row(self) -> list[str]:
        """Return name, expected, got, tolerance and notebook, the cells of a table."""
        moved, sides = self.moved, (self.expected, self.got)
        values = (_shown(one, one.get("unit") if moved == "unit" else None) for one in sides)
        rules = dict.fromkeys(_tolerance(one) for one in sides if one)
        where = self.study if moved == "value" else f"{self.study}, {moved}"
        return [self.name, *values, " → ".join(rules), where]

    @property
    def numbers(self) -> list[Any]:
        """Name, both values, difference, relative difference and unit."""
        values = self.expected.get("value"), self.got.get("value"), self.difference, self.relative
        return [self.name, *values, (self.got or self.expected)["unit"]]

    @property
    def change(self) -> list[str]:
        """The same as texts."""
        *_, difference, share, unit = self.numbers
        values = (_shown(side, digits=6) for side in (self.expected, self.got))
        changes = ("" if difference is None else f"{difference:+.3g}",
                   "" if share is None else f"{100 * share:+.3g} %")  # fmt: skip
        return [self.name, *values, *changes, "" if unit in (None, "1") else unit]


def compare(study: str, expected: Records, got: Records) -> list[Comparison]:
    """Pair the records of one study by name, the missing ones last."""
    names = {**got, **expected}
    return [Comparison(study, name, expected.get(name, {}), got.get(name, {})) for name in names]


def compare_folders(results: Path, expected: Path) -> list[Comparison]:
    """Pair all records of the studies ``NN_topic.json`` of two folders.

    Raises
    ------
    FileNotFoundError
        If the folder of results holds none.
    ProjectError
        If a file does not hold records.
    """
    built, wanted = load_all(results), load_all(expected)
    if not built:
        raise FileNotFoundError(f"no results in {results}: build them first")
    studies = sorted(built | wanted)
    found = (compare(one, wanted.get(one, {}), built.get(one, {})) for one in studies)
    return [*chain.from_iterable(found)]


def update(pairs: Sequence[Comparison], expected: Path) -> None:
    """Replace the expected values that differ by more than their tolerance; keep all others.

    The pairs come study by study, as from `compare_folders`.
    """
    expected.mkdir(parents=True, exist_ok=True)
    for study, group in groupby(pairs, key=lambda pair: pair.study):
        records = {one.name: one.got if one.moved else one.expected for one in group if one.got}
        path = expected / f"{study}.json"
        if records:
            text.write(path, text.to_json(records))
        else:
            path.unlink()


def load(path: Path) -> dict[str, Any]:
    """Read the records of one study.

    Raises
    ------
    ProjectError
        If the file does not hold records.
    """
    with suppress(ValueError, AttributeError, TypeError):
        records = json.loads(path.read_text(encoding="utf-8"))
        if all({"value", "unit", "tolerance"} <= set(item) for item in records.values()):
            return dict(records)
    raise ProjectError(f"{path} is not the record of a study")


def load_all(folder: Path) -> dict[str, dict[str, Any]]:
    """Read the records of every study in a folder, by study."""
    return {path.stem: load(path) for path in text.studies(folder, ".json")}


def _rule(record: Record) -> tuple[Any, ...]:
    return record["tolerance"], record.get("relative"), record.get("compared", True)


def _allowed(record: Record) -> float:
    value, tolerance = record["value"], record["tolerance"]
    relative = record.get("relative", DEFAULT_RELATIVE if isinstance(value, float) else 0.0)
    return relative * abs(value) if tolerance is None else tolerance


def _tolerance(record: Record) -> str:
    if not record.get("compared", True):
        return "not compared"
    if isinstance(record["value"], bool | str):
        return "equal"
    return f"{100 * record['relative']:g} %" if "relative" in record else f"{_allowed(record):.3g}"


def _shown(record: Record, unit: str | None = None, digits: int = 12) -> str:
    return text.number(record["value"], unit, digits) if record else "–"
