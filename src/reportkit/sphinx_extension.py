"""Links from figures to their data, and a list of references for screen readers."""

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
        for image, caption in zip(
            figure.findall(nodes.image), figure.findall(nodes.caption), strict=False
        ):
            uri = image["uri"]
            data = Path(uri).with_suffix(".csv")
            # at this stage paths are still relative to the page
            if uri.endswith(".svg") and (page.parent / data).is_file():
                link = addnodes.download_reference(
                    "", "", nodes.Text("Data (CSV)"), reftarget=data.as_posix()
                )
                caption += [nodes.Text(" "), link]


def visit_citation(self: HTMLTranslator, node: nodes.citation) -> None:
    """Begin a reference as a list item; the ARIA role that docutils gives it is deprecated."""
    if not isinstance(node.previous_sibling(), nodes.citation):
        self.body.append('<div role="list" class="citation-list">\n')
    self.body.append(self.starttag(node, "div", CLASS="citation", role="listitem"))


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect to Sphinx, before it collects the images and the files to download."""
    app.add_node(
        nodes.citation, override=True, html=(visit_citation, HTMLTranslator.depart_citation)
    )
    app.connect("doctree-read", link_data, priority=100)
    return {"version": "1", "parallel_read_safe": True}
