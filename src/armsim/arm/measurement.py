"""Measured motion of an axis: what the instruments give, and the files that hold it."""

import csv
import dataclasses
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from armsim.arm.parameters import AxisParameters
from armsim.arm.simulate import Schedule
from armsim.checks import checked_number, hint

#: Columns of a record, in the order of `Measurement`, with the unit of each.
COLUMNS = {
    "time": "s",
    "set_velocity": "V",
    "position": "m",
    "velocity": "m/s",
    "acceleration": "m/s^2",
}
#: A record with fewer samples is refused: 60 numbers for about 7 unknowns.
MIN_SAMPLES = 20
#: Share of the interval by which a sample may be early or late: room for rounded times.
_UNEVEN = 0.01
_HEADING = re.compile(r"\s*(?P<name>[^\[\]]*?)\s*(?:\[\s*(?P<unit>[^\[\]]*?)\s*\])?\s*")


class FileError(ValueError):
    """A file that is not as it has to be, told in one line with its name and the row."""


@dataclass(frozen=True, eq=False)
class Measurement:
    """Motion of one axis as its instruments recorded it, sampled evenly, from rest.

    Parameters
    ----------
    t : (n,) array_like
        Times of the samples in s.
    set_velocity : (n,) array_like
        Set velocity in V that the controller put out from each sample on: digital, so exact.
    position, velocity : (n,) array_like
        Arm motion as the motor shaft tells it, r_g y2 in m by an encoder, r_g y3 in m/s by the
        tachometer.
    acceleration : (n,) array_like
        Accelerometer on the arm, m/s², with an integrating converter: the mean of the derivative
        of y1 since the sample before.

    Raises
    ------
    ValueError
        If the columns differ in length or a sample is not as it has to be; the message names it.
    """

    t: np.ndarray
    set_velocity: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray

    def __post_init__(self) -> None:
        for item in dataclasses.fields(self):
            object.__setattr__(self, item.name, np.array(getattr(self, item.name), dtype=float))
        shapes = {getattr(self, item.name).shape for item in dataclasses.fields(self)}
        if len(shapes) > 1 or len(next(iter(shapes))) != 1:
            raise ValueError(f"the five columns have shapes {shapes}; five rows (n,) are needed")
        for sample, text in _faults(np.array(dataclasses.astuple(self))):
            raise ValueError(text if sample is None else f"sample {sample}: {text}")

    @property
    def elapsed(self) -> np.ndarray:
        """Times (n,) in s since the first sample."""
        return self.t - self.t[0]

    @property
    def schedule(self) -> Schedule:
        """Set velocity as `armsim.arm.simulate` takes it, in the time `elapsed`."""
        change = np.flatnonzero(np.diff(self.set_velocity, prepend=np.nan) != 0)
        pairs = zip(self.elapsed[change], self.set_velocity[change], strict=True)
        return tuple((float(time), float(volts)) for time, volts in pairs)

    @property
    def signals(self) -> np.ndarray:
        """Position, velocity and acceleration, (3, n)."""
        return np.array([self.position, self.velocity, self.acceleration])


@dataclass(frozen=True, kw_only=True)
class Instrument:
    """Standard deviations of the noise in each signal, quantisation included.

    Parameters
    ----------
    position, velocity, acceleration : float
        In m, m/s and m/s², positive.

    Raises
    ------
    TypeError, ValueError
        If a value is not a number, or not finite and positive.
    """

    position: float
    velocity: float
    acceleration: float

    def __post_init__(self) -> None:
        for name, value in dataclasses.asdict(self).items():
            checked_number(name, value, above=0.0)

    @property
    def deviations(self) -> np.ndarray:
        """The three standard deviations as a column, (3, 1)."""
        return np.array([[self.position], [self.velocity], [self.acceleration]])


def signals(y: np.ndarray, t: np.ndarray, p: AxisParameters) -> np.ndarray:
    """What ideal instruments give of a simulated motion.

    Parameters
    ----------
    y : (..., 7, n) array
        States at the times of the samples, at rest at the first.
    t : (n,) array
        The times in s.
    p : AxisParameters
        Of the axis.

    Returns
    -------
    (..., 3, n) array
        Position in m, velocity in m/s and acceleration in m/s². The acceleration is a difference
        of two velocities, so it is as exact as they are; the first is zero.
    """
    v = y[..., 1, :]
    mean = np.diff(v, prepend=v[..., :1]) / np.diff(t, prepend=2 * t[0] - t[1])
    return np.stack([p.r_g * y[..., 2, :], p.r_g * y[..., 3, :], mean], axis=-2)


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
    for sample, text in _faults(columns):
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


def _faults(columns: np.ndarray) -> Iterator[tuple[int | None, str]]:
    """What is wrong with the five columns (5, n): the sample, if it is one, and a text."""
    for n, name in np.argwhere(~np.isfinite(columns.T)):
        yield int(n), f"{list(COLUMNS)[name]} = {columns[name, n]} is not finite"
    t = columns[0]
    if t.size < MIN_SAMPLES:
        yield None, f"{t.size} samples; at least {MIN_SAMPLES} are needed"
    step = np.diff(t)
    for n in np.flatnonzero(step <= 0):
        what = "stands there twice" if step[n] == 0 else f"comes after {t[n]}: it has to rise"
        yield int(n) + 1, f"time = {t[n + 1]} {what}"
    interval = np.median(step)
    for n in np.flatnonzero(np.abs(step - interval) > _UNEVEN * interval):
        yield (
            int(n) + 1,
            f"time = {t[n + 1]} is {step[n]:.6g} s after the sample before; the others are "
            f"{interval:.6g} s apart, and the sampling has to be even",
        )


# --- axes ---------------------------------------------------------------------------------------


def read_axis(path: str | Path) -> tuple[AxisParameters, Instrument]:
    """Read the constants of an axis and the noise of its instruments.

    Parameters
    ----------
    path : path-like
        TOML with the tables ``[axis]``, the fields of `AxisParameters` (``K_1`` may be left out),
        and ``[instrument]``, those of `Instrument`.

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
        names = [item.name for item in dataclasses.fields(kind)]
        _check_names(tables[table], names, ("K_1",), f"{path}, [{table}]: value")
        try:
            tables[table] = kind(**tables[table])
        except (TypeError, ValueError) as error:
            raise FileError(f"{path}, [{table}]: {error}") from None
    return tables["axis"], tables["instrument"]


def _check_names(
    given: Mapping[str, Any], known: Sequence[str], optional: Sequence[str], where: str
) -> None:
    for name in given:
        if name not in known:
            raise FileError(f"{where} {name!r} is not known; {hint(name, known)}")
    missing = [name for name in known if name not in given and name not in optional]
    if missing:
        raise FileError(f"{where} {', '.join(missing)} missing")
