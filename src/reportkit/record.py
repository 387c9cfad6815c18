"""Record a value once: quoted in the text, kept as JSON, checked by a rebuild."""

import math
import numbers
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from IPython.display import SVG, Markdown, display
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from myst_nb import glue

from reportkit.check import to_json

#: Set by the build to a folder that replaces the published results only when all went well.
RESULTS_VARIABLE = "REPORT_RESULTS"

Value = float | int | str | bool

_STUDY = re.compile(r"\d\d_[a-z0-9_]+")
_KEY = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
_NUMBER = re.compile(r"\$?[-+−]?[\d.]")


class Study:
    """The results of one notebook: values, figures and tables.

    They go to the folder named by the environment variable ``REPORT_RESULTS``, which the build
    sets; without it to ``runs/<name>`` below the current folder, so that a run by hand never
    touches the results of the book.

    Parameters
    ----------
    name : str
        The notebook's file name without its ending, for example ``"20_linear_step_response"``.

    Raises
    ------
    ValueError
        If the name is not two digits, an underscore and lower-case letters, digits or
        underscores.
    """

    def __init__(self, name: str) -> None:
        if not _STUDY.fullmatch(name):
            raise ValueError(
                f"study name {name!r}: expected NN_topic, like 20_linear_step_response"
            )
        self.name = name
        self.results = Path(os.environ.get(RESULTS_VARIABLE) or Path("runs", name))
        self.results.mkdir(parents=True, exist_ok=True)
        self._records: dict[str, dict[str, Value | None]] = {}
        self._keys: set[str] = set()

    def record(
        self,
        name: str,
        value: Any,
        unit: str | None = None,
        tolerance: float | None = None,
        *,
        relative: float | None = None,
        compared: bool = True,
    ) -> None:
        """Glue a value for the text and keep it in ``<results>/<study>.json``.

        Parameters
        ----------
        name : str
            A letter, then letters, digits, ``_`` or ``-``; once per study.
        value : float, int, str or bool, or a NumPy scalar of these
            The value; a number must be finite. A bool is quoted in the text as yes or no.
        unit : str, optional
            The unit of the value; left out, a number has the unit 1.
        tolerance : float, optional
            The largest absolute difference, in the unit of the value, that a rebuild may show.
            Without one, floats have to agree to nine digits and other values have to be equal.
        relative : float, optional
            Instead of `tolerance`, the largest difference as a share of the value.
        compared : bool, optional
            False for what measures time, which no rebuild repeats.

        Raises
        ------
        ValueError
            If the name is malformed or taken, or the value or tolerance is not as above.
        """
        _check_key(name, self._records)
        value = value.item() if isinstance(value, np.generic) else value
        if not isinstance(value, float | int | str) or (
            isinstance(value, float) and not math.isfinite(value)
        ):
            raise ValueError(f"{name} = {value!r}: expected a finite number, a text or a bool")
        if tolerance is not None and relative is not None:
            raise ValueError(f"tolerance of {name}: absolute or relative, not both")
        if unit is None and not isinstance(value, bool | str):
            unit = "1"
        record = {"value": value, "unit": unit, "tolerance": _tolerance(name, tolerance)}
        if relative is not None:
            record["relative"] = _tolerance(name, relative)
        if not compared:
            record["compared"] = False
        self._records[name] = record
        text = to_json(self._records)
        self._write(f"{self.name}.json", text)
        glue(name, ("yes" if value else "no") if isinstance(value, bool) else value, display=False)

    def record_all(self, values: Mapping[str, Any], unit: str | None = None, **rule: Any) -> None:
        """Record several values of one unit under one rule; see `record`.

        A NaN is a measurement that does not apply, and is left out: what is missing is not zero.
        """
        for name, value in values.items():
            if value == value:  # a NaN is not
                self.record(name, value, unit, **rule)

    def figure(
        self,
        key: str,
        fig: Figure,
        data: Mapping[str, Any] | pd.DataFrame | None = None,
        *,
        alt: str | None = None,
    ) -> None:
        """Save a figure as ``<results>/<study>-<key>.svg``, show it and close it.

        Parameters
        ----------
        key : str
            Named like a record; once per study, tables included.
        fig : matplotlib.figure.Figure
            The figure; its background becomes transparent.
        data : mapping of column name to 1-D array, or DataFrame, optional
            What the figure shows, saved beside it as CSV. Shorter columns end in blanks.
        alt : str, optional
            What to say of the figure to who cannot see it, on the page of the notebook itself.
        """
        _check_key(key, self._keys)
        path = self.results / f"{self.name}-{key}.svg"
        with mpl.rc_context({"svg.hashsalt": "report"}):  # with no date: the same bytes each time
            fig.savefig(path, metadata={"Date": None, "Creator": None}, transparent=True)
        self._keys.add(key)
        if data is not None:
            columns = {column: pd.Series(np.asarray(data[column])) for column in data}
            self._csv(key, pd.DataFrame(columns))
        alt = alt or f"Figure of the study {self.name[3:]}: {key}".replace("_", " ")
        display(SVG(filename=path), metadata={"image/svg+xml": {"alt": alt}})
        plt.close(fig)

    def table(
        self,
        key: str,
        rows: pd.DataFrame | Iterable[Any],
        columns: Sequence[str] | None = None,
    ) -> None:
        """Save a table for ``{include}`` as ``<results>/<study>-<key>.md`` and show it.

        Parameters
        ----------
        key : str
            Named like a record; once per study.
        rows : DataFrame, or iterable of mappings or of sequences
            Cells are texts as they shall appear, mathematics included. The index is left out.
            A column most of whose cells are numbers is set flush right.
        columns : sequence of str, optional
            Headings, if the rows are sequences.

        Raises
        ------
        ValueError
            If the key is malformed or taken, or a column has no heading.
        """
        _check_key(key, self._keys)
        frame = (
            rows if isinstance(rows, pd.DataFrame) else pd.DataFrame(list(rows), columns=columns)
        )
        if not all(str(name).strip() for name in frame.columns):
            raise ValueError(f"table {key}: a heading is missing in {list(frame.columns)}")
        cells = [[_cell(cell) for cell in row] for row in frame.itertuples(index=False)]
        rules = [
            "---:" if sum(bool(_NUMBER.match(cell)) for cell in column) > len(column) / 2 else "---"
            for column in zip(*cells, strict=True)
        ] or ["---"] * len(frame.columns)
        rows = [[_cell(name) for name in frame.columns], rules, *cells]
        text = "".join(f"| {' | '.join(row)} |\n" for row in rows)
        self._keys.add(key)
        self._write(f"{self.name}-{key}.md", text)
        display(Markdown(text))

    def data(self, key: str, frame: pd.DataFrame) -> None:
        """Save what no figure shows, such as raw measurements, as ``<results>/<study>-<key>.csv``.

        Parameters
        ----------
        key : str
            Named like a record; once per study, figures and tables included.
        frame : pandas.DataFrame
            The index is left out.
        """
        _check_key(key, self._keys)
        self._keys.add(key)
        self._csv(key, frame)

    def page(self, key: str, html: str) -> None:
        """Save a piece of HTML that a page includes, as ``<results>/<study>-<key>.html``.

        Parameters
        ----------
        key : str
            Named like a record; once per study, figures and tables included.
        html : str
            The text.
        """
        _check_key(key, self._keys)
        self._keys.add(key)
        self._write(f"{self.name}-{key}.html", html)

    def _csv(self, key: str, frame: pd.DataFrame) -> None:
        self._write(f"{self.name}-{key}.csv", frame.to_csv(index=False, float_format="%.9g"))

    def _write(self, name: str, text: str) -> None:
        part = self.results / f".{name}.part"
        part.write_text(text, encoding="utf-8", newline="\n")
        part.replace(self.results / name)


def scientific(value: float, digits: int = 1) -> str:
    r"""Text of a number for a table, such as ``$6.9 \cdot 10^{-2}$``, which never breaks in two."""
    mantissa, exponent = f"{value:.{digits}e}".split("e")
    return f"${mantissa} \\cdot 10^{{{int(exponent)}}}$"


def _check_key(key: Any, taken: Any) -> None:
    if not isinstance(key, str) or not _KEY.fullmatch(key):
        raise ValueError(f"name {key!r}: expected a letter, then letters, digits, _ or -")
    if key in taken:
        raise ValueError(f"name {key!r}: already recorded in this study, each name only once")


def _tolerance(name: str, value: float | None) -> float | None:
    if value is None:
        return None
    if not isinstance(value, numbers.Real) or not 0 <= value < math.inf:
        raise ValueError(f"tolerance of {name} = {value!r}: expected a number >= 0")
    return float(value)


def _cell(value: Any) -> str:
    return str(value).replace("|", r"\|").replace("\n", " ")
