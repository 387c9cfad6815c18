"""Minus signs and powers, references for screen readers, and scripts where they are needed."""

import re
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator as HTMLTranslator

from reportkit.text import powers


def set_numbers(app: Sphinx, doctree: nodes.document, page: str) -> None:
    """Give quoted numbers a minus sign instead of a hyphen, and powers for exponents."""
    for quoted in doctree.findall(nodes.inline):
        if "pasted-text" in quoted["classes"]:
            quoted.children = [nodes.Text(re.sub("^-", "−", powers(quoted.astext())))]


def visit_citation(self: HTMLTranslator, node: nodes.citation) -> None:
    """Begin a reference as a list item; the ARIA role that docutils gives it is deprecated."""
    if not isinstance(node.previous_sibling(), nodes.citation):
        self.body.append('<div role="list" class="citation-list">\n')
    self.body.append(self.starttag(node, "div", CLASS="citation", role="listitem"))


depart_citation = HTMLTranslator.depart_citation


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
