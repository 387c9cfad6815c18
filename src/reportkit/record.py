"""Record a value once: quoted in the text, kept as JSON, checked by a rebuild."""

import math
import numbers
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
from IPython.display import SVG, Markdown, display
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from myst_nb import glue

from reportkit import figures, text
from reportkit.project import RESULTS_VARIABLE

Data: TypeAlias = Mapping[str, Any] | pd.DataFrame

_STUDY = re.compile(r"\d\d_[a-z0-9_]+")
_KEY = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
_NUMBER = re.compile(r"\$?[-+−]?[\d.](?!.*, )")  # and not a list of them


class Study:
    """The results of one notebook: values, figures and tables.

    They go to the folder named by the environment variable ``REPORT_RESULTS``, which the build
    sets; without it to ``runs/<name>`` below the current folder, so that a run by hand never
    touches the results of the book. A study sets the style of all figures that are made after it.

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
            raise ValueError(f"study name {name!r}: expected NN_topic, like 20_step_response")
        figures.use()
        self.name = name
        self.results = Path(os.environ.get(RESULTS_VARIABLE) or Path("runs", name))
        self.results.mkdir(parents=True, exist_ok=True)
        self._records: dict[str, dict[str, Any]] = {}
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
            False for a measured time, which no rebuild repeats.

        Raises
        ------
        ValueError
            If the name is malformed or taken, or the value or tolerance is not as above.
        """
        _check_key(name, self._records)
        value = value.item() if isinstance(value, np.generic) else value
        allowed = math.isfinite(value) if isinstance(value, float) else isinstance(value, int | str)
        if not allowed:
            raise ValueError(f"{name} = {value!r}: expected a finite number, a text or a bool")
        if tolerance is not None and relative is not None:
            raise ValueError(f"tolerance of {name}: absolute or relative, not both")
        if unit is None and not isinstance(value, bool | str):
            unit = "1"
        kept = {"value": value, "unit": unit, "tolerance": None}
        given = {"tolerance": tolerance, "relative": relative}
        kept |= {key: _tolerance(name, most) for key, most in given.items() if most is not None}
        self._records[name] = kept if compared else kept | {"compared": False}
        text.write(self.results / f"{self.name}.json", text.to_json(self._records))
        glue(name, ("yes" if value else "no") if isinstance(value, bool) else value, display=False)

    def record_all(self, values: Mapping[str, Any], unit: str | None = None, **rule: Any) -> None:
        """Record several values of one unit under one rule; see `record`.

        A NaN is a measurement that does not apply, and is left out: what is missing is not zero.
        """
        for name, value in values.items():
            if value == value:  # a NaN is not
                self.record(name, value, unit, **rule)

    def figure(self, key: str, fig: Figure, data: Data | None = None, *, alt: str = "") -> None:
        """Save a figure as ``<results>/<study>-<key>.svg``, show it and close it.

        Parameters
        ----------
        key : str
            Named like a record; once per study, tables included.
        fig : matplotlib.figure.Figure
            The figure; its background becomes transparent.
        data : mapping of column name to 1-D array, or DataFrame, optional
            The plotted data, saved beside the figure as CSV. Shorter columns end in blanks.
        alt : str, optional
            Description for readers who cannot see the figure, on the page of the notebook itself.
            By default that in the metadata of the cell, ``{"mystnb": {"image": {"alt": …}}}``.
        """
        path = self._new(key, "svg")
        figures.save(fig, path)
        if data is not None:
            series = {name: pd.Series(np.asarray(data[name])) for name in data}
            self._csv(path.with_suffix(".csv"), pd.DataFrame(series))
        shown = {"image/svg+xml": {"alt": alt}, "name": path.name}  # the name is a link's target
        display(SVG(filename=path), metadata=shown)
        plt.close(fig)

    def table(self, key: str, rows: Iterable[Any], columns: Sequence[str] | None = None) -> None:
        """Save a table for ``{include}`` as ``<results>/<study>-<key>.md`` and show it.

        Parameters
        ----------
        key : str
            Named like a record; once per study.
        rows : DataFrame, or iterable of mappings or of sequences
            Cells, as they are to appear, mathematics included. The index is left out.
            A column most of whose cells, apart from dashes, are numbers is set flush right.
        columns : sequence of str, optional
            Headings, if the rows are sequences.

        Raises
        ------
        ValueError
            If the key is malformed or taken, or a column has no heading.
        """
        frame = pd.DataFrame(rows, columns=columns)
        if not all(str(name).strip() for name in frame.columns):
            raise ValueError(f"table {key}: a heading is missing in {list(frame.columns)}")
        numeric = frame.map(lambda cell: bool(_NUMBER.match(str(cell))))
        right = np.flatnonzero(numeric.sum() > 0.5 * (frame != "–").sum())
        table = text.markdown_table(list(frame), frame.itertuples(index=False), right)
        path = self._new(key, "md")
        text.write(path, table)
        display(Markdown(table), metadata={"name": path.name})

    def data(self, key: str, frame: pd.DataFrame) -> None:
        """Save data without a figure, such as raw measurements, as ``<results>/<study>-<key>.csv``.

        Parameters
        ----------
        key : str
            Named like a record; once per study, figures and tables included.
        frame : pandas.DataFrame
            The index is left out.
        """
        self._csv(self._new(key, "csv"), frame)

    def page(self, key: str, html: str) -> None:
        """Save a piece of HTML that a page includes, as ``<results>/<study>-<key>.html``.

        Parameters
        ----------
        key : str
            Named like a record; once per study, figures and tables included.
        html : str
            The text.
        """
        text.write(self._new(key, "html"), html)

    def _new(self, key: str, kind: str) -> Path:
        _check_key(key, self._keys)
        self._keys.add(key)
        return self.results / f"{self.name}-{key}.{kind}"

    def _csv(self, path: Path, frame: pd.DataFrame) -> None:
        text.write(path, frame.to_csv(index=False, float_format="%.9g"))


def cell(value: float, form: str = ".2f") -> str:
    """Return a number as text with a true minus sign; a dash for NaN, which does not apply."""
    return "–" if math.isnan(value) else f"{value:{form}}".replace("-", "−")


def scientific(value: float, digits: int = 1) -> str:
    r"""Return a number as ``$6.9 \cdot 10^{-2}$``, which never breaks across lines."""
    mantissa, exponent = f"{value:.{digits}e}".split("e")
    return f"${mantissa} \\cdot 10^{{{int(exponent)}}}$"


def _check_key(key: Any, taken: Any) -> None:
    if not isinstance(key, str) or not _KEY.fullmatch(key):
        raise ValueError(f"name {key!r}: expected a letter, then letters, digits, _ or -")
    if key in taken:
        raise ValueError(f"name {key!r}: already recorded in this study, each name only once")


def _tolerance(name: str, value: float) -> float:
    if not isinstance(value, numbers.Real) or not 0 <= value < math.inf:
        raise ValueError(f"tolerance of {name} = {value!r}: expected a number >= 0")
    return float(value)
