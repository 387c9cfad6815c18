"""Tests of the drawing and the tables of the architecture."""

from dataclasses import fields

import matplotlib as mpl
import numpy as np
import pytest

from armbook import architecture as module
from armbook.architecture import FLOORS, architecture, imports, main, part, reduced
from armsim.arm import AxisParameters
from reportkit import figures


@pytest.fixture(scope="module")
def graph():
    return imports()


def reachable(graph, name):
    """All modules that one imports, and what those import, and so on."""
    found, fresh = set(), {name}
    while fresh:
        fresh = {far for near in fresh for far in graph[near]} - found
        found |= fresh
    return found


def test_import_that_follows_from_others_is_left_out():
    graph = {
        "toy": set(),
        "toy.low": {"toy.low.one", "toy.low.two"},  # a package, which gathers names
        "toy.low.one": {"toy.low.two"},
        "toy.low.two": set(),
        "toy.side": {"toy.low.two"},
        "toy.top": {"toy.low", "toy.low.two", "toy.side"},
    }
    assert reduced(graph) == {
        "toy.low.one": {"toy.low.two"},
        "toy.low.two": set(),
        "toy.side": {"toy.low.two"},
        "toy.top": {"toy.low.one", "toy.side"},
    }


def test_no_import_is_lost_in_the_drawing(graph):
    lines = reduced(graph)
    for name in lines:
        assert reachable(lines, name) == reachable(graph, name) & set(lines), name


def test_every_module_has_a_place_below_what_imports_it(graph):
    lines = reduced(graph)
    assert {part(name) for name in lines} == {name for floor in FLOORS for name in floor}
    figure = architecture(graph)
    texts = figure.axes[0].texts
    shown = [text.get_text() for text in texts]
    parts = [name for floor in FLOORS for name in floor]
    assert sorted(shown) == sorted([*parts, *(name.rpartition(".")[2] for name in lines)])
    points = [np.array(line.get_data()).T for line in figure.axes[0].lines]
    assert len(points) == sum(part(m) != "armsim" for others in lines.values() for m in others)
    downwards = [start[1] < end[1] for start, end in points]
    across = sum(
        part(name) != part(other) and {part(name), part(other)} <= set(FLOORS[0])
        for name, others in lines.items()
        for other in others
    )
    assert downwards.count(False) <= across  # between the two parts of the highest floor


def test_no_two_boxes_meet(graph):
    figure = architecture(graph)
    figure.canvas.draw()
    boxes = [
        patch.get_window_extent()
        for patch in figure.axes[0].patches
        if patch.get_facecolor() == (1, 1, 1, 1)
    ]
    assert len(boxes) == len(reduced(graph))
    for n, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[:n])


def test_drawing_has_the_same_bytes_in_any_order_of_the_modules_and_any_style(graph, tmp_path):
    figures.save(architecture(graph), tmp_path / "one.svg", figures.PLAN)
    with mpl.rc_context({"text.usetex": True, "font.size": 20, "lines.marker": "o"}):
        figures.save(
            architecture(dict(reversed(graph.items()))), tmp_path / "two.svg", figures.PLAN
        )
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
