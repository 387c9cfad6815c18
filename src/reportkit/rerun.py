"""Execute a notebook with other parameters, beside the book, and tell what changed."""

import csv
import io
import itertools
import json
from collections.abc import Iterable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import nbformat

from reportkit import check, page
from reportkit.check import Comparison
from reportkit.execute import executed, locked
from reportkit.parameters import Notebook
from reportkit.project import Project


class Rerun(NamedTuple):
    """Where a rerun went, how it compares, and what the notebook wrote to its standard error."""

    folder: Path
    comparisons: list[Comparison]
    complaints: list[str]


def rerun(
    notebook: Notebook, parameters: Mapping[str, Any], parent: Path, project: Project
) -> Rerun:
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

    Raises
    ------
    NotebookError
        If the notebook fails; then nothing is left.
    """
    name, started = notebook.name, datetime.now()
    with executed(notebook.path, parent, parameters) as (new, complaints):
        got = _load(new / f"{name}.json")
        published = _load(project.expected / f"{name}.json")
        comparisons = check.compare(name, published, got) if published else []
        _write_csv(new / "values.csv", ["name", "value", "unit"], (
            [key, record["value"], record["unit"]] for key, record in got.items()
        ))  # fmt: skip
        _write_csv(new / "comparison.csv", COLUMNS, map(_row, comparisons))
        defaults = {key: item.default for key, item in notebook.parameters.items()}
        lines = (
            f"{key} = {json.dumps(v, ensure_ascii=False)}\n"
            for key, v in (defaults | dict(parameters)).items()
        )
        (new / "parameters.toml").write_text("".join(lines), encoding="utf-8")
        executed_notebook = nbformat.read(new / f"{name}.ipynb", as_version=4)
        text = page.render(notebook, executed_notebook, parameters, comparisons, started, project)
        (new / f"{name}.html").write_text(text, encoding="utf-8")
        folder = _publish(new, parent, f"{name}-{started:%Y%m%d-%H%M%S}")
    return Rerun(folder, comparisons, complaints)


COLUMNS = ["name", "published", "got", "difference", "relative difference", "unit", "changed"]


def _row(pair: Comparison) -> list[Any]:
    published, got = pair.expected or {}, pair.got or {}
    return [
        pair.name,
        published.get("value"),
        got.get("value"),
        pair.difference,
        pair.relative,
        (got or published)["unit"],
        "yes" if pair.moved else "no",
    ]


def _load(path: Path) -> dict[str, Any]:
    return check.load(path) if path.exists() else {}


def _write_csv(path: Path, heading: list[str], rows: Iterable[list[Any]]) -> None:
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerows([heading, *rows])
    path.write_text(buffer.getvalue(), encoding="utf-8")


def _publish(new: Path, parent: Path, name: str) -> Path:
    with locked(parent):
        names = itertools.chain([name], (f"{name}-{n}" for n in itertools.count(2)))
        folder = next(parent / name for name in names if not (parent / name).exists())
        return new.rename(folder)
