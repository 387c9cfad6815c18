"""The built book in a browser, read from disk."""

import re
from pathlib import Path
from urllib.parse import urlsplit

import axe_playwright_python
import numpy as np
import pytest
from playwright.sync_api import sync_playwright

from armbook import explorer
from armsim.arm import AxisParameters, simulate
from reportkit import pdf

try:
    CHROMIUM = pdf.browser()
except FileNotFoundError:
    CHROMIUM = ""
FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
]
AXE = Path(axe_playwright_python.__file__).with_name("axe.min.js").read_text(encoding="utf-8")
WIDTHS = {"laptop": 1280, "phone": 360}
#: Entries of the API that follow one of their kind, and have neither an example nor a heading in
#: them: nine in ten, with more than half of the elements of the page.
LIKE_OTHERS = [
    [f"dl.{kind} ~ dl.{kind}:not(:has(.doctest, .rubric))"]
    for kind in ("attribute", "class", "function", "method", "property")
]

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

    def visit(url, stopped=False, **options):
        context = browser.new_context(
            viewport={"width": WIDTHS["laptop"], "height": 900}, **options
        )
        context.set_default_timeout(300_000)  # ms; for a page that will never come, not a slow one
        contexts.append(context)
        page = context.new_page()
        page.on("request", request)
        page.on("requestfailed", lambda request: complaints.append(f"lacks {request.url}"))
        page.on("console", console)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        if stopped:  # time passes for the page only when the test says so
            page.clock.install(time=0)
        page.goto(url)
        if stopped:
            page.clock.pause_at(10_000)
        page.evaluate("() => window.MathJax?.startup?.promise")
        return page

    yield visit
    for context in contexts:
        context.close()
    assert not complaints


def violations(page, context, rules=None):
    """What axe-core finds against a page: rule, element, and what is wrong with it."""
    options = {"preload": False, "resultTypes": ["violations"]}
    options |= {"runOnly": rules} if rules else {}
    result = page.evaluate("([context, options]) => axe.run(context, options)", [context, options])
    return [
        (rule["id"], node["html"][:200], node["failureSummary"])
        for rule in result["violations"]
        for node in rule["nodes"]
        # a heading that is a formula is read out from MathML, where axe-core does not look
        if not (rule["id"] == "empty-table-header" and page.locator(node["target"][0])
                .locator("mjx-assistive-mml").count())
    ]  # fmt: skip


def test_page_reads_well(path, visit):
    """In light, in dark, on a laptop and on a phone; one visit, since each takes a second."""
    page = visit(path.as_uri())
    formulas_are_drawn(page)
    page.evaluate(AXE)
    alone = path.name == "404.html"  # without a sidebar, and it follows the system's colours
    # highlighted code has thousands of elements, and the same colours on all pages
    context = {"exclude": [[".highlight"]] if path.parent.name == "results" else LIKE_OTHERS}
    assert alone or page.evaluate("document.documentElement.dataset.theme") == "light"
    assert violations(page, context) == []
    be_dark(page, themed=not alone)
    assert violations(page, context, ["color-contrast"]) == []
    no_white_card_is_behind_a_figure(page)
    if not alone:
        logo_and_search_stay_in_sight(page)
    for width in WIDTHS.values():
        page.set_viewport_size({"width": width, "height": 900})
        assert page.evaluate("document.documentElement.scrollWidth") <= width
    nothing_is_cut_off_on_a_phone(page)
    headings_of_tables_are_not_squeezed(page)
    page.wait_for_function(  # what scrolls can be reached by the keyboard, after a moment
        "[...document.querySelectorAll('pre, .pst-scrollable-table-container, .plan, .sig')]"
        ".every(e => e.scrollWidth <= e.clientWidth || e.tabIndex == 0)"
    )
    assert violations(page, context, ["scrollable-region-focusable"]) == []
    text_in_figures_is_legible_on_a_phone(page, path)


def formulas_are_drawn(page):
    has_math = page.locator(".bd-article .math").count() > 0
    assert (page.locator("mjx-container").count() > 0) == has_math
    assert page.locator("[data-mjx-error], [data-mml-node=merror]").count() == 0
    scrolls = page.evaluate(  # a browser would draw a scroll bar below it
        "[...document.querySelectorAll('.bd-article mjx-container:not([display])')]"
        ".filter(e => e.scrollWidth > e.clientWidth && e.clientWidth).map(e => e.textContent)"
    )
    assert scrolls == []


def be_dark(page, themed):
    # no colour half-way from light to dark
    page.add_style_tag(content="*, ::before, ::after { transition: none !important; }")
    page.emulate_media(color_scheme="dark")
    if themed:
        page.wait_for_function("document.documentElement.dataset.theme == 'dark'")


def no_white_card_is_behind_a_figure(page):
    grounds = page.evaluate(
        "[...document.querySelectorAll('.bd-article img')]"
        ".map(image => getComputedStyle(image).backgroundColor)"
    )
    assert set(grounds) <= {"rgba(0, 0, 0, 0)"}


def nothing_is_cut_off_on_a_phone(page):
    cut_off = page.evaluate(  # a command wraps
        "[...document.querySelectorAll('.bd-article .highlight-sh pre')]"
        ".filter(e => e.scrollWidth > e.clientWidth).map(e => e.textContent)"
    )
    assert cut_off == []
    cut_off = page.evaluate(  # wide formulas and tables scroll from their start
        "[...document.querySelectorAll('.bd-article :is(svg, table, img)')]"
        ".filter(e => e.getBoundingClientRect().left < 0).map(e => e.outerHTML.slice(0, 200))"
    )
    assert cut_off == []


def headings_of_tables_are_not_squeezed(page):
    squeezed = page.evaluate(
        "[...document.querySelectorAll('.bd-article th p')]"  # those of the verdicts are hidden
        ".filter(e => !e.closest('.claim'))"
        ".filter(e => e.clientHeight > 3.5 * parseFloat(getComputedStyle(e).lineHeight))"
        ".map(e => e.textContent)"
    )
    assert squeezed == []


def logo_and_search_stay_in_sight(page):
    page.set_viewport_size({"width": 1400, "height": 900})
    for scrolled in ("", "document.querySelector('.bd-sidebar-primary').scrollTo(0, 10000)"):
        page.evaluate(scrolled)
        for part in (".bd-sidebar-primary .logo", ".bd-sidebar-primary .search-button-field"):
            seen = page.locator(part).evaluate(
                """e => {
                    const {left, top, right, bottom} = e.getBoundingClientRect();
                    const over = document.elementFromPoint((left + right) / 2, (top + bottom) / 2);
                    return left >= 0 && top >= 0 && right <= innerWidth && bottom <= innerHeight
                        && e.contains(over);
                }"""
            )
            assert seen, part


def text_in_figures_is_legible_on_a_phone(page, path):
    """At least 10 px, exponents too; a plan is as wide as that needs, and scrolls."""
    shown = page.evaluate(
        "[...document.querySelectorAll('.bd-article img')].filter(e => e.offsetWidth)"
        ".map(e => [e.getAttribute('src'), e.offsetWidth])"
    )
    small = {}
    for source, width in shown:
        drawing = (path.parent / source).read_text(encoding="utf-8")
        assert "<text" not in drawing  # outlines only
        box = re.search(r'viewBox="\S+ \S+ (\S+) \S+"', drawing)
        least, index = sizes_of_text(drawing)
        least *= width / float(box[1])
        if least < 10 or index < 1:
            small[Path(source).name] = round(least, 1), index
    assert small == {}


def sizes_of_text(drawing: str) -> tuple[float, float]:
    """Least size of a text of a drawing, in its own units, and least share of an index in it."""
    outlines = re.findall(r"translate\([^)]*\)[^\"]*? scale\(([\d.]+) -[\d.]+\)", drawing)
    indices = re.findall(r"<use [^>]*scale\(([\d.]+)\)", drawing)
    sizes = [100 * float(one) for one in outlines]
    return min(sizes, default=100), min(map(float, indices), default=1)


@pytest.fixture
def served(site, browser):
    """A tab of a browser for which GitHub Pages has the book, in a folder of its site."""

    def serve(route):
        path = site / urlsplit(route.request.url).path.removeprefix("/armsim/")
        if path.is_file():
            route.fulfill(path=path)
        else:
            route.fulfill(path=site / "404.html", status=404)

    page = browser.new_page()
    page.route("**/*", serve)
    yield page
    page.close()


@pytest.mark.parametrize("missing", ["old.html", "book/very/old.html"])
def test_missing_page_leads_to_the_front_page_of_a_book_below_the_root(served, missing):
    served.goto(f"https://book.example/armsim/{missing}")
    served.wait_for_function("document.links[0].href.endsWith('/armsim/index.html')")
    served.click("text=front page")
    assert served.url == "https://book.example/armsim/index.html"
    assert served.title()


def test_page_that_has_moved_is_shown_at_its_new_address(served):
    served.goto("https://book.example/armsim/book/parameter_study.html")
    served.wait_for_url("**/armsim/book/nonlinear_step_response.html#map-of-two-parameters")
    assert served.locator("#map-of-two-parameters").count() == 1


def test_search_finds_a_word_from_disk(site, visit):
    page = visit(f"{(site / 'search.html').as_uri()}?q=motor")
    page.wait_for_selector("#search-results li a")
    section = page.locator("#search-results li", has_text=" › ").first
    assert section.locator("a").nth(1).get_attribute("href").split("#")[1]
    assert "motor" in section.locator(".context").inner_text().lower()
    page.locator("#search-results li a").first.click()
    page.wait_for_url(lambda url: "search.html" not in url)
    assert "motor" in page.locator("article").inner_text().lower()


class TestExplorer:
    """Its numbers and curves are those of new runs; it works without a mouse."""

    @pytest.fixture
    def explorer(self, site, visit):
        return visit((site / "book" / "explorer.html").as_uri())

    def numbers(self, page, column="chosen-number"):
        cells = page.locator(f".explorer .{column}").all()
        rows = page.locator(".explorer tbody tr").all()
        return {
            row.get_attribute("data-number"): cell.inner_text()
            for row, cell in zip(rows, cells, strict=True)
        }

    def expected(self, T_p, K_2, volts):
        p = AxisParameters.paper_x_axis(T_p=T_p, K_2=K_2)
        run, t = simulate(p, volts, 4.0), np.linspace(0, 4.0, 200_001)
        return explorer.quality(run, t, explorer.sampled(run, t), volts / 10)

    def assert_shows(self, page, *case):
        shown, expected = self.numbers(page), self.expected(*case)
        assert {name: float(text) for name, text in shown.items()} == pytest.approx(
            expected, rel=0.01
        )

    def test_begins_with_the_published_case(self, explorer):
        assert self.numbers(explorer) == self.numbers(explorer, "published-number")
        self.assert_shows(explorer, 0.04, 870.0, 10.0)

    def test_arrow_keys_move_a_slider_and_all_that_follows(self, explorer):
        before = explorer.locator("[data-curve=velocity]").get_attribute("d")
        slider = explorer.get_by_label("time constant")
        slider.focus()
        for _ in range(3):
            explorer.keyboard.press("ArrowRight")
        assert slider.get_attribute("aria-valuetext") == "0.1 s"
        self.assert_shows(explorer, 0.1, 870.0, 10.0)
        assert explorer.locator("[data-curve=velocity]").get_attribute("d") != before
        assert explorer.url.endswith("#T_p=0.1&K_2=870&set_velocity=10")

    @pytest.mark.parametrize("case", [(0.021, 700.0, 10.0), (0.25, 400.0, 3.0)])
    def test_case_of_the_address_is_shown(self, site, visit, case):
        address = "#T_p={:g}&K_2={:g}&set_velocity={:g}".format(*case)
        page = visit((site / "book" / "explorer.html").as_uri() + address)
        self.assert_shows(page, *case)
        page.get_by_role("button", name="Published case").click()
        assert self.numbers(page) == self.numbers(page, "published-number")

    def test_curves_are_those_of_a_run(self, site, visit):
        """Its points, from the screen back to seconds and metres per second."""
        page = visit((site / "book" / "explorer.html").as_uri() + "#T_p=0.1&K_2=550&set_velocity=6")
        d = page.locator("[data-curve=velocity]").get_attribute("d")
        x, y = np.array([point.split(",") for point in d[1:].split("L")], dtype=float).T
        svg = page.locator(".explorer svg").first
        lines = svg.locator("line").evaluate_all(
            "all => all.map(e => Number(e.getAttribute('y1')))"
        )
        texts = svg.locator("text[text-anchor=end]").all_text_contents()
        labels = [float(text) for text in texts]
        scale = np.polyfit(lines, labels, 1)
        t = 4.0 * (x - x[0]) / (x[-1] - x[0])
        run = simulate(AxisParameters.paper_x_axis(T_p=0.1, K_2=550.0), 6.0, 4.0)
        exact = run(np.clip(t, 0, 4.0))[1]
        assert np.polyval(scale, y) == pytest.approx(exact, abs=0.01 * np.ptp(exact))

    def test_table_is_small(self, site):
        size = (site / "book" / "explorer.html").stat().st_size
        size += sum((site / "_static" / f"motion.{end}").stat().st_size for end in ("js", "css"))
        size += sum((site / "_static" / f"explorer.{end}").stat().st_size for end in ("js", "css"))
        assert size <= 3_000_000

    def test_plots_fit_between_their_sliders_and_the_numbers(self, explorer):
        explorer.set_viewport_size({"width": 1400, "height": 900})
        sliders, plots, numbers = (
            explorer.locator(f".explorer .{name}").bounding_box()
            for name in ("sliders", "plots", "numbers")
        )
        assert sliders["x"] + sliders["width"] <= plots["x"]
        assert plots["x"] + plots["width"] <= numbers["x"]
        assert numbers["x"] + numbers["width"] <= 1400
        assert plots["y"] + plots["height"] <= 900

    def test_the_window_can_be_shortened(self, explorer):
        times = "svg text[text-anchor=middle]"
        shown = [explorer.locator(f".plots {times}").all_text_contents()]
        explorer.get_by_label("plotted").select_option("1.2")
        shown.append(explorer.locator(f".plots {times}").all_text_contents())
        assert "4" in shown[0] and "4" not in shown[1]
        assert "1.2" in shown[1]

    def test_animation_is_that_of_the_chosen_case(self, explorer):
        explorer.get_by_label("tachometer").press("Home")
        run = simulate(AxisParameters.paper_x_axis(K_2=100.0), 10.0, 4.0)
        assert explorer.locator(".arm-motion li").count() == len(run.events)

    def test_hints_are_what_the_screen_shows(self, site, visit):
        page = visit((site / "book" / "explorer.html").as_uri() + "#T_p=4.74")
        shown = float(self.numbers(page)["overshoot"])
        hint = page.locator("li", has_text="Raise").inner_text()
        assert f"overshoots by {shown:.0f}\u00a0%" in hint


@pytest.mark.parametrize("name", ["index", "book/explorer"])
def test_labels_are_large_enough_on_a_phone(name, site, visit):
    page = visit((site / f"{name}.html").as_uri())
    page.set_viewport_size({"width": 360, "height": 800})
    sizes = page.locator(":is(.explorer, .arm-motion) svg text").evaluate_all(
        "all => all.map(e => parseFloat(getComputedStyle(e).fontSize)"
        " * e.getScreenCTM().a).filter(Number.isFinite)"
    )
    assert sizes
    assert min(sizes) >= 11


class TestMotion:
    """The animation of the front page, for a reader who asked for less motion unless it says so."""

    @pytest.fixture
    def still(self, site, visit):
        url = (site / "index.html").as_uri()
        return visit(url, stopped=True, reduced_motion="reduce")

    @pytest.fixture
    def run(self):
        return simulate(AxisParameters.paper_x_axis(), 10.0, 1.0)

    def now(self, page):
        """Time on the clock in s."""
        return float(page.locator(".arm-motion .clock").inner_text().split()[0]) / 1e3

    def advance(self, page, start, seconds=0.5):
        """Play from a time on; how far the run gets."""
        page.get_by_label("time", exact=True).fill(str(start))
        page.get_by_role("button", name="Play").click()
        page.clock.run_for(1e3 * seconds)
        page.get_by_role("button", name="Pause").click()
        return self.now(page) - start

    def test_stands_still_until_a_key_starts_it(self, still, run):
        before = self.now(still)
        still.locator(".arm-motion").scroll_into_view_if_needed()
        still.clock.run_for(2000)
        assert self.now(still) == before
        assert run.events[6].time < before < run.events[7].time  # the tooth crosses its play
        still.get_by_role("button", name="Play").focus()
        still.keyboard.press("Enter")
        still.clock.run_for(500)
        assert self.now(still) > before
        still.keyboard.press("Space")
        stopped = self.now(still)
        still.clock.run_for(500)
        assert self.now(still) == stopped

    def test_begins_by_itself_without_that_wish(self, site, visit):
        page = visit((site / "index.html").as_uri(), reduced_motion="no-preference")
        page.locator(".arm-motion").scroll_into_view_if_needed()
        page.get_by_role("button", name="Pause").wait_for()

    def test_makes_and_removes_no_elements_while_it_plays(self, still):
        """The theme would wait for the end with making what scrolls reachable by the keyboard."""
        still.evaluate(
            """() => {
                window.changes = 0;
                new MutationObserver((all) => { window.changes += all.length; })
                    .observe(document.body, {subtree: true, childList: true});
            }"""
        )
        assert self.advance(still, 0.79) > 0
        assert still.evaluate("window.changes") == 0

    def test_arrow_keys_move_the_time(self, still):
        slider = still.get_by_label("time", exact=True)
        slider.press("Home")
        assert self.now(still) == 0
        slider.press("ArrowRight")
        assert self.now(still) == pytest.approx(0.001)
        assert slider.get_attribute("aria-valuetext").startswith("1.000 ms: arm at 0.000 m")

    def test_shows_what_a_run_has(self, still, run):
        slider = still.get_by_label("time", exact=True)
        for t in (0.003, 0.2, 0.5, 0.803, 0.81, 0.83, 1.0):
            slider.fill(str(t))
            told = slider.get_attribute("aria-valuetext").replace("−", "-")
            place, velocity, gear = told.partition(": arm at ")[2].split(", ")
            y, force = run(t), run.auxiliary([t])["f_g"][0]
            assert float(place.split()[0]) == pytest.approx(y[0], abs=0.001)
            assert float(velocity.split()[0]) == pytest.approx(y[1], abs=0.001)
            if force == 0:
                assert gear == "gear no contact"
            else:
                assert float(gear.split()[-2]) == pytest.approx(force, abs=2)

    def test_events_light_up_as_they_happen(self, still, run):
        items = still.locator(".arm-motion li")
        told = [float(text.split()[0]) / 1e3 for text in items.all_inner_texts()]
        assert told == pytest.approx([event.time for event in run.events], abs=5e-5)
        for n in (0, 4, 11):
            items.nth(n).get_by_role("button").press("Enter")
            assert still.locator(".arm-motion li.past").count() == n + 1
            newest = still.locator(".arm-motion li[aria-current]")
            assert newest.inner_text() == items.nth(n).inner_text()

    def test_bars_touch_their_limits(self, still, run):
        slider, bars = still.get_by_label("time", exact=True), still.locator(".arm-motion .bar")
        for t, at_limit in ((0.0001, 2), (0.4, 1), (0.81, 0)):
            slider.evaluate("(e, t) => { e.step = 'any'; e.value = t; }", t)
            slider.dispatch_event("input")
            assert still.locator(".arm-motion .at-limit").count() == at_limit, t
        assert bars.count() == 3

    def test_the_release_is_in_slow_motion(self, still):
        quick, slow = self.advance(still, 0.4), self.advance(still, 0.8)
        assert quick == pytest.approx(0.125, rel=0.1)
        assert slow == pytest.approx(0.005, rel=0.2)
        still.get_by_label("pace").select_option("1")
        assert self.advance(still, 0.3) == pytest.approx(0.5, rel=0.1)

    def test_a_figure_stands_in_its_place_in_print_and_without_the_script(
        self, site, visit, browser
    ):
        url = (site / "index.html").as_uri()
        page = visit(url)
        figure, motion = page.locator(".arm-still img").first, page.locator(".arm-motion")
        assert motion.is_visible() and not figure.is_visible()
        page.emulate_media(media="print")
        assert figure.is_visible() and not motion.is_visible()
        bare = browser.new_page(java_script_enabled=False)
        bare.goto(url)
        assert bare.locator(".arm-still img").first.is_visible()
        assert not bare.locator(".arm-motion").is_visible()
        bare.close()
