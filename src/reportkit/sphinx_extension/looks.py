"""Quoted numbers, a list of references for screen readers, and scripts where they are needed."""

import re
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator as HTMLTranslator

_POWER = re.compile(r"e([+-]\d+)$")
_HIGH = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def set_numbers(app: Sphinx, doctree: nodes.document, page: str) -> None:
    """Write quoted numbers with a minus sign and powers of ten: −2 for -2, 6·10⁻⁸ for 6e-08."""
    for quoted in doctree.findall(nodes.inline):
        told = quoted.astext()
        if "pasted-text" in quoted["classes"] and re.match(r"-|[\d.]+e", told):
            told = _POWER.sub(lambda e: "·10" + str(int(e[1])).translate(_HIGH), told)
            quoted.children = [nodes.Text(re.sub("^-", "−", told))]


def visit_citation(self: HTMLTranslator, node: nodes.citation) -> None:
    """Begin a reference as a list item; the ARIA role that docutils gives it is deprecated."""
    if not isinstance(node.previous_sibling(), nodes.citation):
        self.body.append('<div role="list" class="citation-list">\n')
    self.body.append(self.starttag(node, "div", CLASS="citation", role="listitem"))


def add_assets(app: Sphinx, page: str, template: str, context: Any, doctree: Any) -> None:
    """Load the scripts and styles that a page names in its front matter under ``assets``.

    The book as one page loads those of all its pages.
    """
    metadata = app.env.metadata
    pages = sorted(metadata) if app.builder.name == "singlehtml" else [page]
    for name in dict.fromkeys(" ".join(metadata[p].get("assets", "") for p in pages).split()):
        if name.endswith(".js"):
            app.add_js_file(name, loading_method="defer")
        else:
            app.add_css_file(name)


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect to Sphinx."""
    visitors = visit_citation, HTMLTranslator.depart_citation
    app.add_node(nodes.citation, override=True, html=visitors)
    app.connect("doctree-resolved", set_numbers)
    app.connect("html-page-context", add_assets)
    return {"version": "1", "parallel_read_safe": True}
