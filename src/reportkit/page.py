"""One HTML page of an executed notebook that needs no other file and no network."""

import base64
import re
from collections.abc import Mapping
from typing import Any

from markdown_it import MarkdownIt
from markupsafe import Markup, escape
from mdit_py_plugins.amsmath import amsmath_plugin
from mdit_py_plugins.dollarmath import dollarmath_plugin

from reportkit import text
from reportkit.figures import dark
from reportkit.project import Project

_ROLE = re.compile(r"\{[a-z:]+\}`(?:\.\./)?([^`<]*?)(?:\s*<[^`]*>)?`")


def render(project: Project, **values: Any) -> str:
    """Fill ``templates/rerun.html``, whose first lines list the values that it takes."""
    markdown = _markdown()
    mathjax = project.mathjax.read_text(encoding="utf-8") if project.mathjax.exists() else ""
    return text.render(
        "rerun.html",
        project=project,
        mathjax=Markup(mathjax.replace("</script", "<\\/script")),
        # a reference to another page becomes its text
        markdown=lambda source: Markup(markdown.render(_ROLE.sub(r"*\1*", source))),
        base64=lambda drawing: base64.b64encode(drawing.encode()).decode(),
        dark=dark,
        plain=text.plain,
        number=text.number,
        **values,
    )


def _markdown() -> MarkdownIt:
    """Return a Markdown renderer that leaves formulas to MathJax and lets wide tables scroll."""

    def formula(text: str, options: Mapping[str, Any] | None = None) -> str:
        inline = options is not None and not options.get("display_mode")
        return escape(f"\\({text}\\)" if inline else f"\\[{text}\\]")

    markdown = MarkdownIt("commonmark", {"html": False}).enable("table")
    markdown.add_render_rule("table_open", lambda *_: '<div class="wide" tabindex="0"><table>\n')
    markdown.add_render_rule("table_close", lambda *_: "</table></div>\n")
    markdown.use(dollarmath_plugin, renderer=formula)
    return markdown.use(amsmath_plugin, renderer=formula)
