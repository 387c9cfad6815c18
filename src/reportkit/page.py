"""One HTML page of an executed notebook that needs no other file and no network."""

import base64
import html
import platform
import re
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from importlib.metadata import version
from typing import Any

from markdown_it import MarkdownIt
from mdit_py_plugins.amsmath import amsmath_plugin
from mdit_py_plugins.dollarmath import dollarmath_plugin
from nbformat import NotebookNode

from reportkit.check import Comparison, compared, number
from reportkit.parameters import Notebook
from reportkit.project import Project

_ROLE = re.compile(r"\{[a-z:]+\}`(?:\.\./)?([^`<]*?)(?:\s*<[^`]*>)?`")
_ANSI = re.compile(r"\x1b\[[0-9;]*m")
_MATH = re.compile(r'class="math|\\\(|\\\[')

_STYLE = """
:root { color-scheme: light dark; --ink: #222; --faint: #666; --line: #ddd; --ground: #fff;
  --code: #f5f5f2; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #ddd; --faint: #999; --line: #444; --ground: #161618; --code: #222225; }
  img { filter: invert(1) hue-rotate(180deg); }  /* drawn in dark ink on nothing */
}
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 48rem; padding: 1rem; background: var(--ground);
  color: var(--ink); font: 1rem/1.55 system-ui, sans-serif; overflow-wrap: break-word; }
h1, h2, h3 { line-height: 1.25; margin: 2em 0 .6em; }
h1 { margin-top: .5em; }
img { display: block; max-width: 100%; height: auto; margin: 1.5rem auto; }
.wide, pre { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; font-size: .9em; font-variant-numeric: tabular-nums; }
th, td { border-bottom: 1px solid var(--line); padding: .3em .8em .3em 0; text-align: left;
  overflow-wrap: normal; }
pre { background: var(--code); padding: .7rem; font: .8rem/1.45 ui-monospace, monospace; }
code { font-size: .9em; }
summary { color: var(--faint); font-size: .9em; cursor: pointer; padding: .4em 0; }
header { border-bottom: 1px solid var(--line); padding-bottom: 1rem; margin-bottom: 2rem; }
header p.faint { color: var(--faint); font-size: .9em; }
mjx-container { max-width: 100%; overflow: auto hidden; }
"""
_MATHJAX = (
    "window.MathJax = {options: {enableMenu: false}, svg: {fontCache: 'local'}, "
    r"tex: {inlineMath: [['\\(', '\\)']], displayMath: [['\\[', '\\]']]}};"
)


def render(
    notebook: Notebook,
    executed: NotebookNode,
    parameters: Mapping[str, Any],
    comparisons: Sequence[Comparison],
    started: datetime,
    project: Project,
) -> str:
    """Make the page: what was run and how it compares with the published, then the notebook.

    Parameters
    ----------
    notebook, executed
        What the source says of itself, and the notebook with its outputs.
    parameters
        The values that were given.
    comparisons
        The recorded values beside the published ones; may be empty.
    started
        When the run began.
    project
        The report that the notebook belongs to.
    """
    markdown = _markdown()
    body = "".join(_cell(cell, markdown) for cell in executed.cells)
    head = _head(notebook, parameters, comparisons, started, project.versions)
    scripts = ""
    if _MATH.search(body) and project.mathjax.exists():
        source = project.mathjax.read_text(encoding="utf-8").replace("</script", "<\\/script")
        scripts = f"<script>{_MATHJAX}</script>\n<script>{source}</script>\n"
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{_text(notebook.title)}</title>\n<style>{_STYLE}</style>\n{scripts}</head>\n"
        f"<body>\n{head}<main>\n{body}</main>\n</body>\n</html>\n"
    )


def _head(
    notebook: Notebook,
    parameters: Mapping[str, Any],
    comparisons: Sequence[Comparison],
    started: datetime,
    versions: Sequence[str],
) -> str:
    packages = " ".join(f"{name} {version(name)}," for name in versions)
    parts = [
        f'<header>\n<p class="faint">A rerun of the notebook {_text(notebook.name)}, '
        f"{started:%Y-%m-%d %H:%M:%S}. {packages} Python {platform.python_version()}.</p>\n"
    ]
    known = notebook.parameters
    settings = [
        [name, number(known[name].default), number(value), known[name].unit or "", known[name].help]
        for name, value in parameters.items()
        if value != known[name].default
    ]
    if settings:
        parts.append(_table(["parameter", "published", "here", "unit", ""], settings))
    else:
        parts.append("<p>All parameters are the published ones.</p>\n")
    heading = ["recorded value", "published", "here", "difference", "", "unit"]
    moved = [compared(pair) for pair in comparisons if pair.moved]
    same = [compared(pair) for pair in comparisons if not pair.moved]
    if not comparisons:
        parts.append("<p>There are no published values to compare with.</p>\n")
    else:
        parts.append(f"<p>Of {len(comparisons)} recorded values {len(moved)} changed.</p>\n")
    if moved:
        parts.append(_table(heading, moved))
    if same:
        parts.append(f"<details><summary>The {len(same)} that did not</summary>\n"
                     f"{_table(heading, same)}</details>\n")  # fmt: skip
    return "".join(parts) + "</header>\n"


def _table(heading: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    head = "".join(f"<th>{_text(cell)}</th>" for cell in heading)
    lines = ("".join(f"<td>{_text(cell)}</td>" for cell in row) for row in rows)
    body = "".join(f"<tr>{line}</tr>\n" for line in lines)
    return f'<div class="wide"><table><tr>{head}</tr>\n{body}</table></div>\n'


def _cell(cell: NotebookNode, markdown: MarkdownIt) -> str:
    if cell.cell_type == "markdown":
        return _markdown_html(cell.source, markdown)
    if cell.cell_type != "code":
        return ""
    code = f"<details><summary>Code</summary><pre>{_text(cell.source)}</pre></details>\n"
    return code + "".join(_output(output, markdown) for output in cell.outputs)


def _output(output: NotebookNode, markdown: MarkdownIt) -> str:
    if output.output_type == "stream":
        return f"<pre>{_text(_ANSI.sub('', output.text))}</pre>\n"
    data, metadata = output.get("data", {}), output.get("metadata", {})
    for kind in ("image/svg+xml", "image/png"):
        if kind in data:
            # inside an img no name of one drawing can meet that of another
            code = data[kind] if kind == "image/png" else _base64(data[kind])
            alt = _text(metadata.get(kind, {}).get("alt", ""))
            return f'<img alt="{alt}" src="data:{kind};base64,{"".join(code.split())}">\n'
    if "text/html" in data:
        return f'<div class="wide">{data["text/html"]}</div>\n'
    if "text/markdown" in data:
        return _markdown_html(data["text/markdown"], markdown)
    # glued values have a kind of their own
    return f"<pre>{_text(data['text/plain'])}</pre>\n" if "text/plain" in data else ""


def _markdown() -> MarkdownIt:
    markdown = MarkdownIt("commonmark", {"html": False}).enable("table")
    markdown.use(dollarmath_plugin, renderer=_mathematics)
    return markdown.use(amsmath_plugin, renderer=lambda text: _text(f"\\[{text}\\]"))


def _markdown_html(source: str, markdown: MarkdownIt) -> str:
    text = markdown.render(_ROLE.sub(r"*\1*", source))
    text = text.replace("<table>", '<div class="wide"><table>')
    return text.replace("</table>", "</table></div>")


def _mathematics(text: str, options: Mapping[str, Any]) -> str:
    return _text(f"\\[{text}\\]" if options.get("display_mode") else f"\\({text}\\)")


def _base64(text: str) -> str:
    return base64.b64encode(text.encode()).decode()


def _text(text: str) -> str:
    return html.escape(str(text))
