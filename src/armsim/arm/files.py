"""Files of an axis: records of its motion as CSV, its constants and instruments as TOML."""

import csv
import dataclasses
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from armsim.arm.measurement import COLUMNS, Instrument, Measurement, faults
from armsim.arm.parameters import AxisParameters
from armsim.checks import hint
from armsim.choices import CHOICES

_HEADING = re.compile(r"\s*(?P<name>[^\[\]]*?)\s*(?:\[\s*(?P<unit>[^\[\]]*?)\s*\])?\s*")


class FileError(ValueError):
    """An error in a file, in one line with the file's name and the row."""


# --- records ------------------------------------------------------------------------------------


def read_measurement(path: str | Path) -> Measurement:
    """Read a record of measured motion.

    Parameters
    ----------
    path : path-like
        CSV in UTF-8 with the columns ``time [s]``, ``set_velocity [V]``, ``position [m]``,
        ``velocity [m/s]`` and ``acceleration [m/s^2]`` in any order, see `Measurement`. Empty
        lines and lines that start with ``#`` are passed over.

    Raises
    ------
    FileError
        If a column, a unit, a row or a number is missing or wrong; the message names the file and
        the row, counted from 1 as in an editor.
    OSError
        If the file cannot be read.
    """
    path = Path(path)
    lines = _rows(path)
    row, header = next(lines, (0, []))
    if not header:
        raise FileError(f"{path}: the file has no header; it is {_header()!r}")
    order = _order(header, f"{path}, row {row}")
    rows, values = [], []
    for row, cells in lines:
        if len(cells) != len(header):
            raise FileError(
                f"{path}, row {row}: {len(cells)} cells; the header has {len(header)} columns"
            )
        rows.append(row)
        values.append([_number(cells[n], name, path, row) for name, n in order.items()])
    columns = np.array(values).reshape(-1, len(COLUMNS)).T
    for sample, text in faults(columns):
        where = path if sample is None else f"{path}, row {rows[sample]}"
        raise FileError(f"{where}: {text}")
    return Measurement(*columns)


def write_measurement(path: str | Path, measurement: Measurement, comment: str = "") -> None:
    """Write a record that `read_measurement` gives back number for number.

    Parameters
    ----------
    path : path-like
        File to write.
    measurement : Measurement
        The record.
    comment : str
        Text for the head of the file, a ``#`` before each line.
    """
    head = [f"# {line}".rstrip() for line in comment.splitlines()]
    rows = np.array(dataclasses.astuple(measurement)).T.tolist()
    body = [",".join(map(repr, row)) for row in rows]
    Path(path).write_text("\n".join([*head, _header(), *body, ""]), encoding="utf-8", newline="\n")


def _header() -> str:
    return ",".join(f"{name} [{unit}]" for name, unit in COLUMNS.items())


def _rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Cells of each line that counts, with its number in the file."""
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise FileError(f"{path}: not a text file in UTF-8; save the record as CSV, UTF-8")
    for row, line in enumerate(text.splitlines(), 1):
        if line.strip() and not line.lstrip().startswith("#"):
            try:
                yield row, next(csv.reader([line]))
            except csv.Error as error:
                raise FileError(f"{path}, row {row}: {error}") from None


def _order(header: Sequence[str], where: str) -> dict[str, int]:
    """Place of each column in the file, once names and units are as they have to be."""
    order: dict[str, int] = {}
    for n, cell in enumerate(header):
        heading = _HEADING.fullmatch(cell)
        name = heading["name"] if heading else cell
        unit = ((heading and heading["unit"]) or "").replace("²", "^2")
        if name not in COLUMNS:
            raise FileError(f"{where}: no column {name!r} is known; {hint(name, COLUMNS)}")
        if name in order:
            raise FileError(f"{where}: the column {name!r} stands there twice")
        if unit != COLUMNS[name]:
            raise FileError(
                f"{where}: column {name!r} has the unit {unit!r}; allowed is {COLUMNS[name]!r}, "
                f"so the heading is '{name} [{COLUMNS[name]}]'"
            )
        order[name] = n
    missing = [name for name in COLUMNS if name not in order]
    if missing:
        raise FileError(f"{where}: missing column {', '.join(missing)}; the header is {_header()}")
    return {name: order[name] for name in COLUMNS}


def _number(cell: str, name: str, path: Path, row: int) -> float:
    try:
        return float(cell.replace("_", "?"))  # Python's 1_000 is not a number in a file
    except ValueError:
        raise FileError(f"{path}, row {row}: {name} = {cell!r} is not a number") from None


# --- axes ---------------------------------------------------------------------------------------


def read_axis(path: str | Path) -> tuple[AxisParameters, Instrument]:
    """Read the constants of an axis and the noise of its instruments.

    Parameters
    ----------
    path : path-like
        TOML with the tables ``[axis]``, the fields of `AxisParameters` (``K_1`` may be left out),
        and ``[instrument]``, those of `Instrument`. With ``choices = "x"`` in ``[axis]``, values
        that are not given come from that axis in ``data/choices.toml``.

    Raises
    ------
    FileError
        If a table or name is unknown or missing, or a value is not allowed.
    OSError
        If the file cannot be read.
    """
    path = Path(path)
    try:
        tables = tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise FileError(f"{path}: not a TOML file in UTF-8: {error}") from None
    kinds = {"axis": AxisParameters, "instrument": Instrument}
    _check_names(tables, list(kinds), (), f"{path}: table")
    for table, kind in kinds.items():
        if not isinstance(tables[table], dict):
            raise FileError(f"{path}: {table} has to be a table, [{table}]")
        if table == "axis" and "choices" in tables[table]:
            tables[table] = _with_choices(tables[table], path)
        names = [item.name for item in dataclasses.fields(kind)]
        _check_names(tables[table], names, ("K_1",), f"{path}, [{table}]: value")
        try:
            tables[table] = kind(**tables[table])
        except (TypeError, ValueError) as error:
            raise FileError(f"{path}, [{table}]: {error}") from None
    return tables["axis"], tables["instrument"]


def _with_choices(table: dict[str, Any], path: Path) -> dict[str, Any]:
    """Fill in our own choices for one of our axes."""
    name = table.pop("choices")
    if name not in CHOICES["axis"]:
        raise FileError(f"{path}, [axis]: choices = {name!r}; {hint(name, CHOICES['axis'])}")
    return CHOICES["axis"][name] | table


def _check_names(
    given: Mapping[str, Any], known: Sequence[str], optional: Sequence[str], where: str
) -> None:
    for name in given:
        if name not in known:
            raise FileError(f"{where} {name!r} is not known; {hint(name, known)}")
    missing = [name for name in known if name not in given and name not in optional]
    if missing:
        raise FileError(f"{where} {', '.join(missing)} missing")
