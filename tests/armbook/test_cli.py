"""Tests of the command line that execute nothing; reruns and checks have files of their own."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from armbook.cli import main
from armsim.paths import DATA
from reportkit.parameters import read, sources
from reportkit.project import Project

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"


@pytest.fixture(autouse=True)
def empty(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_list_shows_every_notebook_in_eighty_columns(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["list"]) == 0
    text = capsys.readouterr().out
    for path in NOTEBOOKS.glob("*.ipynb"):
        assert f"{path.stem}\n" in text
    assert max(map(len, text.splitlines())) <= 80


@pytest.mark.parametrize("path", sources(NOTEBOOKS), ids=lambda path: path.stem)
def test_parameters_of_the_report_are_described(path):
    found = read(path, Project.find(path).read_choices())
    assert found.title
    assert found.summary.endswith(".")
    assert found.parameters


def test_list_of_one_tells_default_help_and_range(capsys):
    assert main(["list", "30"]) == 0
    text = capsys.readouterr().out
    assert "T_p = 0.04\n" in text
    assert "0.021 to 4.74 (s)" in text
    assert "20_linear" not in text
    assert main(["list", "52"]) == 0
    assert "\n    only with fine_step < coarse_step\n" in capsys.readouterr().out


def test_list_for_scripts(capsys):
    assert main(["list", "10", "--json"]) == 0
    (model,) = json.loads(capsys.readouterr().out)
    assert model["name"] == "10_model"
    assert model["parameters"] == [
        {"name": "fit", "default": "ndp", "unit": None, "help": "column of Table 5",
         "allowed": "ndp | rk6", "type": "str"}
    ]  # fmt: skip
    assert model["conditions"] == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("list 77", "77: no notebook in"),
        ("rerun linear_step", "did you mean 20_linear_step_response?"),
        ("rerun model -p fot rk6", "fot: not a parameter of 10_model; did you mean fit?"),
        ("rerun 10 -p fit rk5", "fit = 'rk5': expected a text, ndp | rk6"),
        ("rerun 30 -p T_p -1e-3", "T_p = -0.001: expected a number, 0.021 to 4.74 (s)"),
        ("rerun 20 -p T_p_values -1,-.5", "T_p_values = [-1.0, -0.5]: expected a list"),
        ("rerun 30 -p T_p 1 -p T_p 1", "T_p: given twice"),
        ("rerun 30 -f none.toml", "none.toml: not a TOML file in UTF-8"),
        ("rerun 30 -f bad.toml", "bad.toml: not a TOML file in UTF-8"),
        ("rerun 30 -f binary.toml", "binary.toml: not a TOML file in UTF-8"),
        ("rerun 30 -f deep.toml", "deep.toml: not a TOML file in UTF-8: maximum recursion depth"),
        ("rerun 30 -f digits.toml", "T_p = 1000"),
        ("rerun 30 -f hex.toml", "Exceeds the limit (4300 digits)"),
        ("rerun 30 -f bad.toml -f deep.toml", "-f: given twice"),
        ("rerun 30 -o a -o b", "-o: given twice"),
        ("rerun 30 -o bad.toml/runs", "Not a directory: "),
        ("rerun 30 -o LONG", "File name too long: "),
        ("rerun 30 -f LONG", "File name too long: "),
        ("rerun LONG", "no notebook in"),
        ("rerun 52 -p axis LONG", "there is no such file"),
        ("rerun 52 -p axis bad\udcff.toml", "its name is not UTF-8"),
        ("rerun 52 -p axis bad.toml", "bad.toml: not a TOML file in UTF-8"),
        ("rerun 52 -p axis deep.toml", "deep.toml: not a TOML file in UTF-8"),
        ("rerun 52 -p measurements bad.toml", "bad.toml, row 1: no column 'T_p ='"),
        ("rerun 52 -p measurements ms.csv", "record: position varies by 0.0421, summed velocity"),
        ("rerun 52 -p bounds F_0=[1,2", "bounds = 'F_0=[1,2': expected NAME = [LOW, HIGH]"),
        ("rerun 52 -p bounds F_0=[2,1]", "bounds of F_0: [2, 1]; 0 < low < high are needed"),
        ("rerun 60 -p step_sizes 9e-5,8e-5,4e-5,2e-5,1e-5,5e-6", "each half of the one before"),
        (
            "rerun 52 -p coarse_step 5e-6",
            "fine_step = 5e-06, coarse_step = 5e-06: expected fine_step < coarse_step",
        ),
    ],
)
def test_misuse_is_told_in_one_line_and_writes_nothing(empty, capsys, arguments, message):
    files = {"bad.toml": "T_p = ", "deep.toml": "T_p = " + 5000 * "[", "ms.csv": in_ms(),
             "digits.toml": f"T_p = {10**400}", "hex.toml": f"T_p = 0x{4400 * 'f'}"}  # fmt: skip
    for name, text in files.items():
        (empty / name).write_text(text)
    (empty / "binary.toml").write_bytes(b"\xff\xfe")
    (empty / "bad\udcff.toml").touch()
    before = sorted(os.listdir(empty))
    assert main(arguments.replace("LONG", 5000 * "a").split()) == 2
    told = capsys.readouterr()
    assert told.out in ("", "30_nonlinear_step_response: executing\n")
    assert told.err.startswith(f"armsim {arguments.split()[0]}: ")
    assert told.err.count("\n") == 1
    assert message in told.err
    assert sorted(os.listdir(empty)) == before


def in_ms():
    """The published record, with its times in ms."""
    lines = (DATA / "measurements" / "x_axis_test.csv").read_text(encoding="utf-8").splitlines()
    rows = (line.split(",", 1) for line in lines[4:])
    return "\n".join([lines[3], *(f"{1000 * float(time)},{rest}" for time, rest in rows)])


def test_mark_of_byte_order_is_no_error(empty, capsys):
    """A file of parameters is read with it, as the file of an axis is."""
    (empty / "bom.toml").write_text("\ufeffT_p = 5\n", encoding="utf-8")
    assert main("rerun 30 -f bom.toml".split()) == 2
    assert "T_p = 5: expected a number, 0.021 to 4.74 (s)" in capsys.readouterr().err


def test_output_on_a_file_is_refused(empty, capsys):
    (empty / "runs").touch()
    assert main(["rerun", "30"]) == 2
    assert "Error: Invalid value for '-o' / '--output': Directory 'runs' is a file." in (
        capsys.readouterr().err
    )


def test_full_disk_is_told_in_one_line():
    command = [sys.executable, "-m", "armbook.cli", "list"]
    with open("/dev/full", "w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
    told = "armsim list: [Errno 28] No space left on device\n"
    assert (done.returncode, done.stderr) == (2, told)


@pytest.mark.parametrize("arguments", ["", "rerun", "rerun 10 -p fit", "run 10", "check --force"])
def test_command_that_makes_no_sense_exits_with_two(capsys, arguments):
    assert main(arguments.split()) == 2
    told = capsys.readouterr().err
    assert told.startswith("Usage: armsim") or "Error: Option '-p' requires 2 arguments" in told


def test_command_line_imports_nothing_slow():
    code = "import sys, armbook.cli; print({'numpy', 'nbformat', 'papermill'} & {*sys.modules})"
    assert subprocess.check_output([sys.executable, "-c", code], text=True) == "set()\n"


def test_reader_that_stops_early_is_no_error():
    command = f"{sys.executable} -m armbook.cli list | head -1"
    done = subprocess.run(command, shell=True, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("10_model\n", "")
