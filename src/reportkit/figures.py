"""One style for all figures of a report, from ``report.mplstyle``.

The colours are those of Okabe and Ito, with their lightness changed so that they differ in grey as
well. Each has a contrast of at least 3 on white. `dark` gives a drawing the colours of a dark page,
with the same contrast there.
"""

import re
from collections.abc import Container, Iterator, Mapping, Sequence
from contextlib import contextmanager
from decimal import Decimal
from pathlib import Path
from typing import Any, TypeAlias

import matplotlib as mpl
import numpy as np
from IPython.core.getipython import get_ipython
from matplotlib import _mathtext
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Annotation, Text
from matplotlib.typing import ColorType
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
PAGE = "#121212"  #: a dark page
PHONE, LEGIBLE = 328, 10  #: px, width of a figure on a phone and height of a text there
PLAN = 576  #: px, least width of a figure of the class ``plan``, which scrolls on a phone
SHRINK = 1.0  #: size of exponents and indices, as a share of the text around them


def shade(colour: ColorType) -> str:
    """Return a colour dark enough for text on white."""
    red, green, blue = (0.72 * part for part in to_rgb(colour))
    return to_hex((red, green, blue))


_BRIGHT = ("#68b4ee", "#ffb763", "#9887f7", "#8be6c3", "#c9609c", "#d8d8d8")
#: What a drawing's colours become on a dark page; text has the colour of its line.
DARK = dict(zip((*PALETTE, INK), _BRIGHT, strict=True))
DARK |= {shade(colour): bright for colour, bright in DARK.items()}
DARK |= {"#ffffff": PAGE, shade(FAINT): "#9a9a9a"}


def dark(svg: str) -> str:
    """Return a drawing in the colours of a dark page; other colours than of the style stay."""
    return re.sub("#[0-9a-f]{6}", lambda found: DARK.get(found[0], found[0]), svg)


def use() -> None:
    """Set the style; in a notebook also show figures as SVG, without a date, at full size."""
    _set()
    if get_ipython() is not None:
        set_matplotlib_formats("svg", bbox_inches=None, metadata={"Date": None})


def _set() -> None:
    mpl.rcdefaults()  # not what the user prefers in other figures
    mpl.rcParams.update(STYLE)
    _mathtext.SHRINK_FACTOR = SHRINK  # less is too small on a phone, and no setting changes it


@contextmanager
def styled() -> Iterator[None]:
    """Set the style inside a block, or a function if used as a decorator."""
    with mpl.rc_context():
        _set()
        yield


def stack(
    quantities: Sequence[str],
    x: str = "time / s",
    height: float = 1.5,
    ratios: Sequence[float] | None = None,
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
    ratios
        Of the heights of the axes, if they are not all `height`.
    """
    n, ratios = len(quantities), ratios or [1] * len(quantities)
    size, heights = (WIDTH, height * sum(ratios) + 0.5), {"height_ratios": ratios}
    fig, grid = plt.subplots(n, sharex=True, squeeze=False, figsize=size, gridspec_kw=heights)
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


def ranking(
    ax: Axes, values: Mapping[str, float], colours: Mapping[str, str], failed: str = "not reached"
) -> None:
    """Draw a dot with its number for each name, smallest on top, on a logarithmic axis.

    Parameters
    ----------
    ax
        Its height should be 0.25 inches for each name.
    values : mapping of name to value
        A NaN comes last, with the text `failed` at the margin.
    colours : mapping of name to colour
        The names to highlight.
    """
    order = sorted(values, key=lambda name: (np.isnan(values[name]), values[name]))
    for row, name in enumerate(order):
        value, colour = values[name], colours.get(name, FAINT)
        style: Any = {"va": "center", "color": shade(colour), "textcoords": "offset points"}
        if np.isnan(value):
            margin: Any = {"xycoords": ("axes fraction", "data"), "ha": "right"}
            ax.annotate(failed, (1, row), (0, 0), **style, **margin)
        else:
            ax.plot(value, row, "o", color=colour, ms=8 if name in colours else 6)
            told = f"{Decimal(f'{value:.1e}'):f}"  # two digits, a zero at the end included
            ax.annotate(told, (value, row), (8, 0), **style)
    _name_rows(ax, order, bold=colours)
    ax.set_xlim(right=5 * ax.get_xlim()[1])  # room for the number of the last
    ax.grid(visible=False)
    for label in ax.get_yticklabels():
        label.set_color(shade(colours.get(label.get_text(), INK)))
    ax.spines["left"].set_visible(False)


def _name_rows(ax: Axes, names: Sequence[str], bold: Container[str]) -> None:
    """Name the rows of a drawing from the top, beside a logarithmic axis."""
    ax.set(xscale="log", ylim=(len(names) - 0.4, -0.6))
    ax.xaxis.set_major_formatter("{x:g}")
    ax.set_yticks(range(len(names)), names)
    for label, name in zip(ax.get_yticklabels(), names, strict=True):
        label.set_fontweight("bold" if name in bold else "normal")
    ax.tick_params(axis="y", length=0)


def tornado(
    ax: Axes, groups: Mapping[str, Mapping[str, tuple[float, float]]], names: tuple[str, str]
) -> None:
    """Draw a heading for each group, and below it for each name a bar from 1 to two factors.

    Parameters
    ----------
    ax
        Its height should be 0.25 inches for each heading and bar.
    groups : mapping of heading to mapping of name to two factors
        Factors above 0, for a logarithmic axis.
    names
        Names of the two factors in the legend.
    """
    bar: Any = {"lw": 7, "ls": "-"}
    rows = [row for heading, bars in groups.items() for row in ((heading, ()), *bars.items())]
    for n, (_, factors) in enumerate(rows):
        for factor, colour in zip(factors, PALETTE, strict=False):
            ax.plot([1, factor], [n, n], color=colour, solid_capstyle="butt", **bar)
    for name, colour in zip(names, PALETTE, strict=False):
        ax.plot([], [], color=colour, label=name, **bar)
    ax.axvline(1, color=INK, lw=1)
    _name_rows(ax, [name for name, _ in rows], bold=groups)
    ax.grid(visible=False, axis="y")
    ax.grid(axis="x")


def slope_triangle(ax: Axes, order: float, x: float, y: float, factor: float = 2.0) -> None:
    """Draw the slope of an order on logarithmic axes: from (x, y) to `factor` times x."""
    right, top = factor * x, factor**order * y
    ax.fill([x, right, right], [y, y, top], color=FAINT, alpha=0.35, lw=0)
    style: Any = {"textcoords": "offset points", "va": "center", "color": INK}
    ax.annotate(f"{order:g}", (right, (y * top) ** 0.5), (3, 0), **style)


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
        A line whose abscissae increase or decrease, and its name.
    at
        Abscissa of the point beside which the name stands; by default the line's end.
    offset
        From that point to the left end of the text, in points of print.
    """
    xs, ys = (np.asarray(data, dtype=float) for data in line.get_data())
    x = xs[-1] if at is None else at
    rising = np.argsort(xs)
    y = float(np.interp(x, xs[rising], ys[rising]))
    style: Any = {"textcoords": "offset points", "va": "center", "color": shade(line.get_color())}
    assert isinstance(line.axes, Axes)
    return line.axes.annotate(text, (x, y), offset, **style)


def label_ends(ax: Axes, gap: float = 15.0) -> None:
    """Write the label of each line beside its end, `gap` points apart where ends lie close.

    The axes need their limits before.
    """
    fig = ax.get_figure(root=True)
    assert fig is not None
    fig.draw_without_rendering()  # the layout decides how high the axes are
    lines = [line for line in ax.lines if not str(line.get_label()).startswith("_")]
    points = np.array([np.asarray(line.get_xydata())[-1] for line in lines])
    last = ax.transData.transform(points)[:, 1]
    order, apart = np.argsort(last), gap * np.arange(len(lines))
    ends = 72 / fig.dpi * last[order]
    # no label below its end, and none above: half-way between the two
    up = np.maximum.accumulate(ends - apart)
    down = np.minimum.accumulate((ends - apart)[::-1])[::-1]
    for n, move in zip(order, (up + down) / 2 + apart - ends, strict=True):
        direct_label(lines[n], str(lines[n].get_label()), offset=(6, move))


def save(fig: Figure, path: str | Path, shown: float = PHONE) -> None:
    """Write a figure as SVG on a transparent ground, the same bytes each time.

    Parameters
    ----------
    fig, path
        The figure and its file.
    shown
        Width on a phone, in px.

    Raises
    ------
    ValueError
        If a text would be too small to read on a phone.
    """
    least = LEGIBLE * 72 * fig.get_figwidth() / shown
    for text in fig.findobj(Text):
        assert isinstance(text, Text)
        size = float(text.get_fontsize())
        if text.get_visible() and text.get_text().strip() and size < least - 0.1:
            told = f"{size:.3g} pt, below the {least:.3g} pt that are legible on a phone"
            raise ValueError(f"text {text.get_text()!r}: {told}")
    with styled():
        fig.savefig(path, format="svg", metadata={"Date": None, "Creator": None}, transparent=True)
