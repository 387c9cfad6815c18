"""Links from values, figures and tables to their sources and back; the box that ends a chapter.

The directive ``again`` ends a chapter with its verdicts and a box about its notebooks; the role
``minutes`` quotes the time that it takes to read some pages.
"""

import csv
import json
import os
import re
from functools import lru_cache
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.parsers.rst import directives
from docutils.statemachine import StringList
from myst_nb.ext.glue.utils import PendingGlueReference
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.transforms.post_transforms import SphinxPostTransform
from sphinx.util.docutils import SphinxDirective, SphinxRole
from sphinx.writers.html5 import HTML5Translator as HTMLTranslator

from reportkit import claims
from reportkit.figures import dark
from reportkit.project import Project

#: Words of technical prose that are read in a minute.
WORDS_A_MINUTE = 230
#: The space before a unit.
_UNIT = re.compile(r"^\s(?=(?:%|°|/s|[kmnµ]?[msVANWg]|m/s|rad/s|N s/m|Hz|dB)(?:[\s,.;:)²]|$))")
#: The notebook that made a file of results: ``30_topic`` of ``30_topic-key.svg``.
_MADE_BY = re.compile(r"(\d\d_\w+)-([\w-]+)\.(svg|md)")


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


@lru_cache(maxsize=64)
def _cells(notebook: Path) -> list[dict[str, Any]]:
    return json.loads(notebook.read_text(encoding="utf-8"))["cells"]


def _anchor(notebook: Path, cell: dict[str, Any]) -> str:
    # with the name, since all notebooks may be on one page; a letter first, as in a CSS selector
    return f"in-{notebook.stem}-{cell['id']}"


@lru_cache(maxsize=64)
def recording_cells(notebook: Path) -> dict[str, str]:
    """Return for each value, figure and table of an executed notebook the anchor of its cell."""
    found = {}
    for cell in _cells(notebook):
        for output in cell.get("outputs", ()):
            told = output.get("metadata", {})
            if name := told.get("scrapbook", told).get("name"):
                found[name] = _anchor(notebook, cell)
    return found


class LinkSources(SphinxPostTransform):
    """Link each quoted value, figure and table to the cell that made it, and notebooks back."""

    default_priority = 4  # MyST-NB puts the values in at 5

    def run(self, **_: Any) -> None:
        """Change the tree of a page."""
        for quoted in list(self.document.findall(PendingGlueReference)):
            if link := self._link(quoted.refdoc, quoted.key, quoted.key, "value"):
                quoted.replace_self(link)
                link += quoted
                after = link.next_node(descend=False, siblings=True)
                if isinstance(after, nodes.Text):  # no line ends between a number and its unit
                    after.parent.replace(after, nodes.Text(_UNIT.sub("\u00a0", after)))
        for figure in self.document.findall(nodes.figure):
            if (image := figure.next_node(nodes.image)) and "uri" in image:
                self._extend(figure.next_node(nodes.caption), image["uri"])
        for table in self.document.findall(nodes.table):
            self._extend(table.next_node(nodes.title), table.source)  # the included file
        if _is_notebook(self.env, self.env.docname):
            self._lead_back()

    def _link(self, notebook: str, key: str, name: str, kind: str) -> nodes.reference | None:
        path = Path(self.env.doc2path(notebook))
        cell = recording_cells(path).get(key) if path.suffix == ".ipynb" else None
        if cell is None:
            return None
        address = f"{self.app.builder.get_relative_uri(self.env.docname, notebook)}#{cell}"
        told = f"{path.stem}::{name}"
        return nodes.reference("", "", internal=True, refuri=address, reftitle=told, classes=[kind])

    def _extend(self, caption: nodes.Element | None, made: str | None) -> None:
        """Append to a caption the link to the cell that made a file."""
        file = Path(made or "")
        if caption is not None and (found := _MADE_BY.fullmatch(file.name)):
            folder = Project.find(Path(self.app.srcdir)).results.relative_to(self.app.srcdir)
            notebook = (folder / found[1]).as_posix()
            known = notebook in self.env.found_docs
            if known and (link := self._link(notebook, file.name, found[2], "source")):
                link += nodes.Text("Notebook")
                caption += [nodes.Text(" · "), link]

    def _lead_back(self) -> None:
        """Put the pages that quote a notebook below its title."""
        name = Path(self.env.docname).name
        pages = [page for page in self.env.collect_relations() if name in _quoted(self.env, page)]
        title = self.document.next_node(nodes.title)
        if pages and title is not None:
            line = nodes.paragraph("", "Quoted in: ", classes=["quoted"])
            for page in pages:
                link = addnodes.pending_xref(
                    "", nodes.inline(), refdomain="std", reftype="doc", refdoc=self.env.docname,
                    reftarget=f"/{page}", refexplicit=False,
                )  # fmt: skip
                line += [nodes.Text(", " if page != pages[0] else ""), link]
            title.parent.insert(title.parent.index(title) + 1, line)


def _is_notebook(env: BuildEnvironment, page: str) -> bool:
    return Path(env.doc2path(page)).suffix == ".ipynb"


@lru_cache(maxsize=256)
def _quoted(env: BuildEnvironment, page: str) -> set[str]:
    """Return the names of the notebooks whose values, figures or tables a page shows."""
    if _is_notebook(env, page):
        return set()
    text = Path(env.doc2path(page)).read_text(encoding="utf-8")
    return set(re.findall(r"results/(\d\d_\w+)(?:\.ipynb|-)", text))


def name_cells(app: Sphinx, doctree: nodes.document) -> None:
    """Give the cells of a notebook their ids, to be linked to."""
    if _is_notebook(app.env, app.env.docname):
        notebook = Path(app.env.doc2path(app.env.docname))
        for node in doctree.findall(nodes.container):
            if node.get("nb_element") == "cell_code":
                node["ids"].append(_anchor(notebook, _cells(notebook)[node["cell_index"]]))


class Again(SphinxDirective):
    """End a chapter: its verdicts, and how to see, take and rerun its notebooks.

    The arguments are the notebooks. The option ``with`` gives parameters of the command, the
    content says in a sentence what else can be changed.
    """

    optional_arguments = 9
    has_content = True
    option_spec = {"with": directives.unchanged}  # noqa: RUF012

    def run(self) -> list[nodes.Node]:
        """Return the list of verdicts, if the page decides a claim, and the box."""
        project = Project.find(Path(self.env.app.srcdir))
        folder = "/" + project.results.relative_to(project.root).as_posix()
        given = f" {self.options['with']}" if "with" in self.options else ""
        lines = self._verdicts(project)
        if self.arguments:
            lines += ["````{admonition} Do it again", ":class: tip again"]
            for name in self.arguments:
                see = f"See {{doc}}`the notebook {name} <{folder}/{name}>`"
                take = f"{{download}}`download it <{folder}/{name}.ipynb>`"
                command = f".venv/bin/{project.name} rerun {name[3:]}{given}"
                lines += [f"{see} · {take} · rerun it:", "", "```sh", command, "```", ""]
            lines += [*self.content, "````"]
        parent = nodes.container()
        self.state.nested_parse(StringList(lines, source="again"), self.content_offset, parent)
        return parent.children

    def _verdicts(self, project: Project) -> list[str]:
        """List the claims that the page decides, in Markdown."""
        with (project.results / "verdicts.csv").open(encoding="utf-8") as file:
            verdict = {row["claim"]: row["verdict"] for row in csv.DictReader(file)}
        page = Path(self.env.docname).name
        found = [
            f"- **{claims.VERDICTS[verdict[claim.name]]} {verdict[claim.name]}**: {claim.text}"
            for claim in claims.load(project.claims)
            if claim.page == page
        ]
        verdicts = Path(self.env.docname).with_name("verdicts").as_posix()
        all_of_them = " ({doc}`verdicts`)" if verdicts in self.env.found_docs else ""
        heading = f"**Result.** What the paper says on the subject of this page{all_of_them}:"
        return [heading, "", *found, ""] if found else []


class _Minutes(nodes.Inline, nodes.TextElement):
    """Stands for a reading time until all pages are read."""


class MinutesRole(SphinxRole):
    """Quote the minutes that it takes to read pages of the same folder; ``*`` is the whole book."""

    def run(self) -> tuple[list[nodes.Node], list[nodes.system_message]]:
        """Return the placeholder."""
        page, names = Path(self.env.docname), self.text.split()
        pages = [page.with_name(name).as_posix() for name in names] if names != ["*"] else []
        return [_Minutes(pages=pages)], []


class CountWords(SphinxPostTransform):
    """Replace reading times by numbers."""

    default_priority = 4

    def run(self, **_: Any) -> None:
        """Change the tree of a page."""
        for time in list(self.document.findall(_Minutes)):
            whole = [page for page in self.env.collect_relations() if "results/" not in page]
            words = sum(_words(self.env, page) for page in time["pages"] or whole)
            time.replace_self(nodes.Text(f"{max(1, round(words / WORDS_A_MINUTE))}"))


@lru_cache(maxsize=256)
def _words(env: BuildEnvironment, page: str) -> int:
    """Count the words of a page's running text; a quoted value is one, a docstring none."""
    words = 0
    for paragraph in env.get_doctree(page).findall(nodes.paragraph):
        within: nodes.Node | None = paragraph
        while within is not None and not isinstance(within, nodes.table | addnodes.desc):
            within = within.parent
        if within is None:
            quoted = sum(1 for _ in paragraph.findall(PendingGlueReference))
            words += quoted + len(paragraph.astext().split())
    return words


#: Id, title and running text of each section of each page.
_SECTIONS: dict[str, list[tuple[str, str, str]]] = {}


def collect_sections(app: Sphinx, doctree: nodes.document, page: str) -> None:
    """Keep the text of the sections of a page, each without the sections inside it."""
    _SECTIONS[page] = []
    for section in doctree.findall(nodes.section):
        own = [part for part in section.children if not isinstance(part, nodes.section)]
        prose = " ".join(one.astext() for part in own for one in part.findall(nodes.paragraph))
        text = " ".join(re.sub(r"<br ?/?>", " ", prose).split())
        _SECTIONS[page].append((section["ids"][0], own[0].astext(), text))


def write_sections(app: Sphinx, error: Exception | None) -> None:
    """Write the text of all sections as a script for the page of the search."""
    if error is None and app.builder.name == "html":
        script = Path(__file__).parent / "templates" / "sections.js"
        told = f"const SECTIONS = {json.dumps(_SECTIONS, ensure_ascii=False)};\n"
        told += script.read_text(encoding="utf-8")
        Path(app.outdir, "_static", "sections.js").write_text(told, encoding="utf-8")


def load_sections(app: Sphinx, page: str, *_: Any) -> None:
    """Load the script that names the sections of search results, on the page of the search."""
    if page == "search":
        app.add_js_file("sections.js")


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


def add_assets(app: Sphinx, page: str, template: str, context: Any, doctree: Any) -> None:
    """Load the scripts and styles that a page names in its front matter under ``assets``.

    The book as one page loads those of all its pages.
    """
    metadata = app.env.metadata
    pages = sorted(metadata) if app.builder.name == "singlehtml" else [page]
    for name in dict.fromkeys(" ".join(metadata[p].get("assets", "") for p in pages).split()):
        if name.endswith(".js"):
            app.add_js_file(name, loading_method="defer")
        else:
            app.add_css_file(name)


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect to Sphinx, before it collects the images and the files to download."""
    app.setup_extension("reportkit.sharing")
    visitors = visit_citation, HTMLTranslator.depart_citation
    app.add_node(nodes.citation, override=True, html=visitors)
    app.add_directive("again", Again)
    app.add_role("minutes", MinutesRole())
    app.add_post_transform(LinkSources)
    app.add_post_transform(CountWords)
    app.connect("doctree-read", link_data, priority=100)
    app.connect("doctree-read", add_dark_versions, priority=200)
    app.connect("doctree-read", name_cells)
    app.connect("doctree-resolved", set_minus_signs)
    app.connect("doctree-resolved", collect_sections)
    app.connect("html-page-context", load_sections)
    app.connect("build-finished", write_sections)
    app.connect("html-page-context", add_assets)
    return {"version": "1", "parallel_read_safe": True}
