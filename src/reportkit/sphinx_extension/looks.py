"""Minus signs and powers, references for screen readers, and scripts where they are needed."""

import re
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator as HTMLTranslator

from reportkit.text import grouped, powers

_UNITS = "%|°|1?/s|[kmnµ]?[msVANWg]|k?Hz|dB|m?m/s|rad/s|k?N/m|N s/m|[VA]/V"
#: The space before a unit: of a number, and at the end of a heading, "error / mm".
_UNIT = re.compile(
    rf"(?<=[\d⁰¹²³⁴-⁹])\s(?=(?:{_UNITS})(?:[\s,.;:)²”]|$))"
    rf"|(?<=/) (?=\(?(?:{_UNITS})\)?$)|(?<=N) (?=s/m)"
)
_AS_IT_IS = (nodes.literal, nodes.literal_block, nodes.raw, nodes.math, nodes.math_block)


def set_numbers(app: Sphinx, doctree: nodes.document, page: str) -> None:
    """Set quoted numbers as a report writes them, and keep every number with its unit."""
    for quoted in doctree.findall(nodes.inline):
        if "pasted-text" in quoted["classes"]:
            quoted[:] = [nodes.Text(re.sub("^-", "−", grouped(powers(quoted.astext()))))]
    told = ""  # the text before, which may be a quoted number
    for text in list(doctree.findall(nodes.Text)):
        if not isinstance(text.parent, _AS_IT_IS):
            joined = _UNIT.sub("\u00a0", told[-1:] + text)[len(told[-1:]) :]
            if joined != text:
                text.parent.replace(text, nodes.Text(joined))
        told = text.astext()


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
