"""Markdown of a notebook as HTML for a page that needs no other file and no network."""

import re
from collections.abc import Mapping
from functools import cache
from typing import Any

from markdown_it import MarkdownIt
from markupsafe import Markup, escape
from mdit_py_plugins.amsmath import amsmath_plugin
from mdit_py_plugins.dollarmath import dollarmath_plugin

_ROLE = re.compile(r"\{[a-z:]+\}`(?:\.\./)?([^`<]*?)(?:\s*<[^`]*>)?`")


def html(source: str) -> Markup:
    """Return Markdown as HTML; a reference to another page becomes its text."""
    return Markup(_renderer().render(_ROLE.sub(r"*\1*", source)))


@cache
def _renderer() -> MarkdownIt:
    """Return a renderer that leaves formulas to MathJax and lets wide tables scroll."""

    def formula(text: str, options: Mapping[str, Any] | None = None) -> str:
        inline = options is not None and not options.get("display_mode")
        return escape(f"\\({text}\\)" if inline else f"\\[{text}\\]")

    markdown = MarkdownIt("commonmark", {"html": False}).enable("table")
    markdown.add_render_rule("table_open", lambda *_: '<div class="wide" tabindex="0"><table>\n')
    markdown.add_render_rule("table_close", lambda *_: "</table></div>\n")
    markdown.use(dollarmath_plugin, renderer=formula)
    return markdown.use(amsmath_plugin, renderer=formula)
