"""Tests of the verdicts, with made-up claims."""

import pytest

from reportkit import claims
from reportkit.claims import (
    CONFIRMED,
    CORRECTED,
    DEPENDS,
    REFUTED,
    UNTESTABLE,
    Claim,
    ClaimError,
    Reading,
    Test,
    Verdicts,
)
from reportkit.program import run
from reportkit.text import to_json

RECORDS = {
    "10_a": {
        "gain": {"value": 1014.4, "unit": "V/V"},
        "order": {"value": 4, "unit": "1"},
        "limit": {"value": 8.0, "unit": "A"},
    },
    "20_b": {"current": {"value": 8.3, "unit": "A"}},
}


def claim(*tests, name="name", **more):
    return Claim(name, "Section 4", "says so", "model", tests, **more)


def read(*tests, name="name", **readings):
    """A claim with other readings."""
    others = [Reading(key, [test]) for key, test in readings.items()]
    return claim(*tests, name=name, reading="first", readings=others)


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


@pytest.mark.parametrize(
    ("one", "turned", "verdict"),
    [
        (read(TRUE, other=TRUE), [], CONFIRMED),
        (read(FALSE, other=FALSE, third=FALSE), [], REFUTED),
        (read(TRUE, other=TRUE, third=FALSE), [], DEPENDS),
        (read(FALSE, other=TRUE), [], DEPENDS),
        (claim(TRUE), ["K halved"], DEPENDS),
        (claim(FALSE), ["K halved"], DEPENDS),
        (claim(untestable=True, note="why"), [], UNTESTABLE),
    ],
)
def test_a_claim_that_turns_depends_on_the_reading(one, turned, verdict):
    assert one.verdict(RECORDS, turned) == verdict


def test_a_correction_that_holds_agrees_with_a_reading_that_holds():
    one = Claim(
        "n", "w", "t", "p", [FALSE], "first", [TRUE], [Reading("other", [TRUE])], note="why"
    )
    assert one.verdict(RECORDS) == CORRECTED


def test_every_reading_of_a_claim_stands_in_its_card_with_criterion_and_value():
    gain = Test("10_a::gain", equals=1014.0, tolerance=0.5, format=".1f", what="gain")
    one = read(gain, strict=Test("10_a::gain", below=1000, format=".0f"))
    card = Verdicts([one], RECORDS).render("verdicts.md").strip().splitlines()
    assert card == [
        "## ◐ Depends on the reading: 1",
        "",
        ":::{div} claim depends-on-the-reading",
        "**◐ Name** {doc}`evidence <model>`",
        "",
        "The paper (Section 4): says so.",
        "",
        "**Depends on the reading**. It holds under 1 of 2 readings.",
        "",
        "| reading, and what is measured | criterion | measured |",
        "| --- | --- | --- |",
        "| ✓ first: gain | = 1014 ± 0.5 V/V | 1014.4 V/V |",
        "| ✗ strict | < 1000 V/V | 1014 V/V |",
        "",
        "Computed once: by the notebook.",
        ":::",
    ]


def test_criteria_have_the_digits_of_their_source_and_minus_signs():
    records = {"10_a": {"x": {"value": -0.0001, "unit": "%"}, "y": {"value": -2, "unit": "%"}}}
    literal = Test("10_a::x", above=-0.1, format=".2f")
    assert (literal.criterion(records), literal.measured(records)) == ("> −0.1 %", "0.00 %")
    quoted = Test("10_a::x", above="10_a::y", times=0.5, format=".2f")
    assert quoted.criterion(records) == "> −1.00 %"


def test_the_page_is_grouped_by_verdict_and_each_card_tells_how_often_it_was_computed():
    opinions = {"10_a::gain": ["by hand"], "10_a::order": ["by hand", "by another program"]}
    claims_ = [claim(Test("10_a::gain", above=1.0)), claim(FALSE), claim(untestable=True, note="n")]
    page = Verdicts(claims_, RECORDS, opinions=opinions).render("verdicts.md").splitlines()
    told = [line for line in page if line.startswith(("## ", "Computed"))]
    assert told == [
        "## ✗ Refuted: 1",
        "Computed 3 times: by the notebook; by another program; by hand.",
        "## ✓ Confirmed: 1",
        "Computed twice: by the notebook; by hand.",
        "## ? Cannot be tested: 1",
    ]
    # the one that was computed least often counts
    both = claim(Test("10_a::gain", above=1.0), TRUE)
    page = Verdicts([both], RECORDS, opinions=opinions).render("verdicts.md")
    assert "Computed twice: by the notebook; by another program; by hand." in page
    timed = {"10_a": {"order": {"value": 4, "unit": "1", "compared": False}}}
    assert "once: by the notebook, a measured time." in Verdicts([claim(TRUE)], timed).render(
        "verdicts.md"
    )


def test_a_changed_choice_that_turns_a_claim_is_named():
    found = Verdicts([claim(TRUE)], RECORDS, turned={"name": ["$K$ halved"]})
    assert "The verdict changes with one of our choices: $K$ halved." in found.render("verdicts.md")
    assert found.render("verdicts-summary.md") == "Of 1 claims, 1 depends on the reading.\n"


def test_the_summary_counts():
    some = [claim(TRUE), claim(TRUE), claim(FALSE), read(TRUE, o=FALSE), read(FALSE, o=TRUE)]
    assert Verdicts(some, RECORDS).render("verdicts-summary.md") == (
        "Of 5 claims, 1 is refuted, 2 depend on the reading and 2 are confirmed.\n"
    )


def test_the_list_has_every_claim_below_its_verdict():
    some = [
        claim(TRUE, name="a"),
        claim(FALSE, name="b", note="why"),
        claim(TRUE, name="c", note="not told"),
    ]
    assert Verdicts(some, RECORDS).render("verdicts-list.md", "/book").strip().splitlines() == [
        ":::{div} verdict verdict-refuted",
        "**✗ 1 refuted**",
        "",
        "- {doc}`b </book/model>`: why",
        ":::",
        "",
        ":::{div} verdict verdict-confirmed",
        "**✓ 2 confirmed**",
        "",
        "- {doc}`a </book/model>`",
        "- {doc}`c </book/model>`",
        ":::",
    ]


def test_choices_that_turn_a_claim_are_read_from_a_file(tmp_path):
    path = tmp_path / "verdicts.csv"
    assert claims.load_turned(path) == {}
    path.write_text(
        "variation,claim,verdict\npublished,a,confirmed\npublished,b,refuted\n"
        "K halved,a,refuted\nK halved,b,\nK doubled,a,confirmed\nK doubled,b,refuted\n"
    )
    assert claims.load_turned(path) == {"a": ["K halved"], "b": []}


def test_second_opinions_are_read_by_value(tmp_path):
    path = tmp_path / "opinions.toml"
    assert claims.load_opinions(path) == {}
    path.write_text(
        '[[opinion]]\nscript = "a.py"\nhow = "one way"\nvalues = ["10_a::gain"]\n'
        '[[opinion]]\nscript = "b.py"\nhow = "another"\nvalues = ["10_a::gain", "10_a::order"]\n'
    )
    assert claims.load_opinions(path) == {
        "10_a::gain": ["one way", "another"],
        "10_a::order": ["another"],
    }


CLAIMS = """
[[claim]]
name = "the gain"
where = "Section 4"
text = "the gain is 1014"
page = "gain"
tests = [{ value = "10_a::gain", equals = 1014.0, tolerance = 0.5 }]

[[claim]]
name = "the order"
where = "Table 1"
text = "sixth order"
page = "order"
tests = [{ value = "10_a::order", equals = 6 }]
"""


def test_verdicts_are_written_beside_the_results(project, monkeypatch):
    monkeypatch.chdir(project.root)
    project.claims.parent.mkdir()
    project.claims.write_text(CLAIMS)
    project.results.mkdir(parents=True)
    complete = {name: record | {"tolerance": None} for name, record in RECORDS["10_a"].items()}
    (project.results / "10_a.json").write_text(to_json(complete))
    claims.main(project.results)
    written = {path.name: path.read_text() for path in project.results.glob("verdicts*")}
    assert sorted(written) == [
        "verdicts-list.md",
        "verdicts-summary.md",
        "verdicts.csv",
        "verdicts.md",
    ]
    assert written["verdicts-summary.md"] == "Of 2 claims, 1 is refuted and 1 is confirmed.\n"
    assert written["verdicts.csv"].splitlines() == [
        "claim,where,verdict",
        "the gain,Section 4,confirmed",
        "the order,Table 1,refuted",
    ]


def test_a_missing_value_is_an_error_that_names_it(project, monkeypatch, capsys):
    with pytest.raises(ClaimError, match="10_a::gone"):
        claim(Test("10_a::gone", above=1.0)).verdict(RECORDS)
    monkeypatch.chdir(project.root)
    project.claims.parent.mkdir()
    project.claims.write_text(CLAIMS)
    project.results.mkdir(parents=True)
    (project.results / "10_a.json").write_text("{}")
    assert run(claims.main, [str(project.results)]) == 1
    assert "needs 10_a::gain, which is not recorded" in capsys.readouterr().err
    assert not list(project.results.glob("verdicts*"))


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
        (lambda: claim(TRUE, readings=[Reading("other", [TRUE])]), "name the reading"),
    ],
)
def test_malformed_claims_are_refused(make, message):
    with pytest.raises(ClaimError, match=message):
        make()


def test_an_unknown_key_is_refused(tmp_path):
    path = tmp_path / "claims.toml"
    path.write_text('[[claim]]\nname = "a"\nwhere = "b"\ntext = "c"\npage = "d"\nwhy = "e"\n')
    with pytest.raises(ClaimError, match=r"^claims.toml, a: .*why"):
        claims.load(path)
