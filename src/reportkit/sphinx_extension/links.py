"""Links from values, figures and tables to the cells that made them, and from notebooks back."""

import json
import re
from functools import lru_cache
from pathlib import Path
from typing import Any

from docutils import nodes
from myst_nb.ext.glue.utils import PendingGlueReference
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.transforms.post_transforms import SphinxPostTransform

from reportkit.project import Project

#: The notebook that made a file of results: ``30_topic`` of ``30_topic-key.svg``.
_MADE_BY = re.compile(r"(\d\d_\w+)-([\w-]+)\.(svg|md)")


@lru_cache(maxsize=64)
def read_anchors(notebook: Path) -> tuple[list[str], dict[str, str]]:
    """Return the anchors of the cells of a notebook, and of what each has recorded by its name."""
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    # with the stem, since all notebooks may be on one page; a letter first, as in a CSS selector
    anchors, makers = [f"in-{notebook.stem}-{cell['id']}" for cell in cells], {}
    for anchor, cell in zip(anchors, cells, strict=True):
        for output in cell.get("outputs", ()):
            told = output.get("metadata", {})
            if name := told.get("scrapbook", told).get("name"):
                makers[name] = anchor
    return anchors, makers


class LinkSources(SphinxPostTransform):
    """Link each quoted value, figure and table to the cell that made it, and notebooks back."""

    default_priority = 4  # MyST-NB puts the values in at 5

    def run(self, **_: Any) -> None:
        """Change the tree of a page."""
        for quoted in list(self.document.findall(PendingGlueReference)):
            if link := self._link(quoted.refdoc, quoted.key, quoted.key, "value"):
                quoted.replace_self(link)
                link += quoted
        for figure in self.document.findall(nodes.figure):
            if (image := figure.next_node(nodes.image)) and "uri" in image:
                self._extend(figure.next_node(nodes.caption), image["uri"])
        for table in self.document.findall(nodes.table):
            self._extend(table.next_node(nodes.title), table.source)  # the included file
        if _is_notebook(self.env, self.env.docname):
            self._lead_back()

    def _link(self, notebook: str, key: str, name: str, kind: str) -> nodes.reference | None:
        path = Path(self.env.doc2path(notebook))
        cell = read_anchors(path)[1].get(key) if path.suffix == ".ipynb" else None
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
        anchors, _ = read_anchors(Path(app.env.doc2path(app.env.docname)))
        for node in doctree.findall(nodes.container):
            if node.get("nb_element") == "cell_code":
                node["ids"].append(anchors[node["cell_index"]])
