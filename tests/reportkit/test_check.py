"""Tests of the comparison with what is expected, through the command that makes it."""

import errno
import os
import shutil

import pytest

from reportkit.check import load_all
from reportkit.cli import main
from reportkit.text import to_json

RECORDS = {
    "speed": {"value": 1.5, "unit": "m/s", "tolerance": 0.01},
    "free": {"value": 1.5, "unit": None, "tolerance": None},
    "share": {"value": 2.0, "unit": "1", "tolerance": None, "relative": 0.1},
    "time": {"value": 0.3, "unit": "s", "tolerance": None, "compared": False},
    "count": {"value": 3, "unit": "1", "tolerance": None},
    "best": {"value": "RK6", "unit": None, "tolerance": None},
    "agrees": {"value": True, "unit": None, "tolerance": None},
}


@pytest.fixture
def folders(project, monkeypatch):
    """Folders of a report with the same built and expected records."""
    for folder in (project.results, project.expected):
        folder.mkdir(parents=True)
        (folder / "50_x.json").write_text(to_json(RECORDS))
    monkeypatch.chdir(project.root)
    return project.results, project.expected


def check(*arguments):
    return main(["check", *map(str, arguments)])


def build(folders, **changes):
    records = {name: RECORDS[name] | changes.get(name, {}) for name in RECORDS}
    (folders[0] / "50_x.json").write_text(to_json(records))


def test_what_is_as_expected_passes(folders, capsys):
    assert check() == 0
    assert capsys.readouterr().out == "7 values are as expected\n"


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("speed", {"value": 1.5099}),
        ("free", {"value": 1.5 * (1 + 9e-10)}),
        ("share", {"value": 2.19}),
        ("time", {"value": 77.0}),
        ("count", {"value": 3.0}),
    ],
)
def test_what_is_tolerated_passes_and_keeps_its_old_digits(folders, name, change):
    build(folders, **{name: change})
    assert check() == 0
    assert check("--update") == 0
    assert (folders[1] / "50_x.json").read_text() == to_json(RECORDS)


@pytest.mark.parametrize(
    ("name", "change", "row"),
    [
        ("speed", {"value": 1.5101}, "speed 1.5 1.5101 0.01 50_x"),
        ("speed", {"tolerance": 0.02}, "speed 1.5 1.5 0.01 → 0.02 50_x, tolerance"),
        ("speed", {"relative": 0.1}, "speed 1.5 1.5 0.01 → 10 % 50_x, tolerance"),
        ("speed", {"compared": False}, "speed 1.5 1.5 0.01 → not compared 50_x, tolerance"),
        ("speed", {"unit": "km/s"}, "speed 1.5 m/s 1.5 km/s 0.01 50_x, unit"),
        ("free", {"value": 1.500000002}, "free 1.5 1.500000002 1.5e-09 50_x"),
        ("share", {"value": 2.21}, "share 2 2.21 10 % 50_x"),
        ("share", {"value": -2.0}, "share 2 -2 10 % 50_x"),
        ("count", {"value": 4}, "count 3 4 0 50_x"),
        ("best", {"value": "DP5"}, "best RK6 DP5 equal 50_x"),
        ("best", {"value": 6}, "best RK6 6 equal → 0 50_x"),
        ("agrees", {"value": False}, "agrees True False equal 50_x"),
        ("agrees", {"value": 1}, "agrees True 1 equal → 0 50_x"),
    ],
)
def test_what_moved_is_told_and_can_be_made_the_expectation(folders, capsys, name, change, row):
    build(folders, **{name: change})
    assert check() == 1
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert lines[0] == "name expected got tolerance notebook"
    assert lines[2:] == [
        row,
        "1 of 7 values moved. If intended: toy check --update",
    ]
    assert check("--update") == 0
    assert check() == 0
    built, expected = (folder / "50_x.json" for folder in folders)
    assert built.read_bytes() == expected.read_bytes()


def test_missing_and_new_values_and_notebooks_are_told(folders, capsys):
    built, expected = folders
    (built / "50_x.json").write_text(to_json({"speed": RECORDS["speed"], "new": RECORDS["free"]}))
    (built / "52_new.json").write_text(to_json({"a": RECORDS["free"]}))
    (expected / "51_gone.json").write_text(to_json({"b": RECORDS["count"]}))
    assert check() == 1
    told = capsys.readouterr().out
    for row in ("new – 1.5 1.5e-09 50_x, new", "count 3 – 0 50_x, missing",
                "b 3 – 0 51_gone, missing", "a – 1.5 1.5e-09 52_new, new"):  # fmt: skip
        assert row in " ".join(told.split())
    assert check("--update") == 0
    assert load_all(built) == load_all(expected)
    assert sorted(path.name for path in expected.iterdir()) == ["50_x.json", "52_new.json"]


def test_first_expectations_are_what_was_built(folders):
    shutil.rmtree(folders[1])
    assert check() == 1
    assert check("--update") == 0
    assert check() == 0


def test_expectations_that_cannot_be_written_are_told(folders, capsys, monkeypatch):
    def write(path, text):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), path.name)

    monkeypatch.setattr("reportkit.text.write", write)
    assert check("--update") == 2
    assert capsys.readouterr().err == "toy check: [Errno 30] Read-only file system: '50_x.json'\n"


@pytest.mark.parametrize("text", ["", "[]", "[3]", '{"a": 1}', '{"a": {"value": 1}}'])
def test_file_without_records_is_named(folders, capsys, text):
    (folders[1] / "50_x.json").write_text(text)
    assert check() == 2
    assert "50_x.json is not the record of a study" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [[], ["--update"]])
def test_nothing_built_is_misuse(folders, capsys, arguments):
    (folders[0] / "50_x.json").unlink()
    assert check(*arguments) == 2
    assert "build them first" in capsys.readouterr().err
    assert (folders[1] / "50_x.json").exists()
