"""Tests of the style of the figures."""

import re
from itertools import combinations

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.colors import to_rgb

from reportkit import figures


@pytest.fixture(autouse=True)
def _restore():
    with mpl.rc_context():
        yield
    plt.close("all")


def luminance(colour) -> float:
    """Relative luminance, WCAG 2."""
    rgb = np.array(to_rgb(colour))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def contrast(one, two) -> float:
    """Contrast ratio, WCAG 2."""
    low, high = sorted((luminance(one), luminance(two)))
    return (high + 0.05) / (low + 0.05)


def lightness(colour) -> float:
    """CIE L*, from 0 to 100."""
    y = luminance(colour)
    return 116 * np.cbrt(y) - 16 if y > 0.008856 else 903.3 * y


def in_dark_mode(colour) -> str:
    """The colour that a drawing has on a dark page."""
    return figures.dark(colour)


def test_a_drawing_for_a_dark_page_keeps_other_colours():
    drawing = '<path style="fill: #0067a8; stroke: #3a3a3a"/><path fill="#fee838"/>'
    assert figures.dark(drawing) == (
        f'<path style="fill: {figures.DARK["#0067a8"]}; stroke: #d8d8d8"/><path fill="#fee838"/>'
    )


@pytest.mark.parametrize("colour", [figures.INK, figures.FAINT, *figures.PALETTE])
def test_lines_stand_out_on_white_and_in_dark_mode(colour):
    assert contrast(colour, "white") >= 3
    assert contrast(in_dark_mode(colour), "#121212") >= 3


@pytest.mark.parametrize("colour", [figures.INK, *figures.PALETTE])
def test_text_is_readable_on_white_and_in_dark_mode(colour):
    if colour == figures.INK:
        written = colour
    else:
        _, ax = plt.subplots()
        (line,) = ax.plot([0, 1], [0, 1], color=colour)
        written = figures.direct_label(line, "name").get_color()
    assert contrast(written, "white") >= 4.5
    assert contrast(in_dark_mode(written), "#121212") >= 4.5


def test_colours_differ_in_grey():
    for one, two in combinations(figures.PALETTE, 2):
        assert abs(lightness(one) - lightness(two)) > 8, (one, two)
        assert abs(lightness(in_dark_mode(one)) - lightness(in_dark_mode(two))) > 4, (one, two)


def test_lines_of_one_axes_differ_in_colour_and_in_dashes():
    figures.use()
    _, ax = plt.subplots()
    lines = [ax.plot([0, 1], [k, k])[0] for k in range(5)]
    assert len({line.get_color() for line in lines}) == 5
    assert len({str(line._dash_pattern) for line in lines}) == 5
    assert len(set(figures.MARKERS)) == 5


def test_curves_of_a_family_have_markers_or_the_looks_that_are_given():
    _, ax = plt.subplots()
    x, curves = [1.0, 2.0], {"one": [1.0, 4.0], "two": [2.0, 3.0]}
    lines = figures.family(ax, x, curves)
    assert [line.get_marker() for line in lines] == list(figures.MARKERS[:2])
    assert [line.get_label() for line in lines] == list(curves)
    lines = figures.family(ax, x, curves, {"two": {"marker": "P"}}, lw=3)
    assert [line.get_marker() for line in lines] == ["None", "P"]
    assert [line.get_linewidth() for line in lines] == [3, 3]
    assert ax.get_xscale() == ax.get_yscale() == "log"


def test_stack_has_axes_of_one_height_on_one_time_axis():
    figures.use()
    names = ["velocity / (m/s)", "motor current / A", "f"]
    fig, axes = figures.stack(names)
    for ax, scale in zip(axes, (1.0, -123456.0, 1e-9), strict=True):
        ax.plot([0, 2], [0, scale])
    fig.canvas.draw()
    assert [ax.get_title("left") for ax in axes] == names
    assert [ax.get_xlabel() for ax in axes] == ["", "", "time / s"]
    axes[0].set_xlim(0, 7)
    assert axes[2].get_xlim() == (0, 7)
    boxes = [ax.get_position() for ax in axes]
    assert np.ptp([box.height for box in boxes]) < 1e-6
    assert np.ptp([box.x0 for box in boxes]) < 1e-6
    assert boxes[0].y0 > boxes[1].y0 > boxes[2].y0


def test_stack_of_one_and_with_another_axis():
    fig, axes = figures.stack(["relative error"], x="CPU time / ms", height=3)
    assert len(axes) == 1
    assert axes[0].get_xlabel() == "CPU time / ms"
    assert fig.get_size_inches()[0] == pytest.approx(figures.WIDTH)


def test_text_is_legible_on_a_phone():
    figures.use()
    fig, axes = figures.stack(["velocity / (m/s)"])
    pixels_per_point = 328 / (72 * fig.get_size_inches()[0])
    texts = [axes[0].title, axes[0].xaxis.label, *axes[0].get_xticklabels()]
    assert min(text.get_fontsize() for text in texts) * pixels_per_point >= 10


def test_text_too_small_for_a_phone_is_refused(tmp_path):
    figures.use()
    fig, axes = figures.stack(["velocity / (m/s)"])
    axes[0].annotate("too small", (0, 0), fontsize=9)
    with pytest.raises(ValueError, match="'too small': 9 pt, below the 12.3 pt that are legible"):
        figures.save(fig, tmp_path / "one.svg")


def test_axes_of_a_stack_may_differ_in_height():
    figures.use()
    fig, axes = figures.stack(["small", "large"], height=1.5, ratios=[1, 3])
    fig.canvas.draw()
    low, high = (ax.get_position().height for ax in axes)
    assert high / low == pytest.approx(3, rel=0.05)
    assert fig.get_figheight() == pytest.approx(6.5)


def test_a_ranking_is_sorted_and_ends_with_what_failed():
    figures.use()
    fig, ax = plt.subplots()
    values = {"slow": 1234.0, "fails": np.nan, "fast": 0.4996, "middle": 10.0}
    figures.ranking(ax, values, {"fast": figures.PALETTE[0]})
    assert [label.get_text() for label in ax.get_yticklabels()] == [
        "fast",
        "middle",
        "slow",
        "fails",
    ]
    assert [label.get_weight() for label in ax.get_yticklabels()][:2] == ["bold", "normal"]
    assert [text.get_text() for text in ax.texts] == ["0.50", "10", "1200", "not reached"]
    assert [line.get_xdata()[0] for line in ax.lines] == [0.4996, 10, 1234]
    fig.canvas.draw()
    assert ax.texts[2].get_window_extent().x1 <= fig.bbox.x1


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (0.0299, "0.030"),
        (0.031, "0.031"),
        (2.0, "2.0"),
        (0.96, "0.96"),
        (99.6, "100"),
        (37.0, "37"),
    ],
)
def test_a_number_of_a_ranking_has_two_digits(value, told):
    figures.use()
    _, ax = plt.subplots()
    figures.ranking(ax, {"one": value}, {})
    assert [text.get_text() for text in ax.texts] == [told]


def test_a_tornado_has_a_bar_from_one_to_each_factor():
    _, ax = plt.subplots()
    groups = {"gain": {"error": (10.0, 0.5)}, "friction": {"error": (0.9, 1.1), "time": (1.0, 1.0)}}
    figures.tornado(ax, groups, ("halved", "doubled"))
    names = [label.get_text() for label in ax.get_yticklabels()]
    assert names == ["gain", "error", "friction", "error", "time"]
    bars = [tuple(line.get_xdata()) for line in ax.lines if len(line.get_xdata()) == 2]
    assert bars[:4] == [(1, 10.0), (1, 0.5), (1, 0.9), (1, 1.1)]
    assert ax.get_legend_handles_labels()[1] == ["halved", "doubled"]


def test_a_slope_triangle_has_the_slope_of_its_order():
    _, ax = plt.subplots()
    figures.slope_triangle(ax, 4, 1e-5, 1e-8, 3)
    (x, y), right, top = ax.patches[0].get_xy()[:3]
    assert np.log(top[1] / y) / np.log(right[0] / x) == pytest.approx(4)
    assert ax.texts[0].get_text() == "4"


def test_direct_label_stands_at_the_line():
    _, ax = plt.subplots()
    (line,) = ax.plot([0, 1, 3], [0, 10, 30])
    assert figures.direct_label(line, "end").xy == (3, 30)
    assert figures.direct_label(line, "inside", at=0.5).xy == pytest.approx((0.5, 5))
    (falling,) = ax.plot([3, 1, 0], [30, 10, 0])
    assert figures.direct_label(falling, "inside", at=0.5).xy == pytest.approx((0.5, 5))
    assert figures.direct_label(falling, "end").xy == (0, 0)


def test_labels_of_ends_keep_apart_and_in_order():
    figures.use()
    _, ax = plt.subplots()
    for name, end in (("low", 1.0), ("alone", 9.0), ("high", 1.1), ("middle", 1.05)):
        ax.plot([0, 1], [0, end], label=name)
    ax.plot([0, 1], [5, 5])  # without a label
    ax.set(xlim=(0, 1), ylim=(0, 10))
    figures.label_ends(ax, gap=15)
    at = {text.get_text(): text.xyann[1] for text in ax.texts}
    assert at["alone"] == pytest.approx(0)
    shown = {name: 72 / ax.figure.dpi * ax.transData.transform((1, end))[1] + at[name]
             for name, end in (("low", 1.0), ("middle", 1.05), ("high", 1.1))}  # fmt: skip
    assert np.diff(list(shown.values())) == pytest.approx([15, 15])


def test_exponents_are_legible_on_a_phone(tmp_path):
    figures.use()
    fig, _ = figures.stack(["$10^{-6}$"])
    figures.save(fig, tmp_path / "one.svg")
    assert not re.search(r"<use [^>]*scale\(0", (tmp_path / "one.svg").read_text())


def test_saved_figure_is_the_same_each_time(tmp_path):
    for name in ("one", "two"):
        figures.use()
        fig, (ax,) = figures.stack(["velocity / (m/s)"])
        ax.plot([0, 1], [0, 1], marker="o")
        ax.fill_between([0, 1], [0, 1], [1, 1], hatch="/")
        mpl.rcdefaults()  # the style is the figure's, not the session's
        figures.save(fig, tmp_path / f"{name}.svg")
    one = (tmp_path / "one.svg").read_bytes()
    assert one == (tmp_path / "two.svg").read_bytes()
    assert b"<dc:date>" not in one
    assert b"<text" not in one
