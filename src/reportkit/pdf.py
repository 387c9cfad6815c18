"""The book as one PDF: its single HTML page, printed by the system's Chromium."""

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from playwright.sync_api import PdfMargins, sync_playwright
from pypdf import PdfWriter
from pypdf.generic import NameObject, TextStringObject

from reportkit.program import run

#: Where a browser may be; the last two are for macOS.
BROWSERS = "chromium chromium-browser google-chrome google-chrome-stable".split()
BROWSERS += [f"/Applications/{a}.app/Contents/MacOS/{a}" for a in ("Chromium", "Google Chrome")]
MARGIN = PdfMargins(top="17mm", bottom="17mm", left="18mm", right="18mm")
#: Script that lists the printed headings.
HEADINGS = Path(__file__).parent / "templates" / "headings.js"
#: Chromium prints this beneath each page.
FOOTER = '<div style="font: 8px sans-serif; margin: auto"><span class="pageNumber"></span></div>'


def browser() -> str:
    """Return the path of the browser: the system's, or else the one that Playwright installed.

    Raises
    ------
    FileNotFoundError
        If there is none.
    """
    for path in filter(None, map(shutil.which, BROWSERS)):
        return path
    with sync_playwright() as playwright:
        own = playwright.chromium.executable_path
    if Path(own).is_file():
        return own
    raise FileNotFoundError(
        f"no browser to print with: one of {', '.join(BROWSERS)} is needed, "
        "or python -m playwright install chromium"
    )


def main(page: Path, pdf: Path) -> None:
    """Run ``python -m reportkit.pdf PAGE PDF``: print an HTML file, its mathematics included.

    The PDF is tagged and has an outline.

    Raises
    ------
    FileNotFoundError
        If there is no page or no browser.
    """
    if not page.is_file():
        raise FileNotFoundError(f"{page}: there is no such page")
    path = browser()
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        tab = chromium.new_page(color_scheme="light")
        tab.emulate_media(media="print")
        tab.goto(page.resolve().as_uri())
        tab.evaluate("() => window.MathJax?.startup?.promise")
        headings = tab.evaluate(HEADINGS.read_text(encoding="utf-8"))
        part = pdf.with_suffix(".part")
        tab.pdf(
            path=part, format="A4", margin=MARGIN, scale=0.85, tagged=True, outline=True,
            print_background=True, display_header_footer=True, header_template="<span></span>",
            footer_template=FOOTER,
        )  # fmt: skip
        chromium.close()
    writer = PdfWriter(part, incremental=True)  # only what changes is written again
    entitle(writer, headings)
    writer.write(part)
    part.replace(pdf)


def entitle(writer: PdfWriter, headings: list[str]) -> None:
    """Name the entries of the outline by the headings.

    Chromium repeats a name where a page ends before the heading, and leaves formulas out.

    Raises
    ------
    ValueError
        If the numbers of headings and entries differ.
    """
    for entry, heading in zip(_entries(writer.outline), headings, strict=True):
        entry.node[NameObject("/Title")] = TextStringObject(heading)


def _entries(outline: list[Any]) -> Iterator[Any]:
    for entry in outline:
        yield from _entries(entry) if isinstance(entry, list) else [entry]


if __name__ == "__main__":
    sys.exit(run(main, sys.argv[1:]))
