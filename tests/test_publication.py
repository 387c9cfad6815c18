"""What others are told of the project: one version, one title, one address, in every file."""

import re
import tomllib
from pathlib import Path

import yaml
from pybtex.database import parse_string

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))


def test_citation_has_the_version_and_date_of_the_changelog():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    version, date = re.search(r"^## (\S+) – (\S+)$", text, re.MULTILINE).groups()
    assert PROJECT["version"] == version
    assert (CITATION["version"], CITATION["date-released"]) == (version, date)


def test_citation_has_the_licence_and_addresses_of_the_package():
    """The addresses are placeholders until CONTRIBUTING, "Publish", is followed."""
    assert CITATION["license"] == PROJECT["license"]
    urls = PROJECT["urls"]
    assert (CITATION["url"], CITATION["repository-code"]) == (urls["Homepage"], urls["Repository"])


def test_citation_names_the_paper_as_its_text_does():
    printed = (ROOT / "book" / "paper.md").read_text(encoding="utf-8")
    assert f"*{CITATION['references'][0]['title']}*" in printed


def test_box_on_the_page_cites_what_the_citation_file_does():
    box = (ROOT / "book" / "how_to_cite.md").read_text(encoding="utf-8")
    (entry,) = parse_string(re.search(r"@.*?^}", box, re.M | re.S)[0], "bibtex").entries.values()
    title = re.sub(r"[{}]", "", entry.fields["title"])
    assert title == CITATION["title"]
    assert entry.fields["version"] == CITATION["version"]
    assert entry.fields["year"] == CITATION["date-released"][:4]
    authors = [str(person).strip("{}") for person in entry.persons["author"]]
    assert authors == [author["name"] for author in CITATION["authors"]]
