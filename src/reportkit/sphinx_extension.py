"""What a report adds to Sphinx.

Links from figures to their data, minus signs, a list of references for screen readers, and what
search engines and other sites show of a page.
"""

import textwrap
from html import escape
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.config import Config
from sphinx.writers.html5 import HTML5Translator as HTMLTranslator

from reportkit.project import Project, read_toml

#: Picture in a static folder that other sites show beside a link to the book.
CARD = "card.png"


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


def find_address(app: Sphinx, config: Config) -> None:
    """Take the book's address from ``[project.urls]``, unless it is a placeholder."""
    settings = read_toml(Project.find(Path(app.srcdir)).root / "pyproject.toml")
    address = settings.get("project", {}).get("urls", {}).get("Homepage", "")
    if not config.html_baseurl and not address.startswith("https://example.org/"):
        config.html_baseurl = address and address.rstrip("/") + "/"


def describe(
    app: Sphinx, page: str, template: str, context: dict[str, Any], doctree: nodes.document | None
) -> None:
    """Give a page its description, the first paragraph, and a card for links to it (Open Graph)."""
    first = doctree.next_node(nodes.paragraph) if doctree else None
    if first is None:
        return
    text = textwrap.shorten(first.astext(), 200, placeholder=" …")
    tags = {
        "og:type": "website" if page == app.config.root_doc else "article",
        "og:site_name": app.config.html_title or app.config.project,
        "og:title": app.env.titles[page].astext(),
        "og:description": text,
    }
    if base := app.config.html_baseurl:
        tags["og:url"] = context["pageurl"]
    if any(Path(app.confdir, folder, CARD).is_file() for folder in app.config.html_static_path):
        tags["og:image"] = (base or context["pathto"]("", 1)) + f"_static/{CARD}"
    lines = [f'<meta name="description" content="{escape(text)}">']
    lines += [f'<meta property="{name}" content="{escape(value)}">' for name, value in tags.items()]
    context["metatags"] = "\n".join([context["metatags"], *lines, ""])


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect to Sphinx, before it collects the images and the files to download."""
    visitors = visit_citation, HTMLTranslator.depart_citation
    app.add_node(nodes.citation, override=True, html=visitors)
    app.connect("config-inited", find_address)
    app.connect("doctree-read", link_data, priority=100)
    app.connect("doctree-resolved", set_minus_signs)
    app.connect("html-page-context", describe)
    return {"version": "1", "parallel_read_safe": True}
