"""The Python examples of the pages, run as a reader would: saved as a script, or in a notebook."""

import os
import re
import shutil
import subprocess
import sys
from textwrap import dedent

import nbformat
import pytest
from nbclient import NotebookClient

from armsim.paths import DATA

ROOT = DATA.parent
BLOCK = re.compile(r"^( *)```python\n(.*?)^\1```$", re.DOTALL | re.MULTILINE)
READ = [*ROOT.glob("*.md"), *(ROOT / "book").glob("*.md"), *(ROOT / "src").rglob("*.md")]
PAGES = {str(path.relative_to(ROOT)): [dedent(body) for _, body in BLOCK.findall(text)]
         for path in sorted(READ) if "```python" in (text := path.read_text("utf-8"))}  # fmt: skip
#: Files of the reader's own, which the examples read.
FILES = {"my_axis.toml": "axes/x.toml", "my_run.csv": "measurements/x_axis_test.csv"}


def complaints(text):
    """Lines on standard error, without the notice that a reader gets on a first run."""
    return [line for line in text.splitlines() if not line.startswith("armsim: compiling")]


@pytest.fixture
def folder(tmp_path):
    for name, template in FILES.items():
        shutil.copy(DATA / template, tmp_path / name)
    return tmp_path


def test_every_example_is_found():
    assert {"README.md", "book/own_axis.md", "src/reportkit/README.md"} <= {*PAGES}
    for page, blocks in PAGES.items():
        assert (ROOT / page).read_text("utf-8").count("```python") == len(blocks)


@pytest.mark.parametrize("page", PAGES)
def test_script(page, folder):
    (folder / "example.py").write_text("\n".join(PAGES[page]), "utf-8")
    command = [sys.executable, "example.py"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, env=os.environ)
    assert (done.returncode, complaints(done.stderr)) == (0, [])


def test_notebook(folder):
    cell = nbformat.v4.new_code_cell
    cells = [cell(code) for blocks in PAGES.values() for code in ["%reset -f", *blocks]]
    notebook = nbformat.v4.new_notebook(cells=cells)
    NotebookClient(notebook, resources={"metadata": {"path": folder}}).execute()
    said = [o.text for one in notebook.cells for o in one.outputs if o.get("name") == "stderr"]
    assert complaints("".join(said)) == []
