"""Links to data, minus signs, references for screen readers, and scripts where they are needed."""

from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator as HTMLTranslator


def link_data(app: Sphinx, doctree: nodes.document) -> None:
    """Append to the caption of ``NN_topic-key.svg`` a link to ``NN_topic-key.csv``, if any."""
    page = Path(app.srcdir, app.env.docname)
    for figure in doctree.findall(nodes.figure):
        image, caption = figure.next_node(nodes.image), figure.next_node(nodes.caption)
        if image and caption:
            drawing = Path(image["uri"])  # at this stage still relative to the page
            data = drawing.with_suffix(".csv")
            if drawing.suffix == ".svg" and (page.parent / data).is_file():
                text = nodes.Text("Data (CSV)")
                link = addnodes.download_reference("", "", text, reftarget=data.as_posix())
                caption += [nodes.Text(" "), link]


def set_minus_signs(app: Sphinx, doctree: nodes.document, page: str) -> None:
    """Begin quoted negative numbers with a minus sign instead of a hyphen."""
    for quoted in doctree.findall(nodes.inline):
        if "pasted-text" in quoted["classes"] and quoted.astext().startswith("-"):
            quoted.children = [nodes.Text("−" + quoted.astext()[1:])]


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
    """Connect to Sphinx, before it collects the images and the files to download."""
    visitors = visit_citation, HTMLTranslator.depart_citation
    app.add_node(nodes.citation, override=True, html=visitors)
    app.connect("doctree-read", link_data, priority=100)
    app.connect("doctree-resolved", set_minus_signs)
    app.connect("html-page-context", add_assets)
    return {"version": "1", "parallel_read_safe": True}
