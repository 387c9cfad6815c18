"""Tests of the paper's claims and of the expected values, on what is expected of the book."""

import json

import pytest

from armsim.paths import DATA
from reportkit import claims
from reportkit.check import compare, load_all
from reportkit.claims import CONFIRMED, CORRECTED, REFUTED, UNTESTABLE
from reportkit.project import Project

PROJECT = Project.find(DATA)


@pytest.fixture(scope="module")
def known():
    return load_all(PROJECT.expected)


@pytest.fixture(scope="module")
def printed():
    return claims.load(PROJECT.claims)


def test_the_paper_s_claims_have_pages_and_recorded_values(known, printed):
    pages = {path.stem for path in (PROJECT.root / "book").glob("*.md")}
    found = {one.name: one.verdict(known) for one in printed}
    assert len(found) == len(printed) > 25
    assert {one.page for one in printed} <= pages
    assert found["$K_1 = 1014$"] == CONFIRMED
    assert found["RK6 is of sixth order"] == CORRECTED
    assert found["the novel method: sixth order"] == REFUTED
    assert found["a linear model is sufficient"] == REFUTED
    assert found["the constants of Table 5"] == UNTESTABLE


def test_the_figure_names_every_claim(known, printed):
    fig = claims.figure(printed, known)
    texts = {text.get_text() for text in fig.axes[0].texts}
    assert {one.name for one in printed} < texts
    width = fig.get_window_extent().x1
    fig.canvas.draw()
    for text in fig.axes[0].texts:
        box = text.get_window_extent()
        right = width if box.x0 > 0.45 * width else width / 2
        assert box.x1 <= right, text.get_text()


def test_report_has_expectations_and_any_changed_digit_is_found(known):
    assert sorted(known) == sorted(
        path.stem for path in PROJECT.notebooks.glob("[0-9][0-9]_*.ipynb")
    )
    for study, records in known.items():
        for name, record in records.items():
            changed = json.loads(json.dumps(record))
            if isinstance(record["value"], bool | str):
                changed["value"] = "other"
            else:
                changed["value"] = 2 * record["value"] + 1
            (pair,) = compare(study, {name: record}, {name: changed})
            assert bool(pair.moved) == record.get("compared", True)
