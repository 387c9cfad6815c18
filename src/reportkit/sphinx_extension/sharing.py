"""Descriptions of pages for search engines and other sites."""

import textwrap
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.config import Config

from reportkit import text
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
    base = app.config.html_baseurl
    has_card = any(Path(app.confdir, one, CARD).is_file() for one in app.config.html_static_path)
    context["metatags"] += text.render(
        "sharing.html",
        description=textwrap.shorten(first.astext(), 200, placeholder=" …"),
        type="website" if page == app.config.root_doc else "article",
        site=app.config.html_title or app.config.project,
        title=app.env.titles[page].astext(),
        address=base and context["pageurl"],
        picture=has_card and (base or context["pathto"]("", 1)) + f"_static/{CARD}",
    )
