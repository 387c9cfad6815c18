"""Tests of the drawn figures: complete, and nothing lies on something else; and of the trees."""

import re
import runpy
from itertools import combinations, pairwise
from pathlib import Path
from types import SimpleNamespace

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Polygon

from armbook.drawings import rooted_tree
from reportkit import figures

FIGURES = Path(__file__).parents[2] / "book" / "figures"
drawings = SimpleNamespace(**runpy.run_path(str(FIGURES / "draw.py")))
DRAWINGS = [drawings.arm_axes, drawings.block_diagram]
SYMBOLS = (
    "R_a L_a K_b J_m B_m K_t r_g H M T_z T_p T_r K_1 K_2 K_i K_e V_M V_L B_a b_g K_g F_0 v "
    "f_g F_s v_m v_c U x y_0 y_1 y_2 y_3 y_4 y_5 y_6 s"
)


def texts(fig):
    """Each text with its box in pixels; 72 of them to the inch, so that one is a point."""
    fig.set_dpi(72)
    renderer = FigureCanvasAgg(fig).get_renderer()
    return [(t.get_text(), t.get_window_extent(renderer)) for t in fig.axes[0].texts]


def pixels(fig, points):
    """Points of the sheet in the pixels of `texts`."""
    fig.set_dpi(72)
    return fig.axes[0].transData.transform(np.array(points, dtype=float))


def blocks(fig):
    """Corners (left, bottom, right, top) of the white blocks, in pixels."""
    white = [p for p in fig.axes[0].patches
             if isinstance(p, FancyBboxPatch) and p.get_facecolor() == (1, 1, 1, 1)]  # fmt: skip
    corners = [(p.get_x(), p.get_y(), p.get_x() + p.get_width(), p.get_y() + p.get_height())
               for p in white]  # fmt: skip
    return [(x0, y1, x1, y0) for (x0, y0), (x1, y1) in
            (pixels(fig, [c[:2], c[2:]]) for c in corners)]  # fmt: skip


def wires(fig):
    """Return the polylines that are neither parts of glyphs nor arrowheads, in pixels."""
    return [pixels(fig, line.get_xydata()) for line in fig.axes[0].lines
            if line.get_linewidth() not in (0.6, 1.5)]  # fmt: skip


def dense(polyline):
    """Points along a polyline, at most half a pixel from each other."""
    steps = (np.linspace(a, b, 2 + int(2 * np.hypot(*(b - a)))) for a, b in pairwise(polyline))
    return np.concatenate(list(steps))


def inside(points, box, margin=0.0):
    """Tell whether one of the points lies within a box that shrinks by the margin."""
    x0, y0, x1, y1 = box
    x, y = points.T
    return bool(np.any((x > x0 + margin) & (x < x1 - margin)
                       & (y > y0 + margin) & (y < y1 - margin)))  # fmt: skip


@pytest.mark.parametrize("draw", DRAWINGS)
def test_texts_keep_apart(draw):
    for (one, a), (two, b) in combinations(texts(draw()), 2):
        assert not a.overlaps(b), (one, two)


@pytest.mark.parametrize("draw", DRAWINGS)
def test_texts_lie_within_the_figure(draw):
    fig = draw()
    width, height = fig.get_size_inches() * 72
    for text, box in texts(fig):
        assert box.x0 >= 1 and box.y0 >= 1, text
        assert box.x1 <= width - 1 and box.y1 <= height - 1, text


@pytest.mark.parametrize("draw", DRAWINGS)
def test_no_line_runs_through_a_text(draw):
    fig = draw()
    for text, box in texts(fig):
        for line in fig.axes[0].lines:
            points = dense(pixels(fig, line.get_xydata()))
            assert not inside(points, box.extents), text


@pytest.mark.parametrize("draw", DRAWINGS)
def test_same_bytes_each_time_in_any_style(draw, tmp_path):
    figures.save(draw(), tmp_path / "one.svg", figures.PLAN)
    with mpl.rc_context({"font.size": 20, "text.usetex": True, "lines.linestyle": ":"}):
        figures.save(draw(), tmp_path / "two.svg", figures.PLAN)
    one = (tmp_path / "one.svg").read_bytes()
    assert one == (tmp_path / "two.svg").read_bytes()
    assert len(one) < 200_000


def test_committed_drawings_are_those_of_the_script(tmp_path):
    drawings.main(tmp_path)
    made = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert made == {path.name: path.read_bytes() for path in FIGURES.glob("*.svg")}
    assert len(made) == len(DRAWINGS)


def test_every_symbol_of_the_model_is_in_the_diagram():
    found = set()
    for text, _ in texts(drawings.block_diagram()):
        for formula in re.findall(r"\$([^$]*)\$", text):
            plain = re.sub(r"\\[a-z]+", " ", formula)
            found |= set(re.findall(r"[A-Za-z](?:_[A-Za-z0-9])?", plain))
    assert found == set(SYMBOLS.split())


def test_words_of_the_slave_control_unit():
    words = [text for text, _ in texts(drawings.block_diagram())]
    for word in ("position", "velocity", "integrated position", "encoder", "track data",
                 "every 80 ms", "5 ms", r"$\pm$10 V"):  # fmt: skip
        assert words.count(word) == 1, word
    assert words.count("D") == 1  # as in `arm.slave_control`


def test_texts_fit_their_blocks():
    fig = drawings.block_diagram()
    n = 0
    for text, box in texts(fig):
        middle = np.array([[(box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2]])
        for x0, y0, x1, y1 in (b for b in blocks(fig) if inside(middle, b)):
            n += 1
            assert box.x0 > x0 + 1 and box.x1 < x1 - 1, text
            assert box.y0 > y0 + 1 and box.y1 < y1 - 1, text
    assert n == len(blocks(fig)) - 6  # six glyphs hold no text


def test_arrowheads_touch_what_they_point_at():
    fig = drawings.block_diagram()
    heads = [p for p in fig.axes[0].patches if isinstance(p, Polygon)]
    circles = [p for p in fig.axes[0].patches if isinstance(p, Circle) and p.radius > 3]
    loose = 0
    for head in heads:
        tip, a, b = head.get_xy()[:3]
        rear = (a + b) / 2
        touches = [abs(np.hypot(*(tip - c.center)) - c.radius) < 1e-6
                   and np.hypot(*(rear - c.center)) > c.radius for c in circles]  # fmt: skip
        (x, y), (u, v) = pixels(fig, [tip, rear])
        for x0, y0, x1, y1 in blocks(fig):
            on_edge = max(x0 - x, x - x1, y0 - y, y - y1)
            touches.append(abs(on_edge) < 1e-6 and max(x0 - u, u - x1, y0 - v, v - y1) > 1)
        loose += sum(touches) == 0
        assert sum(touches) <= 1
    assert len(heads) > 40
    assert loose == 1  # the arm's position leaves the diagram


def test_wires_pass_beside_blocks_and_cross_once_over_a_bridge():
    fig = drawings.block_diagram()
    for wire in wires(fig):
        for box in blocks(fig):
            assert not inside(dense(wire), box, margin=0.1)
    crossings = 0
    for one, two in combinations(wires(fig), 2):
        for (a, b), (c, d) in ((s, t) for s in pairwise(one) for t in pairwise(two)):
            matrix = np.column_stack([b - a, c - d])
            if abs(np.linalg.det(matrix)) > 1e-9:
                at = np.linalg.solve(matrix, c - a)
                crossings += bool(np.all((at > 1e-6) & (at < 1 - 1e-6)))
    assert crossings == 1


def test_arm_axes_names_its_five_motions():
    words = {text for text, _ in texts(drawings.arm_axes())}
    assert {"$x$", "$y$", "$z$", "pitch", "roll"} <= words


def test_tree_has_an_edge_above_each_node_but_the_root():
    """The tree with branches of one and of two nodes: a node carries it, its child, or both."""
    ax = Figure().subplots()
    tree = ((), ((),))
    rooted_tree(ax, tree, "red")
    *edges, nodes, root = (line.get_xydata().tolist() for line in ax.lines)
    assert len(nodes) == 4
    assert root == [[0, 0]]
    assert sorted(upper for _, upper in edges) == sorted(node for node in nodes if node != root[0])
    assert all(upper[1] == lower[1] + 1 for lower, upper in edges)
    assert {line.get_color() for line in ax.lines} == {"red"}
