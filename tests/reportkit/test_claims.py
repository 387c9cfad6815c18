"""Verdicts of made-up claims, and the paper's claims against what is expected of the book."""

import json
import re

import pytest

from armsim.paths import DATA
from reportkit import claims
from reportkit.claims import CONFIRMED, CORRECTED, REFUTED, UNTESTABLE, Claim, ClaimError, Test

RECORDS = {
    "10_a": {
        "gain": {"value": 1014.4, "unit": "V/V"},
        "order": {"value": 4, "unit": "1"},
        "limit": {"value": 8.0, "unit": "A"},
    },
    "20_b": {"current": {"value": 8.3, "unit": "A"}},
}


def claim(*tests, corrected=(), **more):
    return Claim("name", "Section 4", "says so", "model", tests, corrected, **more)


@pytest.mark.parametrize(
    ("test", "passes"),
    [
        (Test("10_a::gain", equals=1014.0, tolerance=0.5), True),
        (Test("10_a::gain", equals=1014.0, tolerance=0.3), False),
        (Test("10_a::gain", equals=1015.0, tolerance=0.5), False),
        (Test("10_a::order", equals=4), True),
        (Test("10_a::order", equals=6), False),
        (Test("10_a::gain", above=1000), True),
        (Test("10_a::gain", above=1014.4), False),
        (Test("10_a::gain", below=1000), False),
        (Test("20_b::current", above="10_a::limit"), True),
        (Test("20_b::current", above="10_a::limit", times=1.1), False),
        (Test("20_b::current", equals="10_a::limit", tolerance=0.31), True),
        (Test("20_b::current", equals="10_a::limit", tolerance=0.29), False),
    ],
)
def test_criteria(test, passes):
    assert test.passes(RECORDS) is passes


TRUE, FALSE = Test("10_a::order", equals=4), Test("10_a::order", equals=6)


@pytest.mark.parametrize(
    ("one", "verdict"),
    [
        (claim(TRUE), CONFIRMED),
        (claim(TRUE, FALSE), REFUTED),
        (claim(FALSE), REFUTED),
        (claim(FALSE, corrected=[TRUE], note="why"), CORRECTED),
        (claim(FALSE, corrected=[TRUE, FALSE], note="why"), REFUTED),
        (claim(TRUE, corrected=[FALSE], note="why"), CONFIRMED),
        (claim(untestable=True, note="why"), UNTESTABLE),
    ],
)
def test_verdicts(one, verdict):
    assert one.verdict(RECORDS) == verdict


def test_the_table_shows_paper_and_measurement():
    text = claims.table(
        [claim(Test("10_a::gain", equals=1014.0, tolerance=0.5, format=".1f")), claim(FALSE)],
        RECORDS,
    )
    first, second = text.splitlines()[2:]
    assert first.startswith(
        "| says so (Section 4) | 1014.0 V/V | 1014.4 V/V | +0.4 V/V | 0.5 V/V | **confirmed**"
    )
    assert second.startswith("| says so (Section 4) | 6 | 4 | −2 | exact | **refuted**")
    assert claims.summary([claim(TRUE), claim(TRUE), claim(FALSE)], RECORDS) == (
        "Of 3 claims, 2 are confirmed and 1 is refuted.\n"
    )


def test_a_missing_value_is_an_error_that_names_it(tmp_path, capsys):
    with pytest.raises(ClaimError, match="10_a::gone"):
        claim(Test("10_a::gone", above=1.0)).verdict(RECORDS)
    (tmp_path / "10_model.json").write_text("{}")
    assert claims.main([str(tmp_path)]) == 1
    assert re.search(r"needs \d\d_\w+::\w+, which is not recorded", capsys.readouterr().err)
    assert not list(tmp_path.glob("verdicts*"))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Test("10_a::gain"), "one of equals, above, below"),
        (lambda: Test("10_a::gain", above=1.0, below=2.0), "one of equals, above, below"),
        (lambda: Test("10_a::gain", equals=1.0), "needs one"),
        (lambda: Test("10_a::gain", above=1.0, tolerance=0.1), "belongs to equals"),
        (lambda: claim(), "untestable"),
        (lambda: claim(TRUE, untestable=True, note="why"), "untestable"),
        (lambda: claim(untestable=True), "note"),
        (lambda: claim(FALSE, corrected=[TRUE]), "note"),
    ],
)
def test_malformed_claims_are_refused(make, message):
    with pytest.raises(ClaimError, match=message):
        make()


def test_an_unknown_key_is_refused(tmp_path):
    path = tmp_path / "claims.toml"
    path.write_text('[[claim]]\nname = "a"\nwhere = "b"\ntext = "c"\npage = "d"\nwhy = "e"\n')
    with pytest.raises(ClaimError, match=r"^a: .*why"):
        claims.load(path)


def test_the_paper_s_claims_have_pages_and_recorded_values():
    known = claims.load_all(DATA / "expected")
    pages = {path.stem for path in (DATA.parent / "book").glob("*.md")}
    found = {one.name: one.verdict(known) for one in claims.load()}
    assert len(found) == len(claims.load()) > 25
    assert {one.page for one in claims.load()} <= pages
    assert found["$K_1 = 1014$"] == CONFIRMED
    assert found["RK6 is of sixth order"] == CORRECTED
    assert found["the novel method: sixth order"] == REFUTED
    assert found["a linear model is sufficient"] == REFUTED
    assert found["the constants of Table 5"] == UNTESTABLE


def test_the_figure_names_every_claim():
    known = claims.load_all(DATA / "expected")
    fig = claims.figure(claims.load(), known)
    texts = {text.get_text() for text in fig.axes[0].texts}
    assert {one.name for one in claims.load()} < texts
    width = fig.get_window_extent().x1
    fig.canvas.draw()
    for text in fig.axes[0].texts:
        box = text.get_window_extent()
        right = width if box.x0 > 0.45 * width else width / 2
        assert box.x1 <= right, text.get_text()


def test_expected_records_are_complete():
    for path in (DATA / "expected").glob("*.json"):
        for record in json.loads(path.read_text(encoding="utf-8")).values():
            assert {"value", "unit", "tolerance"} <= set(record)
