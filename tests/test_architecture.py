"""Tests of who imports whom, imports inside functions included."""

from graphlib import CycleError, TopologicalSorter

import pytest

from armbook.architecture import FLOORS, imports, part


@pytest.fixture(scope="module")
def graph():
    return imports()


def within(name, *packages):
    """Whether a module is one of some packages or lies in one of them."""
    return any(f"{name}.".startswith(f"{package}.") for package in packages)


@pytest.mark.parametrize(
    ("package", "forbidden"),
    [
        ("reportkit", ("armsim", "armbook")),
        ("armsim", ("reportkit", "armbook")),
        ("armsim.methods", ("armsim.arm", "armsim.exact", "armsim.paper", "armsim.paths")),
        ("armsim.exact", ("armsim.arm", "armsim.methods", "armsim.paper", "armsim.paths")),
    ],
)
def test_package_does_not_import(graph, package, forbidden):
    inside = {name: others for name, others in graph.items() if within(name, package)}
    assert len(inside) > 3
    found = [
        (name, other) for name in inside for other in inside[name] if within(other, *forbidden)
    ]
    assert found == []


def test_exact_solver_needs_checks_and_machine_code_alone(graph):
    needed = {
        other
        for name, others in graph.items()
        if within(name, "armsim.exact")
        for other in others
        if not within(other, "armsim.exact")
    }
    assert needed <= {"armsim.checks", "armsim.machine_code"}


def test_there_is_no_cycle(graph):
    TopologicalSorter(graph).prepare()


def test_no_import_leads_to_a_higher_floor(graph):
    level = {name: n for n, floor in enumerate(FLOORS) for name in floor}
    upwards = [
        (name, other)
        for name, others in graph.items()
        for other in others
        if level[part(name)] > level[part(other)]
    ]
    assert upwards == []


def test_an_import_inside_a_function_closes_a_cycle(tmp_path, monkeypatch):
    package = tmp_path / "toy_package"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "one.py").write_text("from toy_package import two\n")
    (package / "two.py").write_text("def f():\n    from toy_package.one import two\n")
    monkeypatch.syspath_prepend(tmp_path)
    graph = imports(["toy_package"])
    assert graph["toy_package.two"] == {"toy_package.one"}
    with pytest.raises(CycleError):
        TopologicalSorter(graph).prepare()
