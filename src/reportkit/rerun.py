"""Execute a notebook with other parameters, beside the book, and report what changed."""

import json
from collections.abc import Iterable, Mapping
from datetime import datetime
from itertools import chain, count
from pathlib import Path
from typing import Any

import nbformat
import pandas as pd

from reportkit import check, page, text
from reportkit.execute import executed
from reportkit.figures import dark
from reportkit.locks import locked
from reportkit.parameters import Notebook
from reportkit.project import RESULTS_VARIABLE, Project, read_toml

#: The kernel itself states what it is.
CLOSING = f"""
import os
from pathlib import Path
from reportkit.project import Project
from reportkit.provenance import keep
keep(Project.find(Path({{root!r}})), Path(os.environ["{RESULTS_VARIABLE}"]))
"""


def rerun(
    notebook: Notebook, parameters: Mapping[str, Any], parent: Path, project: Project
) -> tuple[Path, list[check.Comparison], list[str]]:
    """Execute a notebook and put everything it makes into a new folder ``NN_topic-<time>``.

    The folder appears as a whole when all is done. Several reruns into one `parent` at a time do
    not disturb each other.

    Parameters
    ----------
    notebook : Notebook
        What `reportkit.parameters.find` gives.
    parameters : mapping
        Checked values, as `Notebook.values` gives them.
    parent : path
        The folder of the new folder; made if missing.
    project : Project
        The report, whose published values are compared.

    Returns
    -------
    folder : path
        The new folder.
    comparisons : list of Comparison
        Recorded and published values; empty if none are published.
    complaints : list of str
        Messages of the notebook on standard error.

    Raises
    ------
    NotebookError
        If the notebook fails; then nothing is left.
    """
    name, started, used = notebook.name, datetime.now(), notebook.defaults | dict(parameters)
    closing = CLOSING.format(root=str(project.root))
    with executed(notebook.path, parent, parameters, closing) as (new, complaints):
        files = new / f"{name}.json", project.expected / f"{name}.json"
        got, published = (check.load(path) if path.exists() else {} for path in files)
        comparisons = check.compare(name, published, got) if published else []
        values = ([key, record["value"], record["unit"]] for key, record in got.items())
        rows = ([*pair.numbers, "yes" if pair.moved else "no"] for pair in comparisons)
        _write_csv(new / "values.csv", ["name", "value", "unit"], values)
        _write_csv(new / "comparison.csv", COLUMNS, rows)
        lines = (f"{key} = {json.dumps(v, ensure_ascii=False)}\n" for key, v in used.items())
        (new / "parameters.toml").write_text("".join(lines), encoding="utf-8")
        mathjax = project.mathjax.read_text("utf-8") if project.mathjax.exists() else ""
        html = text.render(
            "rerun.html",
            project=project,
            notebook=notebook,
            used=used,
            cells=nbformat.read(new / f"{name}.ipynb", as_version=4).cells,
            comparisons=comparisons,
            headings=check.CHANGE,
            started=started,
            made=read_toml(new / "provenance.toml"),
            mathjax=mathjax.replace("</script", "<\\/script"),
            markdown=page.html,
            dark=dark,
        )
        (new / f"{name}.html").write_text(html, encoding="utf-8")
        folder = _publish(new, parent, f"{name}-{started:%Y%m%d-%H%M%S}")
    return folder, comparisons, complaints


COLUMNS = ["name", "published", "got", "difference", "relative difference", "unit", "changed"]


def _write_csv(path: Path, heading: list[str], rows: Iterable[list[Any]]) -> None:
    # dtype object keeps all digits of each number
    pd.DataFrame(rows, columns=heading, dtype=object).to_csv(path, index=False)


def _publish(new: Path, parent: Path, name: str) -> Path:
    endings = chain([""], map("-{}".format, count(2)))
    with locked(parent):
        places = (parent / f"{name}{ending}" for ending in endings)
        return new.rename(next(place for place in places if not place.exists()))
