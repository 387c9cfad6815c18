"""Tests of the software, run times and sums that a report tells."""

import hashlib
import os
import platform
import shutil
import subprocess
import tarfile
import tomllib
import zipfile
from pathlib import Path

import numpy as np
import pytest

from reportkit import provenance
from reportkit.timing import computer

ROOT = Path(__file__).parents[2]
SHA256 = ["sha256sum"] if shutil.which("sha256sum") else ["shasum", "--algorithm", "256"]  # macOS


@pytest.fixture
def toy(project):
    """A report with a data file, an expected one and two executed notebooks."""
    for folder in (project.expected, project.data / "own" / "__pycache__", project.results):
        folder.mkdir(parents=True, exist_ok=True)
    (project.data / "own" / "a.csv").write_text("1,2\n")
    (project.data / "own" / "__pycache__" / "a.pyc").touch()
    (project.expected / "20_one.json").touch()
    (project.results / "20_one.ipynb").touch()
    (project.results / "30_two.ipynb").touch()
    (project.results / "20_one-seconds.txt").write_text("4.2\n")
    return project


def test_report_that_is_not_installed_tells_the_packages_it_names(toy):
    assert provenance.software(toy) == [
        ("toy", "not installed"),
        ("Python", platform.python_version()),
        ("numpy", np.__version__),
    ]


def git(folder, *words):
    who = ("-c", "user.name=A", "-c", "user.email=a@b.invalid")
    command = ["git", "-C", folder, *who, *words]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def committed(folder):
    """Make a folder a repository with all files in its first commit, and return that."""
    for command in (["init", "-q"], ["add", "."], ["commit", "-qm", "first"]):
        git(folder, *command)
    return git(folder, "rev-parse", "HEAD")


@pytest.mark.parametrize("change", ["pyproject.toml", "new.txt"])
def test_report_in_a_repository_tells_the_commit_and_changes(toy, change):
    head = committed(toy.root)
    assert provenance.commit_of(toy.root)[:2] == (head, False)
    assert provenance.software(toy)[0] == ("toy", f"not installed, commit {head[:7]}")
    (toy.root / change).write_text("another")
    assert provenance.commit_of(toy.root)[:2] == (head, True)
    assert provenance.software(toy)[0] == ("toy", f"not installed, commit {head[:7]} with changes")


def test_repository_of_others_is_not_told(toy, tmp_path, monkeypatch):
    committed(tmp_path)
    assert provenance.commit_of(toy.root) == ("", None, "")
    monkeypatch.setenv("GIT_DIR", str(tmp_path / ".git"))  # as in a hook of that repository
    monkeypatch.setenv("GIT_WORK_TREE", str(toy.root))
    assert provenance.commit_of(toy.root) == ("", None, "")
    assert provenance.software(toy)[0] == ("toy", "not installed")


def test_export_tells_the_commit_it_was_made_of(toy, tmp_path):
    for name in (".gitattributes", provenance.ARCHIVED):
        shutil.copy(ROOT / name, toy.root)
    assert provenance.commit_of(toy.root) == ("", None, "")  # a copy without a repository
    head = committed(toy.root)
    git(toy.root, "archive", "--output", tmp_path / "export.tar", "HEAD")
    with tarfile.open(tmp_path / "export.tar") as archive:
        archive.extractall(tmp_path / "export", filter="data")
    assert provenance.commit_of(tmp_path / "export") == (head, None, "")
    committed(tmp_path)  # nor is the export a part of another repository
    assert provenance.commit_of(tmp_path / "export") == (head, None, "")


def test_kept_are_commit_lock_and_versions(toy):
    provenance.keep(toy, toy.results)
    kept = toy.results / "provenance.toml"
    versions = {
        "toy": "not installed",
        "Python": platform.python_version(),
        "numpy": np.__version__,
    }
    assert tomllib.loads(kept.read_text()) == {"versions": versions}
    toy.lock.write_bytes(b"numpy==1")
    head = committed(toy.root)
    provenance.keep(toy, toy.results)
    digest = hashlib.sha256(b"numpy==1").hexdigest()
    known = {"commit": head, "changed": False, "lock_sha256": digest, "versions": versions}
    assert tomllib.loads(kept.read_text()) == known


def test_installed_report_tells_what_its_extra_requires(toy, monkeypatch):
    wanted = ["numpy>=1", "click; extra == 'book'", "pytest; extra == 'dev'"]
    monkeypatch.setattr(provenance.metadata, "requires", lambda name: wanted)
    monkeypatch.setattr(provenance, "installed", lambda name: f"version of {name}")
    object.__setattr__(toy, "extra", "book")
    assert [name for name, _ in provenance.software(toy)] == ["toy", "Python", "click", "numpy"]


def test_all_parts_are_written(toy, monkeypatch):
    monkeypatch.chdir(toy.root)
    provenance.main(toy.results)
    written = {path.name[9:]: path.read_text() for path in toy.results.glob("appendix-*[!p]")}
    digest = hashlib.sha256(b"1,2\n").hexdigest()
    assert written["SHA256SUMS"] == f"{digest}  data/own/a.csv\n"
    assert f"| `data/own/a.csv` | `{digest[:16]}` |" in written["sums.md"]
    assert written["version.md"] == "**Version** not installed\n"
    assert written["computer.md"] == f"{computer()}\n"
    assert written["run-times.md"].splitlines()[2:] == [
        "| {doc}`20_one <results/20_one>` | 4.2 |",
        "| {doc}`30_two <results/30_two>` | – |",
    ]
    assert f"| numpy | {np.__version__} |" in written["software.md"]
    sums = toy.results / "appendix-SHA256SUMS"
    checked = subprocess.run([*SHA256, "--check", sums], cwd=toy.root, capture_output=True)
    assert checked.returncode == 0


def test_version_ends_with_the_date_of_the_commit(toy):
    git = ["git", "-C", str(toy.root), "-c", "user.name=A", "-c", "user.email=a@b.invalid"]
    subprocess.run([*git, "init", "-q"], check=True)
    subprocess.run([*git, "add", "pyproject.toml"], check=True)
    dates = {"GIT_COMMITTER_DATE": "2026-02-03T12:00:00Z", "PATH": os.environ["PATH"]}
    subprocess.run([*git, "commit", "-qm", "first"], check=True, env=dates)
    provenance.write(toy, toy.results)
    told = (toy.results / "appendix-version.md").read_text()
    assert told.startswith("**Version** not installed, commit ")
    assert told.endswith(", 2026-02-03\n")


def test_bundle_has_the_results_of_all_notebooks_and_is_the_same_each_time(toy, tmp_path):
    (toy.results / "20_one-table.md").write_text("| a |")
    (toy.results / "verdicts.md").touch()
    files = [tmp_path / "first.zip", tmp_path / "second.zip"]
    for file in files:
        provenance.bundle(toy.results, file)
        os.utime(toy.results / "20_one.ipynb", (0, 0))
    assert files[0].read_bytes() == files[1].read_bytes()
    with zipfile.ZipFile(files[0]) as archive:
        names = ["20_one-table.md", "20_one.ipynb", "30_two.ipynb"]
        assert archive.namelist() == [f"results/{name}" for name in names]
        assert archive.read("results/20_one-table.md") == b"| a |"
