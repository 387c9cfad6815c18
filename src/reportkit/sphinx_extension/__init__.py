"""The Sphinx extension of a report, named in ``_config.yml`` under ``extra_extensions``."""

from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

from reportkit.sphinx_extension import chapters, figures, links, looks, search, sharing


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect everything to Sphinx."""
    app.add_directive("again", chapters.Again)
    app.add_role("minutes", chapters.Minutes())
    app.add_post_transform(chapters.CountWords)
    app.add_post_transform(links.LinkSources)
    app.add_node(nodes.citation, override=True, html=(looks.visit_citation, looks.depart_citation))
    app.connect("config-inited", sharing.find_address)
    # before Sphinx collects the images and the files to download
    app.connect("doctree-read", figures.link_data, priority=100)
    app.connect("doctree-read", figures.add_dark_versions, priority=200)
    app.connect("doctree-read", links.name_cells)
    app.connect("doctree-resolved", looks.set_numbers)
    app.connect("doctree-resolved", search.collect_sections)
    app.connect("html-page-context", looks.add_assets)
    app.connect("html-page-context", search.load_sections)
    app.connect("html-page-context", sharing.describe)
    app.connect("build-finished", search.write_sections)
    return {"version": "1", "parallel_read_safe": True}
