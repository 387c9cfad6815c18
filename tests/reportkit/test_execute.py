"""Tests of the execution of notebooks; each starts a kernel."""

import io
import json
import os
import signal
import subprocess
import sys
import time

import ipykernel.kernelspec
import nbformat
import pytest

from reportkit import execute as module
from reportkit.execute import NotebookError, execute
from reportkit.locks import LOCK_VARIABLE, locked
from reportkit.program import run

STUDY = """
import sys
from matplotlib import pyplot as plt
from reportkit.record import Study
study = Study("50_trial")
study.record("size", size)
fig, ax = plt.subplots()
ax.plot([0, size])
study.figure("line", fig, {"x": [0, size]}, alt="A line that rises from zero")
print("said", file=sys.stderr)
"""


@pytest.fixture
def notebook(tmp_path):
    """Write a notebook with these cells after one of parameters."""

    def write(*cells, name="50_trial"):
        parameters = nbformat.v4.new_code_cell("size = 1.0", metadata={"tags": ["parameters"]})
        code = [nbformat.v4.new_code_cell(cell) for cell in cells]
        path = tmp_path / f"{name}.ipynb"
        nbformat.write(nbformat.v4.new_notebook(cells=[parameters, *code]), path)
        return path

    return write


LOOP = """
from tqdm import tqdm
print("one")
for n in tqdm(range(4), unit="cases"):
    if n == 2:
        print("careful", file=sys.stderr)
print("two")
"""


class Screen(io.StringIO):
    def isatty(self):
        return True


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_two_runs_give_the_same_bytes_whatever_a_user_has_set(notebook, tmp_path, monkeypatch):
    source = notebook(STUDY, "{1, 2}", "import numba; print(sys.flags, numba.config.DISABLE_JIT)")
    results = [tmp_path / "one", tmp_path / "two"]
    assert execute(source, results[0]) == ["said"]
    (tmp_path / "startup.py").write_text("print('Good morning')\n")
    rules = "lines.markersize: 20\naxes.labelsize: 20\ntext.usetex: True\nno.such_key: 1\n"
    (tmp_path / "matplotlibrc").write_text(rules)
    other = tmp_path / "kernels" / "python3" / "kernel.json"
    other.parent.mkdir(parents=True)
    other.write_text('{"argv": ["false"], "display_name": "another", "language": "python"}')
    settings = {
        "JUPYTER_DEFAULT_PROVISIONER_NAME": "nowhere",
        "JUPYTER_PATH": str(tmp_path),
        "MPLBACKEND": "module://nowhere",
        "MPLCONFIGDIR": str(tmp_path),
        "NUMBA_DISABLE_JIT": "1",
        "PYTHONINSPECT": "1",
        "PYTHONOPTIMIZE": "2",
        "PYTHONSTARTUP": str(tmp_path / "startup.py"),
        "PYTHONUTF8": "0",
        "PYTHONWARNINGS": "error",
    }
    for name, value in settings.items():
        monkeypatch.setenv(name, value)
    assert execute(source, results[1]) == ["said"]
    assert os.environ.items() >= settings.items()
    one, two = map(contents, results)
    assert sorted(one) == [
        "50_trial-line.csv",
        "50_trial-line.svg",
        "50_trial.ipynb",
        "50_trial.json",
    ]
    assert one == two
    text = one["50_trial.ipynb"].decode()
    assert "said" not in json.dumps([cell["outputs"] for cell in json.loads(text)["cells"]])
    image = json.loads(text)["cells"][1]["metadata"]["mystnb"]["image"]
    assert image == {"alt": "A line that rises from zero"}


@pytest.mark.parametrize("own", ["", "Of the argument"])
def test_alternative_text_is_that_of_the_argument_or_of_the_cell(notebook, tmp_path, own):
    source = notebook(STUDY.replace("A line that rises from zero", own))
    content = json.loads(source.read_text(encoding="utf-8"))
    content["cells"][1]["metadata"] = {"mystnb": {"image": {"alt": "Of the cell", "width": "50%"}}}
    source.write_text(json.dumps(content), encoding="utf-8")
    execute(source, tmp_path / "results")
    made = json.loads((tmp_path / "results" / "50_trial.ipynb").read_text(encoding="utf-8"))
    image = made["cells"][1]["metadata"]["mystnb"]["image"]
    assert image == {"alt": own or "Of the cell", "width": "50%"}


def test_new_run_replaces_all_of_the_old(notebook, tmp_path):
    execute(notebook(STUDY), tmp_path / "results")
    execute(notebook(STUDY.replace('"line"', '"curve"')), tmp_path / "results", {"size": 3.0})
    files = contents(tmp_path / "results")
    assert "50_trial-line.svg" not in files
    assert "50_trial-curve.svg" in files
    assert json.loads(files["50_trial.json"])["size"]["value"] == 3.0


def test_failure_names_its_place_and_leaves_what_was(notebook, tmp_path, capsys):
    results = tmp_path / "results"
    execute(notebook(STUDY), results)
    before = contents(results)
    broken = notebook(STUDY.replace("1.0", "2.0"), "import json\njson.loads('?')")
    assert run(module.main, [str(broken), str(results)]) == 1
    message = capsys.readouterr().err
    for part in ("50_trial.ipynb failed in its code cell 3", "json.loads('?')", "JSONDecodeError:"):
        assert part in message
    assert "\x1b" not in message
    assert contents(results) == before


def test_failure_of_a_first_run_leaves_nothing(notebook, tmp_path):
    with pytest.raises(NotebookError, match="ZeroDivisionError: division by zero"):
        execute(notebook(STUDY, "1 / 0"), tmp_path / "results")
    assert contents(tmp_path / "results") == {}


def test_file_that_is_no_notebook_is_named(tmp_path):
    path = tmp_path / "50_trial.ipynb"
    path.write_text("no JSON")
    with pytest.raises(NotebookError, match=r"50_trial\.ipynb is not a notebook"):
        execute(path, tmp_path / "results")


@pytest.mark.parametrize(
    ("code", "why"),
    [
        (
            "raise OSError(28, 'No space left on device')",
            "OSError: [Errno 28] No space left on device",
        ),
        ("", "Kernel died before replying to kernel_info"),
    ],
)
def test_kernel_that_dies_before_it_answers_is_an_error_of_one_line(
    notebook, tmp_path, capfd, monkeypatch, code, why
):
    spec = {"argv": [sys.executable, "-c", code], "display_name": "", "language": "python"}
    monkeypatch.setattr(ipykernel.kernelspec, "get_kernel_dict", lambda: spec)
    source = notebook()
    assert run(module.main, [str(source), str(tmp_path / "results")]) == 1
    assert capfd.readouterr().err == f"{source} failed: its Python did not start: {why}\n"
    assert contents(tmp_path / "results") == {}


def test_folder_that_cannot_be_made_is_an_error_of_one_line(notebook, capfd):
    source = notebook()
    assert run(module.main, [str(source), str(source / "results")]) == 1
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("[Errno ")
    assert line.endswith(f"{source / 'results'}'")


def test_usage_is_told(capsys):
    assert run(module.main, ["one.ipynb"]) == 2
    assert capsys.readouterr().err == "usage: python -m reportkit.execute SOURCE RESULTS\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interruption_leaves_nothing(notebook, tmp_path, number):
    sign, results = tmp_path / "sign", tmp_path / "results"
    cell = f"import pathlib, time\npathlib.Path({str(sign)!r}).touch()\ntime.sleep(10**6)"
    command = [sys.executable, "-m", "reportkit.execute", notebook(STUDY, cell), results]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=dict(os.environ))
    while not sign.exists():
        assert process.poll() is None
        time.sleep(0.05)
    process.send_signal(number)
    _, message = process.communicate()
    assert process.returncode == 130
    assert "nothing published" in message
    assert contents(results) == {}


MEASURING = """
import fcntl, pathlib, time
from reportkit.locks import locked
from reportkit.timing import measure

def others():
    with locked(pathlib.Path({folder!r}), wait=False, kind=fcntl.LOCK_SH):
        return True

assert others()
try:
    measure(dict(f=others), 1, warm_up=False)
except BlockingIOError:
    print("alone")
assert others()
"""


def test_a_notebook_that_measures_has_the_machine_alone_meanwhile(notebook, tmp_path):
    """Its kernel turns the lock that it shares with other notebooks into one of its own."""
    source = notebook(MEASURING.format(folder=str(tmp_path)))
    assert run(module.main, [str(source), str(tmp_path / "results")]) == 0
    assert '"alone\\n"' in (tmp_path / "results" / source.name).read_text()
    with locked(tmp_path, wait=False):
        assert LOCK_VARIABLE not in os.environ


def test_progress_is_told_as_it_goes_and_not_published(notebook, tmp_path, capsys, monkeypatch):
    source = notebook(STUDY, LOOP)
    folders = [tmp_path / name for name in ("log", "short", "screen")]
    at_once = {"TQDM_MININTERVAL": "0", "TQDM_DELAY": "0"}
    monkeypatch.setattr(module, "_bars", lambda name, bars=module._bars: bars(name) | at_once)
    assert execute(source, folders[0]) == ["said", "careful"]
    told = capsys.readouterr().err.splitlines()
    assert told[0] == "50_trial: 0 of 4 cases, about ? left"
    assert told[-1] == "50_trial: 4 of 4 cases, about 00:00 left"
    monkeypatch.undo()
    assert execute(source, folders[1]) == ["said", "careful"]  # done before the first word
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(sys, "stderr", Screen())
    assert execute(source, folders[2]) == ["said", "careful"]
    assert "\r\x1b[K50_trial:   0%|" in sys.stderr.getvalue()
    assert "Executing:" in sys.stderr.getvalue()
    log, short, screen = map(contents, folders)
    assert log == short == screen
    assert json.loads(log["50_trial.ipynb"])["cells"][2]["outputs"][0]["text"] == ["one\n", "two\n"]
