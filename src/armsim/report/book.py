"""What the book adds to Sphinx: below each figure of a notebook, a link to the data it shows."""

from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx


def link_data(app: Sphinx, doctree: nodes.document) -> None:
    """Append to the caption of ``NN_topic-key.svg`` a link to ``NN_topic-key.csv``, if that is."""
    page = Path(app.srcdir, app.env.docname)
    for figure in doctree.findall(nodes.figure):
        for image, caption in zip(
            figure.findall(nodes.image), figure.findall(nodes.caption), strict=False
        ):
            uri = image["uri"]
            data = Path(uri).with_suffix(".csv")
            # when the page is read, the paths are still relative to it
            if uri.endswith(".svg") and (page.parent / data).is_file():
                link = addnodes.download_reference(
                    "", "", nodes.Text("Data (CSV)"), reftarget=data.as_posix()
                )
                caption += [nodes.Text(" "), link]


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect to Sphinx, before it collects the images and the files to download."""
    app.connect("doctree-read", link_data, priority=100)
    return {"version": "1", "parallel_read_safe": True}
