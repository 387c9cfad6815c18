"""Tests of what a notebook records."""

import json

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from reportkit import figures
from reportkit import record as module
from reportkit.project import RESULTS_VARIABLE
from reportkit.record import Study, cell, scientific


@pytest.fixture
def glued(monkeypatch):
    values = {}
    monkeypatch.setattr(module, "glue", lambda name, value, display: values.update({name: value}))
    return values


@pytest.fixture
def shown(monkeypatch):
    shown = []
    monkeypatch.setattr(module, "display", lambda value, **_: shown.append(value))
    return shown


@pytest.fixture
def study(tmp_path, monkeypatch, glued, shown):
    monkeypatch.setenv(RESULTS_VARIABLE, str(tmp_path / "results"))
    return Study("20_topic")


def test_a_study_sets_the_style_of_figures(tmp_path, monkeypatch):
    monkeypatch.setenv(RESULTS_VARIABLE, str(tmp_path))
    with mpl.rc_context():
        mpl.rcdefaults()
        Study("20_topic")
        assert mpl.rcParams["figure.figsize"][0] == figures.WIDTH


@pytest.mark.parametrize(
    ("value", "form", "text"),
    [
        (1.234, ".2f", "1.23"),
        (-1.5, ".1f", "−1.5"),
        (-0.001, "z.2f", "0.00"),
        (12, "g", "12"),
        (np.float64(np.nan), ".2f", "–"),
        (np.inf, ".1f", "inf"),
    ],
)
def test_a_number_in_a_cell(value, form, text):
    assert cell(value, form) == text
    assert cell(value) == cell(value, ".2f")


def figure() -> Figure:
    fig = Figure()
    fig.subplots().plot([0, 1], [0, 1])
    return fig


def test_records_keep_value_unit_tolerance_and_order(study, glued):
    study.record("speed", np.float64(1.5), unit="m/s", tolerance=1e-9)
    study.record("count", np.int64(3))
    study.record("agrees", np.bool_(True))
    study.record("best", "RK6")
    kept = json.loads((study.results / "20_topic.json").read_text())
    assert list(kept) == ["speed", "count", "agrees", "best"]
    assert kept["speed"] == {"value": 1.5, "unit": "m/s", "tolerance": 1e-9}
    assert kept["count"] == {"value": 3, "unit": "1", "tolerance": None}
    assert kept["agrees"] == {"value": True, "unit": None, "tolerance": None}
    assert kept["best"]["unit"] is None
    assert glued == {"speed": 1.5, "count": 3, "agrees": "yes", "best": "RK6"}
    assert [type(value) for value in glued.values()] == [float, int, str, str]


def test_of_several_values_those_that_do_not_apply_are_left_out(study, glued):
    study.record_all({"rise": 1.5, "fall": np.nan, "zero": 0.0, "told": "RK6"}, tolerance=0.1)
    kept = json.loads((study.results / "20_topic.json").read_text())
    assert list(kept) == list(glued) == ["rise", "zero", "told"]
    assert kept["rise"]["tolerance"] == 0.1
    with pytest.raises(ValueError, match="endless"):
        study.record_all({"endless": np.inf})


@pytest.mark.parametrize("value", [np.nan, np.inf, None, [1.0], np.ones(2), 1j])
def test_value_that_is_none_is_refused(study, glued, value):
    with pytest.raises(ValueError, match=r"speed = .*finite number"):
        study.record("speed", value)
    assert not glued
    assert not (study.results / "20_topic.json").exists()


def test_several_values_are_recorded_under_one_rule(study):
    study.record_all({"fast": 1.5, "slow": np.float64(2.5)}, "s", relative=0.1)
    kept = json.loads((study.results / "20_topic.json").read_text())
    assert kept["slow"] == {"value": 2.5, "unit": "s", "tolerance": None, "relative": 0.1}
    assert list(kept) == ["fast", "slow"]


def test_tolerance_may_be_relative_or_absent(study):
    study.record("share", 1.5, relative=np.float64(0.1))
    study.record("time", 1.5, unit="s", compared=False)
    kept = json.loads((study.results / "20_topic.json").read_text())
    assert kept["share"] == {"value": 1.5, "unit": "1", "tolerance": None, "relative": 0.1}
    assert kept["time"] == {"value": 1.5, "unit": "s", "tolerance": None, "compared": False}


@pytest.mark.parametrize("tolerance", [-1, np.nan, "1"])
@pytest.mark.parametrize("kind", ["tolerance", "relative"])
def test_tolerance_that_is_none_is_refused(study, kind, tolerance):
    with pytest.raises(ValueError, match=r"tolerance of speed = .* >= 0"):
        study.record("speed", 1.0, **{kind: tolerance})


def test_tolerance_is_not_absolute_and_relative(study):
    with pytest.raises(ValueError, match="tolerance of speed: absolute or relative, not both"):
        study.record("speed", 1.0, tolerance=1, relative=1)


@pytest.mark.parametrize("name", ["", "1st", "a b", "a:b", "ü", None])
def test_name_that_text_cannot_quote_is_refused(study, name):
    for call in (lambda: study.record(name, 1), lambda: study.figure(name, figure())):
        with pytest.raises(ValueError, match="expected a letter"):
            call()


def test_names_are_used_once(study):
    study.record("a", 1)
    study.figure("a", figure())
    with pytest.raises(ValueError, match="'a': already"):
        study.record("a", 2)
    with pytest.raises(ValueError, match="'a': already"):
        study.table("a", pd.DataFrame())


@pytest.mark.parametrize("name", ["topic", "2_topic", "20-topic", "20_Topic", "../20_topic"])
def test_study_needs_the_name_of_a_notebook(name):
    with pytest.raises(ValueError, match="NN_topic"):
        Study(name)


def test_figure_has_the_same_bytes_each_time_and_no_ground(study):
    study.figure("one", figure())
    study.figure("two", figure())
    one, two = ((study.results / f"20_topic-{key}.svg").read_text() for key in ("one", "two"))
    assert one == two
    assert "<dc:date>" not in one
    assert "fill: #ffffff" not in one


def test_data_of_a_figure_stand_beside_it(study):
    study.figure("one", figure(), {"t / s": np.array([0.0, 0.1, 0.2]), "dots": [1, 2]})
    text = (study.results / "20_topic-one.csv").read_text()
    assert text == "t / s,dots\n0,1\n0.1,2\n0.2,\n"


def test_table_escapes_bars_and_sets_numbers_right(study, shown):
    study.table("t", pd.DataFrame({"$|x|$": ["$x_1$", "a\nb"], "value": ["1.5", "−2"]}))
    text = (study.results / "20_topic-t.md").read_text()
    assert text.splitlines() == [
        r"| $\|x\|$ | value |",
        "| --- | ---: |",
        "| $x_1$ | 1.5 |",
        "| a b | −2 |",
    ]
    assert shown[0].data == text


@pytest.mark.parametrize(
    ("rows", "columns"),
    [
        ([["a", 1], ["b", 2]], ["name", "value"]),
        (zip("ab", (1, 2), strict=True), ["name", "value"]),
        ([{"name": "a", "value": 1}, {"name": "b", "value": 2}], None),
    ],
)
def test_table_is_made_of_rows(study, rows, columns):
    study.table("t", rows, columns)
    text = (study.results / "20_topic-t.md").read_text()
    assert text == "| name | value |\n| --- | ---: |\n| a | 1 |\n| b | 2 |\n"


def test_table_sets_a_column_right_if_most_of_it_are_numbers(study):
    cells = {"some": ["1", "–", "not yet"], "most": ["1", "–", "2"], "none": ["–", "a", "b"]}
    cells |= {"lists": ["1, 2", "1, 2, 3", "4"], "one": ["–", "–", 1]}
    study.table("t", pd.DataFrame(cells))
    rules = (study.results / "20_topic-t.md").read_text().splitlines()[1]
    assert rules == "| --- | ---: | --- | --- | ---: |"


def test_table_needs_headings(study):
    with pytest.raises(ValueError, match=r"table t: a heading is missing in \['', 'value'\]"):
        study.table("t", pd.DataFrame({"": ["x"], "value": ["1"]}))
    assert not list(study.results.iterdir())


def test_page_is_kept_as_it_is(study):
    study.page("p", "<p>α &lt; β</p>\n")
    assert (study.results / "20_topic-p.html").read_text(encoding="utf-8") == "<p>α &lt; β</p>\n"
    with pytest.raises(ValueError, match="already recorded"):
        study.page("p", "")


def test_run_by_hand_keeps_to_its_own_folder(tmp_path, monkeypatch, glued):
    monkeypatch.delenv(RESULTS_VARIABLE, raising=False)
    monkeypatch.chdir(tmp_path)
    Study("20_topic").record("a", 1)
    assert [str(path) for path in tmp_path.rglob("*.json")] == [
        str(tmp_path / "runs" / "20_topic" / "20_topic.json")
    ]


def test_data_are_kept_as_csv_under_a_key_of_their_own(study, shown):
    study.data("raw", pd.DataFrame({"seconds": [0.1, 1 / 3], "function": ["a", "b"]}))
    text = (study.results / "20_topic-raw.csv").read_text()
    assert text == "seconds,function\n0.1,a\n0.333333333,b\n"
    assert not shown
    with pytest.raises(ValueError, match="only once"):
        study.figure("raw", figure())


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.0694, 1, r"$6.9 \cdot 10^{-2}$"),
        (-1234.0, 2, r"$-1.23 \cdot 10^{3}$"),
        (0.0, 0, r"$0 \cdot 10^{0}$"),
    ],
)
def test_scientific_notation(value, digits, text):
    assert scientific(value, digits) == text
