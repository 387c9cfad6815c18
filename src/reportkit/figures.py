"""One style for all figures of a report, from ``report.mplstyle``.

The colours are those of Okabe and Ito, with their lightness changed so that they differ in grey as
well. Each has a contrast of at least 3 on white, and also on the dark page, where the book shows a
figure through ``filter: invert(1) hue-rotate(180deg)``.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias

import matplotlib as mpl
import numpy as np
from IPython.core.getipython import get_ipython
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Annotation
from matplotlib_inline.backend_inline import set_matplotlib_formats

Values: TypeAlias = Sequence[float] | np.ndarray
Looks: TypeAlias = Mapping[str, Mapping[str, Any]]

_FILE = Path(__file__).with_name("report.mplstyle")
STYLE: dict[Any, Any] = dict(mpl.rc_params_from_file(_FILE, use_default_template=False))
INK, FAINT = STYLE["text.color"], STYLE["grid.color"]
_CYCLE = STYLE["axes.prop_cycle"].by_key()
PALETTE, DASHES = tuple(_CYCLE["color"]), tuple(_CYCLE["linestyle"])
MARKERS = ("o", "s", "^", "D", "v")
WIDTH = STYLE["figure.figsize"][0]


def use() -> None:
    """Set the style; in a notebook also show figures as SVG, without a date, at full size."""
    _set()
    if get_ipython() is not None:
        set_matplotlib_formats("svg", bbox_inches=None, metadata={"Date": None})


def _set() -> None:
    mpl.rcdefaults()  # not what the user prefers in other figures
    mpl.rcParams.update(STYLE)


@contextmanager
def styled() -> Iterator[None]:
    """Set the style inside a block, or a function if used as a decorator."""
    with mpl.rc_context():
        _set()
        yield


def stack(
    quantities: Sequence[str], x: str = "time / s", height: float = 1.5
) -> tuple[Figure, list[Axes]]:
    """Make a column of axes of one height that share the horizontal axis.

    Parameters
    ----------
    quantities
        One label for each axes, as ``"velocity / (m/s)"``, written above it.
    x
        Label of the shared horizontal axis.
    height
        Height of one axes with its label, in inches.
    """
    n = len(quantities)
    fig, grid = plt.subplots(n, sharex=True, squeeze=False, figsize=(WIDTH, height * n + 0.5))
    axes = list(grid[:, 0])
    for ax, quantity in zip(axes, quantities, strict=True):
        ax.set_title(quantity)
    axes[-1].set_xlabel(x)
    return fig, axes


def family(
    ax: Axes, x: Values, curves: Mapping[str, Values], looks: Looks | None = None, **style: Any
) -> list[Line2D]:
    """Draw curves over the same abscissae on two logarithmic axes, each under its name.

    Parameters
    ----------
    ax, x
        Axes, and the common abscissae.
    curves : mapping of name to ordinates
        The name is the curve's label.
    looks : mapping of name to properties of a line, optional
        The cycle of the style decides for a curve without an entry. By default the curves have
        the markers `MARKERS` in turn.
    **style
        Properties of all lines; those of a curve take precedence.
    """
    pen: dict[str, Any] = {"ms": 4, "lw": 1.2} | style
    if looks is None:
        looks = {name: {"marker": mark} for name, mark in zip(curves, MARKERS, strict=False)}
    return [
        ax.loglog(x, y, **(pen | dict(looks.get(name, {}))), label=name)[0]
        for name, y in curves.items()
    ]


def legend_below(fig: Figure, ax: Axes, columns: int = 3) -> None:
    """Place the legend of an axes below the whole figure."""
    fig.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=columns)


def direct_label(
    line: Line2D, text: str, at: float | None = None, offset: tuple[float, float] = (5, 0)
) -> Annotation:
    """Write a line's name beside it, in a darker shade of its colour.

    Parameters
    ----------
    line, text
        A line with increasing abscissae, and its name.
    at
        Abscissa of the point beside which the name stands; by default the line's end.
    offset
        From that point to the left end of the text, in points of print.
    """
    xs, ys = (np.asarray(data, dtype=float) for data in line.get_data())
    x = xs[-1] if at is None else at
    y = float(np.interp(x, xs, ys))
    darker = tuple(0.72 * part for part in to_rgb(line.get_color()))
    style: Any = {"textcoords": "offset points", "va": "center", "color": darker}
    assert isinstance(line.axes, Axes)
    return line.axes.annotate(text, (x, y), offset, **style)


def save(fig: Figure, path: str | Path) -> None:
    """Write a figure as SVG on a transparent ground, the same bytes each time."""
    with styled():
        fig.savefig(path, format="svg", metadata={"Date": None, "Creator": None}, transparent=True)
