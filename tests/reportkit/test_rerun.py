"""Tests of reruns, as processes where it matters that they are; each starts a kernel."""

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from html.parser import HTMLParser

import nbformat
import numpy as np
import pytest

from armbook.cli import main
from armsim.paths import DATA
from reportkit import rerun as module
from reportkit.check import to_json

PARAMETERS = """size = 1.0  # m, size; 0.1 to 10
motion = ""  # measured motion; path"""
STUDY = """
from matplotlib import pyplot as plt
from reportkit.record import Study
study = Study("50_trial")
study.record("double", 2 * size, unit="m")
study.record("same", 3)
study.record("own", open(motion).read() if motion else "")
fig, ax = plt.subplots()
ax.plot([0, size])
study.figure("line", fig, {"x": [0, size]}, alt="A line that rises from zero")
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Go to an empty folder, beside notebooks and expectations of one trial."""
    data, here = tmp_path / "data", tmp_path / "here"
    (data / "expected").mkdir(parents=True)
    records = {
        "double": {"value": 2.0, "unit": "m", "tolerance": None},
        "same": {"value": 3, "unit": None, "tolerance": None},
        "own": {"value": "", "unit": None, "tolerance": None},
    }
    (data / "expected" / "50_trial.json").write_text(to_json(records))
    monkeypatch.setattr(module, "DATA", data)
    here.mkdir()
    monkeypatch.chdir(here)
    return here


@pytest.fixture
def arguments(folder):
    """Write a notebook and return the arguments that rerun it."""

    def write(*cells):
        text = "# A trial $x_1$\n\nSee {doc}`../page` or $x^2$.\n\n| $|a|$ |\n|---|\n| 1 |"
        notebook = nbformat.v4.new_notebook(
            cells=[
                nbformat.v4.new_markdown_cell(text),
                nbformat.v4.new_code_cell(PARAMETERS, metadata={"tags": ["parameters"]}),
                *(nbformat.v4.new_code_cell(cell) for cell in (STUDY, *cells)),
            ]
        )
        (folder.parent / "notebooks").mkdir(exist_ok=True)
        nbformat.write(notebook, folder.parent / "notebooks" / "50_trial.ipynb")
        return ["rerun", "trial", "--notebooks", str(folder.parent / "notebooks")]

    return write


def start(arguments):
    command = [sys.executable, "-m", "armbook.cli", *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def wait_for(path, process):
    while not path.exists():
        assert process.poll() is None
        time.sleep(0.02)


class Page(HTMLParser):
    """What a browser would load for a page, and the alternative texts of its images."""

    def __init__(self, text):
        super().__init__()
        self.loads, self.alts = [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        if tag != "a":
            self.loads += [attributes[key] for key in ("src", "href", "data") if key in attributes]
        if tag == "img":
            self.alts.append(attributes["alt"])


def test_rerun_makes_a_folder_with_everything(arguments, folder, capsys):
    (folder / "own.txt").write_text("measured")
    (folder / "given.toml").write_text('size = 3\nmotion = "own.txt"\n')
    (folder / "numpy.py").write_text("raise SystemExit")  # must not stand in for the module
    assert main([*arguments(), "-f", "given.toml", "-p", "size", "2"]) == 0
    (made,) = (folder / "runs").iterdir()
    assert re.fullmatch(r"50_trial-\d{8}-\d{6}", made.name)
    assert sorted(path.name for path in made.iterdir()) == [
        "50_trial-line.csv",
        "50_trial-line.svg",
        "50_trial.html",
        "50_trial.ipynb",
        "50_trial.json",
        "comparison.csv",
        "parameters.toml",
        "values.csv",
    ]
    assert (made / "values.csv").read_text().splitlines()[1] == "double,4.0,m"
    with open(made / "comparison.csv") as file:
        rows = [list(row.values()) for row in csv.DictReader(file)]
    assert rows == [
        ["double", "2.0", "4.0", "2.0", "1.0", "m", "yes"],
        ["same", "3", "3", "0", "0.0", "", "no"],
        ["own", "", "measured", "", "", "", "yes"],
    ]
    told = capsys.readouterr()
    assert "double          2          4         +2          m" in told.out
    assert "2 of 3 recorded values changed" in told.out
    assert told.err == ""
    again = [*arguments(), "-f", str(made / "parameters.toml"), "-o", "again"]
    assert main(again) == 0
    (same,) = (folder / "again").iterdir()
    for name in ("50_trial.json", "50_trial-line.svg", "50_trial-line.csv", "comparison.csv"):
        assert (same / name).read_bytes() == (made / name).read_bytes()

    text = (made / "50_trial.html").read_text()
    page = Page(text)
    assert page.loads
    assert all(load.startswith("data:") for load in page.loads)
    assert not re.search(r"@import|url\(", text[: text.index("</style>")])
    assert page.alts == ["A line that rises from zero"]
    assert r"\(x^2\)" in text
    assert "<em>page</em>" in text
    assert "Of 3 recorded values 2 changed." in text


def test_failing_notebook_leaves_nothing(arguments, folder, capsys):
    assert main(arguments("1 / 0")) == 1
    assert "ZeroDivisionError: division by zero" in capsys.readouterr().err
    assert list((folder / "runs").iterdir()) == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interruption_leaves_nothing(arguments, folder, number):
    sign = folder / "sign"
    process = start(arguments(f"open({str(sign)!r}, 'w')\nimport time\ntime.sleep(10**6)"))
    wait_for(sign, process)
    process.send_signal(number)
    _, message = process.communicate()
    assert process.returncode == 130
    assert "nothing written" in message
    assert list((folder / "runs").iterdir()) == []


def test_killed_run_is_cleared_away_and_a_living_one_is_not(arguments, folder):
    """Of two runs at the same time one is killed; what it leaves goes with the next."""
    go, runs = folder / "go", folder / "runs"
    signs = [folder / "1", folder / "2"]
    wait = f"""
import os, pathlib, time
pathlib.Path({str(folder)!r}, str(int(size))).touch()
while not os.path.exists({str(go)!r}):
    time.sleep(0.02)"""
    command = arguments(wait)
    killed, living = (start([*command, "-p", "size", sign.name]) for sign in signs)
    wait_for(signs[0], killed)
    wait_for(signs[1], living)
    killed.send_signal(signal.SIGKILL)
    killed.communicate()
    assert len(list(runs.iterdir())) == 2
    assert all(path.name.startswith(".") for path in runs.iterdir())
    last = start([*command, "-p", "size", "3"])
    wait_for(folder / "3", last)
    assert len(list(runs.iterdir())) == 2
    go.touch()
    for process in (living, last):
        _, errors = process.communicate()
        assert (process.returncode, errors) == (0, "")
    values = {
        json.loads((made / "50_trial.json").read_text())["double"]["value"]
        for made in runs.iterdir()
    }
    assert values == {4.0, 6.0}


def test_runs_of_one_second_get_folders_of_their_own(tmp_path):
    for _ in range(3):
        (tmp_path / "new").mkdir()
        module._publish(tmp_path / "new", tmp_path, "50_trial-now")
    assert sorted(os.listdir(tmp_path)) == ["50_trial-now", "50_trial-now-2", "50_trial-now-3"]


def test_notebook_of_the_report_reruns(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["rerun", "10", "-p", "fit", "rk6"]) == 0
    (made,) = (tmp_path / "runs").iterdir()
    told = capsys.readouterr().out
    assert "saturation_current " in told
    assert str(made.relative_to(tmp_path) / "10_model.html") in told
    text = (made / "10_model.html").read_text()
    assert all(load.startswith("data:") for load in Page(text).loads)
    assert "application/papermill" not in text


def test_a_record_and_an_axis_of_the_users_own_are_fitted(tmp_path, monkeypatch, capsys):
    """Another axis than the book's, its record in other columns, a wrong start for two values."""
    from armsim.arm import simulate
    from armsim.arm.measurement import Measurement, read_axis, signals, write_measurement

    monkeypatch.chdir(tmp_path)
    text = (DATA / "axes" / "y.toml").read_text(encoding="utf-8")
    axis, noise = read_axis(DATA / "axes" / "y.toml")
    true = axis.replace(K_1=axis.K_1, V_L=0.95 * axis.V_L, B_a=1.1 * axis.B_a)
    (tmp_path / "my_axis.toml").write_text(
        text.replace("[instrument]", f"K_1 = {axis.K_1!r}\n\n[instrument]"), encoding="utf-8"
    )
    t = np.round(0.002 * np.arange(451), 9)
    volts = np.where(t < 0.45, 9.0, 0.0)
    ideal = signals(simulate(true, [(0.0, 9.0), (0.45, 0.0)], t[-1])(t), t, true)
    seen = ideal + noise.deviations * np.random.default_rng(1).standard_normal(ideal.shape)
    write_measurement("my_run.csv", Measurement(t, volts, *seen))
    files = "-p measurements my_run.csv -p axis my_axis.toml"
    short = "-p refits 20 -p fine_step 2e-5 -p starts 1"
    assert main(["rerun", "parameter_fit", *files.split(), *short.split()]) == 0
    (result,) = (tmp_path / "runs").iterdir()
    values = json.loads((result / "52_parameter_fit.json").read_text(encoding="utf-8"))
    for name in ("V_L", "B_a"):
        off = values[name]["value"] - getattr(true, name)
        assert abs(off) < 4 * values[f"{name}_error"]["value"]
    assert values["passed"]["value"] is True
    assert "V_L_true" not in values  # what is known of the published record only
