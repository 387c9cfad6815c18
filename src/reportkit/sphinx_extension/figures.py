"""Figures: links to their data, and versions for dark pages."""

import os
from pathlib import Path

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

from reportkit.figures import dark


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


def add_dark_versions(app: Sphinx, doctree: nodes.document) -> None:
    """Put behind each drawing in the colours of the style one for a dark page.

    An image knows nothing of the page's switch between light and dark, so there are two of them,
    with the classes by which the theme shows one.
    """
    folder = Path(app.doctreedir).parent / "dark"
    folder.mkdir(parents=True, exist_ok=True)
    for image in list(doctree.findall(nodes.image)):
        path = Path(app.env.relfn2path(image["uri"])[1])
        if path.suffix == ".svg" and (drawing := path.read_text(encoding="utf-8")) != dark(drawing):
            other = folder / f"{path.stem}-dark.svg"
            other.write_text(dark(drawing), encoding="utf-8")
            copy = image.deepcopy()
            copy["uri"] = "/" + os.path.relpath(other, app.srcdir)
            copy["classes"].append("only-dark")
            both = nodes.inline()  # beside a hidden image the theme would hide the caption as well
            image.replace_self(both)
            image["classes"].append("only-light")
            both += [image, copy]
