"""SIGKILL leaves nothing: no process that goes on or holds the output, and no half of a result."""

import os
import subprocess
import sys
import time

import nbformat
import psutil
import pytest

# The time steps take for ever, in machine code, as a long Runge-Kutta run does. They let other
# threads run, as all loops of the package do, also where Python makes one call to see its result.
WORK = """
from pathlib import Path
from numba import njit
from armsim.methods import integrate, tableaux
from armsim.parallel import each

@njit(nogil=True)
def slow(t, y):
    total = y[0]
    for _ in range(10**13):
        total += 1e-3
    return y * total

def work(n):
    Path({signs!r}, str(n)).touch()
    return integrate(slow, (0, 1), [1.0], tableaux.RK4_GILL, 0.5).y

print("begun", flush=True)
"""
PARALLEL, ALONE = "each(work, range(2))", "work(0)"


@pytest.fixture
def started(tmp_path):
    """Start a script or the execution of a notebook; return it and its processes when they work."""
    begun = []

    def start(kind, code, signs):
        folder, results = tmp_path / "signs", tmp_path / "results"
        folder.mkdir()
        source = WORK.format(signs=str(folder)) + code
        if kind == "script":
            path = tmp_path / "study.py"
            path.write_text(source)
            command = [path]
        else:
            path = tmp_path / "50_trial.ipynb"
            cell = nbformat.v4.new_code_cell(source)
            nbformat.write(nbformat.v4.new_notebook(cells=[cell]), path)
            command = ["-m", "reportkit.execute", path, results]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
        environment = os.environ | {"TMPDIR": str(tmp_path / "temporary")}
        (tmp_path / "temporary").mkdir()
        process = subprocess.Popen([sys.executable, *command], **pipes, text=True, env=environment)
        begun.append(psutil.Process(process.pid))
        while len([*folder.iterdir()]) < signs:
            assert process.poll() is None, process.communicate()[0]
            time.sleep(0.05)
        begun.extend(begun[0].children(recursive=True))
        return process, begun

    yield start
    for process in begun:  # if the test failed
        if process.is_running():
            process.kill()


def is_worker(process):
    return any("LokyProcess" in word for word in process.cmdline())


def is_kernel(process):
    return "ipykernel_launcher" in process.cmdline()


@pytest.mark.parametrize(
    ("kind", "code", "victim", "told"),
    [
        ("script", PARALLEL, None, "begun\n"),
        ("notebook", PARALLEL, None, ""),
        ("notebook", ALONE, None, ""),
        ("notebook", PARALLEL, is_kernel, "its Python died"),
        ("notebook", PARALLEL, is_worker, "worker process managed by the executor"),
    ],
)
def test_nothing_is_left(started, tmp_path, kind, code, victim, told):
    process, running = started(kind, code, 1 if code == ALONE else min(2, os.cpu_count()))
    killed = next(filter(victim, running))
    killed.kill()
    output, _ = process.communicate(timeout=60)  # ends when the last process has closed it
    assert told in output
    assert output.count("begun") <= 1
    _, alive = psutil.wait_procs(running[1:], timeout=60)
    assert alive == []
    for _ in range(600):  # a shell removes it
        if not (left := [*tmp_path.glob("results/*"), *tmp_path.glob("temporary/*")]):
            break
        time.sleep(0.1)
    assert left == []
