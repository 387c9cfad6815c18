"""Tests of the appendix: the modules' imports, hashes, versions and run times."""

import subprocess
from dataclasses import fields

import pytest

from armbook import architecture as appendix
from armsim.arm import AxisParameters
from armsim.paths import DATA


@pytest.fixture(scope="module")
def graph():
    return appendix.imports()


def test_no_import_leads_upwards(graph):
    assert appendix.upwards(graph) == []
    assert {appendix.floor(module) for module in graph} == {*appendix.FLOORS, ""}
    assert graph["paths"] == set()


def test_an_import_that_leads_upwards_is_found():
    graph = {"methods.trees": {"arm.linear"}, "paths": {"cli"}, "arm.linear": {"methods.trees"}}
    assert appendix.upwards(graph) == [("methods.trees", "arm.linear"), ("paths", "cli")]


@pytest.fixture
def package(tmp_path):
    sources = {
        "__init__": "",
        "low/__init__": "from toy.low.base import thing as name",
        "low/base": "import os\ndef f():\n    from toy.high import top",
        "high/__init__": "",
        "high/top": "from toy.low import name\nfrom toy.high import side",
        "high/side": "def f():\n    from toy.low.base import thing",
    }
    for name, text in sources.items():
        path = tmp_path / "toy" / f"{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path / "toy"


def test_imports_of_a_small_package(package):
    graph = appendix.imports(package)
    assert graph == {
        "high.side": {"low.base"},  # inside a function
        "high.top": {"low.base", "high.side"},  # through what the package gathers
        "low.base": set(),  # inside a function too, but that would close a circle
    }
    assert appendix.reduced(graph)["high.top"] == {"high.side"}


def test_drawing_shows_every_module_once(graph):
    figure = appendix.architecture(graph)
    shown = [text.get_text() for text in figure.axes[0].texts]
    names = [module.rpartition(".")[2] for module in graph if appendix.floor(module)]
    assert sorted(shown) == sorted([*names, *appendix.FLOORS])
    lines = sum(
        len(others) for module, others in appendix.reduced(graph).items() if module != "paths"
    )
    to_paths = sum("paths" in others for others in appendix.reduced(graph).values())
    assert len(figure.axes[0].lines) == lines - to_paths


def test_table_names_every_module(graph):
    rows = appendix.modules_table(graph).splitlines()[2:]
    assert sorted(row.split("`")[1] for row in rows) == sorted(graph)
    assert all(row.split("|")[2].strip() for row in rows)


def test_table_of_symbols_has_every_parameter():
    rows = [row.split(" | ") for row in appendix.symbols_table().splitlines()[2:]]
    assert sorted(row[1].strip("`") for row in rows) == sorted(
        item.name for item in fields(AxisParameters)
    )
    assert ["| $K_{g}$", "`K_g`", "N/m", "gear stiffness", "Table 5 |"] in rows


def test_sums_are_those_of_the_data(tmp_path):
    sums = appendix.sums()
    (tmp_path / "SHA256SUMS").write_text(sums)
    checked = subprocess.run(
        ["sha256sum", "--check", "--quiet", tmp_path / "SHA256SUMS"], cwd=DATA.parent
    )
    assert checked.returncode == 0
    named = {line.split("  ")[1] for line in sums.splitlines()}
    assert {"data/paper/tables.toml", "data/axes/x.toml"} <= named
    assert appendix.sums_table(sums).count("\n") == len(named) + 2


def test_main_writes_all_parts(tmp_path):
    (tmp_path / "20_one.ipynb").touch()
    (tmp_path / "30_two.ipynb").touch()
    (tmp_path / "20_one-seconds.txt").write_text("4.2\n")
    assert appendix.main([str(tmp_path)]) == 0
    times = (tmp_path / "appendix-run-times.md").read_text()
    assert "| {doc}`20_one <results/20_one>` | 4.2 |" in times
    assert "| {doc}`30_two <results/30_two>` | – |" in times
    software = (tmp_path / "appendix-software.md").read_text()
    assert all(f"| {name} |" in software for name in ("armsim", "Python", "numpy", "numba"))
    assert (tmp_path / "appendix-computer.md").read_text().endswith("\n")
    assert "<svg" in (tmp_path / "appendix-architecture.svg").read_text()
