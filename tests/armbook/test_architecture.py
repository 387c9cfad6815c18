"""Tests of the drawing and the tables of the architecture."""

from dataclasses import fields

import matplotlib as mpl
import pytest

from armbook import architecture as module
from armbook.architecture import FLOORS, architecture, arrows, imports, main, members
from armsim.arm import AxisParameters
from reportkit import figures


@pytest.fixture(scope="module")
def graph():
    return imports()


def test_import_that_follows_from_others_is_left_out():
    graph = {
        "armbook.one": {"armbook.two", "armsim.arm.simulate", "armsim.methods.trees"},
        "armbook.two": {"armsim.checks"},
        "armsim.amplifier": {"armsim.checks"},  # stands beside the arm
        "armsim.arm.simulate": {"armsim.methods.trees"},
        "armsim.methods.trees": {"armsim.checks", "armsim.methods.tableaux"},
    }
    assert arrows(graph) == {
        ("armbook", "armsim.arm"),
        ("armsim.arm", "armsim.methods"),
        ("armsim.methods", "armsim"),
    }


def test_arrows_are_those_of_the_design(graph):
    """Each leads to a lower floor, or sideways on the highest floor."""
    assert arrows(graph) == {
        ("armbook", "reportkit"),
        ("armbook", "armsim.arm"),
        ("armsim.arm", "armsim.exact"),
        ("armsim.arm", "armsim.methods"),
        ("armsim.exact", "armsim"),
        ("armsim.methods", "armsim"),
    }
    (ax,) = architecture(graph).axes
    drawn = [text for text in ax.texts if not text.get_text()]
    assert len(drawn) == len(arrows(graph))
    ends = [(*text.xyann, *text.xy) for text in drawn]  # from, to
    highest = ax.patches[0].get_y() + ax.patches[0].get_height()
    assert all(y < y_2 or (y == y_2 < highest and x < x_2) for x, y, x_2, y_2 in ends)


def test_members_are_named_once_by_their_place_in_the_part(graph):
    assert members(graph, "armsim") == ["checks", "choices", "machine_code", "parallel", "paths"]
    assert {"amplifier", "paper", "simulate"} <= {*members(graph, "armsim.arm")}
    of_kit = members(graph, "reportkit")
    assert of_kit.count("figures") == of_kit.count("sphinx_extension") == 1
    assert "looks" not in of_kit


def test_drawing_lists_the_members_of_each_part_inside_it(graph):
    figure = architecture(graph)
    figure.canvas.draw()
    (ax,) = figure.axes
    boxes = [patch.get_window_extent() for patch in ax.patches]
    parts = [name for floor in FLOORS for name in floor]
    titles, lists = ([t for t in ax.texts if t.get_text()][n::2] for n in (0, 1))
    assert [title.get_text() for title in titles] == parts
    for name, box, title, listed in zip(parts, boxes, titles, lists, strict=True):
        assert ", ".join(members(graph, name)) == listed.get_text().replace("\n", " ")
        for text in (title, listed):
            (left, low), (right, high) = text.get_window_extent().get_points()
            assert box.x0 < left and right < box.x1 and box.y0 < low and high < box.y1
    for n, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[:n])


def test_drawing_has_the_same_bytes_in_any_order_of_the_modules_and_any_style(graph, tmp_path):
    figures.save(architecture(graph), tmp_path / "one.svg")
    with mpl.rc_context({"text.usetex": True, "font.size": 20, "lines.marker": "o"}):
        figures.save(architecture(dict(reversed(graph.items()))), tmp_path / "two.svg")
    assert (tmp_path / "one.svg").read_bytes() == (tmp_path / "two.svg").read_bytes()


def test_table_names_every_module(graph):
    rows = [row.split(" | ") for row in module.modules_table(graph).splitlines()[2:]]
    assert [row[0].split("`")[1] for row in rows] == sorted(graph)
    assert all(row[1].strip() for row in rows)
    (trees,) = (row for row in rows if row[0] == "| `armsim.methods.trees`")
    assert trees[2] == "`armsim.checks`, `armsim.methods.tableaux` |"


def test_table_of_symbols_has_every_parameter():
    rows = [row.split(" | ") for row in module.symbols_table().splitlines()[2:]]
    assert sorted(row[1].strip("`") for row in rows) == sorted(
        item.name for item in fields(AxisParameters)
    )
    assert ["| $K_{g}$", "`K_g`", "N/m", "gear stiffness", "Table 5 |"] in rows


def test_main_writes_all_parts(tmp_path):
    main(tmp_path)
    for part_ in ("modules.md", "symbols.md", "software.md", "computer.md", "run-times.md"):
        assert (tmp_path / f"appendix-{part_}").read_text().endswith("\n")
    software = (tmp_path / "appendix-software.md").read_text()
    for name in ("armsim", "Python", "numpy", "numba", "jupyter-book"):
        assert f"| {name} |" in software
    assert "data/paper/tables.toml" in (tmp_path / "appendix-SHA256SUMS").read_text()
    assert "<svg" in (tmp_path / "appendix-architecture.svg").read_text()
