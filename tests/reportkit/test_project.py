"""Tests of the settings of a report."""

import pytest

from reportkit.cli import main
from reportkit.project import Project, ProjectError


def test_settings_are_found_from_any_folder_below(root, monkeypatch):
    (root / "a" / "b").mkdir(parents=True)
    monkeypatch.chdir(root / "a" / "b")
    found = Project.find()
    assert (found.root, found.name, list(found.versions)) == (root, "toy", ["numpy"])
    assert found.notebooks == root / "notebooks"
    assert found.expected == root / "data" / "expected"
    assert Project.find(root) == found


def test_paths_are_relative_to_the_settings(root):
    (root / "pyproject.toml").write_text(
        '[tool.reportkit]\nname = "toy"\nclaims = "own/claims.toml"\n'
    )
    assert Project.find(root).claims == root / "own" / "claims.toml"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[tool.reportkit]\n", "name"),
        ('[tool.reportkit]\nname = "toy"\nnotebook = "n"\n', "notebook"),
        ("[tool.reportkit]\nname = \n", "pyproject.toml"),
        ('[project]\nname = "toy"\n', "or above"),
        ("# [tool.reportkit]\n", "pyproject.toml"),
        ("[tool.reportkit]\nname = " + 5000 * "[", "recursion"),
        ('[tool.reportkit]\nname = "toy \udcff"\n', "pyproject.toml"),
        ("tool = 3  # [tool.reportkit]\n", "pyproject.toml"),
    ],
)
def test_wrong_settings_are_told_in_one_line(root, monkeypatch, capsys, text, message):
    (root / "pyproject.toml").write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(ProjectError, match=message):
        Project.find(root)
    monkeypatch.chdir(root)
    assert main(["list"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_parameters_are_checked_by_the_function_that_the_settings_name(
    root, notebook, monkeypatch, capsys
):
    """Before a kernel starts, and with the defaults."""
    notebook("never executed = 1")
    with (root / "pyproject.toml").open("a") as file:
        file.write('[tool.reportkit.checks]\n50_trial = "own_checks:small"\n')
    (root / "own_checks.py").write_text(
        "def small(values):\n    raise ArithmeticError(f'{values}: too large')\n"
    )
    monkeypatch.syspath_prepend(root)
    monkeypatch.chdir(root)
    assert main(["rerun", "trial", "-p", "size", "3"]) == 2
    told = "toy rerun: {'size': 3.0, 'motion': ''}: too large\n"
    assert capsys.readouterr() == ("", told)
    assert not (root / "runs").exists()
