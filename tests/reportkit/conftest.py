"""A toy report in a temporary folder: settings and a notebook of two cells."""

import nbformat
import pytest

from reportkit.project import Project

SETTINGS = """
[tool.reportkit]
name = "toy"
versions = ["numpy"]
"""
PARAMETERS = """size = 1.0  # m, size; 0.1 to 10
motion = ""  # measured motion; path"""
STUDY = """
from matplotlib import pyplot as plt
from reportkit.record import Study
study = Study("50_trial")
study.record("double", 2 * size, unit="m")
study.record("same", 3)
study.record("own", open(motion).read() if motion else "")
fig, ax = plt.subplots()
ax.plot([0, size])
study.figure("line", fig, {"x": [0, size]}, alt="A line that rises from zero")
"""
TEXT = "# A trial $x_1$\n\nSee {doc}`../page` or $x^2$.\n\n| $|a|$ |\n|---|\n| 1 |"


@pytest.fixture
def study():
    """The code of the second cell."""
    return STUDY


@pytest.fixture
def root(tmp_path):
    """Folder of a report without notebooks."""
    (tmp_path / "toy").mkdir()
    (tmp_path / "toy" / "pyproject.toml").write_text(SETTINGS)
    return tmp_path / "toy"


@pytest.fixture
def project(root):
    """The report in that folder."""
    return Project.find(root)


@pytest.fixture
def notebook(project):
    """Write a notebook of the report: a text, its parameters and further cells of code."""

    def write(*cells, parameters=PARAMETERS, name="50_trial"):
        new = nbformat.v4
        settings = new.new_code_cell(parameters, metadata={"tags": ["parameters"]})
        code = [new.new_code_cell(cell) for cell in cells or (STUDY,)]
        project.notebooks.mkdir(exist_ok=True)
        path = project.notebooks / f"{name}.ipynb"
        content = new.new_notebook(cells=[new.new_markdown_cell(TEXT), settings, *code])
        nbformat.write(content, path)
        return path

    return write
