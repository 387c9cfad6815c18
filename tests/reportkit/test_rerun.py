"""Tests of reruns, as processes where it matters that they are; each starts a kernel."""

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from html.parser import HTMLParser

import numpy as np
import psutil
import pytest

from reportkit import rerun as module
from reportkit.cli import main
from reportkit.text import to_json


@pytest.fixture
def folder(project, monkeypatch):
    """Go to an empty folder of the report, whose notebook has expected values."""
    project.expected.mkdir(parents=True)
    records = {
        "double": {"value": 2.0, "unit": "m", "tolerance": None},
        "same": {"value": 3, "unit": "1", "tolerance": None},
        "own": {"value": "", "unit": None, "tolerance": None},
    }
    (project.expected / "50_trial.json").write_text(to_json(records))
    (project.root / "here").mkdir()
    monkeypatch.chdir(project.root / "here")
    return project.root / "here"


@pytest.fixture
def arguments(folder, notebook, study):
    """Write the notebook, with further cells, and return the arguments that rerun it."""

    def write(*cells):
        notebook(study, *cells)
        return ["rerun", "trial"]

    return write


def start(arguments):
    command = [sys.executable, "-m", "reportkit.cli", *arguments]
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


def test_each_figure_of_a_rerun_has_its_own_text_or_that_of_its_cell(folder, notebook, study):
    several = """from IPython.display import Image, display
from matplotlib.figure import Figure
study.figure("one", Figure(), alt="Of the first")
study.figure("two", Figure(), alt="Of the second")
display(Image(b"png", format="png"), metadata={"image/png": {"alt": "Of the picture"}})"""
    source = notebook(study, several, 'study.figure("three", Figure())')
    content = json.loads(source.read_text(encoding="utf-8"))
    content["cells"][-1]["metadata"] = {"mystnb": {"image": {"alt": "Of the cell"}}}
    source.write_text(json.dumps(content), encoding="utf-8")
    assert main(["rerun", "trial"]) == 0
    (made,) = (folder / "runs").iterdir()
    page = Page((made / "50_trial.html").read_text(encoding="utf-8"))
    own = ["A line that rises from zero", "Of the first", "Of the second", "Of the picture"]
    assert page.alts == [*own, "Of the cell"]


def test_rerun_makes_a_folder_with_everything(arguments, folder, capsys):
    (folder / "own.txt").write_text("measured")
    (folder / "given.toml").write_text('size = 3\nmotion = "own.txt"\n')
    (folder / "numpy.py").write_text("raise SystemExit")  # must not stand in for the module
    kernel = "import platform\nplatform.python_version = lambda: '4.0'"
    assert main([*arguments(kernel), "-f", "given.toml", "-p", "size", "2"]) == 0
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
        "provenance.toml",
        "values.csv",
    ]
    assert (made / "values.csv").read_text().splitlines()[1] == "double,4.0,m"
    with open(made / "comparison.csv") as file:
        rows = [list(row.values()) for row in csv.DictReader(file)]
    assert rows == [
        ["double", "2.0", "4.0", "2.0", "1.0", "m", "yes"],
        ["same", "3", "3", "0", "0.0", "1", "no"],
        ["own", "", "measured", "", "", "", "yes"],
    ]
    told = capsys.readouterr()
    assert "double          2          4         +2          +100 %    m" in told.out
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
    assert "2 of 3 recorded values changed." in text
    assert f"numpy {np.__version__}, Python 4.0." in text  # those of the kernel
    assert 'Python" = "4.0"' in (made / "provenance.toml").read_text()
    assert "provenance" not in (made / "50_trial.ipynb").read_text()


def test_windows_lists_and_checks_and_says_that_it_cannot_rerun(
    arguments, folder, capsys, monkeypatch
):
    monkeypatch.setitem(sys.modules, "fcntl", None)
    for name in ("execute", "locks", "rerun"):
        monkeypatch.delitem(sys.modules, f"reportkit.{name}", raising=False)
    assert main(["list", *arguments()[1:]]) == 0
    shutil.copytree("../data/expected", "../book/results")
    assert main(["check"]) == 0
    capsys.readouterr()
    assert main(arguments()) == 2
    told = "toy rerun: notebooks run on Linux and macOS; on Windows, use WSL\n"
    assert capsys.readouterr().err == told


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
    assert message.strip() == "toy rerun: interrupted, nothing half-written"
    assert list((folder / "runs").iterdir()) == []


def test_killed_run_is_cleared_away_and_a_living_one_is_not(arguments, folder):
    """Of two runs one is killed with its guard; what it leaves goes with the next."""
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
    children = psutil.Process(killed.pid).children()
    next(child for child in children if child.cmdline()[0] == "sh").kill()
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
