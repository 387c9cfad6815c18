"""The book as one PDF."""

import os
import re
import subprocess
import unicodedata
from pathlib import Path

import pytest
from pypdf import PdfReader

from reportkit import pdf

ROOT = Path(__file__).parents[2]


@pytest.fixture
def book(site, tmp_path):
    try:
        pdf.browser()
    except FileNotFoundError as error:
        pytest.skip(str(error))
    made = tmp_path / "book.pdf"
    subprocess.run(  # from the pages as they are
        ["make", "-o", "_build/.built", "pdf", f"PDF={made}"],
        cwd=ROOT, check=True, capture_output=True,
        env={name: os.environ[name] for name in os.environ if "MAKE" not in name},
    )  # fmt: skip
    return PdfReader(made)


def entries(outline):
    for entry in outline:
        yield from entries(entry) if isinstance(entry, list) else [entry]


def elements(node, kind):
    """Structure elements of a kind below a node of the tags."""
    found, todo = [], [node]
    while todo:
        node = todo.pop()
        node = node.get_object() if hasattr(node, "get_object") else node
        if isinstance(node, list):
            todo += node
        elif isinstance(node, dict):
            if node.get("/S") == kind:
                found.append(node)
            todo += [node["/K"]] if "/K" in node else []
    return found


def test_the_book_as_one_pdf(book, site):
    """In one test, so that no two workers make the PDF."""
    every_chapter_is_in_the_outline(book, site)
    it_is_tagged_and_says_what_it_is(book)
    formulas_are_drawn_and_numbers_are_there(book)


def every_chapter_is_in_the_outline(book, site):
    headings = re.findall(r"<h1>(.*?)<a", "".join(
        path.read_text(encoding="utf-8") for path in sorted(site.glob("book/*.html"))
    ))  # fmt: skip
    wanted = [" ".join(re.sub(r"<[^>]+>", "", text).split()) for text in headings]
    assert len(wanted) > 20
    titles = [entry.title for entry in entries(book.outline)]
    assert set(wanted) <= set(titles)
    assert "What “order p” demands" in titles  # a formula among the words


def it_is_tagged_and_says_what_it_is(book):
    root = book.trailer["/Root"]
    assert root["/MarkInfo"]["/Marked"]
    assert root["/Lang"].startswith("en")
    assert book.metadata.title == "A robot arm and a novel Dormand–Prince technique"
    told = [node.get("/Alt", "") for node in elements(root["/StructTreeRoot"], "/Figure")]
    figures = [alt for alt in told if len(alt) > 30]
    assert len(figures) >= len(list((ROOT / "book" / "results").glob("[0-9]*.svg")))


def formulas_are_drawn_and_numbers_are_there(book):
    """On one page of numbers, and on a few of formulas: MathJax draws all of a page or none.

    In the PDF the book is one page.
    """
    text = text_from(book, "Verdicts", 1)
    summary = (ROOT / "book" / "results" / "verdicts-summary.md").read_text(encoding="utf-8")
    assert summary.strip() in text
    text = text_from(book, "What “order p” demands", 4)
    assert "rooted trees" in text
    assert not re.search(r"\\(dot|frac|begin|tag)\b|\\\(", text)


def text_from(book, title, count):
    """Text of some pages from each heading with a title."""
    found = [entry for entry in entries(book.outline) if entry.title.endswith(title)]
    firsts = [book.get_destination_page_number(entry) for entry in found]
    assert firsts, title
    pages = [book.pages[first + n] for first in firsts for n in range(count)]
    text = "\n".join(page.extract_text() for page in pages)
    return " ".join(unicodedata.normalize("NFKC", text).split())  # no ligatures
