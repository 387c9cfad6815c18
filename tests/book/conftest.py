"""The pages of the built book, read once."""

from dataclasses import dataclass, field
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

import pytest

SITE = Path(__file__).parents[2] / "_build" / "html"
VOID = set("area base br col embed hr img input link meta source track wbr".split())


@dataclass
class Page(HTMLParser):
    """What the tests ask of one page."""

    path: Path
    tags: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    article: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    ids: set[str] = field(default_factory=set)
    prose: str = ""

    def __post_init__(self):
        super().__init__()
        self.open: list[str] = []
        self.feed(self.path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        attrs = {name: value or "" for name, value in attrs}
        self.tags.append((tag, attrs))
        if "article" in self.open:
            self.article.append((tag, attrs))
        self.ids.update(attrs[name] for name in ("id", "name") if name in attrs)
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        while tag in self.open and self.open.pop() != tag:
            pass

    def handle_data(self, data):
        if "article" in self.open and not {"code", "pre", "script"} & set(self.open):
            self.prose += data


def paths() -> list[Path]:
    """List the pages; none if the last build failed, which leaves some behind."""
    if not (SITE.parent / ".built").exists():
        return []
    return sorted(
        path for path in SITE.rglob("*.html") if path.relative_to(SITE).parts[0] != "_static"
    )


def pytest_generate_tests(metafunc):
    if "path" in metafunc.fixturenames:
        metafunc.parametrize("path", paths(), ids=lambda path: str(path.relative_to(SITE)))


@pytest.fixture(scope="session")
def site() -> Path:
    if not paths():
        pytest.skip("there is no book in _build/html: make book")
    return SITE


@pytest.fixture(scope="session")
def read():
    return cache(Page)


@pytest.fixture
def page(read, path):
    return read(path)
