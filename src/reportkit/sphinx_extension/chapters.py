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
from myst_nb.ext.glue.utils import PendingGlueReference
from sphinx import addnodes
from sphinx.environment import BuildEnvironment
from sphinx.transforms.post_transforms import SphinxPostTransform
from sphinx.util.docutils import SphinxDirective, SphinxRole

from reportkit import claims, text
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
        project, here = Project.find(Path(self.env.app.srcdir)), Path(self.env.docname)
        with (project.results / "verdicts.csv").open(encoding="utf-8") as file:
            verdicts = {row["claim"]: row["verdict"] for row in csv.DictReader(file)}
        told = text.render(
            "again.md",
            project=project,
            claims=[claim for claim in claims.load(project.claims) if claim.page == here.name],
            verdicts=verdicts,
            symbols=claims.VERDICTS,
            listed=here.with_name("verdicts").as_posix() in self.env.found_docs,
            names=self.arguments,
            folder="/" + project.results.relative_to(project.root).as_posix(),
            given=self.options.get("with"),
            content="\n".join(self.content),
        )
        return self.parse_text_to_nodes(told)


class _Minutes(nodes.Inline, nodes.TextElement):
    """Stands for a reading time until all pages are read."""


class Minutes(SphinxRole):
    """Quote the minutes that it takes to read pages of the same folder; ``*`` is the whole book."""

    def run(self) -> tuple[list[nodes.Node], list[nodes.system_message]]:
        """Return the placeholder."""
        page, names = Path(self.env.docname), self.text.split()
        pages = [page.with_name(name).as_posix() for name in names if name != "*"]
        return [_Minutes(pages=pages)], []


class CountWords(SphinxPostTransform):
    """Replace reading times by numbers."""

    default_priority = 4

    def run(self, **_: Any) -> None:
        """Change the tree of a page."""
        whole = [page for page in self.env.collect_relations() if "results/" not in page]
        for time in list(self.document.findall(_Minutes)):
            words = sum(_words(self.env, page) for page in time["pages"] or whole)
            time.replace_self(nodes.Text(f"{max(1, round(words / WORDS_A_MINUTE))}"))


@lru_cache(maxsize=256)
def _words(env: BuildEnvironment, page: str) -> int:
    """Count the words of a page's running text; a quoted value is one."""
    tree = env.get_doctree(page)  # a copy
    for part in [*tree.findall(nodes.table), *tree.findall(addnodes.desc)]:
        part.clear()
    paragraphs = [*tree.findall(nodes.paragraph)]
    quoted = (len([*one.findall(PendingGlueReference)]) for one in paragraphs)
    return sum(quoted) + sum(len(one.astext().split()) for one in paragraphs)
