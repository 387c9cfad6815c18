"""Follow the README of reportkit to the letter: from nothing to a book, in its own environment.

Only the lock is not installed anew, which takes minutes: a new environment here also sees the
packages of the one that runs the tests, so that pip finds all of the lock in place.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import nbformat
import pytest

import reportkit
from reportkit.pdf import BROWSERS

PACKAGE = Path(reportkit.__file__).parent
STARTER = PACKAGE / "starter"
TEXT = (PACKAGE / "README.md").read_text(encoding="utf-8")
BLOCK = re.compile(
    r"^(?:`(?P<file>\S+)`:\n\n)?(?P<fence>```+)(?P<kind>\w+)\n(?P<body>.*?)^(?P=fence)$",
    re.DOTALL | re.MULTILINE,
)
BLOCKS = [block.groupdict() for block in BLOCK.finditer(TEXT)]
ROOT = Path(__file__).parents[2]
#: What the package is made of; a clone has it, but an export is no repository to clone.
SOURCES = "environment.txt pyproject.toml README.md LICENSE src data".split()
#: Stands for python3: an environment that it makes sees the locked packages. Python 3.11 puts an
#: old setuptools into a new one.
PYTHON = """#!/bin/sh
"{python}" "$@" && [ "$2" = venv ] && cd "$3/lib/python{version}/site-packages" &&
rm -rf setuptools* && echo "{packages}" > lock.pth
"""
GIT = {
    f"GIT_{who}_{key}": "reportkit" for who in ("AUTHOR", "COMMITTER") for key in ("NAME", "EMAIL")
}


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """Folder of the report that the commands of the README make, in an empty folder."""
    root = tmp_path_factory.mktemp("report")
    origin, tools, empty = root / "origin", root / "tools", root / "empty"
    tools.mkdir()
    empty.mkdir()
    packages, version = sysconfig.get_path("purelib"), sysconfig.get_python_version()
    text = PYTHON.format(python=sys.executable, packages=packages, version=version)
    (tools / "python3").write_text(text)
    (tools / "python3").chmod(0o755)
    for name in SOURCES:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        (origin / name).parent.mkdir(exist_ok=True)
        copy(ROOT / name, origin / name)
    ignored = {"PYTHONPATH", "PYTHONHOME", "MAKEFLAGS", "MAKELEVEL", "MFLAGS"}
    environment = {key: os.environ[key] for key in os.environ if key not in ignored} | GIT
    environment |= {"ARMSIM": str(origin), "PIP_NO_INDEX": "1"}
    environment["PATH"] = f"{tools}{os.pathsep}{os.environ['PATH']}"

    def run(folder, commands):
        done = subprocess.run(
            ["bash", "-ex"], input=commands, cwd=folder, env=environment, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout[-5000:]

    run(origin, "git init -q\ngit add .\ngit commit -qm all")
    (commands,) = (block["body"] for block in BLOCKS if block["kind"] == "sh")
    assert len(commands.splitlines()) == 12
    if not any(map(shutil.which, BROWSERS)):
        commands = commands.replace("make pdf\n", "")
    run(empty, commands)
    return empty / "growth"


def test_readme_shows_the_files_that_a_report_starts_with():
    notebook = nbformat.read(STARTER / "notebooks" / "10_growth.ipynb", as_version=4)
    code = [f"{cell.source}\n" for cell in notebook.cells if cell.cell_type == "code"]
    assert code == [block["body"] for block in BLOCKS if block["kind"] == "python"]
    shown = {block["file"]: block["body"] for block in BLOCKS if block["file"]}
    assert len(shown) == 3
    for name, body in shown.items():
        assert (STARTER / name).read_text(encoding="utf-8") == body


def test_report_runs_in_its_own_environment(report):
    (library,) = (report / ".venv" / "lib").glob("python*/site-packages")
    assert (library / "reportkit" / "cli.py").is_file()
    page = (report / "_build" / "html" / "book" / "growth.html").read_text(encoding="utf-8")
    assert sys.prefix not in page


def test_results_are_recorded_and_expected(report):
    made = sorted(path.name for path in (report / "book" / "results").glob("10_*"))
    assert made == ["10_growth-curve.csv", "10_growth-curve.svg", "10_growth-ends.md",
                    "10_growth-seconds.txt", "10_growth.ipynb", "10_growth.json"]  # fmt: skip
    values = json.loads((report / "data" / "expected" / "10_growth.json").read_text())
    assert values["factor"]["value"] == pytest.approx(1.6487212707)
    assert values["doubling_time"]["unit"] == "s"


def test_rerun_compares(report):
    (page,) = report.glob("runs/10_growth-*/10_growth.html")
    assert "2 of 2 recorded values changed" in page.read_text()


def test_page_shows_value_verdict_and_link_to_the_data(report):
    page = (report / "_build" / "html" / "book" / "growth.html").read_text()
    link = r'grows by a factor of <a class="value[^>]* title="10_growth::factor"><span'
    assert re.search(link, page)
    assert ">1.65<" in page
    assert "<strong>Confirmed</strong>" in page
    assert re.search(
        r'<span>\s*<img .*?only-dark" src="[^"]*" /></span>\s*<figcaption>', page
    )  # else it is hidden
    (light,) = re.findall('class="only-light" src="(.*?)"', page)  # each figure has a dark version
    (dark,) = re.findall('class="only-dark" src="(.*?)"', page)
    drawings = [(report / "_build/html/book" / path).read_text() for path in (light, dark)]
    assert [("#3a3a3a" in drawing, "#d8d8d8" in drawing) for drawing in drawings] == [
        (True, False),
        (False, True),
    ]
    assert 'class="claim confirmed docutils' in page
    assert re.search(r'href="[^"]*10_growth-curve\.csv"', page)
    assert 'property="og:description"' in page
    assert ".venv/bin/growth rerun growth" in re.sub("<[^>]+>", "", page)


@pytest.mark.skipif(not any(map(shutil.which, BROWSERS)), reason="no browser")
def test_pdf_is_printed(report):
    assert (report / "_build" / "book.pdf").read_bytes().startswith(b"%PDF")
