"""Tests of the verdicts, with made-up claims."""

import pytest

from reportkit import claims
from reportkit.claims import CONFIRMED, CORRECTED, REFUTED, UNTESTABLE, Claim, ClaimError, Test
from reportkit.text import to_json

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
    assert claims.main([str(project.results)]) == 0
    written = {path.name: path.read_text() for path in project.results.glob("verdicts*")}
    assert sorted(written) == [
        "verdicts-summary.md",
        "verdicts.csv",
        "verdicts.md",
        "verdicts.svg",
    ]
    assert written["verdicts-summary.md"] == "Of 2 claims, 1 is confirmed and 1 is refuted.\n"
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
    assert claims.main([str(project.results)]) == 1
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


def test_the_figure_names_every_claim():
    some = [claim(TRUE), claim(FALSE), claim(untestable=True, note="why")]
    fig = claims.figure(some, RECORDS)
    texts = [text.get_text() for text in fig.axes[0].texts]
    assert texts == ["1 confirmed", "name", "1 cannot be tested", "name", "1 refuted", "name"]
