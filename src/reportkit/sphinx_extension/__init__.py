"""The Sphinx extension of a report, named in ``_config.yml`` under ``extra_extensions``."""

from typing import Any

from sphinx.application import Sphinx

#: Each has a subject of its own, and can be used without the others.
PARTS = ("chapters", "figures", "links", "looks", "search", "sharing")


def setup(app: Sphinx) -> dict[str, Any]:
    """Set up all parts."""
    for part in PARTS:
        app.setup_extension(f"{__name__}.{part}")
    return {"version": "1", "parallel_read_safe": True}
