"""Our own choices stand in one file, and everything that needs them reads them there."""

import dataclasses
import importlib.util
import tomllib
from pathlib import Path

import pytest

from armsim.arm import AxisParameters, SlaveControl, Track
from armsim.arm.files import read_axis
from armsim.arm.parameters import OUR_CHOICE
from armsim.choices import CHOICES
from armsim.paths import DATA
from reportkit.parameters import find
from reportkit.project import Project

ROOT = Path(__file__).parents[1]


def test_what_the_fields_call_our_choice_is_in_the_file():
    ours = {
        item.name
        for item in dataclasses.fields(AxisParameters)
        if item.metadata["source"] == OUR_CHOICE
    }
    for axis in CHOICES["axis"].values():
        assert set(axis) == ours


@pytest.mark.parametrize("name", CHOICES["axis"])
def test_axes_have_the_choices(name):
    axis, _ = read_axis(DATA / "axes" / f"{name}.toml")
    for key, value in CHOICES["axis"][name].items():
        assert getattr(axis, key) == value
    table = tomllib.loads((DATA / "axes" / f"{name}.toml").read_text(encoding="utf-8"))["axis"]
    assert not set(table) & set(CHOICES["axis"][name])


def test_the_paper_s_axis_is_that_of_the_file():
    assert AxisParameters.paper_x_axis() == read_axis(DATA / "axes" / "x.toml")[0]


def test_control_and_move_have_the_choices():
    control = SlaveControl()
    for name, value in CHOICES["control"].items():
        assert getattr(control, name) == value
    move = CHOICES["move"]
    assert control.track == Track.trapezoid(
        move["distance"], move["velocity"], move["acceleration"]
    )


def test_notebook_of_the_move_starts_from_the_choices():
    project = Project.find(ROOT)
    notebook = find("50", project.notebooks, project.read_choices())
    for table in ("control", "move"):
        for name, value in CHOICES[table].items():
            assert notebook.parameters[name].default == value


def test_sensitivity_changes_the_file_and_nothing_else():
    path = ROOT / "data" / "sensitivity" / "make_sensitivity.py"
    spec = importlib.util.spec_from_file_location("make_sensitivity", path)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    assert tomllib.loads(script.toml(CHOICES)) == CHOICES
    for name in script.USED_BY:
        changed = tomllib.loads(script.toml(script.change(CHOICES, name, 2.0)))
        assert changed != CHOICES
        assert script.change(changed, name, 0.5) == CHOICES


def test_the_record_of_the_move_was_made_with_our_choices():
    """Else the notebook on the move has no record to compare with."""
    truth = tomllib.loads((DATA / "measurements" / "truth.toml").read_text(encoding="utf-8"))
    assert truth["control"] == CHOICES["move"] | CHOICES["control"]
