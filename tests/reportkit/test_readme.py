"""Follow the README of reportkit in an empty folder."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest

import reportkit
from reportkit.pdf import BROWSERS

TEXT = (Path(reportkit.__file__).parent / "README.md").read_text(encoding="utf-8")
BLOCK = re.compile(
    r"^(?:`(?P<file>\S+)`:\n\n)?(?P<fence>```+)(?P<kind>\w+)\n(?P<body>.*?)^(?P=fence)$",
    re.DOTALL | re.MULTILINE,
)


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """Folder in which the files of the README were written and its commands run, in their order."""
    root = tmp_path_factory.mktemp("report")
    blocks = list(BLOCK.finditer(TEXT))
    parameters, code = (block["body"] for block in blocks if block["kind"] == "python")
    new = nbformat.v4
    cells = [
        new.new_markdown_cell("# Growth\n\nA population grows."),
        new.new_code_cell(parameters, metadata={"tags": ["parameters"]}),
        new.new_code_cell(code),
    ]
    (root / "notebooks").mkdir()
    nbformat.write(new.new_notebook(cells=cells), root / "notebooks" / "10_growth.ipynb")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for block in blocks:
        if block["file"]:
            (root / block["file"]).parent.mkdir(parents=True, exist_ok=True)
            (root / block["file"]).write_text(block["body"], encoding="utf-8")
        elif block["kind"] == "sh" and (
            "pdf" not in block["body"] or any(map(shutil.which, BROWSERS))
        ):
            done = subprocess.run(
                ["bash", "-e"], input=block["body"], cwd=root, env=os.environ | {"PATH": path},
                text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            )  # fmt: skip
            assert done.returncode == 0, done.stdout
    return root


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
    assert "grows by a factor of <span" in page
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


@pytest.mark.skipif(not any(map(shutil.which, BROWSERS)), reason="no browser")
def test_pdf_is_printed(report):
    assert (report / "_build" / "growth.pdf").read_bytes().startswith(b"%PDF")
