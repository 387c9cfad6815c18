"""Tests of the sensitivity to our own choices: reading the file, counting, and its age."""

import pandas as pd
import pytest

from armbook.sensitivity import BASE, counts, largest, load, recorded, smallest_gain
from armsim.arm import AxisParameters, simulate
from armsim.paths import DATA
from reportkit import claims
from reportkit.check import compare, load_all

ROWS = """\
choice,factor,study,name,value
published,1.0,30_a,speed,2.0
published,1.0,30_a,pair,x
published,1.0,30_a,zero,0.0
K,2.0,30_a,speed,1.9
K,2.0,30_a,pair,y
K,2.0,30_a,zero,0.5
K,2.0,30_a,new,1.0
K,0.5,30_a,fails,no extrema
"""


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "choices.csv"
    path.write_text(ROWS)
    return load(path)


def test_changes_are_in_per_cent_of_the_published(table):
    speed = table[table["name"] == "speed"].iloc[0]
    assert (speed["factor"], speed["published"], speed["value"]) == (2.0, "2.0", "1.9")
    assert speed["change"] == pytest.approx(-5.0)
    for name in ("pair", "zero", "new"):  # a text, from zero, unknown before
        assert table[table["name"] == name]["change"].isna().all()


def test_counts(table):
    doubled, halved = counts(table).to_dict("records")
    assert (doubled["choice"], doubled["factor"], doubled["values"]) == ("K", 2.0, 4)
    assert (doubled["0.1 %"], doubled["1 %"], doubled["10 %"]) == (4, 4, 3)
    assert (halved["values"], halved["failed"]) == (0, "30_a")


def test_the_larger_change_of_each_value(table):
    more = table[table["name"] == "speed"].assign(factor=0.5, change=7.0)
    found = largest(recorded(pd.concat([table, more])))
    assert found["K", "30_a", "speed"] == 7.0
    assert set(found.index.get_level_values("name")) == {"speed", "pair", "zero", "new"}


def test_the_smallest_gain_holds_the_speed_and_no_smaller_one():
    p = AxisParameters.paper_x_axis()
    least = smallest_gain(p, 0.9)
    for factor, holds in ((1.01, True), (0.97, False)):
        run = simulate(p.replace(K_e=factor * least), 9.0, 4.0)
        assert (run(4.0)[1] > 0.899) == holds
        assert (abs(run.auxiliary([4.0])["v_c"][0]) >= p.V_L) != holds


def test_file_starts_from_the_values_of_the_book():
    """Else: data/sensitivity/make_sensitivity.py, see CONTRIBUTING."""
    rows = pd.read_csv(DATA / "sensitivity" / "choices.csv", dtype=str, keep_default_na=False)
    expected = load_all(DATA / "expected")
    base = rows[rows["choice"] == BASE]
    assert len(base) > 300
    for study, part in base.groupby("study"):
        now = expected[study]
        kept = {
            name: now[name] | {"value": _like(now[name]["value"], text)}
            for name, text in zip(part["name"], part["value"], strict=True)
        }
        moved = [
            pair.name for pair in compare(study, {n: now[n] for n in kept}, kept) if pair.moved
        ]
        assert moved == [], study


def test_verdicts_are_those_of_the_book():
    rows = pd.read_csv(DATA / "sensitivity" / "verdicts.csv", dtype=str, keep_default_na=False)
    published = rows[rows["variation"] == claims.PUBLISHED].set_index("claim")["verdict"]
    expected = load_all(DATA / "expected")
    now = {c.name: c.verdict(expected) for c in claims.load(DATA / "paper" / "claims.toml")}
    assert published.to_dict() == now
    assert rows.groupby("variation")["claim"].count().eq(len(now)).all()


def _like(value, text):
    if isinstance(value, bool):
        return text == "True"
    return text if isinstance(value, str) else type(value)(text)
