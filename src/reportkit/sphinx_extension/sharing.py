"""Descriptions of pages for search engines and other sites."""

import textwrap
from html import escape
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.config import Config

from reportkit.project import Project, read_toml

#: Picture in a static folder that other sites show beside a link to the book.
CARD = "card.png"


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
    paragraphs = doctree.findall(nodes.paragraph) if doctree else ()
    # not the line of a notebook that names the pages that quote it
    first = next((one for one in paragraphs if "quoted" not in one["classes"]), None)
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
    """Connect to Sphinx."""
    app.connect("config-inited", find_address)
    app.connect("html-page-context", describe)
    return {"version": "1", "parallel_read_safe": True}
