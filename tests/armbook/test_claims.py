"""Tests of the paper's claims and of the expected values, on what is expected of the book."""

import json

import pytest

from armsim.paths import DATA
from reportkit import claims
from reportkit.check import compare, load_all
from reportkit.claims import CONFIRMED, CORRECTED, DEPENDS, REFUTED, UNTESTABLE
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
    assert found["gain K₁ = 1014"] == CONFIRMED
    assert found["RK6 has order six"] == CORRECTED
    assert found["the novel sixth-order technique has order six"] == REFUTED
    assert found["the novel technique matches better than RK6"] == REFUTED
    assert found["the novel technique takes less CPU time than RK6"] == DEPENDS
    assert found["a linear model is sufficient"] == DEPENDS
    assert found["RK6 is more accurate than RK5"] == DEPENDS
    assert found["the constants of Table 5 give a good match"] == UNTESTABLE


def test_every_claim_about_a_norm_or_a_time_has_other_readings(printed):
    readings = {one.name: len(one.readings) for one in printed}
    for name in (
        "RK6 is more accurate than RK5",
        "the novel technique matches better than RK6",
        "the novel technique takes less CPU time than RK6",
        "the novel technique is faster than Dormand–Prince",
        "two orders of magnitude faster than the others",
        "a linear model is sufficient",
        "the linear response needs over 40 times the rated current",
        "the linear response takes about 0.03 s",
        "nonlinear effects are significant",
    ):
        assert readings[name] >= 2, name


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
                changed["value"] = 2 * record["value"] + 1 + 2 * (record["tolerance"] or 0)
            (pair,) = compare(study, {name: record}, {name: changed})
            assert bool(pair.moved) == record.get("compared", True)
