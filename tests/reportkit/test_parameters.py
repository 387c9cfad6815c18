"""Tests of what is read from a cell of parameters, and of what it lets pass."""

import json

import pytest

from reportkit.parameters import ParameterError, find, read

CELL = """
T_p = 0.04  # s, time constant; 0.001 to 10
count = 3  # 1, number of runs; at least 1
gain = 2  # V/V, gain; 1 | 2 | 4
fit = "ndp"  # column of Table 5; ndp | rk6
quick = False  # leave out what takes long
# s, step sizes
# of the runs; 2 or more values, each above 0
steps = [
    1e-4,
    5e-5,
]
motion = ""  # measured motion, empty for the published one; path
least = 1  # 1, least number of runs; 0 to 9
# 1, sizes; 2 or more values, each half of the one before, each 1 to 64
halves = [4, 2]

# require: least < count
# require: gain != count
"""


@pytest.fixture
def notebook(tmp_path):
    def write(
        cell=CELL, text="# The title\n\nSee eq. (3), for\nwhat it does. And more.", name="50_x"
    ):
        cells = [
            {"cell_type": "markdown", "metadata": {}, "source": text.splitlines(True)},
            {"cell_type": "code", "metadata": {"tags": ["parameters"]}, "source": cell},
        ]
        path = tmp_path / f"{name}.ipynb"
        path.write_text(json.dumps({"cells": cells}))
        return path

    return write


def test_comments_tell_unit_help_and_range(notebook):
    found = read(notebook())
    assert found.title == "The title"
    assert found.summary == "See eq. (3), for what it does."
    T_p, count, gain, fit, quick, steps, motion, _, halves = found.parameters.values()
    assert (T_p.default, T_p.unit, T_p.help) == (0.04, "s", "time constant")
    assert T_p.wanted == "a number, 0.001 to 10 (s)"
    assert count.wanted == "an integer, at least 1"
    assert gain.wanted == "an integer, 1 | 2 | 4 (V/V)"
    assert (fit.unit, fit.wanted, quick.wanted) == (None, "a text, ndp | rk6", "true or false")
    assert steps.help == "step sizes of the runs"
    assert steps.wanted == "a list of numbers, 2 or more values, each above 0 (s)"
    assert motion.wanted == "a file"
    assert halves.wanted == (
        "a list of integers, 2 or more values, each half of the one before, each 1 to 64"
    )
    assert found.conditions == ["least < count", "gain != count"]


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("T_p", "1", 1.0),
        ("T_p", "1e-3", 0.001),
        ("T_p", "10", 10.0),
        ("count", "7", 7),
        ("gain", "4", 4),
        ("fit", "rk6", "rk6"),
        ("quick", "True", True),
        ("quick", "no", False),
        ("steps", "[1e-4, 2]", [1e-4, 2.0]),
        ("steps", "1,2,3,", [1.0, 2.0, 3.0]),
        ("motion", "", ""),
        ("halves", "64,32,16,8", [64, 32, 16, 8]),
    ],
)
def test_texts_become_values(notebook, name, text, value):
    got = read(notebook()).values([(name, text)], {})[name]
    assert got == value
    assert type(got) is type(value)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("T_q", "1", "T_q: not a parameter of 50_x; did you mean T_p?"),
        ("zzzz", "1", "zzzz: not a parameter of 50_x; known are T_p, count, gain"),
        ("T_p", "0.0009", r"T_p = 0.0009: expected a number, 0.001 to 10 \(s\)"),
        ("T_p", "nan", "T_p = nan: expected a number"),
        ("T_p", "1e999", "T_p = inf: expected a number"),
        ("T_p", "", "T_p = '': expected a number"),
        ("count", "0", "count = 0: expected an integer, at least 1"),
        ("count", "1.0", "count = '1.0': expected an integer"),
        ("gain", "3", "gain = 3: expected an integer, 1 | 2 | 4"),
        ("fit", "RK6", "fit = 'RK6': expected a text, ndp | rk6"),
        ("quick", "maybe", "quick = 'maybe': expected true or false"),
        ("steps", "1e-4", r"steps = \[0.0001\]: expected a list of numbers, 2 or more values"),
        ("steps", "1,0", r"steps = \[1.0, 0.0\]: expected .* each above 0"),
        ("steps", "1,1", "steps = .*: each value only once"),
        ("steps", "", "steps = '': expected a list"),
        ("motion", "none.csv", "motion = 'none.csv': there is no such file"),
        ("halves", "64,16", r"halves = \[64, 16\]: expected .* each half of the one before"),
        ("halves", "8,16", r"halves = \[8, 16\]: expected .* each half of the one before"),
    ],
)
def test_text_that_will_not_do_is_refused(notebook, name, text, message):
    with pytest.raises(ParameterError, match=message):
        read(notebook()).values([(name, text)], {})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("T_p", True),
        ("T_p", "1"),
        ("T_p", 10**400),
        ("T_p", {"a": 1}),
        ("count", 2.0),
        ("quick", 1),
        ("fit", 1),
        ("steps", 1.0),
        ("steps", []),
        ("steps", [1.0, "2"]),
        ("motion", 3),
    ],
)
def test_value_of_another_type_is_refused(notebook, name, value):
    with pytest.raises(ParameterError, match=f"{name} = .*: expected "):
        read(notebook()).values([], {name: value})


def test_texts_win_over_a_table(notebook):
    found = read(notebook())
    given = found.values([("T_p", "2")], {"T_p": 1, "steps": [1, 2]})
    assert given == {"T_p": 2.0, "steps": [1.0, 2.0]}
    with pytest.raises(ParameterError, match="T_p: given twice"):
        found.values([("T_p", "2"), ("T_p", "2")], {})


def test_conditions_between_parameters_are_checked_with_the_defaults_of_the_others(notebook):
    found = read(notebook())
    assert found.values([("least", "4")], {"count": 5}) == {"least": 4, "count": 5}
    for given, told in (
        ({"least": 3}, "least = 3, count = 3: expected least < count"),
        ({"count": 1}, "least = 1, count = 1: expected least < count"),
        ({"count": 4, "gain": 4}, "gain = 4, count = 4: expected gain != count"),
    ):
        with pytest.raises(ParameterError, match=told):
            found.values([], given)


def test_path_is_taken_from_where_the_caller_is(notebook, tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "own.csv").touch()
    monkeypatch.chdir(tmp_path / "here")
    values = read(notebook()).values([("motion", "own.csv")], {})
    assert values == {"motion": str(tmp_path / "here" / "own.csv")}


@pytest.mark.parametrize(
    "line",
    [
        "T_p = 0.04",
        "T_p = 0.04  # time constant",
        "T_p = 0.04  # time constant; 1 to 2",
        "T_p = 0.04  # s, time constant",
        "T_p = 0.04  # s, time constant; from 1 to 2",
        "T_p = 0.04  # s, time constant; a to b",
        "T_p = 0.04  # s, time constant; 1 to 2",
        "T_p = 0.04  # s; 0 to 1",
        "T_p = 2 * 0.02  # s, time constant; 0 to 1",
        "T_p, K = 1, 2  # s, time constant; 0 to 1",
        "fit = 'a'  # column; b | c",
        "fit = 'a'",
        "steps = [1.0]  # s, steps; 0 to 2",
        "steps = []  # s, steps; each 0 to 2",
        "steps = ['a']  # s, steps; each 0 to 2",
        "steps = [1.0]  # s, steps; 2 values, each 0 to 2",
        "value = None  # s, value; 0 to 1",
        "value = (",
        "a = 1  # 1, value; 1 to 2\n# require: a < b",
        "a = 1  # 1, value; 1 to 2\n# require: a > a",
        "a = 1  # 1, value; 1 to 2\n# require: a < a",
        "a = 1  # 1, value; 1 to 2\n# require: a != a != a",
        "a = 1  # 1, value; 1 to 2\n# require:",
        "a = 1  # 1, value; 1 to 2\nb = ''  # a file; path\n# require: a < b",
    ],
)
def test_malformed_comment_names_the_notebook(notebook, line):
    with pytest.raises(ParameterError, match=r"50_x\.ipynb: "):
        read(notebook(line))


def test_file_that_is_no_notebook_is_named(tmp_path):
    for text in ("no JSON", "[]", '{"cells": 3}'):
        (tmp_path / "50_x.ipynb").write_text(text)
        with pytest.raises(ParameterError, match=r"50_x\.ipynb is not a notebook"):
            find("50", tmp_path)


@pytest.mark.parametrize("name", ["50_x", "50", "x", "50_x.ipynb", "notebooks/50_x.ipynb"])
def test_notebook_is_found_by_number_or_topic(notebook, tmp_path, name):
    notebook()
    notebook(name="51_other_topic")
    assert find(name, tmp_path).name == "50_x"


def test_unknown_notebook_comes_with_the_nearest(notebook, tmp_path):
    with pytest.raises(ParameterError, match="no notebooks in"):
        find("50", tmp_path)
    notebook(name="51_other_topic")
    with pytest.raises(ParameterError, match="did you mean 51_other_topic?"):
        find("51_other_topics", tmp_path)


def test_a_default_may_be_one_of_the_choices(tmp_path):
    cell = (
        'from kit import CHOICES\n\nlength = CHOICES["move"]["length"]  # m, of the move; 0 to 9\n'
    )
    cells = [{"cell_type": "code", "metadata": {"tags": ["parameters"]}, "source": cell}]
    path = tmp_path / "10_move.ipynb"
    path.write_text(json.dumps({"cells": cells}), encoding="utf-8")
    assert read(path, {"move": {"length": 2.5}}).parameters["length"].default == 2.5
    with pytest.raises(ParameterError, match="'move'"):
        read(path)
