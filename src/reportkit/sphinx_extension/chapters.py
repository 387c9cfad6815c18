"""The end of a chapter, and reading times.

The directive ``again`` ends a chapter with its verdicts and a box about its notebooks; the role
``minutes`` quotes the time that it takes to read some pages.
"""

import csv
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

from reportkit import claims
from reportkit.project import Project

#: Words of technical prose that are read in a minute.
WORDS_A_MINUTE = 230


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
            lines += ["````{admonition} Reproduce it", ":class: tip again"]
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
        heading = f"**Verdicts** on the paper's claims about this subject{all_of_them}:"
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


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect to Sphinx."""
    app.add_directive("again", Again)
    app.add_role("minutes", MinutesRole())
    app.add_post_transform(CountWords)
    return {"version": "1", "parallel_read_safe": True}
