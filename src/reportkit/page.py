"""A self-contained HTML page of an executed notebook."""

import base64
import re
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any

from jinja2 import Environment, PackageLoader
from markdown_it import MarkdownIt
from markupsafe import Markup, escape
from mdit_py_plugins.amsmath import amsmath_plugin
from mdit_py_plugins.dollarmath import dollarmath_plugin
from nbformat import NotebookNode

from reportkit.check import Comparison
from reportkit.figures import dark
from reportkit.parameters import Notebook
from reportkit.project import Project
from reportkit.text import number

_ROLE = re.compile(r"\{[a-z:]+\}`(?:\.\./)?([^`<]*?)(?:\s*<[^`]*>)?`")
_ANSI = re.compile(r"\x1b\[[0-9;]*m")


def render(
    notebook: Notebook,
    executed: NotebookNode,
    parameters: Mapping[str, Any],
    comparisons: Sequence[Comparison],
    started: datetime,
    project: Project,
    made: Mapping[str, Any],
) -> str:
    """Fill ``templates/rerun.html``: settings, comparison with the published values, notebook.

    Parameters
    ----------
    notebook, executed
        The description read from the source, and the notebook with its outputs.
    parameters
        The values given by the user.
    comparisons
        The recorded values beside the published ones; may be empty.
    started
        When the run began.
    project
        The report that the notebook belongs to.
    made
        What `reportkit.provenance.keep` wrote.
    """
    files = PackageLoader("reportkit")
    pages = Environment(loader=files, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    markdown = _markdown()
    pages.filters |= {
        # a reference to another page becomes its text
        "markdown": lambda text: Markup(markdown.render(_ROLE.sub(r"*\1*", text))),
        "dark": dark,
        "base64": lambda text: base64.b64encode(text.encode()).decode(),
        "plain": lambda text: _ANSI.sub("", text),
    }
    mathjax = project.mathjax.read_text(encoding="utf-8") if project.mathjax.exists() else ""
    items = ((notebook.parameters[name], value) for name, value in parameters.items())
    return pages.get_template("rerun.html").render(
        notebook=notebook,
        cells=executed.cells,
        settings=[
            [item.name, number(item.default), number(value), item.unit or "", item.help]
            for item, value in items
            if value != item.default
        ],
        comparisons=comparisons,
        started=started,
        versions=[f"{name} {made['versions'][name]}" for name in (*project.versions, "Python")],
        made=made,
        mathjax=Markup(mathjax.replace("</script", "<\\/script")),
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
