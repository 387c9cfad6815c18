"""Compare what notebooks recorded with what is expected, value by value.

Only recorded values are compared. Tables and the data of figures come from the same computations,
but some of their columns are rounding errors, which differ from machine to machine.
"""

import json
import os
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

#: Of a float recorded without a tolerance; anything else then has to be equal.
DEFAULT_RELATIVE = 1e-9

Record = Mapping[str, Any]
Records = Mapping[str, Record]


@dataclass(frozen=True)
class Comparison:
    """One recorded value beside the expected one; either may be missing."""

    study: str
    name: str
    expected: Record | None
    got: Record | None

    @property
    def difference(self) -> float | None:
        """How much more it is than expected; None unless both are numbers."""
        values = [record["value"] for record in (self.expected, self.got) if record]
        if len(values) < 2 or any(isinstance(value, bool | str) for value in values):
            return None
        return values[1] - values[0]

    @property
    def relative(self) -> float | None:
        """The difference as a share of the expected value."""
        if self.difference is None or not self.expected or not self.expected["value"]:
            return None
        return self.difference / abs(self.expected["value"])

    @property
    def moved(self) -> str:
        """What differs by more than is tolerated: value, unit, tolerance, or nothing."""
        if self.expected is None:
            return "new"
        if self.got is None:
            return "missing"
        if self.expected["unit"] != self.got["unit"]:
            return "unit"
        if _rule(self.expected) != _rule(self.got):
            return "tolerance"  # or a notebook could loosen its own test
        return "" if self._agrees() else "value"

    def _agrees(self) -> bool:
        assert self.expected is not None and self.got is not None
        if not self.expected.get("compared", True):
            return True
        expected, got = self.expected["value"], self.got["value"]
        if self.difference is None:
            return type(expected) is type(got) and expected == got
        return abs(self.difference) <= _allowed(self.expected)

    def row(self) -> list[str]:
        """Cells of the table that tells what moved."""
        sides = [self.expected, self.got]
        rules = [_tolerance(side) for side in sides if side]
        unit = self.moved == "unit"
        return [
            self.name,
            *(number(side["value"], side["unit"] if unit else None) if side else "–"
              for side in sides),
            " → ".join(dict.fromkeys(rules)),
            f"{self.study}{f', {self.moved}' if self.moved != 'value' else ''}",
        ]  # fmt: skip


def compared(pair: Comparison) -> list[str]:
    """Name, both values, difference, its share and unit of a comparison, as texts."""
    sides = [number(side["value"], digits=6) if side else "–" for side in (pair.expected, pair.got)]
    difference = "" if pair.difference is None else f"{pair.difference:+.3g}"
    share = "" if pair.relative is None else f"{100 * pair.relative:+.3g} %"
    unit = (pair.got or pair.expected or {})["unit"] or ""
    return [pair.name, *sides, difference, share, "" if unit == "1" else unit]


def compare(study: str, expected: Records, got: Records) -> list[Comparison]:
    """Pair the records of one study by name: what it recorded, then what it misses."""
    return [
        Comparison(study, name, expected.get(name), got.get(name))
        for name in dict.fromkeys([*got, *expected])
    ]


def compare_folders(results: Path, expected: Path) -> list[Comparison]:
    """Pair all records of the studies ``NN_topic.json`` of two folders.

    Raises
    ------
    FileNotFoundError
        If nothing was built.
    ValueError
        If a file does not hold records.
    """
    built, wanted = load_all(results), load_all(expected)
    if not built:
        raise FileNotFoundError(f"no results in {results}: build them first with make book")
    pairs = []
    for study in sorted(built | wanted):
        pairs += compare(study, wanted.get(study, {}), built.get(study, {}))
    return pairs


def update(pairs: Sequence[Comparison], expected: Path) -> None:
    """Make what moved the expectation; what did not keeps its old digits."""
    expected.mkdir(parents=True, exist_ok=True)
    for study in dict.fromkeys(pair.study for pair in pairs):
        records = {
            pair.name: pair.got if pair.moved else pair.expected
            for pair in pairs
            if pair.study == study and pair.got
        }
        path = expected / f"{study}.json"
        if records:
            replace_text(path, to_json(records))
        else:
            path.unlink()


def load(path: Path) -> dict[str, Any]:
    """Read the records of one study.

    Raises
    ------
    ValueError
        If the file does not hold records.
    """
    try:
        records = json.loads(path.read_text(encoding="utf-8"))
        complete = all({"value", "unit", "tolerance"} <= set(item) for item in records.values())
    except (ValueError, AttributeError, TypeError):
        complete = False
    if not complete:
        raise ValueError(f"{path} does not hold what a study records")
    return dict(records)


def load_all(folder: Path) -> dict[str, dict[str, Any]]:
    """Read the records of every study in a folder, by study."""
    return {path.stem: load(path) for path in sorted(folder.glob("[0-9][0-9]_*.json"))}


def to_json(records: Any) -> str:
    """Text of the file that keeps records."""
    return json.dumps(records, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def replace_text(path: Path, text: str) -> None:
    """Write a file so that it is there as a whole or not at all."""
    with tempfile.TemporaryDirectory(prefix=f".{path.stem}-", dir=path.parent) as folder:
        part = Path(folder, path.name)
        part.write_text(text, encoding="utf-8", newline="\n")
        os.replace(part, path)


def number(value: Any, unit: str | None = None, digits: int = 12) -> str:
    """Text of a recorded value, with its unit if it has one."""
    text = f"{value:.{digits}g}" if isinstance(value, float) else str(value)
    return text if unit in (None, "1") else f"{text} {unit}"


def layout(rows: Iterable[Sequence[str]]) -> str:
    """Set rows, the first being the heading, in columns."""
    rows = list(rows)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    rows.insert(1, ["-" * width for width in widths])
    pad = [[cell.ljust(width) for cell, width in zip(row, widths, strict=True)] for row in rows]
    return "\n".join("  ".join(row).rstrip() for row in pad)


def _rule(record: Record) -> tuple[Any, ...]:
    return record["tolerance"], record.get("relative"), record.get("compared", True)


def _allowed(record: Record) -> float:
    value, tolerance, relative = record["value"], record["tolerance"], record.get("relative")
    if tolerance is not None:
        return float(tolerance)
    if relative is None:
        relative = DEFAULT_RELATIVE if isinstance(value, float) else 0.0
    return relative * abs(value)


def _tolerance(record: Record) -> str:
    if not record.get("compared", True):
        return "not compared"
    if isinstance(record["value"], bool | str):
        return "equal"
    if record.get("relative") is not None:
        return f"{100 * record['relative']:g} %"
    return f"{_allowed(record):.3g}"
