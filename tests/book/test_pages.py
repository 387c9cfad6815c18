"""The files of the built book: whole, for themselves, and readable to all."""

import re
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from reportkit import figures

RESOURCES = {"script": "src", "link": "href", "img": "src", "iframe": "src", "source": "src"}
REMOTE = re.compile(r"(?:https?:)?//", re.IGNORECASE)


def target(path, url):
    return (path.parent / unquote(urlsplit(url).path)).resolve() if urlsplit(url).path else path


def test_local_links_lead_somewhere(page, path, read):
    for _, attrs in page.tags:
        for url in filter(None, (attrs.get("href"), attrs.get("src"))):
            if urlsplit(url).scheme or REMOTE.match(url):
                continue
            file, anchor = target(path, url), unquote(urlsplit(url).fragment)
            assert file.is_file(), url
            if anchor and file.suffix == ".html":
                assert anchor in read(file).ids, url


def test_page_asks_nothing_of_another_machine(page):
    for tag, attrs in page.tags:
        if attrs.get("rel") != "canonical":  # the book's own address
            assert not REMOTE.match(attrs.get(RESOURCES.get(tag, ""), "")), (tag, attrs)
        assert "url(http" not in attrs.get("style", "")


def test_style_sheets_ask_nothing_of_another_machine(site):
    sheets = list(site.rglob("*.css"))
    assert sheets
    for sheet in sheets:
        text = sheet.read_text(encoding="utf-8")
        for url in re.findall(r"url\(\s*['\"]?([^'\")]+)", text):
            assert not REMOTE.match(url), (sheet, url)
        assert not re.search(r"@import\s+['\"]?(?:https?:)?//", text), sheet


def test_mathematics_is_drawn_by_the_file_beside_the_pages(page, path, site):
    scripts = [attrs.get("src", "") for tag, attrs in page.tags if tag == "script"]
    drawn = [target(path, src) for src in scripts if "mathjax" in src]
    if any("math" in attrs.get("class", "").split() for _, attrs in page.tags):
        assert drawn == [site / "_static" / "mathjax" / "tex-svg-full.js"]
        assert drawn[0].stat().st_size > 1_000_000


def test_page_describes_itself_to_search_engines_and_other_sites(page, path, site):
    tags = [attrs for tag, attrs in page.tags if tag == "meta"]
    told = {attrs.get("property") or attrs.get("name", ""): attrs.get("content") for attrs in tags}
    if path.parent.name == "book" or path == site / "index.html":
        assert 20 < len(told["description"]) <= 200
        assert told["og:description"] == told["description"]
        assert told["og:title"]
        assert (site / "_static" / Path(told["og:image"]).name).is_file()


def test_images_are_vectors_and_say_what_they_show(page):
    for tag, attrs in page.article:
        if tag == "img":
            assert attrs["src"].endswith(".svg"), attrs
            assert len(attrs.get("alt", "")) >= 15, attrs
            assert not re.search(r"\.(svg|png|jpe?g)$|_images/", attrs["alt"]), attrs


def test_text_of_figures_has_a_colour_for_a_dark_page(page, path):
    """The contrast of those colours is tested in tests/reportkit; a text with a halo needs none."""
    for tag, attrs in page.article:
        if tag == "img" and not attrs["src"].endswith("-dark.svg"):
            drawing = target(path, attrs["src"]).read_text(encoding="utf-8")
            texts = re.findall(r'<g id="text_\d+">(?:\s*<!--.*?-->)?\s*<g ([^>]*)>', drawing, re.S)
            found = {fill[1] for text in texts if (fill := re.search(r"fill: (#\w+)", text))}
            assert found <= set(figures.DARK), attrs["src"]


#: A number with a decimal point or a unit.
MEASURED = re.compile(
    r"\d+\.\d+(?: [^\s.,;:)]+)?|\d+ (?:%|per cent|[kmnµ]?(?:m/s|[msVANW]|Hz)|dB|seconds?)(?!\w)"
)
#: What is set and not found: settings of a figure, lines drawn in it, and what the paper prints.
GIVEN = set("0.9 m/s,1 m/s,1 mm,10 V,30 ms,2 per cent,5 per cent,10 %,95 %,100 %".split(","))


def test_alt_texts_and_captions_have_no_typed_results(page, path):
    """A result may have moved since; a caption can quote it, an alt text says what is seen."""
    texts = [attrs.get("alt", "") for tag, attrs in page.article if tag == "img"]
    for caption in re.findall(r"<figcaption>(.*?)</figcaption>", path.read_text("utf-8"), re.S):
        typed = re.sub(
            r'<a [^>]*\bvalue\b.*?</a>|<span class="(math|caption-n).*?</span>', "", caption
        )
        texts.append(re.sub("<[^>]+>", "", typed))
    found = {number for text in texts for number in MEASURED.findall(text.replace("\u00a0", " "))}
    assert found <= GIVEN


def test_figures_offer_their_data(page, path, site):
    offered = {Path(unquote(attrs["href"])).stem for tag, attrs in page.article
               if tag == "a" and attrs["href"].endswith(".csv")}  # fmt: skip
    results = site.parents[1] / "book" / "results"
    for tag, attrs in page.article:
        key = Path(attrs.get("src", "")).stem
        if tag == "img" and path.parent.name != "results" and (results / f"{key}.csv").exists():
            assert key in offered


def test_caption_is_one_paragraph(page):
    """A second one is what is left of an option broken over lines, which MyST does not join."""
    legends = [attrs for _, attrs in page.article if "legend" in attrs.get("class", "").split()]
    assert not legends


def test_no_markup_is_left_over(page):
    assert not re.search(r"\{(glue|numref|cite|doc|ref|eq|include)\b[^}]*\}", page.prose)
    assert not any("problematic" in attrs.get("class", "").split() for _, attrs in page.tags)


def test_docstrings_of_attributes_are_whole(site):
    # napoleon takes what stands before a colon for a type
    api = (site / "book" / "api.html").read_text(encoding="utf-8")
    assert re.findall(r"Type<span class=.colon.*\s*<dd[^>]*><p>(.*)</p>", api) == ["int"]
    assert "Alias for field number" not in api


def test_quoted_negative_numbers_have_a_minus_sign(path):
    assert '<span class="pasted-text">-' not in path.read_text(encoding="utf-8")


def test_search_index_lists_every_page(site):
    index = (site / "searchindex.js").read_text(encoding="utf-8")
    sources = [path.relative_to(site / "_sources") for path in (site / "_sources").rglob("*.*")]
    assert sources
    for source in sources:
        assert f'"{source.with_suffix("").as_posix()}"' in index


def test_chapter_opens_with_a_bold_finding(path):
    if path.parent.name == "book":
        first = re.search(
            r"<h1>.*?</h1>.*?(<p>.*?</p>)", path.read_text(encoding="utf-8"), re.DOTALL
        )
        assert "<strong>" in first[1]


def test_quoted_values_link_to_their_cells(page, path):
    """That the links resolve is tested with all the others."""
    text = path.read_text(encoding="utf-8")
    quoted = re.findall(r'(<a [^>]*>)?<span class="pasted-text">', text)
    for link in quoted:
        assert re.search(r'class="value .*href="[^"]*results/(\d\d_\w+)\.html#.+ title="\1::', link)


def test_figures_and_tables_link_to_their_cells(path):
    text = path.read_text(encoding="utf-8")
    if path.parent.name == "book":
        for figure in re.findall(r"<figure.*?</figure>", text, re.DOTALL):
            made = re.search(r'src="[^"]*/(\d\d_\w+)-([\w-]+)\.svg"', figure)
            if made:
                assert f'title="{made[1]}::{made[2]}"' in figure


def test_notebooks_lead_back_to_the_pages_that_quote_them(path, site):
    if path.parent.name == "results":
        line = re.search(r'<p class="quoted">.*?</p>', path.read_text(encoding="utf-8"))
        pages = re.findall(r'href="\.\./([^"]+)"', line[0])
        assert pages
        for page in pages:
            quoting = (path.parent.parent / page).read_text(encoding="utf-8")
            assert re.search(f"results/{path.stem}.html|{path.stem}-", quoting)


def test_chapter_that_quotes_a_notebook_ends_with_the_box(path):
    """The verdicts are no notebook's."""
    text = path.read_text(encoding="utf-8")
    if path.parent.name == "book" and 'class="value ' in text:
        _, *boxes = text.partition("</article>")[0].split('<div class="tip again admonition">')
        assert len(boxes) == 1
        assert "<h2>" not in boxes[0]
        assert re.search(r"\.venv/bin/\S+</span>|\.venv/bin/", boxes[0])


def test_title_is_not_doubled(path):
    (title,) = re.findall(r"<title>(.*?)</title>", path.read_text(encoding="utf-8"), re.DOTALL)
    parts = re.split(r" &#8212; | - ", title)
    assert len(set(parts)) == len(parts)


def test_commands_are_shell(path):
    blocks = re.findall(r'<div class="highlight-(\w+)[^>]*><div class="highlight"><pre>(.*?)</pre>',
                        path.read_text(encoding="utf-8"), re.DOTALL)  # fmt: skip
    for language, code in blocks:
        told = re.sub(r"<[^>]+>", "", code).lstrip()
        if path.parent.name == "book" and told.startswith((".venv/", "make ", "git ", "armsim ")):
            assert language == "sh", told


def test_the_main_line_takes_twenty_minutes(site):
    text = (site / "book" / "guide.html").read_text(encoding="utf-8")
    main, whole = map(
        int, re.search(r"about (\d+) minutes.*?about (\d+)", text, re.DOTALL).groups()
    )
    assert 15 <= main <= 25 < whole
    each = [int(number) for number in re.findall(r"\((\d+) min\)", text)]
    assert sum(each) == pytest.approx(main, abs=len(each) / 2 + 1)  # each is rounded
    assert "The exponential form</span></a> (" in text


def test_scripts_are_loaded_where_they_are_needed(page, path, site):
    wanted = {"index": {"motion"}, "book/explorer": {"motion", "explorer"}}
    name = path.relative_to(site).with_suffix("").as_posix()
    loaded = {Path(attrs.get("src", "").split("?")[0]).stem for _, attrs in page.tags}
    assert loaded & {"motion", "explorer"} == wanted.get(name, set())
