"""A small report built by Sphinx: links to cells and back, the box, reading times."""

import re

import nbformat
import pytest
from sphinx.application import Sphinx

from reportkit.sphinx_extension.chapters import WORDS_A_MINUTE

CONF = """
extensions = ["myst_nb", "reportkit.sphinx_extension"]
nb_execution_mode = "off"
myst_enable_extensions = ["colon_fence"]
"""
CLAIMS = """
[[claim]]
name = "fast"
where = "2"
text = "it is fast"
page = "growth"
untestable = true
note = "no clock"
"""
PAGE = """# Growth

The rate is {glue:text}`results/10_growth.ipynb::rate:.1f` %,
at first {glue:text}`results/10_growth.ipynb::first:.1e`.
This takes {minutes}`long`, all {minutes}`*`.
It lasts 10⁻³ s over 5 km.

```{figure} results/10_growth-curve.svg
A curve.
```

:::{table} Ends
```{include} results/10_growth-ends.md
```
:::

```{again} 10_growth
:with: -p rate 2
The rate is a parameter.
```
"""


def output(data, metadata):
    return nbformat.v4.new_output("display_data", data, metadata=metadata)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    root = tmp_path_factory.mktemp("report")
    results = root / "book" / "results"
    results.mkdir(parents=True)
    (root / "data").mkdir()
    (root / "pyproject.toml").write_text('[tool.reportkit]\nname = "toy"\n')
    (root / "data" / "claims.toml").write_text(CLAIMS)
    (root / "conf.py").write_text(CONF)
    pages = "\n".join(
        f"book/{name}" for name in ("growth", "long", "verdicts", "results/10_growth")
    )
    (root / "index.md").write_text(f"# Toy\n\n```{{toctree}}\n{pages}\n```\n")
    (root / "book" / "growth.md").write_text(PAGE)
    (root / "book" / "long.md").write_text(
        "# Long {math}`\\mu` of {math}`x`\n\n" + 3 * WORDS_A_MINUTE * "word "
    )
    (root / "book" / "verdicts.md").write_text("# Verdicts\n")
    (results / "verdicts.csv").write_text("claim,where,verdict\nfast,2,cannot be tested\n")
    (results / "10_growth-curve.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg"/>')
    (results / "10_growth-ends.md").write_text("| load / (N s/m) |\n|---|\n| 1 |\n")
    mime = "application/papermill.record/text/plain"
    glued = [
        output({mime: value}, {"scrapbook": {"name": name, "mime_prefix": mime[:29]}})
        for name, value in (("rate", "1.5"), ("first", "-2.5e-07"))
    ]
    shown = [output({"text/plain": "x"}, {"name": f"10_growth-{end}"}) for end in
             ("curve.svg", "ends.md")]  # fmt: skip
    new = nbformat.v4
    cells = [
        new.new_markdown_cell("# The notebook"),
        new.new_code_cell("record()", outputs=glued, id="one"),
        new.new_code_cell("show()", outputs=shown, id="two"),
    ]
    language = {"language_info": {"name": "python", "pygments_lexer": "python"}}
    nbformat.write(new.new_notebook(cells=cells, metadata=language), results / "10_growth.ipynb")
    folders = root, root, root / "_build", root / "_doctrees"
    Sphinx(*folders, "html", status=None, warningiserror=True).build()
    return root / "_build"


@pytest.fixture
def page(site):
    return (site / "book" / "growth.html").read_text(encoding="utf-8")


def test_values_figures_and_tables_link_to_their_cells(site, page):
    links = re.findall(
        r'href="results/10_growth.html#in-10_growth-(\w+)" title="10_growth::(\w+)"', page
    )
    assert links == [("one", "rate"), ("one", "first"), ("two", "curve"), ("two", "ends")]
    notebook = (site / "book" / "results" / "10_growth.html").read_text(encoding="utf-8")
    assert 'id="in-10_growth-one"' in notebook and 'id="in-10_growth-two"' in notebook
    assert re.search(r'Quoted in: <a [^>]*href="../growth.html"', notebook)
    assert notebook.count("Quoted in") == 1


def test_values_have_minus_signs_and_powers(page):
    assert ">−2.5\u00a0·\u00a010⁻⁷</span></a>" in page


def test_no_line_ends_between_a_number_and_its_unit(page):
    assert ">1.5</span></a>\u00a0%," in page and "10⁻³\u00a0s over 5\u00a0km." in page
    assert "load /\u00a0(N\u00a0s/m)</p></th>" in page


def test_box_and_verdicts_end_the_chapter(page):
    end = re.sub(r"<[^>]+>", "", page[page.index("Verdicts</strong>") :])
    assert "? cannot be tested: it is fast" in end
    assert ".venv/bin/toy rerun growth -p rate 2\n" in end
    assert "The rate is a parameter." in end
    assert re.search(r'href="../_downloads/\w+/10_growth.ipynb"', page)


def test_reading_times_come_from_the_words(page):
    assert "This takes 3, all 3." in page


def test_sections_are_kept_for_the_search(site):
    script = (site / "_static" / "sections.js").read_text(encoding="utf-8")
    told = "The rate is 1.5 %, at first −2.5 · 10⁻⁷."
    assert f'"book/growth": [["growth", "Growth", "{told}' in script
    assert '[["long-mu-of-x", "Long … of x", "word ' in script  # formulas are not typeset there
    search = (site / "search.html").read_text(encoding="utf-8")
    assert "sections.js" in search
    assert "sections.js" not in (site / "index.html").read_text(encoding="utf-8")
