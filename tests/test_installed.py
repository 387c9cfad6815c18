"""Tests of an installation without the packages of the book, in a virtual environment of its own.

No network is needed: the wheel is built here, and what it requires is linked from this environment.
"""

import shutil
import subprocess
import sys
import venv
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
PIP = (sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check")
CALCULATE = """
import tomllib
import numpy as np
from armsim.arm import AxisParameters, simulate
from armsim.arm.identify import fit
from armsim.arm.files import read_axis, read_measurement
from armsim.exact import System
from armsim.methods import integrate, tableaux, trees
from armsim.paper import PRINTED
from armsim.paths import DATA

assert "site-packages" in DATA.parts
assert trees.order(tableaux.RK6) == 6
assert PRINTED["rk6"].stages == tableaux.RK6.stages
run = integrate(lambda t, y: -y, (0.0, 1.0), np.ones(1), tableaux.DP5, 0.1)
assert abs(run.y[0, -1] - np.exp(-1)) < 1e-6
run = simulate(AxisParameters.paper_x_axis(), set_velocity=10.0, t_end=0.1)
assert run(0.1).shape == (7,)
axis, instrument = read_axis(DATA / "axes" / "x.toml")
truth = tomllib.loads((DATA / "measurements" / "truth.toml").read_text(encoding="utf-8"))["axis"]
record = read_measurement(DATA / "measurements" / "x_axis_test.csv")
found = fit(record, axis.replace(K_1=axis.K_1, **truth), instrument, names=["b_g"], starts=1)
assert abs(found.values[0] - truth["b_g"]) < 3 * found.standard_errors[0]
"""


def required():
    """Names of the distributions that armsim without extras brings."""
    found, fresh = set(), {"armsim"}
    while fresh:
        found |= fresh
        wanted = [Requirement(line) for name in fresh for line in metadata.requires(name) or ()]
        names = {w.name.lower() for w in wanted if not w.marker or w.marker.evaluate({"extra": ""})}
        fresh = names - found
    return found - {"armsim"}


def test_it_brings_few_packages():
    names = required()
    assert {"numpy", "scipy", "sympy", "numba", "joblib"} <= names
    assert len(names) < 20
    assert not [name for name in names if "jupyter" in name or "sphinx" in name]


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Folder of the commands of an environment that holds armsim and what it requires."""
    folder = tmp_path_factory.mktemp("installed")
    build = ("wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", folder, ROOT)
    subprocess.run([*PIP, *build], check=True)
    venv.create(folder / "venv", symlinks=True)
    (packages,) = folder.glob("venv/lib/python*/site-packages")
    for name in required():
        files = metadata.distribution(name).files or []
        for top in {file.parts[0] for file in files} - {"..", "__pycache__"}:
            (packages / top).symlink_to(metadata.distribution(name).locate_file(top))
    (wheel,) = folder.glob("*.whl")
    install = ("--python", folder / "venv", "install", "--no-deps", "--no-index", wheel)
    subprocess.run([*PIP, *install], check=True)
    # machine code that is there already need not be compiled again: it is kept by its content
    for kept in (ROOT / "src" / "armsim" / "__pycache__").glob("*.nb*"):
        shutil.copy(kept, packages / "armsim" / "__pycache__")
    return folder / "venv" / "bin"


def test_it_calculates_with_the_data_of_the_wheel(installed):
    command = [installed / "python", "-c", CALCULATE]
    done = subprocess.run(command, capture_output=True, text=True, cwd="/")
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("command", ["list", "check", "rerun 10"])
def test_the_command_says_what_to_install(installed, command):
    command = [installed / "armsim", *command.split()]
    done = subprocess.run(command, capture_output=True, text=True, cwd="/")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        "armsim: this command needs the packages of the book (click is missing): "
        "pip install 'armsim[book]'\n"
    )
