"""Sections and excerpts in the results of the search."""

import json
import re
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

#: Id, title and running text of each section of each page.
_SECTIONS: dict[str, list[tuple[str, str, str]]] = {}


def collect_sections(app: Sphinx, doctree: nodes.document, page: str) -> None:
    """Keep the text of the sections of a page, each without the sections inside it."""
    _SECTIONS[page] = []
    for section in doctree.findall(nodes.section):
        own = [part for part in section.children if not isinstance(part, nodes.section)]
        prose = " ".join(_told(one) for part in own for one in part.findall(nodes.paragraph))
        text = " ".join(re.sub(r"<br ?/?>", " ", prose).split())
        _SECTIONS[page].append((section["ids"][0], _told(own[0]), text))


def _told(element: nodes.Node) -> str:
    """Return the text of an element, with dots for formulas that need typesetting."""
    copy = element.deepcopy()
    for formula in [*copy.findall(nodes.math)]:
        if "\\" in formula.astext():
            formula.replace_self(nodes.Text("…"))
    return copy.astext()


def write_sections(app: Sphinx, error: Exception | None) -> None:
    """Write the text of all sections as a script for the page of the search."""
    if error is None and app.builder.name == "html":
        script = Path(__file__).parents[1] / "templates" / "sections.js"
        told = f"const SECTIONS = {json.dumps(_SECTIONS, ensure_ascii=False)};\n"
        told += script.read_text(encoding="utf-8")
        Path(app.outdir, "_static", "sections.js").write_text(told, encoding="utf-8")


def load_sections(app: Sphinx, page: str, *_: Any) -> None:
    """Load the script that names the sections of search results, on the page of the search."""
    if page == "search":
        app.add_js_file("sections.js")
