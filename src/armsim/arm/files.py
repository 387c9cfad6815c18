"""Files of an axis: records of motion as CSV, constants and instruments as TOML."""

import dataclasses
import re
import tomllib
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from armsim.arm.measurement import COLUMNS, Instrument, Measurement, faults
from armsim.arm.parameters import AxisParameters
from armsim.checks import hint
from armsim.choices import CHOICES

#: Name and unit of a column; matches any text.
_HEADING = re.compile(r"^\s*(.*?)\s*(?:\[\s*([^\[\]]*?)\s*\])?\s*$", re.DOTALL)
_COMMAS = "; decimal commas need semicolons or tabs between the cells"
_HEADER = ",".join(f"{name} [{unit}]" for name, unit in COLUMNS.items())


class FileError(ValueError):
    """Error in a file; the message is one line and names the file and the row."""


# --- records ------------------------------------------------------------------------------------


def read_measurement(path: str | Path) -> Measurement:
    """Read a record of measured motion.

    Parameters
    ----------
    path : path-like
        CSV in UTF-8 with the columns ``time [s]``, ``set_velocity [V]``, ``position [m]``,
        ``velocity [m/s]`` and ``acceleration [m/s^2]`` in any order, see `Measurement`. Commas,
        semicolons or tabs separate the cells, as in the header; with the latter two, numbers may
        have decimal commas. Empty lines and lines that start with ``#`` or ``sep=`` are skipped.

    Raises
    ------
    FileError
        If a column, unit, row or number is missing or wrong. Rows are counted from 1, as in an
        editor.
    OSError
        If the file cannot be read.
    """
    path = Path(path)
    lines = _rows(path)
    if not lines:
        raise FileError(f"{path}: the file has no header; it is {_HEADER!r}")
    (head, header), *lines = lines
    separator = max(",;\t", key=header.count)
    names = _names(_cells(header, separator), head)
    comma = separator != "," and any("," in line for _, line in lines)
    rows, values = [where for where, _ in lines], []
    for where, line in lines:
        cells = _cells(line, separator)
        if len(cells) != len(names):
            told = f"{where}: {len(cells)} cells; the header has {len(names)} columns"
            raise FileError(told + _COMMAS * (separator == "," and len(cells) > len(names)))
        named = zip(cells, names, strict=True)
        values.append([_number(cell, f"{where}: {name}", comma) for cell, name in named])
    in_order = [names.index(name) for name in COLUMNS]
    columns = np.array(values).reshape(-1, len(COLUMNS)).T[in_order]
    for sample, text in faults(columns):
        raise FileError(f"{path if sample is None else rows[sample]}: {text}")
    return Measurement(*columns)


def write_measurement(path: str | Path, measurement: Measurement, comment: str = "") -> None:
    """Write a record that `read_measurement` reads without loss.

    Parameters
    ----------
    path : path-like
        File to write.
    measurement : Measurement
        The record.
    comment : str
        Text for the top of the file; each line is prefixed with ``#``.
    """
    head = [f"# {line}".rstrip() for line in comment.splitlines()]
    rows = np.array(dataclasses.astuple(measurement)).T.tolist()
    body = [",".join(map(repr, row)) for row in rows]
    Path(path).write_text("\n".join([*head, _HEADER, *body, ""]), encoding="utf-8", newline="\n")


def _rows(path: Path) -> list[tuple[str, str]]:
    """Place and text of each line that is not empty or a comment."""
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise FileError(f"{path}: not a text file in UTF-8; save the record as CSV, UTF-8")
    lines = ((f"{path}, row {n}", line) for n, line in enumerate(text.splitlines(), 1))
    # A spreadsheet writes separators in empty lines, and on top a line that names the separator.
    return [one for one in lines if one[1].strip(" ,;\t") and not re.match(r"\s*#|sep=", one[1])]


def _cells(line: str, separator: str) -> list[str]:
    return [cell.strip().strip('"') for cell in line.split(separator)]


def _names(header: Sequence[str], where: str) -> list[str]:
    """Names of the columns in the order of the file; names and units are checked."""
    names: list[str] = []
    for cell in header:
        ((name, unit),) = _HEADING.findall(cell)
        if name not in COLUMNS:
            raise FileError(f"{where}: no column {name!r} is known; {hint(name, COLUMNS)}")
        if name in names:
            raise FileError(f"{where}: the column {name!r} appears twice")
        if unit.replace("²", "^2") != (allowed := COLUMNS[name]):
            heading = f"allowed is {allowed!r}, so the heading is '{name} [{allowed}]'"
            raise FileError(f"{where}: column {name!r} has the unit {unit!r}; {heading}")
        names.append(name)
    if missing := [name for name in COLUMNS if name not in names]:
        raise FileError(f"{where}: missing column {', '.join(missing)}; the header is {_HEADER}")
    return names


def _number(cell: str, name: str, comma: bool) -> float:
    # Python's 1_000 is not a number in a file, nor is 1.000 where the decimal sign is a comma.
    try:
        return float(cell.translate(str.maketrans("_.,", "??.") if comma else {ord("_"): "?"}))
    except ValueError:
        told = "; the file has decimal commas" * comma
        raise FileError(f"{name} = {cell!r} is not a number{told}") from None


# --- axes ---------------------------------------------------------------------------------------


def read_axis(path: str | Path) -> tuple[AxisParameters, Instrument]:
    """Read the parameters of an axis and the noise of its instruments.

    Parameters
    ----------
    path : path-like
        TOML with the tables ``[axis]``, which has the fields of `AxisParameters` (``K_1`` is
        optional), and ``[instrument]``, which has those of `Instrument`. With ``choices = "x"`` in
        ``[axis]``, missing values are taken from that axis in ``data/choices.toml``.

    Raises
    ------
    FileError
        If a table or name is unknown or missing, or a value is not allowed.
    OSError
        If the file cannot be read.
    """
    try:
        tables = tomllib.loads(Path(path).read_bytes().decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise FileError(f"{path}: not a TOML file in UTF-8: {error}") from None
    kinds = {"axis": AxisParameters, "instrument": Instrument}
    _check_names(tables, kinds, f"{path}: table")
    for name, kind in kinds.items():
        where, table = f"{path}, [{name}]", tables[name]
        if not isinstance(table, dict):
            raise FileError(f"{path}: {name} has to be a table, [{name}]")
        if name == "axis" and (choices := table.pop("choices", None)) is not None:
            if choices not in [*CHOICES["axis"]]:
                known = hint(choices, CHOICES["axis"])
                raise FileError(f"{where}: choices = {choices!r}; {known}")
            table = CHOICES["axis"][choices] | table
        _check_names(table, [item.name for item in dataclasses.fields(kind)], f"{where}: value")
        try:
            tables[name] = kind(**table)
        except (TypeError, ValueError) as error:
            raise FileError(f"{where}: {error}") from None
    return tables["axis"], tables["instrument"]


def _check_names(given: Iterable[str], known: Iterable[str], where: str) -> None:
    for name in given:
        if name not in known:
            raise FileError(f"{where} {name!r} is not known; {hint(name, known)}")
    if missing := [name for name in known if name not in given and name != "K_1"]:
        raise FileError(f"{where} {', '.join(missing)} missing")
