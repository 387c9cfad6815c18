"""The built book in a browser, read from disk."""

import shutil

import pytest
from playwright.sync_api import sync_playwright

CHROMIUM = next(
    filter(None, map(shutil.which, ["chromium", "chromium-browser", "google-chrome"])), ""
)
FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
]
WIDTHS = {"laptop": 1280, "phone": 375}

pytestmark = pytest.mark.skipif(not CHROMIUM, reason="no Chromium here to read the book with")


@pytest.fixture(scope="module")
def browser():
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture
def visit(browser):
    """Open an address; complain of requests to elsewhere and of errors when the test ends."""
    complaints, contexts = [], []

    def request(request):
        if not request.url.startswith(("file:", "data:")):
            complaints.append(f"asks for {request.url}")

    def console(message):
        if message.type == "error":
            complaints.append(message.text)

    def visit(url, width=WIDTHS["laptop"], scheme="light"):
        context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
        contexts.append(context)
        page = context.new_page()
        page.on("request", request)
        page.on("requestfailed", lambda request: complaints.append(f"lacks {request.url}"))
        page.on("console", console)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.goto(url)
        page.evaluate("() => window.MathJax?.startup?.promise")
        return page

    yield visit
    for context in contexts:
        context.close()
    assert not complaints


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_page_reads_well(path, visit, scheme):
    page = visit(path.as_uri(), scheme=scheme)
    assert page.evaluate("document.documentElement.dataset.theme") == scheme
    has_math = page.locator(".bd-article .math").count() > 0
    assert (page.locator("mjx-container").count() > 0) == has_math
    assert page.locator("[data-mjx-error], [data-mml-node=merror]").count() == 0
    grounds = page.evaluate(
        "[...document.querySelectorAll('.bd-article img')]"
        ".map(image => getComputedStyle(image).backgroundColor)"
    )
    assert set(grounds) <= {"rgba(0, 0, 0, 0)"}  # no white card behind a figure in the dark
    for name, width in WIDTHS.items():
        page.set_viewport_size({"width": width, "height": 900})
        too_wide = page.evaluate("document.documentElement.scrollWidth - innerWidth")
        assert too_wide <= 0, name


def test_wide_formulas_and_tables_scroll_from_their_start(path, visit):
    page = visit(path.as_uri(), width=WIDTHS["phone"])
    cut_off = page.evaluate(
        "[...document.querySelectorAll('.bd-article :is(svg, table, img)')]"
        ".filter(e => e.getBoundingClientRect().left < 0).map(e => e.outerHTML.slice(0, 200))"
    )
    assert cut_off == []


def test_search_finds_a_word_from_disk(site, visit):
    page = visit(f"{(site / 'search.html').as_uri()}?q=motor")
    page.wait_for_selector("#search-results li a")
    page.locator("#search-results li a").first.click()
    assert "motor" in page.locator("article").inner_text().lower()
