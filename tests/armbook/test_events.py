"""Events in words; references against the exact solver."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from armbook.events import agreement, story
from armsim.arm import AxisParameters, simulate
from armsim.arm.dynamics import STUCK, Region

REFERENCES = Path(__file__).parents[1] / "reference"


def changed(**fields):
    """Region before and after, from the one in which all is free."""
    free = Region(0, 0, 0, 0)
    before = {name: value[0] for name, value in fields.items()}
    after = {name: value[1] for name, value in fields.items()}
    return free._replace(**before), free._replace(**after)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"preamplifier": (0, -1)}, "preamplifier reaches its limit"),
        ({"preamplifier": (1, 0)}, "preamplifier comes off its limit"),
        ({"power": (-1, 1)}, "motor voltage reaches its limit"),
        ({"power": (-1, 0)}, "motor voltage comes off its limit"),
        ({"contact": (0, 1)}, "teeth meet on the driving flank"),
        ({"contact": (1, -1)}, "teeth meet on the braking flank"),
        ({"contact": (-1, 0)}, "teeth part from the braking flank"),
        ({"friction": (0, 1)}, "static friction sets in"),
        ({"friction": (1, 0)}, "static friction ends"),
        ({"friction": (-1, STUCK)}, "the arm comes to rest and sticks"),
        ({"friction": (STUCK, -1)}, "the arm breaks loose"),
        ({"power": (0, 1), "friction": (STUCK, 1)},
         "motor voltage reaches its limit, the arm breaks loose"),
        ({}, ""),
    ],
)  # fmt: skip
def test_story(fields, words):
    assert story(*changed(**fields)) == words


def test_every_event_of_a_run_has_a_story():
    run = simulate(AxisParameters.paper_x_axis(), [(0.0, 8.0), (0.3, -8.0), (0.6, 0.0)], 1.0)
    told = [story(event.before, event.after) for event in run.events]
    assert all(told)
    met = [words for words in told if "teeth" in words]
    assert all(("meet" in one) != ("meet" in two) for one, two in pairwise(met))


@pytest.fixture
def wanted():
    return json.loads((REFERENCES / "published_step.json").read_text())


@pytest.fixture
def file(tmp_path):
    return tmp_path / "changed.json"


def test_a_planted_error_is_found(wanted, file):
    file.write_text(json.dumps(wanted))
    found = agreement(file)
    assert found.events == len(wanted["events"])
    assert found.error < 1e-12
    assert found.delay < 1e-14
    sample, event = wanted["samples"][3], wanted["events"][2]
    sample["y"][6] = str(float(sample["y"][6]) + 1e-6 * float(wanted["y_largest"][6]))
    event["time"] = str(float(event["time"]) + 3e-9)
    file.write_text(json.dumps(wanted))
    found = agreement(file)
    assert found.error == pytest.approx(1e-6, rel=1e-5)
    assert found.delay == pytest.approx(3e-9, rel=1e-5)


def test_other_events_are_an_error(wanted, file):
    del wanted["events"][-1]
    file.write_text(json.dumps(wanted))
    with pytest.raises(ValueError, match=r"changed.json: .* other events"):
        agreement(file)


def test_a_run_without_events_has_no_delay(wanted, file):
    zeros = [["0"] * 7]
    wanted |= {"set_velocity": [[0.0, 0.0]], "y_initial": [0.0] * 7, "events": []}
    wanted["samples"] = [{"t": 0.1, "y": y} for y in zeros]
    file.write_text(json.dumps(wanted))
    assert agreement(file)[::2] == (0, 0.0)
    assert np.isfinite(agreement(file).error)
